"""Fused sensors at chosen rows, and over a record that grows: the numbers of `fuse`, bit for bit."""

from __future__ import annotations

import numpy as np
import pytest
from each import each

from kalscope import BadSetting
from kalscope.filtering.filter import fuse
from kalscope.filtering.fusion.growing import FIRST_CAPACITY, PIECE
from kalscope.filtering.filter import GrowingRun
from kalscope.filtering.chosen import filter_at
from kalscope.filtering.params import FilterParams

NAMES = ("x", "p", "velocity", "velocity_p")


def readings(n, missing=0.02):
    g = np.random.default_rng(7)
    x = np.cumsum(g.normal(0.0, 0.1, n))
    z = x[:, None] + g.normal(size=(n, 3)) * [1.0, 0.5, 2.0] + [0.0, 0.3, -0.2]
    z[g.random((n, 3)) < missing] = np.nan
    return z


def model(momentum, gate=None):
    return FilterParams(0.01, [1.0, 0.25, 4.0], [0.0, 0.3, -0.2], [1.0, 1.0, 1.1], momentum=momentum, gate=gate)


def assert_same(one, other, rows=slice(None)):
    for name in NAMES:
        mine, theirs = getattr(one, name), getattr(other, name)
        assert (mine is None) == (theirs is None)
        assert mine is None or np.array_equal(mine, theirs[rows], equal_nan=True)
    assert one.rejected == other.rejected.sum()


@each("momentum", [0.0, 12.0])
@each("dt", [False, True])
@each("missing", [0.0, 0.02])
def test_chosen_rows_are_those_of_the_whole_run(momentum, dt, missing):
    z = readings(2 * PIECE + 100, missing)
    steps = np.tile([1.0, 2.0], len(z))[: len(z)] if dt else None
    indices = np.array([0, 5, PIECE - 1, PIECE, 2 * PIECE, len(z) - 1])
    params = model(momentum, gate=9.0)
    assert_same(filter_at(z, params, indices, steps), fuse(z, params, steps), indices)


@pytest.mark.parametrize("momentum", [0.0, 12.0])
def test_a_record_that_grows_gives_the_same_numbers(momentum):
    z, params = readings(FIRST_CAPACITY + PIECE + 500), model(momentum, gate=9.0)
    growing = GrowingRun(params)
    for first, last in ((0, 1), (1, 1), (1, 700), (700, len(z))):
        growing.extend(z[first:last])
    assert_same(growing.result, fuse(z, params))
    growing.forget(300)
    assert len(growing) == len(z) - 300
    assert_same(growing.result, fuse(z, params), slice(300, None))


def test_earlier_results_stay_as_they_were():
    z, growing = readings(3 * FIRST_CAPACITY), GrowingRun(model(0.0))
    growing.extend(z[:10])
    early = growing.result
    kept = early.x.copy()
    growing.extend(z[10:])
    assert np.array_equal(early.x, kept, equal_nan=True)


def test_what_is_infinite_is_refused_and_changes_nothing():
    z, growing = readings(20), GrowingRun(model(0.0))
    growing.extend(z)
    with pytest.raises(BadSetting, match="finite"):
        growing.extend(np.array([[np.inf, 0.0, 0.0]]))
    assert len(growing) == 20
