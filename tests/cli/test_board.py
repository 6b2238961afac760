"""`kalscope ports`, `calibrate` and `demo-board`: what they show, what a board keeps and sends, how they end."""

from __future__ import annotations

import json
import re
import signal
import socket
import threading

import numpy as np
import pytest
from tests.support.measuring_board import MeasuringBoard
from tests.support.program import command, end, next_line
from tests.support.waiting import wait_until

from kalscope import Recording
from kalscope.cli import board as calibrate
from kalscope.cli import demo_board
from kalscope.cli.app import run
from kalscope.cli.demo_board import BoardLines
from kalscope.export.board import check_board, commands, values_in_use
from kalscope.export.float32 import Float32Params
from kalscope.sources.live.source import LiveSource
from kalscope.sources.port.serial_port import PortInfo


@pytest.fixture
def board():
    with MeasuringBoard(("light", "temp")) as board:
        yield board


@pytest.mark.slow
def test_it_prints_both_figures_of_each_channel_and_keeps_them_where_that_was_asked_for(board, capsys):
    assert run(["calibrate", board.port, "--seconds", "2"]) == 0
    out = capsys.readouterr().out
    assert re.findall(r"^(\w+): r = \d+\.\d+ unit².*; from 336 samples, ", out, re.M) == ["light", "temp"]
    assert out.count(" here: equal within 0.0010 %.") == 2
    assert out.endswith("after a reset the board uses the values of its export. --keep stores these.\n")
    assert not board.kept
    assert run(["calibrate", board.port, "--seconds", "2", "--channel", "temp", "--keep"]) == 0
    out = capsys.readouterr().out
    assert out.startswith("temp: r = ")
    assert out.endswith("Kept: the board uses these values from its next start.\n")
    assert [line for line in board.asked if line != "?"] == ["c 2", "2 c 2", "k"]
    assert board.kept


@pytest.mark.slow
def test_a_refusal_is_status_1_and_what_cannot_be_is_status_2_in_one_line(board, capsys, monkeypatch):
    board.refuses = "the level moves"
    assert run(["calibrate", board.port, "--seconds", "1", "--keep"]) == 1
    assert capsys.readouterr().out.startswith("light: The board keeps its values: the level moves.\n")
    assert not board.kept
    board.refuses, board.worn = "", True
    assert run(["calibrate", board.port, "--seconds", "1", "--keep"]) == 2
    printed = capsys.readouterr()
    assert re.findall(r"^(\w+): r = ", printed.out, re.M) == ["light", "temp"]  # they are in use
    assert printed.err.startswith("kalscope: the board could not store its values: the EEPROM does not hold")
    board.knows = False
    monkeypatch.setattr(calibrate, "START_S", 0.1)
    for options, words in (
        ([], "cannot measure by itself: export the Arduino sketch with self-calibration (--calibration)"),
        (["--channel", "other"], "sends no filtered column for other"),
        (["--seconds", "0"], "--seconds must be a number above 0"),
    ):
        assert run(["calibrate", board.port, "--seconds", "1", *options]) == 2
        assert words in capsys.readouterr().err
    board.halted = True
    assert run(["calibrate", board.port, "--seconds", "0.1"]) == 2
    assert "no sample arrived from tcp:" in capsys.readouterr().err


def test_ctrl_c_ends_it_and_the_board_keeps_its_values(board):
    patient = "from kalscope.export import board as measuring; measuring._CANCEL_S = 120\n"
    with command("calibrate", board.port, "--seconds", "300", change=patient) as process:
        wait_until(lambda: "c 300" in board.asked)
        cancelled = "kalscope: the measurement was cancelled: the board keeps its values\n"
        assert end(process, signal.SIGINT) == (130, "", cancelled)
    wait_until(lambda: board.asked[-1] == "c 0")


PORTS = (PortInfo("/dev/ttyS0", "", ""), PortInfo("/dev/ttyACM0", "Arduino\nUno\x1b[2J", "7533", (0x2341, 0x43)))


def test_ports_are_a_table_that_ends_with_the_command_for_the_board_or_json(monkeypatch, capsys):
    monkeypatch.setattr(calibrate, "list_ports", lambda: ())
    assert run(["ports"]) == 0
    assert capsys.readouterr().out == f"{calibrate.NONE_FOUND}\n"
    monkeypatch.setattr(calibrate, "list_ports", lambda: PORTS)
    assert run(["ports"]) == 0
    table = capsys.readouterr().out.splitlines()
    assert table[0].split("  ")[0] == "device"
    assert table[2].split() == ["/dev/ttyACM0", "Arduino", "Uno", "[2J", "7533"]
    assert table[-1].endswith("kalscope open serial:/dev/ttyACM0@115200")
    assert all(line.isprintable() for line in table)
    assert run(["ports", "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)
    assert [(row["device"], row["serial_number"]) for row in rows] == [(p.device, p.serial_number) for p in PORTS]


# ---- a demo board


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
        assert run(["demo-board", "--socket", str(other.getsockname()[1])]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "must be a free port" in line
