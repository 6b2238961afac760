"""`kalscope demo-board`: a recording at its true rate over a port, for ever."""

import signal
import socket
import threading

import numpy as np
import pytest
from tests.support.measuring_board import MeasuringBoard
from tests.support.program import command, end, next_line
from tests.support.waiting import wait_until

from kalscope import Recording
from kalscope.cli import app as cli
from kalscope.cli import demo_board
from kalscope.cli.demo_board import BoardLines
from kalscope.export.board import check_board, commands, values_in_use
from kalscope.export.float32 import Float32Params
from kalscope.sources.live.source import LiveSource


def recording(time, values, names=("a", "b"), units=("", "mV"), period=0.1):
    return Recording(np.array(time), names, units, np.array(values, dtype=float), period)


TWO = recording([0.0, 0.1, 0.4], [[1, 2], [3.25, np.nan], [-1e-7, 6]])


def test_no_name_can_break_a_line():
    for name in ("a,b", "a:b", "x\ny", "", "#1", "*"):
        line = BoardLines(recording([0.0, 0.1], [[1], [2]], (name,), ("",))).lines[0].decode()
        assert (line.count(":"), line.count("\n")) == (1, 1)
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


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_it_serves_one_program_after_the_other_from_the_start_and_stops_cleanly(number):
    with command("demo-board", "--rate", "500") as program:
        address = next_line(program).removeprefix("Demo board: kalscope open ").strip()
        seen = []
        for _ in range(2):
            with LiveSource(address) as live:
                wait_until(lambda live=live: live.status().accepted >= 20, "20 rows")
                snapshot = live.snapshot()
            assert (snapshot.recording.names, live.status().rejected) == (("flex",), 0)
            seen.append(snapshot.recording.values[:20])
        np.testing.assert_array_equal(*seen)
        assert end(program, number) == (0, "", "")


def test_a_program_that_reads_nothing_is_disconnected(monkeypatch):
    monkeypatch.setattr(demo_board, "_MAX_BLOCKED_S", 0.05)
    reader, client = socket.socketpair()
    with reader, client:
        demo_board.send_lines(client, BoardLines(TWO, rate=1e5), threading.Event())
        assert reader.recv(100).startswith(b"# kalscope demo-board\r\na:1,b[mV]:2\r\n")


def test_q_r_and_p0_take_effect_in_the_next_rows_as_in_the_exported_sketch():
    """Bit for bit: `check_board` filters the rows after the restart here."""
    wanted = Float32Params(np.float32(0.37), np.float32(8.1), np.float32(2.5))
    with MeasuringBoard() as board, LiveSource(board.port) as live:
        wait_until(lambda: live.status().accepted > 20, "rows")
        assert "not understood" in live.send("q -1")[0]
        for line in commands(wanted):
            (answer,) = values_in_use(live, line)
        assert (answer.q, answer.r, answer.p0) == (wanted.q, wanted.r, wanted.p0)
        row = live.snapshot().first + len(live.snapshot().recording)
        wait_until(lambda: live.status().accepted > row + 900, "rows after the restart")
        raw, filtered = live.snapshot().recording.values[max(row - 200, 0) :].T
    check = check_board(raw, filtered, wanted)
    assert check.rows > 800
    assert check.different == 0


def test_a_taken_port_is_refused_in_one_line(capsys):
    with socket.create_server(("127.0.0.1", 0)) as other:
        assert cli.run(["demo-board", "--socket", str(other.getsockname()[1])]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "must be a free port" in line
