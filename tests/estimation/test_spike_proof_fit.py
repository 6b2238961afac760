"""The spike-proof fit: spikes go, steps stay, and what is left is fitted as if the spikes had never been there."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest

from kalscope import estimate, kalman_filter
from kalscope.estimation.fit import estimate_fixed_r, estimate_fixed_ratio
from kalscope.estimation.spikes import MAX_SHARE
from kalscope.filtering.kernels import GATE_LIMIT

N = 1200


def walk(seed=0, n=N, ratio=0.01):
    """The moving level and the record of it, r = 1."""
    g = np.random.default_rng(seed)
    level = np.cumsum(g.normal(0.0, np.sqrt(ratio), n))
    return level, level + g.normal(0.0, 1.0, n)


def spiky(seed=0, share=0.03, size=20.0, beside=1, n=N):
    """A record with spikes of both signs, and where they are; `beside` stand side by side with one sign."""
    level, z = walk(seed, n)
    g = np.random.default_rng(seed + 1000)
    where = np.zeros(n, dtype=bool)
    for first in g.choice(n // 8 - 2, round(share * n / beside), replace=False) * 8 + 8:
        where[first : first + beside] = True
        z[first : first + beside] += size * g.choice([-1.0, 1.0])
    return level, z, where


def fields_of(one, names=()):
    return [getattr(one, name) for name in names or [f.name for f in fields(one) if f.name != "outliers"]]


PAIR = ("q", "r", "ratio", "momentum")


@pytest.mark.parametrize("size", [10.0, 100.0, 1e6])
@pytest.mark.parametrize("beside", [1, 2, 3])
def test_it_is_the_fit_of_the_record_without_the_spikes(size, beside):
    _, z, where = spiky(size=size, beside=beside)
    found = estimate(z)
    np.testing.assert_array_equal(found.outliers, where)
    oracle = estimate(np.where(where, np.nan, z), robust=False)
    assert found.ratio == pytest.approx(oracle.ratio, rel=1e-12)
    assert oracle.r < found.r < 1.002 * oracle.r  # the few good samples beyond 4 σ
    assert (found.plain_q, found.plain_r) == tuple(fields_of(estimate(z, robust=False), ("q", "r")))
    assert found.outlier_share == where.mean()


@pytest.mark.parametrize("seed", range(6))
def test_without_spikes_it_is_the_plain_fit_bit_for_bit(seed):
    _, z = walk(seed, 600)
    found, plain = estimate(z), estimate(z, robust=False)
    assert fields_of(found) == fields_of(plain)
    assert (found.outliers, found.gate) == (None, None)


def test_spikes_without_noise_are_left_to_the_gate():
    g = np.random.default_rng(5)
    truth = np.cumsum(g.normal(0.0, 1.0, N))
    z = truth.copy()
    spikes = g.choice(N, N // 100, replace=False)
    z[spikes] += 25.0
    found = estimate(z)
    assert (found.verdict, found.params.gate) == ("only_spikes", found.gate**2)
    assert found.ratio == pytest.approx(found.ratio_interval[0])
    assert found.r == found.params.r < 0.05
    first, plain = (kalman_filter(z, one.params).x - truth for one in (found, estimate(z, robust=False)))
    assert np.std(first) < 0.5 * np.std(plain)


@pytest.mark.parametrize("length", [3, GATE_LIMIT, GATE_LIMIT + 1, N])
def test_a_step_and_a_lone_pulse_are_movements(length):
    _, z = walk()
    z[500 : 500 + length] += 30.0
    assert fields_of(estimate(z)) == fields_of(estimate(z, robust=False))


@pytest.mark.slow
@pytest.mark.parametrize("ends", [[0], [0, 1], [N - 1], [N - 2, N - 1], [0, N - 1]])
def test_the_ends_are_judged_by_their_only_side(ends):
    _, z = walk()
    z[ends] += 40.0
    assert np.flatnonzero(estimate(z).outliers).tolist() == ends


def test_missing_samples_and_long_steps_say_the_same():
    _, z, where = spiky()
    gone = np.zeros(N, dtype=bool)
    gone[5::7] = True
    gone[400:420] = True
    holes = np.where(gone, np.nan, z)
    present = ~gone
    steps = np.diff(np.flatnonzero(present), prepend=-1).astype(float)
    one, other = estimate(holes), estimate(z[present], dt=steps)
    np.testing.assert_array_equal(one.outliers, where & present)
    np.testing.assert_array_equal(one.outliers[present], other.outliers)
    assert fields_of(one, PAIR) == fields_of(other, PAIR)
    assert one.outlier_share == other.outlier_share == (where & present).sum() / present.sum()


def test_too_many_are_refused_with_words():
    _, z, where = spiky(share=0.24, beside=2)
    found = estimate(z)
    assert found.outlier_share > MAX_SHARE
    assert (found.verdict, found.params) == ("too_many_outliers", None)
    assert "Check the wiring" in found.message
    assert np.mean(found.outliers == where) > 0.99


@pytest.mark.parametrize("known", [lambda z, **k: estimate_fixed_r(z, 1.0, **k), estimate_fixed_ratio])
def test_one_known_variance_is_spike_proof_too(known):
    _, z, where = spiky()
    found = known(z)
    np.testing.assert_array_equal(found.outliers, where)
    oracle = known(np.where(where, np.nan, z), robust=False)
    assert found.q == pytest.approx(oracle.q, rel=2e-3)
    assert known(z, robust=False).outliers is None


def test_one_step_of_a_coarse_converter_is_no_spike():
    _, z = walk(ratio=0.001)
    coarse = np.round(z / 6.0) * 6.0
    assert estimate(coarse).outliers is None
    coarse[[100, 600, 601]] += 60.0
    assert np.flatnonzero(estimate(coarse).outliers).tolist() == [100, 600, 601]


def test_impacts_that_no_gate_can_tell_from_movement_stay_in_the_fit():
    g = np.random.default_rng(8)
    z = np.cumsum(g.standard_t(2.0, N))
    z[g.choice(N, 3 * N // 100, replace=False)] += 25.0
    found, plain = estimate(z), estimate(z, robust=False)
    assert fields_of(found, PAIR) == fields_of(plain, PAIR)
    assert (plain.verdict, found.gate) == ("ok", None)
    assert "stay in the fit" in found.message
    assert estimate(z, robust=True).verdict == "no_noise"
