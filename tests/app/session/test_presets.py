"""Presets: what they say is what they do, and taking one is one undoable step."""

from __future__ import annotations

import numpy as np
import pytest

from kalscope import BadSetting, Recording, kalman_filter, starting_params, steady_state
from kalscope.papers.generalized import GeneralizedParams
from kalscope_app.session.changes import PRESETS, set_text, take_preset, use_paper_filter
from kalscope_app.session.opening import opened
from kalscope_app.session.session import Session, undo


@pytest.fixture
def state():
    z = 1e-3 * np.random.default_rng(5).normal(size=(2000, 1))
    return opened(Recording(np.arange(2000) * 0.01, ("z",), ("V",), z, 0.01))


@pytest.mark.parametrize(("name", "lag", "kept"), [("smooth", 50, 0.1), ("balanced", 10, 0.22), ("fast", 2, 0.45)])
def test_a_preset_by_lag_has_that_lag_and_keeps_the_said_share_of_the_noise(state, name, lag, kept):
    title = next(title for title in PRESETS if title.startswith(name))
    taken = take_preset(title)(state)
    assert taken.tuning.r == starting_params(state.recording.channel("z")).r
    assert float(steady_state(taken.params).lag_samples) == pytest.approx(lag, rel=1e-3)
    noise = np.random.default_rng(6).normal(size=200_000)
    assert np.std(kalman_filter(noise, taken.params).x[1000:]) == pytest.approx(kept, rel=0.05)


def test_the_preset_with_momentum_is_as_calm_as_balanced_and_does_what_it_says(state):
    ramps, balanced = (
        next(title for title in PRESETS if title.startswith(name)) for name in ("follows", "balanced")
    )
    taken, calm = take_preset(ramps)(state), take_preset(balanced)(state)
    steady, reference = steady_state(taken.params), steady_state(calm.params)
    assert taken.tuning.momentum > 0.0
    assert float(steady.noise_reduction_db) == pytest.approx(float(reference.noise_reduction_db), abs=0.01)
    assert float(steady.overshoot) == pytest.approx(0.1, abs=1e-3)
    assert f"a lag of {float(steady.lag_samples):.1f} samples instead of 10" in PRESETS[ramps].why
    assert take_preset(balanced)(taken).tuning.momentum == 0.0


@pytest.mark.parametrize(
    ("beginning", "q", "r"),
    [
        ("Ma'arif 2019: R = 1, Q = 10", 10, 1),
        ("Ma'arif 2019: R = 1, Q = 1", 1, 1),
        ("Ma'arif 2019: R = 1, Q = 0.1", 0.1, 1),
        ("Ma'arif 2019: R = 1, Q = 0.01", 0.01, 1),
        ("Ma'arif 2019: R = 10, Q = 0.1", 0.1, 10),
        ("Ma'arif 2019: R = 100, Q = 0.1", 0.1, 100),
        ("interactive matter: q = 128", 128, 4),
        ("interactive matter: q = 4", 4, 4),
        ("interactive matter: q = 0.125", 0.125, 4),
        ("interactive matter: r = 1", 0.125, 1),
        ("interactive matter: r = 4", 0.125, 4),
        ("interactive matter: r = 32", 0.125, 32),
    ],
)
def test_the_documents_pairs_are_taken_as_printed(state, beginning, q, r):
    taken = take_preset(beginning)(state)
    assert (taken.tuning.q, taken.tuning.r) == (q, r)
    assert taken.tuning.how == f"preset {beginning}"


def test_taking_one_is_one_step_that_undo_takes_back(state):
    session = Session(state)
    session.request(set_text("p0", "3"))
    for title in PRESETS:
        session.request(take_preset(title))
        taken, _, failures = session.apply_requests()
        assert failures == []
        assert taken.tuning.p0 == 3.0  # the start stays
        session.request(undo)
        assert session.apply_requests()[0].tuning.q == state.tuning.q


def test_a_preset_ends_the_second_papers_filter_and_an_unknown_one_is_refused(state):
    other = use_paper_filter(state, GeneralizedParams(1.0, None, None, "printed"))
    assert take_preset(next(iter(PRESETS)))(other).filter.is_standard
    with pytest.raises(BadSetting, match="preset must be one of"):
        take_preset("<img>")
