"""What is opened: the figures of the source documents, and what stays of the settings before."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.app.recordings import Board, walk

from kalscope import FilterParams
from kalscope.estimation.request import FitResult
from kalscope.papers.reproduction import list_experiments, open_experiment
from kalscope_app.engine.frame import compute_frame
from kalscope_app.session import changes
from kalscope_app.session.changes import pin_present, refreshed, reset_parameters, select_channel, set_text
from kalscope_app.session.opening import opened, opened_experiment
from kalscope_app.studies.checks import compute_checks
from kalscope_app.views.tune import table


@pytest.mark.slow
@pytest.mark.parametrize("name", [experiment.name for experiment in list_experiments()])
def test_every_experiment_opens_at_the_settings_of_its_figure(name):
    recording, filters = open_experiment(name)
    state = opened_experiment(name)
    frame = compute_frame(state)
    expected = filters[state.channel].run(recording.channel(state.channel)).x
    assert np.array_equal(frame.filtered, expected[frame.drawn.indices], equal_nan=True)
    assert reset_parameters(set_text("q", "7")(state)).tunings == state.tunings
    assert "gain K" in table(frame)


@pytest.mark.slow
def test_the_second_papers_filter_has_its_gain_and_can_be_left():
    state = opened_experiment("experiment:generalized_figure_7")
    frame = compute_frame(state)
    assert frame.steady.lag_samples == pytest.approx((1 - frame.steady.gain) / frame.steady.gain)
    assert "q / r" not in table(frame)
    assert compute_checks(state) is None
    found = changes.apply_found(state.recording, state.channel, FitResult(FilterParams(1.0, 2.0), "x", "y"))(state)
    assert (state.with_standard_filter().filter.is_standard, found.filter.is_standard) == (True, True)


# --- what stays when another record is opened -----------------------------------------------------------


SET = {"q": "7", "r": "3", "p0": "2", "gate": "16", "momentum": "12"}


def recording(title, names=("a", "b"), units=""):
    return walk(600, names, units, source=title, title=title)


@pytest.fixture
def tuned():
    """Every number set and one setting pinned, on the second channel of a file."""
    state = select_channel("b")(opened(recording("first.csv")))
    for name, text in SET.items():
        state = set_text(name, text)(state)
    return pin_present(state)


def of_b(state):
    return state.tunings[state.recording.index("b")]


@pytest.mark.parametrize("title", ["first.csv", "second.csv", "sample:second", "synthetic:sine"])
def test_what_was_set_stays_for_the_same_name_and_unit(tuned, title):
    again = opened(recording(title, names=("c", "b")), tuned)
    assert (of_b(again), again.tunings[0]) == (tuned.tuning, again.starts[0])
    assert (again.channel, again.variants) == ("b", tuned.variants)
    assert again.note.endswith("Undo returns to the previous recording.")
    assert of_b(reset_parameters(again)) == again.starts[1]


@pytest.mark.parametrize("other", [{"names": ("a", "c")}, {"units": ("", "V")}])
def test_another_name_or_unit_is_another_channel(tuned, other):
    again = opened(recording("second.csv", **other), tuned)
    assert again.tunings == again.starts
    assert (again.note, again.channel) == ("", "a")
    assert not any(select_channel(name)(again).variants for name in again.recording.names)


def test_from_a_file_to_a_board_and_to_its_recording(tuned):
    board = Board()
    waiting = live = changes.opened_live(board.id, "serial:x", tuned)
    assert waiting.note == ""  # its channels are not known yet
    for count in (20, 30, 500):
        live = refreshed(live, board.send(count).snapshot())
        assert (of_b(live), live.note[:16]) == (tuned.tuning, "Filters and pins")
    live = select_channel("b")(set_text("q", "0.5")(select_channel("b")(live)))
    assert live.variants == tuned.variants
    file = opened(replace(board.snapshot().recording, source="recording.csv"), live)
    assert (of_b(file), file.channel, file.variants) == (live.tuning, "b", tuned.variants)


def test_a_figure_of_a_document_keeps_its_own_settings():
    alone = opened_experiment("experiment:noise_reducer_figure_6")
    figure = opened_experiment("experiment:noise_reducer_figure_6", set_text("q", "7")(alone))
    assert (figure.tunings, figure.note) == (alone.tunings, "")
