"""`kalscope record` as a process of its own: of a pseudo-terminal and of the network; its files, end and kills."""

from __future__ import annotations

import os
import random
import re
import signal
import tempfile
import threading
import time
import tty
from contextlib import contextmanager, suppress
from itertools import chain, repeat
from pathlib import Path
from statistics import median

import pytest
from tests.support.effort import FUZZ
from tests.support.line_sender import MAX_LINES, line_sender
from tests.support.program import command, end
from tests.support.waiting import PATIENCE, wait_until

from kalscope.sources.reading.recording_file import read_recording

pytest.importorskip("termios", reason="there are no pseudo-terminals here")


class Board:
    """A pseudo-terminal that sends numbered lines `number,half of it` at an even rate, from a thread."""

    def __init__(self, rate, *, other=b""):
        self.master, slave = os.openpty()
        tty.setraw(slave)
        self.port, self._slave = Path(tempfile.mkdtemp(prefix="tty")) / "tty", slave
        self.port.symlink_to(os.ttyname(slave))  # the system gives the name itself to the next terminal at once
        self.sent = 0
        self._rate, self._other, self._end = rate, other, threading.Event()
        self._thread = threading.Thread(target=self._run)

    def __enter__(self):
        os.set_blocking(self.master, False)
        self._thread.start()
        return self

    def __exit__(self, *_):
        self.unplug()

    def unplug(self):
        if not self._end.is_set():
            self._end.set()
            self._thread.join()
            self.port.unlink()
            os.close(self._slave)
            os.close(self.master)

    def next_unread(self):
        """Number of the first whole line that the last reader of the port left there."""
        data = b""
        while data.count(b"\n") < 2:
            data += os.read(self._slave, 4096)
        return int(data.split(b"\n")[1].split(b",")[0])

    def _run(self):
        begin = time.monotonic()
        while not self._end.wait(0.01):
            due = int((time.monotonic() - begin) * self._rate)
            data = b"".join(b"%d,%.1f\n" % (i, i / 2) for i in range(self.sent, due))
            with suppress(BlockingIOError):  # nothing reads them: the lines of a real board would be lost as well
                os.write(self.master, self._other + data)
            self.sent = due


def record(board, path, *options, change=""):
    return command("record", str(board.port), "-o", path, *options, change=change)


@contextmanager
def recording(board, path, *options, rows=1):
    """The command, running and past so many rows."""
    with record(board, path, *options) as process:
        wait_until(lambda: len(rows_in(path)) >= rows or process.returncode is not None, "rows", pause=0.02)
        assert process.returncode is None, process.communicate()[1]
        yield process


def rows_in(path):
    """(number, half of it) of all whole rows of a recording, without their host time."""
    if not path.exists():
        return []
    whole = path.read_bytes().rpartition(b"\n")[0].decode().split("\n")
    rows = [line.split(",") for line in whole if line and not line.startswith("#")][1:]
    return [(int(number), float(half)) for _, number, half in rows]


def are_consecutive(rows):
    return rows == [(number, number / 2) for number in range(rows[0][0], rows[0][0] + len(rows))]


def account_of(out):
    """Lines received, written, rejected and dropped, as the command says at its end."""
    found = re.search(r"received (\d+) lines = (\d+) written \+ (\d+) rejected \+ (\d+) dropped", out)
    received, *parts = map(int, found.groups())
    assert received == sum(parts)
    return received, *parts


def test_ctrl_c_leaves_all_rows_and_the_account(tmp_path):
    path = tmp_path / "run.csv"
    with Board(1000) as board, recording(board, path, rows=300) as process:
        status, out, err = end(process, signal.SIGINT)
    rows = rows_in(path)
    assert status == 0, err
    assert are_consecutive(rows)
    assert path.read_text().splitlines()[-1].startswith("# end: received ")
    assert account_of(out)[1:3] == (len(rows), 0)
    assert len(read_recording(path)) == len(rows)
    assert os.listdir(tmp_path) == ["run.csv"]  # the torn first line is counted, and opens no file of rejects


