"""Odd folders, limits and accounts: the program works, or says in one line what must hold; never a traceback."""

from __future__ import annotations

import socket
import sys
from contextlib import ExitStack

import pytest
from tests.app.attack_table import exchange, status
from tests.app.wire import Guest
from tests.support.line_sender import line_sender
from tests.support.program import command, end, free_port, port_of, running, token_of
from tests.support.waiting import PATIENCE

from kalscope.cli.console import user_message

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="limits and /proc as Linux has them")

POOR = """
import os, resource, time
resource.setrlimit(resource.RLIMIT_NOFILE, (64, 64))
resource.setrlimit(resource.RLIMIT_AS, (2 << 30, 2 << 30))
os.environ.update(LC_ALL="C", TZ="Nowhere/At:all;3", TMPDIR="/proc/none", HOME="/proc/none")
time.tzset()
"""
"""64 files, 2 GB of addresses, no home, and neither a locale nor a time zone nor a temporary folder of its own."""
FOLDER_GONE = "import os; os.rmdir(os.getcwd())\n"


def shows_its_page(url):
    with Guest(port_of(url), token_of(url)) as guest:
        guest.read_until(lambda: "Download tuning file" in str(guest.widgets))


def test_a_poor_account_has_the_dashboard_and_settings_that_cannot_be_kept_cost_one_line(tmp_path):
    (tmp_path / "file").write_text("")
    env = {"KALSCOPE_CONFIG_DIR": str(tmp_path / "file" / "settings")}
    with running(tmp_path, "--port", str(free_port()), change=POOR, env=env) as (program, url):
        shows_its_page(url)
        status, _, err = end(program)
    (line,) = err.splitlines()
    assert status == 0
    assert line.count(f"'{tmp_path}/file/settings' cannot be used: a file takes the place of its folder") == 1


def test_a_flood_of_half_open_connections_is_named_and_the_page_still_answers(tmp_path):
    few = "import resource; resource.setrlimit(resource.RLIMIT_NOFILE, (256, 256))"
    with running(tmp_path, change=few) as (program, url), ExitStack() as opened:
        for _ in range(400):
            opened.enter_context(socket.create_connection(("127.0.0.1", port_of(url)), timeout=PATIENCE))
        link = f"GET /?token={token_of(url)} HTTP/1.1\r\nHost: localhost:{port_of(url)}\r\n\r\n"
        assert status(exchange(port_of(url), link)) == "200"
        shows_its_page(url)
        code, _, err = end(program)
    (line,) = err.splitlines()
    assert (code, "too many open connections" in line) == (0, True)


def test_a_poor_account_has_the_commands_and_what_cannot_be_written_is_one_line(tmp_path):
    with line_sender() as url:
        for change, line, reason in (
            (POOR, "tune demo --lag-ms 50 -o tuning.toml", ""),
            (POOR, "filter demo --config tuning.toml", ""),
            (POOR, "export tuning.toml --to c -o code", ""),
            (POOR, f"record {url} -o run.csv --lines 20", ""),
            (FOLDER_GONE, "tune demo --lag-ms 50 -o out.toml", "must exist"),
            (FOLDER_GONE, "open demo --no-browser --port 0", "must exist (it was removed or renamed)"),
            (FOLDER_GONE, f"record {url} -o out.csv", "does not exist"),
            ("", "filter demo --q 1 --r 1 -o /dev/full", "/dev/full' cannot be used: the disk"),
            ("", "tune demo --lag-ms 50 -o /proc/none/out", "'/proc/none/out' cannot be used: it or"),
            ("", f"record {url} -o /proc/none/out", "'/proc/none/out': it or its folder does not exist"),
        ):
            (folder := tmp_path / ("poor" if change == POOR else "work")).mkdir(exist_ok=True)
            with command(*line.split(), cwd=folder, change=change) as program:
                _, err = program.communicate(timeout=PATIENCE)
            assert (program.returncode, err.count("\n")) == ((2, 1) if reason else (0, 0)), err
            assert reason in err


def test_memory_that_is_refused_is_no_mistake_of_the_program():
    segment, thread = ImportError("x.so: failed to map segment"), RuntimeError("can't start new thread")
    for error in MemoryError(), segment, thread:
        assert "ulimit -v" in user_message(error)
    assert user_message(RuntimeError("other")) is None
