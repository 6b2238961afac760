"""The real program with a board behind a socket: before its first sample, what is sent, its own noise."""

from __future__ import annotations

import re
import socket

import pytest
from tests.app.wire import Guest
from tests.support import measuring_board
from tests.support.program import command, labels, next_line, port_of, running, token_of
from tests.support.waiting import PATIENCE

from kalscope.common.text import number
from kalscope_app.session.session import Failed
from kalscope_app.views.board import FORGET, KEEP


def test_before_the_first_sample_no_text_counts_the_rows_of_the_placeholder(tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as silent:
        source = f"tcp://127.0.0.1:{silent.getsockname()[1]}"
        with running(tmp_path, source=source) as (_, url), Guest(port_of(url), token_of(url)) as guest:
            for text in ("Waiting for the first 10 samples", "**connected**", "a comparison needs 16"):
                guest.read_until(lambda text=text: text in "".join(guest.markdown.values()))
            assert re.findall(r"\b2 \w*(?:rows|samples)", "".join(guest.markdown.values())) == []


def test_a_demo_board_takes_what_is_sent(tmp_path):
    source = "synthetic:constant?n=900&sample_period=0.002&sigma=3"
    with command("demo-board", source, "--sketch", cwd=tmp_path) as board:
        address = next_line(board).split()[-1]
        with running(tmp_path, source=address) as (_, url), Guest(port_of(url), token_of(url)) as guest:
            wait_for(guest, "**connected**")
            wait_for(guest, "the board's filter differs")
            guest.set(guest.find("process noise q"), "0.037")
            guest.set(guest.find("measurement noise r"), "11.3")
            press(guest, "Send q, r and p0")
            wait_for(guest, "The board now uses q = 0.037, r = 11.3, p0 = inf")
            wait_for(guest, "**Equal bit for bit** in ")


# --- a board that can be made to fail ---------------------------------------------------------------------


FOLDER, MEASURE, USE = "Noise measured by the board", "Let the board measure r", "Use its r and q here"
CHANGE = f"""
from kalscope.sources.live import source
from kalscope_app.views import widgets
source.CommandChannel.send.__defaults__, widgets.MIN_SECONDS = ({PATIENCE},), 0.0
"""
"""Cancel is there at once; a busy board is no board that is silent."""


@pytest.fixture
def board(monkeypatch):
    monkeypatch.setattr(measuring_board, "RATE", 400.0)  # a busy machine reads as much
    with measuring_board.MeasuringBoard() as board:
        yield board


@pytest.fixture
def guest(board, tmp_path):
    program = running(tmp_path, source=board.port, change=CHANGE)
    with program as (_, url), Guest(port_of(url), token_of(url)) as guest:
        wait_for(guest, "**connected**")
        guest.read_until(lambda: {USE, KEEP, "Open this path"} <= labels(guest))
        yield guest


def text_on(guest):
    return "".join((*guest.markdown.values(), *guest.notices)).replace("\\", "").replace("\xa0", " ")


def wait_for(guest, text):
    guest.read_until(lambda: text in text_on(guest))


def press(guest, label):
    guest.set(guest.find(label), True)


def undo(guest):
    guest.send("CommandTriggerMessage", uuid=next(uuid for uuid, name in guest.commands.items() if name == "Undo"))


def measure(guest, seconds):
    guest.set(guest.find("measure for (s)"), seconds)
    press(guest, MEASURE)


def shown(guest, label):
    return guest.widgets[guest.find(label)]["props"]["visible"]


def cancel_of(guest):
    """The Cancel button beside the measurement."""
    folder = guest.widgets[guest.find(MEASURE)]["container_uuid"]
    beside = {uuid: one for uuid, one in guest.widgets.items() if one.get("container_uuid") == folder}
    return next(uuid for uuid, one in beside.items() if one["props"].get("label") == "Cancel")


def test_a_board_measures_and_its_values_are_compared_used_and_kept(board, guest):
    measure(guest, "4")
    press(guest, MEASURE)  # twice: one measurement
    guest.read_until(lambda: shown(guest, USE))
    r = board.uses("light")
    wait_for(guest, f"The board measured r = {number(r, 4)} unit², and for the lag of the export q = ")
    wait_for(guest, "here: equal within 0.0010 %.")
    wait_for(guest, "; from 696 samples")
    box = guest.find("measurement noise r")
    before = guest.values[box]
    press(guest, USE)
    guest.read_until(lambda: float(guest.values[box]) == pytest.approx(r, rel=1e-6) and not shown(guest, USE))
    undo(guest)
    guest.read_until(lambda: guest.values[box] == before and shown(guest, USE))  # what was measured stays so
    for label, other, kept in ((KEEP, FORGET, True), (FORGET, KEEP, False)):
        press(guest, label)
        guest.read_until(lambda other=other: other in labels(guest))
        assert board.kept == kept
    assert [line for line in board.asked if line != "?"] == ["c 4", "k", "f"]


def test_what_went_wrong_is_said_and_nothing_is_stuck(board, guest):
    def fails(words, seconds="4"):
        guest.notices.clear()
        measure(guest, seconds)
        guest.read_until(lambda: words in text_on(guest) and Failed.MEASURE in text_on(guest))
        guest.read_until(lambda: shown(guest, MEASURE))

    def ends(words, act):
        guest.notices.clear()
        before = len(board.asked)
        measure(guest, "300")
        guest.read_until(lambda: "c 300" in board.asked[before:] and not shown(guest, MEASURE))
        wait_for(guest, ": keep what the sensor measures constant.")
        act()
        guest.read_until(lambda: words in "".join(guest.notices))

    fails("must be a number such as", "soon")
    board.refuses = "the level moves"
    fails("The board keeps its values: the level moves.")
    board.knows = False
    fails("The sketch on this board cannot measure by itself: export the Arduino sketch with self-calibration")
    board.knows, board.refuses = True, ""
    ends("cancelled: the board keeps its values", lambda: guest.set(cancel_of(guest), True))
    lost = "The board was disconnected before it answered"
    guest.set(guest.find("path"), "demo")
    ends(lost, lambda: press(guest, "Open this path"))
    guest.read_until(lambda: not shown(guest, FOLDER))
    undo(guest)
    guest.read_until(lambda: shown(guest, FOLDER) and "**connected**" in text_on(guest))
    ends(lost, board.unplug)
    fails("is not connected")
