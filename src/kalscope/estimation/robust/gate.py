"""Whether the filter should have a gate: only where it brings the filter nearer to the signal of this record."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from kalscope.common.array import Array, Mask
from kalscope.estimation.robust.kernels import SIGMAS
from kalscope.filtering.filter import denoise, smooth
from kalscope.filtering.params import FilterParams


def advised_gate(z: Array, steps: Array, params: FilterParams, away: Mask) -> float | None:
    """The gate in standard deviations of the innovation; None where the filter does better without.

    A gate keeps spikes out, but it also delays the response to a step. The signal is taken from the smoother, which
    does not get the spikes.

    Args:
        z: one channel, shape (n,), NaN where missing.
        steps: nominal sample periods before each sample; empty = 1 each.
        params: the filter.
        away: the samples set aside, shape (n,).
    """
    dt = steps if len(steps) else None
    signal = smooth(np.where(away, np.nan, z), params, dt).x
    errors: list[float] = []
    for one in (params, replace(params, gate=SIGMAS**2)):
        error = np.abs(denoise(z, one, dt) - signal)
        size = float(np.nanmax(error))
        errors.append(size * float(np.sqrt(np.nanmean((error / size) ** 2))) if size > 0.0 else 0.0)
    return SIGMAS if errors[1] < errors[0] else None
