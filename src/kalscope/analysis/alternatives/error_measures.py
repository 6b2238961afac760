"""How far a curve is from the truth, or from the next sample where the truth is not known. Pure."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from kalscope.common.array import Array

SPIKE = 6.0
"""Distance from the median of five around it, in robust standard deviations, from which a sample is a spike."""


class Errors:
    """Squared errors of curves over the judged samples of a stretch.

    No filter should predict a spike: without the truth, spikes are left out, the same ones for every filter. What a
    spike does to the samples after it counts.
    """

    def __init__(self, z: Array, truth: Array | None, begun: int) -> None:
        """Args: the samples; the truth or None; first sample to judge."""
        self.z, self._truth, self._begun = z, truth, begun
        self.judged = max(len(z) - begun, 0)
        self.words = "error in predicting the next sample" if truth is None else "error against the truth"
        self._rough = rms_step(z)
        self._ahead_of = np.append(z[1:], np.nan)
        aside = np.append(spikes_in(z)[1:], False)
        self._ahead_of[aside] = np.nan
        self.spikes = 0 if truth is not None else int(aside[begun:].sum())
        """Samples that are not judged because they are spikes."""

    def squared(self, curve: Array) -> Array:
        """Against the truth if it is known, else against the next sample, which no causal filter has seen."""
        return (self._ahead(curve) if self._truth is None else (curve - self._truth) ** 2)[self._begun :]

    def _ahead(self, curve: Array) -> Array:
        return (self._ahead_of - curve) ** 2

    def rmse(self, curve: Array) -> float | None:
        """RMS error against the truth; None where it is not known."""
        return None if self._truth is None else root_mean(self.squared(curve))

    def prediction(self, curve: Array) -> float:
        """RMS error against the next sample."""
        return root_mean(self._ahead(curve)[self._begun :])

    def roughness(self, curve: Array) -> float:
        """RMS step of the curve over that of the raw signal."""
        return rms_step(curve[self._begun :]) / self._rough if self._rough > 0.0 else math.nan


def spikes_in(z: Array) -> NDArray[np.bool_]:
    """Which samples lie far from the median of five around them, shape of z; a step or a slope never does.

    The standard deviation is that of z less the mean of its neighbours, by its median, so a slope does not count;
    where most readings repeat, it is their smallest change.
    """
    from scipy.ndimage import median_filter

    seen, found = np.isfinite(z), np.zeros(z.shape, dtype=np.bool_)
    there = z[seen]
    if len(there) > 2:
        apart = np.abs(there - median_filter(there, size=5, mode="nearest"))
        rough = there[1:-1] - 0.5 * (there[:-2] + there[2:])
        usual = 1.4826 * math.sqrt(2.0 / 3.0) * float(np.median(np.abs(rough)))
        moved = np.abs(np.diff(there))
        found[seen] = apart > SPIKE * (usual or np.min(moved, where=moved > 0.0, initial=np.inf))
    return found


def root_mean(squares: Array) -> float:
    """Square root of the mean of what is finite; NaN where nothing is."""
    good = squares[np.isfinite(squares)]
    return math.sqrt(float(good.mean())) if len(good) else math.nan


def rms_step(curve: Array) -> float:
    """RMS change from sample to sample."""
    return root_mean(np.diff(curve) ** 2)
