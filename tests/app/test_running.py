"""The real program from outside: its link, its log, its errors, and its end."""

from __future__ import annotations

import os
import signal
import socket
import stat
from pathlib import Path

import pytest
from tests.app.attack_table import UPGRADE, exchange, status
from tests.app.wire import Guest
from tests.support.program import end, free_port, is_free, labels, link_of, port_of, running, start, token_of
from tests.support.required import needs
from tests.support.waiting import PATIENCE, wait_until

from kalscope_app.session.session import Failed
from kalscope_app.views.window import MAP_POINTED

posix = pytest.mark.skipif(os.name != "posix", reason="signals and modes as POSIX has them")

# --- the link ---------------------------------------------------------------------------------------------


@posix
def test_a_restart_on_the_same_port_keeps_the_link_until_a_new_one_is_asked_for(tmp_path):
    port, links = str(free_port()), []
    for options in ((), (), ("--new-link",)):
        with running(tmp_path, "--port", port, *options) as (program, url):
            links.append(url)
            assert end(program)[0] == 0
    assert links[0] == links[1] != links[2]
    assert (tmp_path / "state" / "kalscope" / f"token-{port}").read_text() == token_of(links[2])


@posix
def test_the_browser_is_started_without_the_token_on_its_command_line(tmp_path):
    """Every user of the machine can read command lines."""
    seen = tmp_path / "seen"
    browser = tmp_path / "browser"
    browser.write_text(f'#!/bin/sh\nprintf "%s\\n" "$@" > {seen}.new\nmv {seen}.new {seen}\n')
    browser.chmod(0o700)
    with running(tmp_path, env={"BROWSER": f"{browser} %s"}) as (program, url):
        wait_until(seen.exists, "the browser's start")
        (argument,) = seen.read_text().splitlines()
        page = Path(argument.removeprefix("file://"))
        assert token_of(url) not in argument
        assert url in page.read_text()
        assert stat.S_IMODE(page.stat().st_mode) == 0o600
        assert end(program)[0] == 0
    assert not page.exists()


def test_behind_a_proxy_the_link_and_the_origin_are_the_proxys(tmp_path):
    port = free_port()
    options = ("--behind", "https://lab.example", "--port", str(port))
    with running(tmp_path, *options) as (program, url):
        assert url.startswith("https://lab.example/?token=")
        cookie = f"Cookie: kalscope_{port}={token_of(url)}\r\n"
        proxied = f"GET / HTTP/1.1\r\nHost: lab.example\r\n{cookie}"
        socket_of = f"{proxied}Upgrade: websocket\r\n{UPGRADE}Origin: {{}}\r\n\r\n"
        assert status(exchange(port, f"{proxied}\r\n")) == "200"
        assert status(exchange(port, socket_of.format("https://lab.example"))) == "open"
        assert status(exchange(port, socket_of.format("http://lab.example"))) == "403"
        assert end(program)[0] == 0


def test_a_guard_that_lets_something_through_prints_no_link(tmp_path):
    """As after an upgrade of viser that goes round the guard."""
    change = "from kalscope_app.guard import requests as rules\nrules.host_allowed = lambda *_: True"
    with start(tmp_path, "--port", "0", "--no-browser", change=change) as program:
        out, err = program.communicate(timeout=PATIENCE)
    assert (program.returncode, out) == (2, "")
    (line,) = err.splitlines()
    assert line.startswith("kalscope: the guard's self-test failed: a page under a foreign name (H2)")


# --- the log, and errors ----------------------------------------------------------------------------------


def test_the_log_tells_who_was_refused_and_never_the_token(tmp_path):
    with running(tmp_path, "--log", "kalscope.log", "-v") as (program, url):
        port, token = port_of(url), token_of(url)
        assert status(exchange(port, f"GET /?token={token} HTTP/1.1\r\nHost: evil.example\r\n\r\n")) == "403"
        assert status(exchange(port, f"GET /{token} HTTP/1.1\r\nHost: localhost:{port}\r\n\r\n")) == "403"
        code, _, err = end(program)
    assert code == 0
    for said in ((tmp_path / "kalscope.log").read_text(), err):
        assert "Kalscope is not known under this address" in said
        assert token not in said


RAISING = """
import threading
from kalscope_app.views import export, map, source

def raising(what=None):
    def act(*_):
        raise LookupError(f"no such {what or threading.current_thread().name}")
    return act

export.CodeView._preview = raising("files")  # on the loop
source.SourceView._upload = raising("upload")  # in the pool
export.filtered_csv_chunks = raising()  # in a job
export.CodeView._send = lambda *_: threading.Thread(target=raising(), name="reader").start()
map.TuningMapView._on_pointed = raising("point")
"""
BUTTONS = {"Preview code": "no such files", "Download filtered CSV": "no such kalscope-jobs"}
BUTTONS["Download code"] = "no such reader"


