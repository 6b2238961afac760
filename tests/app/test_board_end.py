"""The end of the real program while a board sends and is recorded: the file is finished before anything else."""

from __future__ import annotations

import os
import re
import signal
from contextlib import ExitStack
from itertools import count
from pathlib import Path

import pytest
from tests.app.wire import PATIENCE, Guest
from tests.support.line_sender import line_sender
from tests.support.program import end, is_free, labels, port_of, running, token_of
from tests.support.waiting import wait_until

SIGNALS = [signal.SIGINT, signal.SIGTERM, signal.SIGHUP]
PATIENT = f"from kalscope_app import open_command\nopen_command.MAX_RECORDING_S = {PATIENCE}\n"
"""A busy machine may take long to finish a recording."""


def numbered():
    """`number,half of it`, without end."""
    return (f"{number},{number / 2:.1f}\n" for number in count())


def start_recording(guest, folder):
    """Press Record, and wait for rows in the file."""
    guest.read_until(lambda: "Record" in labels(guest))
    guest.set(guest.find("Record"), True)
    guest.read_until(lambda: "Recording to" in "".join(guest.notices))
    file = folder / "recording.csv"
    guest.read_until(lambda: file.read_text().count("\n") >= 20)  # the board's values come as frames
    return file


def assert_finished(file):
    """Whole, consecutive rows and the account of them as the last line."""
    *lines, last = file.read_text().splitlines()
    rows = [line for line in lines if re.match(r"-?[0-9.]+,", line)]
    numbers = [int(float(row.split(",")[1])) for row in rows]
    assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))
    assert last.startswith("# end: ")
    assert f"{len(rows)} written" in last


@pytest.mark.parametrize("by", SIGNALS)
def test_a_recording_is_finished_and_nothing_is_left_behind(tmp_path, by):
    with line_sender(lines=numbered) as board, running(tmp_path, source=board, change=PATIENT) as (program, url):
        port = port_of(url)
        with Guest(port, token_of(url)) as guest:
            file = start_recording(guest, tmp_path)
            children = Path(f"/proc/{program.pid}/task/{program.pid}/children").read_text()
            code, out, err = end(program, by)
        assert (code, out, err, children) == (0, "", "", "")
        assert_finished(file)
        assert is_free(port)
        assert os.listdir(tmp_path / "tmp") == []


FOR_EVER = 10 * PATIENCE
"""Seconds; `end` fails where the program has not ended within PATIENCE."""

SLOW_FRAMES = f"""
import time
from kalscope_app.engine.engine import Engine
Engine.stop = lambda self: time.sleep({FOR_EVER})
"""

SWALLOWING = f"""
import pathlib, time
from kalscope.sources.port.serial_port import SocketPort
openings, connect = [], SocketPort.__init__
def slow(*arguments):
    openings.append(1)
    if len(openings) > 1:
        pathlib.Path("connecting").touch()
        time.sleep({FOR_EVER})
    return connect(*arguments)
SocketPort.__init__ = slow
"""
"""A network that swallows what is sent: to connect again takes longer than the program has to end."""


@pytest.mark.parametrize("change", [SLOW_FRAMES, SWALLOWING], ids=["slow frames", "a board that does not answer"])
def test_a_recording_is_finished_although_something_takes_for_ever(tmp_path, change):
    with ExitStack() as plugged, ExitStack() as used:
        board = plugged.enter_context(line_sender(lines=numbered))
        program, url = used.enter_context(running(tmp_path, source=board, change=PATIENT + change))
        guest = used.enter_context(Guest(port_of(url), token_of(url)))
        file = start_recording(guest, tmp_path)
        if change is SWALLOWING:
            plugged.close()
            guest.read_until(lambda: "disconnected" in "".join(guest.markdown.values()))
            wait_until((tmp_path / "connecting").exists, "an attempt to connect again")
        assert end(program)[0] == 0
        assert_finished(file)
