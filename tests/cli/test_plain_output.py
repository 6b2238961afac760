"""No control character of a name from outside reaches the terminal."""

from __future__ import annotations

import io
import sys
import threading
import warnings
from itertools import cycle

import numpy as np
import pytest
from tests.support.line_sender import line_sender

from kalscope.cli.app import run
from kalscope.cli.console import plain_diagnostics
from kalscope.common.text import CONTROL

HOSTILE = "a\x1b]52;c;ZXZpbA==\x07\x1b[2J\x9b31m\x7f\u202e\u2028b"
"""Sets the clipboard, clears the screen, changes the colour, turns the direction, ends a line."""

COMMANDS = (
    "tune {log}; tune {log} --all --details; tune {log} --json; tune {log} -o {tuning}; tune {log}{hostile};"
    "filter {log} --config {tuning} --report; filter {log} --config {tuning} --channel {hostile};"
    "export {tuning} --to c -o {log}.c; export {tuning} --to {hostile};"
    "report {log} --config {tuning} -o {log}.html; ports {hostile}"
)


@pytest.mark.slow
def test_names_of_files_channels_and_options_are_plain(tmp_path, capsys):
    log = tmp_path / f"{HOSTILE}.csv"
    values = np.cumsum(np.random.default_rng(1).normal(size=200)).tolist()
    rows = "\n".join(f"{i},{value}" for i, value in enumerate(values))
    log.write_text(f"time (s),{HOSTILE} ({HOSTILE})\n{rows}\n", encoding="utf-8")
    printed = {}
    for command in COMMANDS.split(";"):
        run([part.format(log=log, tuning=tmp_path / "tuning.toml", hostile=HOSTILE) for part in command.split()])
        printed[command] = "".join(capsys.readouterr())
    assert sum("]52;c;ZXZpbA==" in text for text in printed.values()) > 6
    assert [command for command, text in printed.items() if CONTROL.search(text)] == []


@pytest.mark.slow
def test_what_a_board_sends_is_plain(tmp_path, capsys):
    lines = [f"{HOSTILE}: starting\n".encode(), b"\x9b2J\xff\x00\n", f"# {HOSTILE}\n".encode(), b"1,2\n"]
    with line_sender(500.0, lambda: cycle(lines)) as address:
        assert run(["record", address, "-o", str(tmp_path / f"{HOSTILE}.csv"), "--lines", "3"]) == 0
        run(["record", address, "-o", str(tmp_path / f"{HOSTILE}.csv")])  # the file is there already
    printed = "".join(capsys.readouterr())
    assert "lines" in printed
    assert not CONTROL.search(printed)


def test_tracebacks_and_warnings_are_plain(capsys, monkeypatch):
    """What only a bug of the program or of a library shows: it may quote anything."""
    for owner, name in ((sys, "excepthook"), (threading, "excepthook"), (warnings, "formatwarning")):
        monkeypatch.setattr(owner, name, getattr(owner, name))  # put back in the end
    plain_diagnostics()
    sys.excepthook(ValueError, ValueError(HOSTILE), None)
    threading.excepthook(threading.ExceptHookArgs((ValueError, ValueError(HOSTILE), None, None)))
    printed = capsys.readouterr().err + warnings.formatwarning(UserWarning(HOSTILE), UserWarning, HOSTILE, 1)
    assert printed.count("]52;c;ZXZpbA==") == 4
    assert not CONTROL.search(printed)


@pytest.mark.parametrize("argv", [["tune", "--help"], ["tune", "−.csv"]])
def test_what_is_printed_into_a_pipe_is_utf8_whatever_the_system_writes(argv, monkeypatch):
    """Windows encodes a pipe as cp1252, which has no minus."""
    streams = {name: io.TextIOWrapper(io.BytesIO(), "cp1252") for name in ("stdout", "stderr")}
    for name, stream in streams.items():
        monkeypatch.setattr(sys, name, stream)
    assert run(argv) in (0, 2)
    assert "−" in "".join(stream.buffer.getvalue().decode("utf-8") for stream in streams.values())
