"""The spike-proof fit: spikes go, steps stay, and what is left is fitted as if the spikes had never been there."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest

from kalscope import estimate, kalman_filter
from kalscope.estimation.fit import estimate_fixed_r, estimate_fixed_ratio
from kalscope.estimation.spikes import MAX_SHARE, SIGMAS
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


def fields_of(one, names=None):
    chosen = names or [f.name for f in fields(one) if f.name not in ("message", "outliers")]
    return [getattr(one, name) for name in chosen]


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
    assert found.message == plain.message
    assert found.outliers is None
    assert found.gate is None


def test_spikes_without_noise_are_left_to_the_gate():
    g = np.random.default_rng(5)
    truth = np.cumsum(g.normal(0.0, 1.0, N))
    z = truth.copy()
    spikes = g.choice(N, N // 100, replace=False)
    z[spikes] += 25.0
    found = estimate(z)
    assert found.verdict == "only_spikes"
    assert found.params.gate == found.gate**2
    assert found.ratio == pytest.approx(found.ratio_interval[0])
    assert found.r == found.params.r < 0.05
    errors = [
        np.sqrt(np.mean((kalman_filter(z, one.params).x - truth) ** 2))
        for one in (found, estimate(z, robust=False))
    ]
    assert errors[0] < 0.5 * errors[1]


@pytest.mark.parametrize("seed", range(4))
def test_steps_stay(seed):
    g = np.random.default_rng(seed)
    _, z = walk(seed)
    for place in 10 * g.choice(range(2, N // 10 - 2), 5, replace=False):
        z[place:] += 30.0 * g.choice([-1.0, 1.0])
    assert fields_of(estimate(z)) == fields_of(estimate(z, robust=False))


@pytest.mark.parametrize("length", [3, GATE_LIMIT, GATE_LIMIT + 1, 50])
def test_a_lone_pulse_is_a_movement(length):
    _, z = walk()
    z[500 : 500 + length] += 30.0
    assert fields_of(estimate(z)) == fields_of(estimate(z, robust=False))


@pytest.mark.slow
@pytest.mark.parametrize("ends", [[0], [0, 1], [N - 1], [N - 2, N - 1], [0, N - 1]])
def test_the_ends_are_judged_by_their_only_side(ends):
    _, z = walk()
    z[ends] += 40.0
    assert np.flatnonzero(estimate(z).outliers).tolist() == ends


@pytest.mark.parametrize("factor", [2.0**-60, -1.0, 2.0**60])
def test_the_unit_does_not_matter(factor):
    _, z, _ = spiky()
    before, after = estimate(z), estimate(factor * z)
    assert np.array_equal(before.outliers, after.outliers)
    expected = [factor**2 * before.q, factor**2 * before.r]
    np.testing.assert_allclose(fields_of(after, ("q", "r")), expected, rtol=1e-10)
    assert after.gate == before.gate


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


@pytest.mark.slow
def test_momentum_is_found_without_the_spikes():
    g = np.random.default_rng(3)
    signal = 40.0 * np.sin(np.arange(N) / 40.0) + np.cumsum(np.cumsum(g.normal(0.0, 0.01, N)))
    z = signal + g.normal(0.0, 1.0, N)
    where = np.zeros(N, dtype=bool)
    where[g.choice(N // 6, 20, replace=False) * 6 + 3] = True
    z[where] += 25.0
    found = estimate(z)
    np.testing.assert_array_equal(found.outliers, where)
    oracle = estimate(np.where(where, np.nan, z), robust=False)
    assert found.momentum == oracle.momentum > 0.0
    assert found.params.gate == SIGMAS**2


def test_too_many_are_refused_with_words():
    _, z, where = spiky(share=0.24, beside=2)
    found = estimate(z)
    assert found.outlier_share > MAX_SHARE
    assert found.verdict == "too_many_outliers"
    assert found.params is None
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
    assert plain.verdict == "ok"
    assert fields_of(found, PAIR) == fields_of(plain, PAIR)
    assert found.gate is None
    assert "stay in the fit" in found.message
    assert estimate(z, robust=True).verdict == "no_noise"