def test_an_uncaught_error_is_shown_and_logged_and_the_dashboard_goes_on(tmp_path):
    """On the event loop, in viser's pool, in a job, in a thread of its own, and on the map."""
    with running(tmp_path, "--log", "kalscope.log", change=RAISING) as (program, url):
        with Guest(port_of(url), token_of(url)) as guest:
            guest.read_until(lambda: {*BUTTONS, "Upload a file …"} <= labels(guest))
            for button, said in BUTTONS.items():
                guest.set(guest.find(button), True)
                guest.read_until(lambda said=said: said in "".join(guest.notices))
            guest.upload("x.csv", b"1")
            guest.read_until(lambda: "no such upload" in "".join(guest.notices))
            guest.set(guest.find(MAP_POINTED), (0.5, 0.5, -1.0))
            guest.read_until(lambda: "no such point" in "".join(guest.notices))
            told = "".join(guest.notices)
            assert told.count("Something went wrong") >= len(BUTTONS) + 2
            assert all(failed not in told for failed in Failed)
            assert "Details are in kalscope.log" in told
            guest.set(guest.find("process noise q"), "7.25")  # the dashboard goes on
            guest.read_until(lambda: guest.values[guest.find("log₁₀ q")] == pytest.approx(0.86, abs=0.01))
        code, _, err = end(program)
    log = (tmp_path / "kalscope.log").read_text()
    assert (code, "Traceback" in log, "Traceback" in err) == (0, True, False)
    assert [said for said in (*BUTTONS.values(), "no such upload", "no such point") if said not in log] == []


# --- the end ----------------------------------------------------------------------------------------------


@posix
def test_with_a_client_and_a_job_the_end_leaves_nothing_behind(tmp_path):
    """By Ctrl+C; all three signals are in test_stopping.py."""
    with running(tmp_path) as (program, url):
        port = port_of(url)
        with Guest(port, token_of(url)) as guest:
            guest.read_until(lambda: "Open this path" in labels(guest))
            guest.set(guest.find("path"), "synthetic:sine?n=8000000")
            guest.set(guest.find("Open this path"), True)
            children = wait_until(lambda: children_of(program.pid), "the process that reads")
            code, out, err = end(program, signal.SIGINT)
    assert (code, out, err) == (0, "", "")
    wait_until(lambda: not any(Path(f"/proc/{child}").exists() for child in children), "their end")
    assert is_free(port)
    assert os.listdir(tmp_path / "tmp") == []


def children_of(pid):
    """Processes that a program has started."""
    listed = (task / "children" for task in Path(f"/proc/{pid}/task").iterdir())
    return [int(child) for one in listed for child in one.read_text().split()]


HANGING = """
import threading, time
from kalscope_app.dashboard import Dashboard
Dashboard.stop = lambda self: time.sleep(600)
threading.Thread(target=time.sleep, args=(600,)).start()
"""


@posix
def test_a_part_that_hangs_does_not_keep_the_program(tmp_path):
    """A device, or a file on a network that has gone: nothing can interrupt those."""
    with running(tmp_path, change=HANGING) as (program, url):
        code, out, err = end(program)
    assert (code, out, err) == (0, "", "")
    assert is_free(port_of(url))
    assert os.listdir(tmp_path / "tmp") == []


@posix
def test_a_terminal_that_has_gone_is_no_error(tmp_path):
    """SIGHUP comes together with broken pipes in place of the terminal."""
    with running(tmp_path, "-v") as (program, _):
        program.stdout.close()
        program.stderr.close()
        program.send_signal(signal.SIGHUP)
        assert program.wait(timeout=PATIENCE) == 0


def test_nothing_is_said_at_the_end_after_a_library_counts_what_it_leaves(tmp_path):
    """DuckDB prints a list of its own objects that are left when Python ends; a forked program does not end so."""
    needs("duckdb")
    import duckdb

    file = tmp_path / "log.parquet"
    duckdb.execute(f"COPY (SELECT i * 0.1 AS t, sin(i) AS x FROM range(25) r(i)) TO '{file}' (FORMAT parquet)")
    with start(tmp_path, "tune", "log.parquet", source=None, fresh=True) as program:
        out, err = program.communicate(timeout=PATIENCE)
    assert (program.returncode, err) == (0, "")
    assert out.startswith("log.parquet: 25 rows, 1 channel")


def test_without_a_command_the_demo_opens(tmp_path):
    with socket.socket() as probe:
        if probe.connect_ex(("127.0.0.1", 8080)) == 0:
            pytest.skip("another program listens on port 8080")
    with start(tmp_path, source=None, env={"BROWSER": "true"}) as program:
        assert link_of(program).startswith("http://127.0.0.1:8080/?token=")
        assert end(program)[0] == 0
