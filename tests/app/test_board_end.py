"""The end of the real program while a board sends and is recorded: the file is finished before anything else."""

from __future__ import annotations

import os
import re
import signal
import threading
import time
from contextlib import suppress
from pathlib import Path

import pytest
from program import end, is_free, labels, port_of, running, token_of
from terminal import link_to
from waiting import wait_until
from wire import PATIENCE, Guest

tty = pytest.importorskip("tty", reason="there are no pseudo-terminals here")

SIGNALS = [signal.SIGINT, signal.SIGTERM, signal.SIGHUP]


class Board:
    """A pseudo-terminal on which `number,half of it` comes a hundred times a second."""

    def __init__(self):
        self.master, self.slave = os.openpty()
        tty.setraw(self.slave)
        self.port, self.sent, self._end = link_to(os.ttyname(self.slave)), 0, threading.Event()
        self._thread = threading.Thread(target=self._run)

    def __enter__(self):
        os.set_blocking(self.master, False)
        self._thread.start()
        return self

    def __exit__(self, *_):
        self.unplug()

    def unplug(self):
        """Pull the cable."""
        if not self._end.is_set():
            self._end.set()
            self._thread.join()
            self.port.unlink()
            os.close(self.slave)
            os.close(self.master)

    def _run(self):
        while not self._end.wait(0.01):
            with suppress(BlockingIOError):
                os.write(self.master, b"%d,%.1f\n" % (self.sent, self.sent / 2))
            self.sent += 1


def start_recording(guest, folder):
    """Press Record, and wait for rows in the file."""
    guest.read_until(lambda: "Record" in labels(guest))
    guest.set(guest.find("Record"), True)
    guest.read_until(lambda: "Recording to" in "".join(guest.notices))
    file = folder / "recording.csv"
    deadline = time.monotonic() + PATIENCE
    while file.read_text().count("\n") < 20:
        assert time.monotonic() < deadline, file.read_text()
        guest.read(timeout=0.05)
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
    with Board() as board, running(tmp_path, source=f"serial:{board.port}@115200") as (program, url):
        port = port_of(url)
        with Guest(port, token_of(url)) as guest:
            file = start_recording(guest, tmp_path)
            children = Path(f"/proc/{program.pid}/task/{program.pid}/children").read_text()
            code, out, err = end(program, by)
        assert (code, out, err, children) == (0, "", "", "")
        assert_finished(file)
        assert is_free(port)
        assert os.listdir(tmp_path / "tmp") == []
        with open(board.port, "rb", buffering=0) as again:  # it is no longer held exclusively
            assert again.read(1)


FOR_EVER = 10 * PATIENCE
"""Seconds; `end` fails where the program has not ended within PATIENCE."""

SLOW_FRAMES = f"""
import time
from kalscope_app.engine.engine import Engine
Engine.stop = lambda self: time.sleep({FOR_EVER})
"""


def test_a_recording_is_finished_although_a_frame_takes_for_ever(tmp_path):
    with (
        Board() as board,
        running(tmp_path, source=f"serial:{board.port}@115200", change=SLOW_FRAMES) as (program, url),
        Guest(port_of(url), token_of(url)) as guest,
    ):
        file = start_recording(guest, tmp_path)
        assert end(program)[0] == 0
        assert_finished(file)


SWALLOWING = f"""
import pathlib, time
from kalscope.sources.port.serial_port import SerialPort
openings, connect = [], SerialPort.__init__
def slow(*arguments):
    openings.append(1)
    if len(openings) > 1:
        pathlib.Path("connecting").touch()
        time.sleep({FOR_EVER})
    return connect(*arguments)
SerialPort.__init__ = slow
"""


def test_a_recording_is_finished_although_its_board_does_not_answer(tmp_path):
    """A network that swallows what is sent: to connect again takes longer than the program has to end."""
    with (
        Board() as board,
        running(tmp_path, source=f"serial:{board.port}@115200", change=SWALLOWING) as (program, url),
        Guest(port_of(url), token_of(url)) as guest,
    ):
        file = start_recording(guest, tmp_path)
        board.unplug()
        guest.read_until(lambda: "disconnected" in "".join(guest.markdown.values()))
        wait_until((tmp_path / "connecting").exists, "an attempt to connect again")
        assert end(program)[0] == 0
        assert_finished(file)
