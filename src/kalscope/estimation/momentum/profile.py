"""The likelihood over λ = q/r for a given momentum."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from kalscope.common.array import Array
from kalscope.estimation.likelihood.profile import (
    DEFAULT_LOG_RATIOS,
    Differences,
    Profile,
    profile_input,
    profile_of,
    walk_profile,
)
from kalscope.estimation.momentum.likelihood import moving_sums, step_variance
from kalscope.filtering.params import FilterParams

SPACING = float(DEFAULT_LOG_RATIOS[1] - DEFAULT_LOG_RATIOS[0])
"""Of the values of ln λ."""


def likelihood_profile(
    z: ArrayLike, log_ratios: ArrayLike | None = None, dt: ArrayLike | None = None, momentum: float = 0.0
) -> Profile:
    """Scan the likelihood of one channel over λ, exact diffuse start, in a single pass over the data.

    Args:
        z: measurements, shape (n,), at least two of them finite; NaN is a missing sample.
        log_ratios: ln λ, shape (k,), ascending, within ±300; None = 121 values from −24 to 24, with momentum
            as many more above as its steps are smaller.
        dt: nominal sample periods before each sample, shape (n,), ≥ 0; None = 1 each.
        momentum: τ in nominal sample periods, 0 … 1e5.

    Raises:
        BadSetting: z is not one channel, holds inf or fewer than two finite samples; log_ratios do not ascend or
            exceed ±300; dt does not fit z; momentum is out of its range.
    """
    tau = float(FilterParams(q=1.0, r=1.0, momentum=momentum).momentum)
    if tau == 0.0:
        return walk_profile(z, log_ratios, dt)
    step = step_variance(tau)
    data, grid = profile_input(z, log_ratios, dt, default_log_ratios(step))
    return profile_of(data, grid, *_sums(data, grid, tau, step), step)


def default_log_ratios(step: float) -> Array:
    """Ln λ from lags far beyond any record to no filtering; a step of the signal has the variance q·`step`."""
    more = math.ceil(-math.log(step) / SPACING)
    return np.concatenate([DEFAULT_LOG_RATIOS, DEFAULT_LOG_RATIOS[-1] + SPACING * np.arange(1.0, more + 1.0)])


def _sums(data: Differences, grid: Array, tau: float, step: float) -> tuple[Array, Array]:
    """Σv²/f (in scale²) and Σln f with r = 1, computed with variances near 1 and scaled to that."""
    r = 1.0 / (1.0 + np.exp(grid + math.log(step)))
    q = 1.0 / (np.exp(-grid) + step)
    chi2, logdet = moving_sums(data, q, r, np.full(len(grid), tau))
    return chi2 * r, logdet - data.m * np.log(r)
