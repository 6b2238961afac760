"""Which samples of a record are spikes: those that neither the samples before nor those after them predict.

A genuine step is predicted well from the samples after it, and so is a fast movement: both stay.
"""

from __future__ import annotations

import numpy as np

from kalscope.common.array import Array, Mask
from kalscope.common.centred_median import centred_median
from kalscope.estimation.robust import kernels
from kalscope.estimation.robust.kernels import NORMAL, SIGMAS, START_SIGMAS, WINDOW
from kalscope.estimation.sensor.resolution import resolution_of


def unpredicted(z: Array, steps: Array, q: float, r: float, tau: float) -> Array:
    """e²/s of each sample that neither side predicts, by both sides together, shape (n,); 0 for all others.

    Where the samples around it are predicted badly too, the signal is lively there: it takes as many times more.

    Args:
        z: one channel, shape (n,), NaN where missing.
        steps: nominal sample periods before each sample; empty = 1 each.
        q: variance of the movement, unit².
        r: variance of the noise, unit².
        tau: momentum in sample periods, 0 for none.
    """
    return kernels.unpredicted(z, steps, q, r + rounding_variance(z), tau or None)


def far_from_median(z: Array) -> tuple[Mask, bool]:
    """The samples of z, shape (n,), far from the centred median; whether there are more than by chance."""
    present = np.isfinite(z)
    away = np.abs(z[present] - centred_median(z[present], WINDOW))
    scale = NORMAL * float(np.median(away))
    if scale == 0.0 and away.any():
        scale = float(np.median(away[away > 0.0]))
    far = np.zeros(len(z), dtype=bool)
    far[present] = away > START_SIGMAS * scale
    return far, kernels.beyond_chance(away / scale if scale > 0.0 else away, START_SIGMAS)


def more_than_chance(scores: Array, z: Array) -> bool:
    """Whether the samples that neither side predicts are more, or farther away, than normal noise explains.

    Args:
        scores: of `unpredicted`.
        z: the record, shape (n,).
    """
    return kernels.beyond_chance(np.sqrt(scores[np.isfinite(z)]), SIGMAS)


def rounding_variance(z: Array) -> float:
    """Δ²/12 of a record of which many readings equal the one before, else 0: one step of Δ is not a spike."""
    readings = z[np.isfinite(z)]
    return resolution_of(readings) ** 2 / 12.0 if kernels.repeats(readings) else 0.0
