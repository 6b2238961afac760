"""`kalscope demo-board`: a recording at its true rate over a port, for ever."""

import signal
import socket
import subprocess
import sys

import numpy as np
import pytest
from terminal import link_to
from waiting import PATIENCE, wait_until

from kalscope import Recording, synthesize
from kalscope.cli import app as cli
from kalscope.cli.board import BOOT_S, Board, BoardLines, PtyWire, SocketWire
from kalscope.sources.live.source import LiveSource
from kalscope.sources.reading.line_parser import LineParser


def recording(time, values, names=("a", "b"), units=("", "mV"), period=0.1):
    return Recording(np.array(time), names, units, np.array(values, dtype=float), period)


TWO = recording([0.0, 0.1, 0.4], [[1, 2], [3.25, np.nan], [-1e-7, 6]])


def test_lines_are_written_as_a_board_writes_them():
    assert BoardLines(TWO).lines == [b"a:1,b[mV]:2\r\n", b"a:3.25,b[mV]:nan\r\n", b"a:-1e-07,b[mV]:6\r\n"]


def test_what_it_sends_is_read_back_exactly():
    sent, parser = synthesize("sine", n=50, channels=2, quantum=0.001), LineParser()
    parser.feed(b"# remark\n" + b"".join(BoardLines(sent).lines))
    rows = [event.rows[0] for event in parser if event.kind == "row"]
    names = [parser.layout.columns[i].name for i in parser.layout.channels]
    assert names == list(sent.names)
    np.testing.assert_allclose(rows, sent.values, atol=1e-12)


@pytest.mark.parametrize("name", ["a,b", "a:b", "x\ny", "", "#1", "*"])
def test_no_name_can_break_a_line(name):
    line = BoardLines(recording([0.0, 0.1], [[1], [2]], (name,), ("",))).lines[0].decode()
    assert line.count(":") == 1
    assert line.count("\n") == 1
    assert not set(line[: line.index(":")]) & set(",#*")


def test_each_sample_is_due_at_its_own_time_and_the_recording_repeats_without_drift():
    lines = BoardLines(TWO)
    np.testing.assert_allclose([*lines.due, lines.period], [0.0, 0.1, 0.4, 0.5])
    sent, now, at = 0, 0.0, []
    while sent < 3000:
        found, due = lines.between(sent, now)
        at += [now] * len(found)
        sent += len(found)
        now = due
    expected = [turn * 0.5 + offset for turn in range(1000) for offset in (0.0, 0.1, 0.4)]
    np.testing.assert_allclose(at[:3000], expected, atol=1e-9)


def test_a_rate_outranks_the_time_of_the_recording():
    np.testing.assert_allclose(BoardLines(TWO, rate=50).due, [0.0, 0.02, 0.04])
    assert BoardLines(recording([0, 1, 2], TWO.values, period=None)).due[1] == 0.01


class Wire:
    """The other end of the line, in memory, with room for some bytes."""

    address = "x"

    def __init__(self):
        self.open, self.room, self.sent, self.coming = True, 10**9, b"", b""

    def connected(self):
        return self.open

    def send(self, data):
        count = min(len(data), self.room)
        self.sent += data[:count]
        return count

    def receive(self):
        data, self.coming = self.coming, b""
        return data

    def close(self):
        self.open = False


def test_a_board_restarts_whenever_the_port_is_opened():
    wire, now = Wire(), [5.0]
    board = Board(BoardLines(TWO), wire, lambda: now[0])
    start = b"# kalscope demo-board\r\na:1,b[mV]:2\r\n"
    for opened in (5.0, 9.0):
        wire.open, wire.sent, now[0] = True, b"", opened
        assert board.step() == pytest.approx(BOOT_S)
        assert wire.sent == b""  # a program that opens a port may still discard what is there
        now[0] += BOOT_S + 1e-9
        board.step()
        assert wire.sent == start
        wire.open = False
        board.step()


def test_a_board_whose_lines_are_not_read_drops_whole_lines():
    wire, now = Wire(), [0.0]
    board = Board(BoardLines(TWO, rate=1000), wire, lambda: now[0])
    wire.room = 0
    for _ in range(100):
        board.step()
        now[0] += 0.1
    wire.room, wire.coming = 10**9, b"q 0.01\n"
    board.step()
    assert wire.coming == b""  # it reads what is sent to it
    whole = wire.sent.splitlines(keepends=True)[1:]
    assert set(whole) == set(BoardLines(TWO).lines)
    assert 2**15 < sum(map(len, whole)) < 2**16


@pytest.mark.slow
@pytest.mark.parametrize("make", [PtyWire, lambda: SocketWire(0)], ids=["pty", "socket"])
def test_a_live_source_reads_the_board_over_either_wire(make, tmp_path):
    wire, now = make(), [0.0]
    board = Board(BoardLines(TWO, rate=2000), wire, lambda: now[0])

    def step():
        """Its clock waits for the reader: a board drops what is not read in time."""
        board.step()
        now[0] += 0.001 if board._sent <= live.status().received + 50 else 0.0
        return live.status().accepted >= 300

    try:
        with LiveSource(wire.address) as live:
            wait_until(step, "300 rows", pause=0.001)
            status, values = live.status(), live.snapshot().recording.values
    finally:
        wire.close()
    assert status.accepted >= 300
    assert (status.rejected, live.snapshot().recording.names) == (0, ("a", "b"))
    np.testing.assert_array_equal(values[:300], np.tile(TWO.values, (100, 1)))


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_the_program_prints_what_opens_it_and_stops_cleanly(number):
    command = [sys.executable, "-m", "kalscope.cli", "demo-board", "--rate", "500"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as program:
        first = program.stdout.readline()
        assert first.startswith("Demo board: kalscope open serial:/dev/")
        link = link_to(first.split()[-1].removeprefix("serial:"))
        live = LiveSource(str(link))
        live.start(require=True)
        wait_until(lambda: live.status().accepted >= 20, "20 rows")
        link.unlink()
        program.send_signal(number)
        assert program.wait(timeout=PATIENCE) == 0
        assert program.stderr.read() == ""
        live.close()
    assert live.snapshot().recording.names == ("flex",)


def test_what_a_board_cannot_do_is_one_line(capsys):
    with socket.create_server(("127.0.0.1", 0)) as other:
        taken = str(other.getsockname()[1])
        for option, value, words in (
            ("--rate", "fast", "--rate must be a number"),
            ("--rate", "0", "--rate must be above 0"),
            ("--rate", "1e9", "at most 100000 lines per second"),
            ("--socket", taken, "must be a free port"),
            ("--socket", "70000", "--socket must be a port from 0 to 65535"),
        ):
            assert cli.run(["demo-board", option, value]) == 2
            (line,) = capsys.readouterr().err.splitlines()
            assert words in line
