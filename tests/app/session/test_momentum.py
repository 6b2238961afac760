"""The momentum τ in the session: its slider and box, and everything that a tuning value passes through."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kalscope import BadSetting, FilterParams, Recording, kalman_filter
from kalscope.filtering.params import MAX_MOMENTUM
from kalscope_app.engine.filter_runs import choose_samples
from kalscope_app.engine.frame import compute_frame
from kalscope_app.session.changes import (
    MAX_POSITION,
    momentum_at,
    set_link,
    set_momentum_position,
    set_momentum_text,
    set_text,
    set_velocity,
    slider_position,
)
from kalscope_app.session.opening import opened
from kalscope_app.session.session import Session, redo, undo
from kalscope_app.session.state import SAME_LAG, SAME_NUMBERS


def recording(period=0.02, n=600):
    z = np.cumsum(np.random.default_rng(3).normal(size=(n, 2)), axis=0) * [1.0, 30.0]
    return Recording(np.arange(n) * (period or 1.0), ("a", "b"), ("V", "mm"), z, period)


@pytest.fixture
def state():
    return opened(recording())


def with_momentum(state, momentum):
    return set_momentum_text("momentum", repr(momentum))(state)


def momenta(state):
    return [tuning.momentum for tuning in state.settings.tunings]


def test_the_low_end_of_the_slider_is_exactly_off_and_the_high_end_the_longest():
    assert momentum_at(0.0) == 0.0
    assert momentum_at(MAX_POSITION) == MAX_MOMENTUM
    assert slider_position(0.0) == 0.0
    assert slider_position(MAX_MOMENTUM) == pytest.approx(MAX_POSITION, abs=1e-5)


@given(st.floats(0.0, MAX_POSITION))
def test_the_slider_stays_where_it_was_put(position):
    """The slider is set again where it is more than half a step away, so it must come back nearer than that."""
    assert abs(slider_position(momentum_at(position)) - position) < 0.005


@pytest.mark.parametrize("position", [-1.0, 9.0, -1e300, 1e300, math.nan, math.inf])
def test_whatever_a_browser_sends_the_momentum_is_in_its_range(state, position):
    moved = set_momentum_position(position)(with_momentum(state, 7.0))
    assert 0.0 <= moved.tuning.momentum <= MAX_MOMENTUM


@pytest.mark.parametrize(
    ("text", "samples"),
    [
        *(("12", 12.0), ("12,5", 12.5), ("12 samples", 12.0), ("0", 0.0), ("off", 0.0), ("", 0.0), (" OFF ", 0.0)),
        *(("240 ms", 12.0), ("240ms", 12.0), ("0.24 s", 12.0), ("0.004 min", 12.0)),
    ],
)
def test_a_momentum_is_typed_in_samples_or_as_a_time(state, text, samples):
    typed = set_momentum_text("momentum", text)(with_momentum(state, 3.0))
    assert typed.tuning.momentum == pytest.approx(samples, rel=1e-12)


@pytest.mark.parametrize("text", ["-1", "1e6", "nan", "inf", "much", "ms", "-3 ms", "9 h", "1 2"])
def test_what_is_no_momentum_is_refused_by_its_name(state, text):
    with pytest.raises(BadSetting, match="momentum must be"):
        set_momentum_text("momentum", text)(state)


def test_a_time_needs_the_sample_period():
    with pytest.raises(BadSetting, match="momentum must be in samples while the sample period is not known"):
        set_momentum_text("momentum", "240 ms")(opened(recording(period=None)))


def test_undo_and_redo_take_the_momentum_back_and_forth(state):
    session = Session(state)
    for position in (1.0, 2.0, 3.0):  # one drag
        session.request(set_momentum_position(position), key="slider momentum")
        session.apply_requests()
    session.request(set_text("q", "7"))
    seen = []
    for step in (undo, undo, redo, redo):
        session.request(step)
        seen.append(session.apply_requests()[0].tuning)
    assert [tuning.momentum for tuning in seen] == [999.0, 0.0, 999.0, 999.0]
    assert seen[-1].q == 7.0


def test_the_other_channels_keep_their_momentum_unless_they_are_linked(state):
    assert momenta(with_momentum(state, 12.0)) == [12.0, 0.0]
    for link in (SAME_NUMBERS, SAME_LAG):
        assert momenta(with_momentum(set_link(link)(state), 12.0)) == [12.0, 12.0]


@pytest.mark.parametrize("period", [0.02, None])
def test_the_frame_shows_the_filter_with_momentum_and_its_velocity_on_request(period):
    state = with_momentum(opened(recording(period)), 12.0)
    drawn = choose_samples(state.recording, state.channel, None)
    plain, shown = (compute_frame(one, 0, drawn) for one in (state, set_velocity(True)(state)))
    expected = kalman_filter(state.z, FilterParams(state.tuning.q, state.tuning.r, momentum=12.0))
    assert np.array_equal(shown.filtered, expected.x, equal_nan=True)
    assert plain.velocity is None
    rate = 1.0 if period is None else 1.0 / period
    np.testing.assert_allclose(shown.velocity, expected.velocity * rate, rtol=1e-12)
    np.testing.assert_allclose(shown.velocity_spread, 2.0 * rate * np.sqrt(expected.velocity_p), rtol=1e-12)
    off = set_velocity(True)(set_momentum_position(0.0)(state))
    assert compute_frame(off, 0, drawn).velocity is None  # the five lines have none
