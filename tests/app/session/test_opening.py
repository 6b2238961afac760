"""The figures of the source documents in the dashboard, and the Khan et al. filter as a choice."""

from __future__ import annotations

import numpy as np
import pytest

from kalscope import BadSetting, FilterParams, open_source
from kalscope.estimation.request import FitResult
from kalscope.papers.reproduction import list_experiments, open_experiment
from kalscope_app.engine.filter_runs import choose_samples
from kalscope_app.engine.frame import compute_frame
from kalscope_app.session.changes import apply_found, reset_parameters, set_text, use_kalman_filter
from kalscope_app.session.opening import opened_experiment, opened_with
from kalscope_app.session.session import History, record
from kalscope_app.studies.checks import compute_checks
from kalscope_app.views.tune import table


def frame_of(state):
    return compute_frame(state, 0, choose_samples(state.recording, state.channel, None))


@pytest.mark.slow
@pytest.mark.parametrize("name", [experiment.name for experiment in list_experiments()])
def test_every_experiment_opens_at_the_settings_of_its_figure(name):
    recording, filters = open_experiment(name)
    state = opened_experiment(name)
    frame = frame_of(state)
    expected = filters[state.channel].run(recording.channel(state.channel)).x
    assert np.array_equal(frame.filtered, expected[frame.drawn.indices], equal_nan=True)
    assert reset_parameters(set_text("q", "7")(state)).settings.tunings == state.settings.tunings
    assert "gain K" in table(frame)


def test_the_second_papers_filter_has_its_gain_and_can_be_left():
    state = opened_experiment("experiment:generalized_figure_7")
    frame = frame_of(state)
    assert frame.steady.lag_samples == pytest.approx((1 - frame.steady.gain) / frame.steady.gain)
    assert "q / r" not in table(frame)
    assert compute_checks(state) is None
    left = use_kalman_filter(state)
    found = apply_found(state.recording, state.channel, FitResult(FilterParams(1.0, 2.0), "x", "y"))(state)
    assert left.filter.is_standard
    assert found.filter.is_standard
    assert len(record(History(), state, left, "", 0.0).past) == 1


def test_an_unknown_experiment_is_refused():
    with pytest.raises(BadSetting, match="experiment must be one of"):
        opened_experiment("experiment:nothing")


def test_an_experiment_is_a_source_like_any_other():
    name = list_experiments()[0].name
    opened_alone, _ = open_experiment(name)
    assert np.array_equal(open_source(f"experiment:{name}").values, opened_alone.values, equal_nan=True)
    again = opened_with(opened_alone, opened_experiment(name).as_tuning())
    assert again.settings.tunings == opened_experiment(name).settings.tunings
