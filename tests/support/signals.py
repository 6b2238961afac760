"""Records of the two models themselves: a random walk and a signal with momentum, in white noise."""

from __future__ import annotations

import math

import numpy as np

from kalscope.filtering.kernels import transition


def walk(n, ratio, seed=0, missing=0.0, r=1.0):
    g = np.random.default_rng(seed)
    z = np.cumsum(g.normal(0, math.sqrt(ratio * r), n)) + g.normal(0, math.sqrt(r), n)
    z[g.random(n) < missing] = np.nan
    return z


def moving(n, tau, q=10.0, r=1.0, seed=0, missing=0.0):
    g = np.random.default_rng(seed)
    e, f, a, b, c = transition(1.0, q, tau)
    shocks = g.standard_normal((n, 2)) @ np.linalg.cholesky([[a, b], [b, c]]).T
    x, v, signal = 0.0, g.normal(0.0, math.sqrt(0.5 * q / tau)), np.empty(n)
    for i, (move, turn) in enumerate(shocks):
        x, v = x + f * v + move, e * v + turn
        signal[i] = x
    z = signal + g.normal(0.0, math.sqrt(r), n)
    z[g.random(n) < missing] = np.nan
    return z
