"""The ways to find q and r, what is filed, and what is written: without a browser."""

from __future__ import annotations

import numpy as np
import pytest
from tests.app.recordings import walk

from kalscope import BadSetting, FilterParams, Recording, estimate, steady_state
from kalscope.common.text import percent
from kalscope.estimation.request import FitResult, find_parameters, proposed_lag
from kalscope_app.session.changes import apply_found, select_channel
from kalscope_app.session.opening import opened
from kalscope_app.views import goal
from kalscope_app.views.goal import SEARCH_METHODS, answer_text, method_of, settings_of


@pytest.fixture
def state():
    return opened(walk(2000))


def search(state, way, text=""):
    rec = state.recording
    request = method_of(state.with_view(search_method=way)).request(state, text)
    return find_parameters(rec.channel(state.channel), request, sample_period=rec.sample_period)


@pytest.mark.parametrize(
    ("way", "text", "field", "value", "refused"),
    [
        ("maximum lag", "50,5", "lag_s", 0.0505, "-5"),
        ("cut-off frequency", "3", "cutoff_hz", 3.0, "51"),
        ("noise reduction", "12", "noise_reduction_db", 12.0, ""),
        ("gain K", "0.1", "gain", 0.1, "1"),
    ],
)
def test_a_goal_is_met_exactly_and_r_comes_from_the_recording(state, way, text, field, value, refused):
    found = search(state, way, text)
    assert getattr(steady_state(found.params, 0.01), field) == pytest.approx(value)
    assert found.params.r == estimate(state.z, momentum=0.0).r
    assert search(state.with_tuning(r=7.0), way, text).params == found.params  # whatever was there before
    with pytest.raises(BadSetting):
        search(state, way, refused)


def test_every_way_without_a_box_answers_and_the_others_need_their_number(state):
    for way, method in SEARCH_METHODS.items():
        if method.label or way in goal.SMOOTHING:
            with pytest.raises(BadSetting):
                search(state, way)
        else:
            assert search(state.with_view(window=(10.0, 15.0)), way).params is not None


def test_what_is_known_about_the_noise_holds_for_the_next_goal(state):
    told = apply_found(state.recording, "a", search(state, "data sheet σ, fit q", "0.9"))(state)
    assert search(told, "maximum lag", "50").params.r == pytest.approx(0.81)
    by_hand = told.with_tuning(r=2.0)  # nobody knows where this r comes from
    assert search(by_hand, "maximum lag", "50").params.r == estimate(state.z, momentum=0.0).r


def plain(text):
    return text.replace("\u00a0", " ")


def test_the_answer_is_one_sentence_with_what_it_costs_and_what_has_changed(state):
    state = state.with_tuning(q=0.01, r=1.0)
    found = search(state, "maximum lag", "20")  # two samples: K = 1/3, and K/(2 − K) = 1/5 of the variance is left
    text = plain(answer_text(apply_found(state.recording, "a", found)(state)))
    assert text.startswith("Lag **20 ms** leaves **45 % of the noise** (−6.99 dB). Before: 95.1 ms, 22 %. Changed:")
    assert "overshoot" not in text
    found = FitResult(FilterParams(1.0, 2.0, momentum=24.0), "maximum likelihood", "Found.")
    text = plain(answer_text(apply_found(state.recording, "a", found)(state)))
    assert "momentum off → 240 ms" in text
    assert f"A step overshoots by {plain(percent(float(steady_state(found.params).overshoot)))}." in text


@pytest.mark.slow
def test_the_lag_is_first_that_of_the_medium_setting_in_a_unit_that_suits_it():
    units = {None: "samples", 0.002: "ms", 0.1: "ms", 3.0: "s", 240.0: "min", 31557600.0: "years"}
    for period, unit in units.items():
        state = opened(walk(2000, period=period))
        lag = proposed_lag(goal.costs_of(state), state.tuning.params)
        assert 0.5 < lag < 10.0
        method = method_of(state)
        assert method.label == f"lag ({unit})"
        assert method_of(state.with_tuning(q=1e-9)).content == method.content  # the box stays as it was filled
        (target,) = method.request(state, method.content).target.values()
        assert target / (period or 1.0) == pytest.approx(lag, rel=0.05)


@pytest.mark.slow
def test_three_settings_are_offered_where_the_best_fit_hardly_filters():
    time = np.arange(2000) * 0.01
    still, moving = opened(walk(2000)), opened(Recording(time, ("a",), ("",), np.sin(time)[:, None], 0.01))
    assert settings_of(still) == {}
    lost = [one.movement_lost for one in settings_of(moving).values()]
    assert (list(settings_of(moving)), lost) == (["light", "medium", "strong"], sorted(lost))
    assert (goal.settings_text(still), goal.settings_text(moving).count("\n|")) == ("", 5)
    assert goal.goals_of(moving) == (*goal.SMOOTHING, *goal.goals_of(still))
    for way, name in goal.SMOOTHING.items():
        lag = steady_state(search(moving, way).params).lag_samples
        assert lag == pytest.approx(settings_of(moving)[name].lag_samples)
        assert method_of(still.with_view(search_method=way)).label == method_of(still).label  # not on this channel


def test_a_late_answer_goes_to_its_own_channel_or_nowhere(state):
    found = FitResult(FilterParams(7.0, 8.0), "x", "y")
    on_b = apply_found(state.recording, "a", found)(select_channel("b")(state))
    assert (on_b.tunings[0].q, on_b.tuning, on_b.searched) == (7.0, state.tunings[1], None)
    elsewhere = opened(walk(seed=1))
    late = apply_found(state.recording, "a", found)(elsewhere)
    assert late.tunings == elsewhere.tunings
    assert "another recording" in late.note
