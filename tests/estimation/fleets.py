"""Simulated fleets: random walks in noise, a device a row, each with its own q and r."""

from __future__ import annotations

import numpy as np


def fleet(devices, samples, q=0.01, r=1.0, seed=1):
    """Records of shape (devices, samples); q and r are numbers, or one a device."""
    rng = np.random.default_rng(seed)
    steps, noise = rng.standard_normal((2, devices, samples))
    q, r = (np.broadcast_to(np.asarray(value, float), (devices,))[:, None] for value in (q, r))
    return np.cumsum(steps, axis=1) * np.sqrt(q) + noise * np.sqrt(r)
