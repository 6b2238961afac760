"""How far a curve is from the truth, or from the next sample where the truth is not known. Pure."""

from __future__ import annotations

import math

import numpy as np

from kalscope.common.array import Array


class Errors:
    """Squared errors of curves over the judged samples of a stretch."""

    def __init__(self, z: Array, truth: Array | None, begun: int) -> None:
        """Args: the samples; the truth or None; first sample to judge."""
        self.z, self._truth, self._begun = z, truth, begun
        self.judged = max(len(z) - begun, 0)
        self.words = "error in predicting the next sample" if truth is None else "error against the truth"
        self._rough = rms_step(z)

    def squared(self, curve: Array) -> Array:
        """Against the truth if it is known, else against the next sample, which no causal filter has seen."""
        return (self._ahead(curve) if self._truth is None else (curve - self._truth) ** 2)[self._begun :]

    def _ahead(self, curve: Array) -> Array:
        return np.append((self.z[1:] - curve[:-1]) ** 2, np.nan)

    def rmse(self, curve: Array) -> float | None:
        """RMS error against the truth; None where it is not known."""
        return None if self._truth is None else root_mean(self.squared(curve))

    def prediction(self, curve: Array) -> float:
        """RMS error against the next sample."""
        return root_mean(self._ahead(curve)[self._begun :])

    def roughness(self, curve: Array) -> float:
        """RMS step of the curve over that of the raw signal."""
        return rms_step(curve[self._begun :]) / self._rough if self._rough > 0.0 else math.nan


def root_mean(squares: Array) -> float:
    """Square root of the mean of what is finite; NaN where nothing is."""
    good = squares[np.isfinite(squares)]
    return math.sqrt(float(good.mean())) if len(good) else math.nan


def rms_step(curve: Array) -> float:
    """RMS change from sample to sample."""
    return root_mean(np.diff(curve) ** 2)
