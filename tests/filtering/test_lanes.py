"""Lanes only change how fast chosen samples are filtered: what is kept equals a whole run, bit for bit."""

from __future__ import annotations

import numpy as np
import pytest
from each import each
from hypothesis import given, settings
from hypothesis import strategies as st

from kalscope import BadSetting, FilterParams, kalman_filter
from kalscope.filtering.pieces import lanes
from kalscope.filtering.pieces.chosen import PIECE
from kalscope.filtering.chosen import filter_at, picked
from kalscope.filtering.pieces.lane_kernels import BLOCK, LANES

N = 3 * LANES * PIECE + 1234
RNG = np.random.default_rng(5)
RECORD = np.cumsum(RNG.normal(size=N)) + RNG.normal(size=N)
DRAWN = np.unique(RNG.integers(0, N, 3000))
PLAIN = FilterParams(1.0, 0.25)


def assert_same(z, params, at=DRAWN):
    kept, whole = filter_at(z, params, at), kalman_filter(z, params)
    wanted = whole.at(at)
    for name in ("x", "p", "k", "innovation", "s"):
        np.testing.assert_array_equal(getattr(kept, name), getattr(wanted, name), err_msg=name)
    assert (kept.m, kept.rejected) == (whole.m, whole.rejected)
    assert kept.loglik == pytest.approx(whole.loglik, rel=1e-11)


@pytest.fixture
def stretches(monkeypatch):
    """Every stretch that is filtered in lanes."""
    found, real = [], lanes.filter_stretch

    def noted(*arguments):
        found.append(real(*arguments))
        return found[-1]

    monkeypatch.setattr("kalscope.filtering.pieces.chosen.filter_stretch", noted)
    return found


def period_of(params):
    rows = kalman_filter(RECORD[:PIECE], params)
    cycle = lanes.cycle_of(rows.p, rows.k, rows.s)
    return 0 if cycle is None else len(cycle.p)


def with_period(period):
    """A filter whose variance repeats itself every so many samples."""
    rng = np.random.default_rng(9)
    return next(
        params
        for params in (FilterParams(q, 0.3) for q in rng.uniform(0.2, 2.0, 4000))
        if period_of(params) == period
    )


@pytest.mark.parametrize("period", lanes.PERIODS)
def test_whatever_the_period_of_the_variance(period, stretches):
    assert_same(RECORD, with_period(period))
    assert sum(one.done for one in stretches) > 0.9 * N


@each(("q", "least"), [(1e4, 0.9), (0.01, 0.9), (1e-5, 0.8), (1e-7, 0.5), (1e-12, 0), (0, 0)])
@each("offset", [0.0, -1e9])
def test_whatever_the_gain(q, least, offset, stretches):
    assert_same(RECORD + offset, FilterParams(q, 0.25))
    assert sum(one.done for one in stretches) >= least * N


@pytest.mark.parametrize("params", [FilterParams(1.0, 0.0), FilterParams(0.1, 1.0, p0=0.0, x0=5.0)], ids=repr)
def test_whatever_the_start(params):
    assert_same(RECORD, params)
    assert_same(np.zeros(N), params)


@pytest.mark.slow
@settings(max_examples=40, deadline=None)
@given(st.lists(st.integers(0, N - 1), max_size=4), st.sampled_from([1e-4, 0.01, 1.0]))
def test_whatever_is_missing(missing, q):
    z = RECORD.copy()
    z[missing] = np.nan
    assert_same(z, FilterParams(q, 0.25))


@pytest.mark.slow
@each("lane", range(LANES))
@each("beside", [-1, 0, 1])
def test_a_missing_sample_at_the_edge_of_a_lane(lane, beside, stretches):
    first, warm = PIECE, BLOCK
    z = RECORD.copy()
    z[first + warm + lane * lanes.LONGEST // BLOCK * BLOCK + beside] = np.nan
    assert_same(z, PLAIN)
    assert stretches[0].done < stretches[0].tried


def test_lanes_that_do_not_meet_do_not_count(monkeypatch, stretches):
    monkeypatch.setattr(lanes, "FORGOTTEN", 0.3)  # far too short a warm-up
    assert_same(RECORD + 1e6, FilterParams(1e-6, 0.25))
    assert any(0 < one.done < one.tried for one in stretches)


def test_every_sample_of_a_channel_among_others_can_be_kept():
    table = np.stack([RECORD, -RECORD, RECORD], axis=1)
    assert_same(table[:, 1], PLAIN, np.arange(N))


def test_an_infinite_sample_is_named(stretches):
    z = RECORD.copy()
    z[2 * LANES * PIECE] = -np.inf
    with pytest.raises(BadSetting, match=f"-inf at sample {2 * LANES * PIECE}"):
        filter_at(z, PLAIN, DRAWN)
    assert stretches


def test_a_gate_and_momentum_go_sample_by_sample(stretches):
    assert_same(RECORD, FilterParams(1.0, 0.25, gate=9.0))
    assert_same(RECORD, FilterParams(1.0, 0.25, momentum=5.0))
    assert stretches == []
