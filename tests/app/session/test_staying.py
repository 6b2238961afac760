"""What stays when another record is opened: what was set for a channel of the same name and unit, and its pins."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from feed import Board

from kalscope import Recording
from kalscope_app.session.changes import pin_present, reset_parameters, select_channel, set_text
from kalscope_app.session.live_changes import opened_live, refreshed
from kalscope_app.session.opening import opened, opened_experiment

SET = {"q": "7", "r": "3", "p0": "2", "gate": "16", "momentum": "12"}


def recording(title, names=("a", "b"), units=("", ""), scale=1.0):
    values = scale * np.random.default_rng(len(title)).normal(size=(600, len(names)))
    return Recording(np.arange(600) * 0.01, names, units, values, 0.01, source=title, title=title)


@pytest.fixture
def tuned():
    """Every number set and one setting pinned, on the second channel of a file."""
    state = select_channel("b")(opened(recording("first.csv")))
    for name, text in SET.items():
        state = set_text(name, text)(state)
    return pin_present(state)


def of_b(state):
    return {tuning.name: tuning for tuning in state.settings.tunings}["b"]


@pytest.mark.parametrize("title", ["first.csv", "second.csv", "sample:second", "synthetic:sine"])
def test_what_was_set_stays_for_the_same_name_and_unit(tuned, title):
    again = opened(recording(title, names=("c", "b")), tuned)
    assert of_b(again) == tuned.tuning
    assert (again.channel, again.variants) == ("b", tuned.variants)
    assert again.settings.tunings[0] == again.settings.starts[0]
    assert again.answers.note.endswith("Undo returns to the previous recording.")
    assert of_b(reset_parameters(again)) == again.settings.starts[1]


@pytest.mark.parametrize("other", [{"names": ("a", "c")}, {"units": ("", "V")}])
def test_another_name_or_unit_is_another_channel(tuned, other):
    again = opened(recording("second.csv", **other), tuned)
    assert again.settings.tunings == again.settings.starts
    assert (again.answers.note, again.channel) == ("", "a")
    assert not any(select_channel(name)(again).variants for name in again.recording.names)


def fed(board, state, *counts):
    for count in counts:
        state = refreshed(state, board.send(count).snapshot())
        yield state


def test_from_a_file_to_a_board_and_to_its_recording(tuned):
    board = Board()
    waiting = opened_live(board.id, "serial:x", tuned)
    assert waiting.answers.note == ""  # its channels are not known yet
    begun = list(fed(board, waiting, 20, 30, 500))
    assert [of_b(state) for state in begun] == [tuned.tuning] * 3
    assert {state.answers.note[:16] for state in begun} == {"Filters and pins"}
    live = select_channel("b")(set_text("q", "0.5")(select_channel("b")(begun[-1])))
    assert live.variants == tuned.variants
    file = opened(replace(board.snapshot().recording, source="recording.csv"), live)
    assert (of_b(file), file.channel, file.variants) == (live.tuning, "b", tuned.variants)


def test_a_figure_of_a_document_keeps_its_own_settings():
    name = "experiment:noise_reducer_figure_6"
    alone = opened_experiment(name)
    before = set_text("q", "7")(alone)
    figure = opened_experiment(name, before)
    assert figure.settings.tunings == alone.settings.tunings == figure.settings.starts
    assert figure.answers.note == ""
