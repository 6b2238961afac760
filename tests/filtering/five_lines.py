"""The filter's five lines as the documents print them, and equality of bits."""

from __future__ import annotations

import math

import numpy as np


def five_lines(z, q, r, p, x, dt=None):
    """The step of design section 1, written out; the diffuse start as its limit."""
    xs, ps, ks, vs, ss = [], [], [], [], []
    for i, sample in enumerate(z):
        p = p + q * (1.0 if dt is None else dt[i])
        k, v, s = 0.0, math.nan, p + r
        if not math.isnan(sample):
            if math.isinf(p):
                x, p, k, s = sample, r, 1.0, math.inf
            else:
                start = math.isnan(x)
                x = sample if start else x
                k = p / (p + r)
                v = math.nan if start else sample - x
                x = x + k * (sample - x)
                p = k * r  # (1 - k) p without its cancellation
        xs.append(x), ps.append(p), ks.append(k), vs.append(v), ss.append(s)
    return tuple(map(np.array, (xs, ps, ks, vs, ss)))


def assert_same_bits(a, b):
    a, b = np.asarray(a, dtype=float), np.asarray(b, dtype=float)
    assert a.shape == b.shape
    both_nan = np.isnan(a) & np.isnan(b)
    assert np.array_equal(a[~both_nan], b[~both_nan])
    assert np.array_equal(np.isnan(a), np.isnan(b))
