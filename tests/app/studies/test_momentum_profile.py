"""The likelihood over the momentum: against the estimate at each, and what is said of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from kalscope import BadSetting, Recording, estimate
from kalscope.errors import Cancelled
from kalscope_app.session.changes import select_channel, set_momentum_text
from kalscope_app.session.opening import opened
from kalscope_app.studies.checks import momentum_profile
from kalscope_app.views.checks import lines_of, words_of


def recording(n=1500, momentum=40.0, ratio=0.5):
    """Channel a keeps its direction for 40 samples, channel b is a random walk; both have noise of variance 1."""
    g = np.random.default_rng(8)
    velocity = np.zeros(n)
    for i in range(1, n):
        velocity[i] = velocity[i - 1] * (1 - 1 / momentum) + g.normal(0, np.sqrt(ratio) / momentum)
    signals = np.stack([np.cumsum(velocity), np.cumsum(g.normal(0, np.sqrt(ratio), n))], axis=1)
    return Recording(np.arange(n) * 0.02, ("a", "b"), ("V", "V"), signals + g.normal(size=(n, 2)), 0.02)


def profile_of(state):
    return momentum_profile(state, lambda _share, _text: None, lambda: False)


@pytest.mark.slow
def test_every_point_is_the_best_pair_of_its_momentum():
    state = opened(recording())
    profile = profile_of(state)
    assert profile.plain == pytest.approx(estimate(state.z, momentum=0.0).loglik)
    for i in (0, 9, 24):
        best = estimate(state.z, momentum=float(profile.momentum[i]))
        assert profile.loglik[i] == pytest.approx(best.loglik)


@pytest.mark.slow
def test_it_finds_the_momentum_of_a_signal_that_keeps_its_direction_and_none_of_a_random_walk():
    state = opened(recording())
    profile = profile_of(state)
    assert 10.0 < profile.momentum[np.argmax(profile.loglik)] < 160.0
    assert "The best is near" in words_of(profile)
    walk = profile_of(select_channel("b")(state))
    assert "No momentum explains it better than none." in words_of(walk)


@pytest.mark.slow
def test_the_chart_shows_what_is_below_the_best_and_marks_the_present_momentum():
    state = set_momentum_text("momentum", "40")(opened(recording()))
    profile = profile_of(state)
    _, (plain, below, present), layout = lines_of(profile, state)
    assert below.max() == 0.0
    assert (plain < 0.0).all()
    (at,) = np.flatnonzero(np.isfinite(present))
    assert abs(np.log(profile.momentum[at] / 40.0)) == np.abs(np.log(profile.momentum / 40.0)).min()
    assert 2 in layout.gaps
    off = set_momentum_text("momentum", "off")(state)
    assert np.isnan(lines_of(profile, off)[1][2]).all()


@pytest.mark.slow
def test_a_profile_belongs_to_its_channel_alone():
    state = opened(recording())
    profile = profile_of(state)
    assert profile.belongs_to(set_momentum_text("momentum", "9")(state))
    assert not profile.belongs_to(select_channel("b")(state))
    assert not profile.belongs_to(opened(recording()))


@pytest.mark.slow
def test_a_profile_drawn_again_is_another_one():
    state = opened(recording(200))
    first, again = profile_of(state), profile_of(state)
    assert (first, 40.0) == (first, 40.0)
    assert (first, 40.0) != (again, 40.0)  # compared by its arrays it would raise, and no frame could be made


def test_it_can_be_cancelled_and_refuses_what_says_nothing():
    state = opened(recording())
    with pytest.raises(Cancelled):
        momentum_profile(state, lambda _share, _text: None, lambda: True)
    flat = replace(recording(), values=np.ones((1500, 2)))
    with pytest.raises(BadSetting, match="there is no momentum profile"):
        profile_of(opened(flat))
