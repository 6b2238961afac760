"""Noise that sensors share is found and named; that of independent ones is not."""

from __future__ import annotations

import numpy as np
import pytest
from effort import FUZZ

from kalscope import estimate_fusion, judge_fusion
from kalscope.filtering.kernels import transition


def sensors(seed, r, *, correlation=0.0, n=500, q=0.01, tau=0.0, missing=0.0):
    """A random walk, or a signal with momentum, read by sensors of which the first two share noise."""
    g = np.random.default_rng(seed)
    x = np.cumsum(np.sqrt(q) * g.normal(size=n))
    if tau:
        e, f, a, b, c = transition(1.0, q, tau)
        v, shocks = np.zeros(n), g.normal(size=(n, 2)) @ np.linalg.cholesky([[a, b], [b, c]]).T
        for i in range(1, n):
            v[i] = e * v[i - 1] + shocks[i, 1]
        x = np.cumsum(np.append(0.0, f * v[:-1]) + shocks[:, 0])
    covariance = np.diag(np.asarray(r, dtype=float))
    covariance[0, 1] = covariance[1, 0] = correlation * np.sqrt(r[0] * r[1])
    z = x[:, None] + g.multivariate_normal(np.arange(len(r)), covariance, size=n)
    z[g.random(z.shape) < missing] = np.nan
    return z


@pytest.mark.slow
def test_two_sensors_that_share_noise_are_named():
    found = 0
    for seed in range(12 * FUZZ):
        r, q = ([1, 1, 0.5], [1, 4, 1], [1, 1, 0.1], [4, 1, 1, 1])[seed % 4], (1e-3, 0.1, 1.0)[seed % 3]
        shared = estimate_fusion(sensors(seed, r, correlation=0.5, q=q), momentum=0.0, robust=False).shared
        found += shared is not None and shared.sensors == (0, 1) and abs(shared.correlation - 0.5) < 0.2
    assert found >= 0.95 * 12 * FUZZ


@pytest.mark.slow
def test_independent_sensors_share_nothing():
    false = 0
    for seed in range(15 * FUZZ):
        g = np.random.default_rng(seed)
        r = 10.0 ** g.uniform(-1.5, 1.5, 2 + seed % 3)
        options = ({"q": 0.0}, {"tau": 8.0, "q": 0.1}, {"missing": 0.3}, {"q": 1.0}, {})[seed % 5]
        z = sensors(seed, r, n=int(g.choice([100, 500, 2000])), **options)
        found = estimate_fusion(z, momentum="auto" if "tau" in options else 0.0, robust=False)
        false += found.shared is not None or found.verdict == "shared_noise"
    assert false <= 0.01 * 15 * FUZZ


@pytest.mark.parametrize("r", [[1.0, 1.0, 0.5], [1.0, 1.0, 4.0]])
def test_no_sentence_promises_what_shared_noise_takes_away(r):
    z = sensors(1, r, correlation=0.9)
    found = estimate_fusion(z, momentum=0.0, robust=False)
    assert found.verdict == "shared_noise"
    assert found.message.startswith("sensor 1 and sensor 2 share noise (correlation 0.9")
    assert found.params is not None
    for judged in (judge_fusion(z, found), judge_fusion(z, found.params)):
        assert "sensor 1 and sensor 2 share noise (correlation 0.9" in judged.headline
        assert "less than the best" not in " ".join(judged.sentences)
