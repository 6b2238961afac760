"""Which samples of a record are spikes: those that neither the samples before nor those after them predict.

A genuine step is predicted well from its own future, and a fast movement too, so both stay.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kalscope.common.array import Array
from kalscope.estimation.robust.kernels import refused_samples
from kalscope.estimation.sensor.resolution import resolution_of

SIGMAS = 4.0
"""Standard deviations of the innovation beyond which a sample counts as not predicted."""
LONGEST = 4
"""Spikes side by side that are recognised; more of them are taken for a movement."""
START_SIGMAS = 3.0
"""Distance from the running median, in standard deviations of the noise, at which the search starts."""
WINDOW = 2 * LONGEST + 1
"""Samples of the running median: spikes side by side are fewer than half of them."""
FALSE_ALARM = 1e-3
"""Share of records of normal noise in which a spike is found."""
_NORMAL = 1.85
"""Standard deviation of white normal noise over the median of its distances from the running median. It is not
1.48: a sample that is the median itself has the distance 0. Where the signal moves fast it is larger."""
_EQUAL_SHARE = 0.2
"""Share of readings equal to the one before from which the record is called quantised."""

Mask = NDArray[np.bool_]


def unpredicted(z: Array, steps: Array, q: float, r: float, tau: float) -> Array:
    """v²/s of each sample that neither side predicts, the smaller of the two, shape (n,); 0 for all others.

    Args:
        z: one channel, shape (n,), NaN where missing.
        steps: nominal sample periods before each sample; empty = 1 each.
        q: variance of the movement, unit².
        r: variance of the noise, unit².
        tau: momentum in sample periods, 0 for none.
    """
    noise = r + rounding_variance(z)
    sides: list[Array] = []
    for samples, gaps in ((z, steps), (z[::-1], np.append(1.0, steps[:0:-1]) if len(steps) else steps)):
        out = np.empty(len(z))
        refused_samples(np.ascontiguousarray(samples), gaps, q, noise, tau, SIGMAS**2, LONGEST, out)
        sides.append(out)
    return np.minimum(sides[0], sides[1][::-1])


@dataclass(frozen=True)
class Start:
    """Where the search for spikes starts."""

    far: Mask
    """The samples far from the running median, shape (n,)."""
    looks_spiky: bool
    """Whether they are more, or farther away, than normal noise explains."""


def far_from_median(z: Array) -> Start:
    """The samples of z, shape (n,), that are far from the running median."""
    from scipy.ndimage import median_filter

    present = np.isfinite(z)
    samples = z[present]
    away = np.abs(samples - median_filter(samples, WINDOW, mode="nearest"))
    scale = _NORMAL * float(np.median(away))
    if scale == 0.0 and away.any():
        scale = float(np.median(away[away > 0.0]))
    far = np.zeros(len(z), dtype=bool)
    far[present] = away > START_SIGMAS * scale
    return Start(far, _beyond_chance(away / scale if scale > 0.0 else away, START_SIGMAS))


def more_than_chance(scores: Array, z: Array) -> bool:
    """Whether the samples that neither side predicts are more, or farther away, than normal noise explains.

    Args:
        scores: their v²/s, shape (n,), 0 for all others.
        z: the record, shape (n,).
    """
    return _beyond_chance(np.sqrt(scores[np.isfinite(z)]), SIGMAS)


def _beyond_chance(distances: Array, least: float) -> bool:
    """Of normal noise one record in a thousand has one so far away, and fewer have so many beyond `least`."""
    n = len(distances)
    expected = n * math.erfc(least / math.sqrt(2.0))
    many = np.count_nonzero(distances > least) > expected + 4.0 * math.sqrt(expected) + 2.0
    return bool(many) or n * math.erfc(float(distances.max(initial=0.0)) / math.sqrt(2.0)) < FALSE_ALARM


def rounding_variance(z: Array) -> float:
    """Δ²/12 of a record of which many readings equal the one before, else 0: one step of Δ is not a spike."""
    readings = z[np.isfinite(z)]
    if np.count_nonzero(np.diff(readings) == 0.0) <= _EQUAL_SHARE * (len(readings) - 1):
        return 0.0
    return resolution_of(readings) ** 2 / 12.0