SMALL_QUEUE = "from kalscope.sources.live import source; source.MAX_WAITING_BYTES = 2**18"
BLOCK = b"".join(b"%d,%.1f\n" % (i, i / 2) for i in range(10_000))


def test_a_flood_is_recorded_as_far_as_possible_and_every_line_of_it_counted(tmp_path):
    path = tmp_path / "run.csv"
    with (
        line_sender(1000.0, lambda: chain(repeat(BLOCK, 30), repeat(b"-1,-0.5\n"))) as address,
        command("record", address, "-o", path, change=SMALL_QUEUE) as process,
    ):
        next(line for line in process.stderr if "the port sends faster than it can be read" in line)
        wait_until(lambda: b",-1,-0.5\n" in path.read_bytes()[-4096:], "a line after the flood")
        status, out, err = end(process, signal.SIGINT)
    assert status == 0, err
    received, written, rejected, _ = account_of(out)
    assert 300_000 <= received <= 300_000 + MAX_LINES
    assert (sum(number == 2 * half for number, half in rows_in(path)), rejected) == (written, 0)
    assert "# gap overrun " in path.read_text()


def test_it_stops_once_so_many_lines_are_written_and_shows_what_was_rejected(tmp_path):
    path = tmp_path / "run.csv"
    options = "--lines", "600", "--seconds", "1000"
    with Board(500, other=b"1,2,3\n") as board, record(board, path, *options) as process:
        out, err = process.communicate(PATIENCE)
    assert process.returncode == 0, err
    _, written, rejected, _ = account_of(out)
    assert written == len(rows_in(path)) >= 600
    rejected += sum(map(int, re.findall(r"; (\d+) others", out)))  # text, if they were there from the beginning
    assert rejected > 0
    assert "run.rejects" in out
    lines = (tmp_path / "run.rejects").read_text().splitlines()
    assert sum(not line.startswith("#") for line in lines) == rejected  # a header, and not the first: it is torn


def test_a_board_that_goes_away_ends_it_where_that_was_asked_for(tmp_path):
    path = tmp_path / "run.csv"
    with Board(500) as board, recording(board, path, "--no-reconnect") as process:
        board.unplug()
        out, err = process.communicate(timeout=PATIENCE)
    assert process.returncode == 2
    assert "was the board unplugged" in err.splitlines()[-1]
    assert account_of(out)[1] == len(rows_in(path))
    assert path.read_text().splitlines()[-1].startswith("# end: ")


def test_lines_that_the_disk_refused_end_in_status_1(tmp_path):
    """The limit on the size of a file stands for the disk that is full."""
    path = tmp_path / "run.csv"
    limit = "import resource, signal; signal.signal(signal.SIGXFSZ, signal.SIG_IGN)\n"
    limit += "resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096))\n"
    with Board(2000) as board, record(board, path, "--seconds", "1", change=limit) as process:
        out, err = process.communicate(PATIENCE)
    assert process.returncode == 1, err
    assert account_of(out)[3] > 0
    assert path.read_bytes().endswith(b"\n")


def test_killed_at_any_moment_it_loses_a_quarter_of_a_second_at_most_and_invents_nothing(tmp_path):
    rate, moments, lost = 1000, random.Random(5), []
    with Board(rate) as board:
        for kill in range(3 * FUZZ):
            path = tmp_path / f"{kill}.csv"
            with recording(board, path) as process:
                time.sleep(moments.uniform(0.0, 0.3))
                process.kill()
                process.wait(PATIENCE)
            received = board.next_unread()
            rows = rows_in(path)
            assert are_consecutive(rows)
            lost.append(received - 1 - rows[-1][0])
            assert len(read_recording(path)) == len(rows)
    assert median(lost) <= rate / 4  # a busy machine may hold the program up between a read and its write
