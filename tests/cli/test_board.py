"""`kalscope ports` and `kalscope calibrate`: what they show, what a board keeps, and how they end."""

from __future__ import annotations

import json
import re
import signal

import pytest
from tests.support.measuring_board import MeasuringBoard
from tests.support.program import command
from tests.support.waiting import PATIENCE, wait_until

from kalscope.cli import board as calibrate
from kalscope.cli.app import run
from kalscope.sources.port.serial_port import PortInfo


@pytest.fixture
def board():
    with MeasuringBoard(("light", "temp")) as board:
        yield board


@pytest.mark.slow
def test_it_prints_both_figures_of_each_channel_and_keeps_them_where_that_was_asked_for(board, capsys):
    assert run(["calibrate", board.port, "--seconds", "2"]) == 0
    said = capsys.readouterr().out
    assert re.findall(r"^(\w+): r = \d+\.\d+ unit².*; from 336 samples, ", said, re.M) == ["light", "temp"]
    assert said.count(" here: equal within 0.0010 %.") == 2
    assert said.endswith("after a reset the board uses the values of its export. --keep stores these.\n")
    assert not board.kept
    assert run(["calibrate", board.port, "--seconds", "2", "--channel", "temp", "--keep"]) == 0
    said = capsys.readouterr().out
    assert said.startswith("temp: r = ")
    assert said.endswith("Kept: the board uses these values from its next start.\n")
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
    said = capsys.readouterr()
    assert re.findall(r"^(\w+): r = ", said.out, re.M) == ["light", "temp"]  # they are in use
    assert said.err.startswith("kalscope: the board could not store its values: the EEPROM does not hold")
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
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(PATIENCE)
    assert process.returncode == 130
    assert err == "kalscope: the measurement was cancelled: the board keeps its values\n"
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
