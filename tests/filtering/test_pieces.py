"""A record that comes in pieces is filtered as one that comes whole, bit for bit; what was given out stays."""

from __future__ import annotations

import numpy as np
import pytest
from each import each
from hypothesis import given
from hypothesis import strategies as st

from kalscope import BadSetting, FilterParams, kalman_filter
from kalscope.filtering.pieces.running import FIRST_CAPACITY
from kalscope.filtering.filter import GrowingRun

PARAMS = (
    FilterParams(0.01, 1.0),
    FilterParams(0.01, 1.0, p0=4.0),
    FilterParams(0.0, 1.0, p0=0.5, x0=2.0),
    FilterParams(1e-4, 1.0, gate=9.0),
)


def record(n=3000, seed=1):
    rng = np.random.default_rng(seed)
    z = rng.normal(size=n)
    z[rng.random(n) < 0.05] = np.nan
    z[rng.random(n) < 0.02] += 30.0
    z[500:509] += 50.0  # longer than the gate may refuse
    return z


def same(piecewise, whole):
    for name in ("x", "p", "k", "innovation", "s"):
        np.testing.assert_array_equal(getattr(piecewise, name), getattr(whole, name), err_msg=name)
    assert (piecewise.m, piecewise.rejected) == (whole.m, whole.rejected)
    assert piecewise.loglik == pytest.approx(whole.loglik, rel=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("params", PARAMS, ids=repr)
@given(cuts=st.lists(st.integers(0, 3000), max_size=8), timed=st.booleans())
def test_pieces_equal_the_whole(params, cuts, timed):
    z = record()
    dt = np.random.default_rng(2).random(len(z)) * 3 if timed else None
    running = GrowingRun(params)
    for part, steps in zip(np.split(z, sorted(cuts)), np.split(z if dt is None else dt, sorted(cuts)), strict=True):
        running.extend(part, None if dt is None else steps)
    same(running.result, kalman_filter(z, params, dt))


@each("cut", range(498, 512))
def test_a_cut_within_refused_samples_keeps_their_count(cut):
    z, params = record(), PARAMS[3]
    running = GrowingRun(params)
    running.extend(z[:cut])
    running.extend(z[cut:])
    same(running.result, kalman_filter(z, params))


def test_what_was_given_out_never_changes():
    running, z = GrowingRun(PARAMS[0]), record(5 * FIRST_CAPACITY)
    given_out, copies = [], []
    for part in np.array_split(z, 37):
        running.extend(part)
        running.forget(300)
        given_out.append(running.result.x)
        copies.append(running.result.x.copy())
    for view, copy in zip(given_out, copies, strict=True):
        np.testing.assert_array_equal(view, copy)
        assert not view.flags.writeable


def test_forgetting_changes_nothing_that_follows():
    running, z = GrowingRun(PARAMS[0]), record()
    running.extend(z[:2000])
    running.forget(1500)
    running.extend(z[2000:])
    assert len(running) == 1500
    np.testing.assert_array_equal(running.result.x, kalman_filter(z, PARAMS[0]).x[1500:])
    running.forget(10**9)
    assert len(running) == 0


def test_room_grows_with_what_is_kept_not_with_what_has_come():
    running = GrowingRun(PARAMS[0])
    for _ in range(200):
        running.extend(np.zeros(1000))
        running.forget(len(running) - 2000)
    assert running.result.x.base is not None
    assert running.result.x.base.nbytes <= 5 * 8 * 8192


def test_a_refused_piece_leaves_what_was_filtered():
    running, z = GrowingRun(PARAMS[0]), record()
    running.extend(z[:100])
    for bad, dt in (([np.inf], None), ([1.0], [-1.0]), ([[1.0]], None)):
        with pytest.raises(BadSetting):
            running.extend(bad, dt)
    running.extend(z[100:])
    same(running.result, kalman_filter(z, PARAMS[0]))
    with pytest.raises(BadSetting, match="one channel"):
        GrowingRun(FilterParams([1.0, 2.0], 1.0))
