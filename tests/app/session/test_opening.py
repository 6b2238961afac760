"""The figures of the source documents in the dashboard, and the Khan et al. filter as a choice."""

from __future__ import annotations

import numpy as np
import pytest

from kalscope import BadSetting, FilterParams, Recording, open_source, steady_state
from kalscope.estimation.request import FitResult
from kalscope.papers.generalized import GeneralizedParams
from kalscope.papers.reproduction import list_experiments, open_experiment
from kalscope_app.engine.filter_runs import choose_samples
from kalscope_app.engine.frame import compute_frame
from kalscope_app.session.changes import apply_found, reset_parameters, set_paper_text, set_text, set_variant_of_eq3
from kalscope_app.session.opening import opened, opened_experiment, opened_with
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


@pytest.fixture
def state():
    z = 100.0 + np.random.default_rng(0).normal(size=(500, 1))
    return opened(Recording(np.arange(500.0), ("z",), ("",), z, 1.0))


@pytest.mark.parametrize("reading", ["printed", "without_slip"])
def test_the_second_papers_filter_is_a_choice_and_can_be_left(state, reading):
    chosen = set_variant_of_eq3(reading)(state)
    typed = set_paper_text("sigma_m", "50")(chosen)
    frame = frame_of(typed)
    expected = GeneralizedParams(50.0, None, None, reading).run(state.recording.channel("z")).x
    assert np.array_equal(frame.filtered, expected)
    assert compute_checks(typed) is None
    assert "q / r" not in table(frame)
    assert set_variant_of_eq3(None)(typed).filter.is_standard
    assert len(record(History(), state, chosen, "", 0.0).past) == 1


def test_its_gain_is_told_in_the_words_of_the_five_lines(state):
    frame = frame_of(set_paper_text("sigma_m", "100")(set_variant_of_eq3("printed")(state)))
    assert float(frame.steady.gain) == pytest.approx(frame.gain[-1], abs=0.1)
    assert frame.steady.lag_samples == pytest.approx((1 - frame.steady.gain) / frame.steady.gain)


def test_finding_q_and_r_returns_to_the_five_lines(state):
    chosen = set_variant_of_eq3("printed")(state)
    found = apply_found(state.recording, "z", FitResult(FilterParams(1.0, 2.0), "x", "y"))(chosen)
    assert found.filter.is_standard
    assert frame_of(found).steady == steady_state(FilterParams(1.0, 2.0), 1.0)


def test_a_signal_below_zero_is_refused_by_the_printed_equation_in_words():
    z = np.linspace(5, -5, 50)[:, None]
    state = opened(Recording(np.arange(50.0), ("z",), ("",), z, 1.0))
    with pytest.raises(BadSetting, match="0"):
        frame_of(set_variant_of_eq3("printed")(state))


def test_an_unknown_experiment_is_refused():
    with pytest.raises(BadSetting, match="experiment must be one of"):
        opened_experiment("experiment:nothing")


def test_an_experiment_is_a_source_like_any_other():
    name = list_experiments()[0].name
    opened_alone, _ = open_experiment(name)
    assert np.array_equal(open_source(f"experiment:{name}").values, opened_alone.values, equal_nan=True)
    again = opened_with(opened_alone, opened_experiment(name).as_tuning())
    assert again.settings.tunings == opened_experiment(name).settings.tunings
