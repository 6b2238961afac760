"""What each device of a fleet loses by a filter that all share."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from kalscope.common.array import Array, Mask
from kalscope.common.checks import above_zero
from kalscope.estimation.fleet import pool_kernels as kernels
from kalscope.estimation.fleet.many.estimate_many import fitted_ratios
from kalscope.estimation.fleet.many.series import Series, above_zero_each, series_of
from kalscope.estimation.fleet.many.table import lags_of, reductions_of
from kalscope.filtering.params import MAX_VARIANCE


@dataclass(frozen=True)
class FleetLoss:
    """What k devices lose by a shared λ, arrays of shape (k,); NaN for a series that cannot be fitted."""

    counted: Mask
    """Whether the series can be fitted."""
    ratio: Array
    """The λ that the device is given."""
    own_ratio: Array
    """The most likely λ of the device alone, 0 … inf."""
    r: Array
    """The r that fits the device best with the shared λ, unit²."""
    loglik_loss: Array
    """By how much the log-likelihood falls below that of the device's own q and r, ≥ 0: with the shared λ, and with
    the common r where one is given."""
    error: Array
    """Root mean square error of predicting the next sample, on the second half of the series with the shared λ,
    unit."""
    own_error: Array
    """The same with the λ that fits the first half best: what a filter of its own would do. NaN for short
    series."""
    slope: Array
    """Derivative of the device's log-likelihood by ln λ at the shared λ."""

    @property
    def error_ratio(self) -> Array:
        """Prediction error with the shared λ over that with a filter of its own; below 1 where sharing helps."""
        with np.errstate(invalid="ignore", divide="ignore"):
            return self.error / self.own_error

    @property
    def lag_loss(self) -> Array:
        """By how many samples the shared filter lags a ramp more than the device's own; −inf for own λ = 0."""
        return lags_of(self.ratio) - lags_of(self.own_ratio)

    @property
    def noise_loss_db(self) -> Array:
        """By how many dB the shared filter reduces white noise less than the device's own; inf for own λ = 0."""
        return reductions_of(self.own_ratio) - reductions_of(self.ratio)


def fleet_loss(
    series: Series | ArrayLike | Sequence[ArrayLike],
    ratio: ArrayLike,
    dt: ArrayLike | Sequence[ArrayLike] | None = None,
    *,
    r: float | None = None,
) -> FleetLoss:
    """What each series loses by a λ that all share, in one compiled call.

    Args:
        series: as `estimate_many` takes them.
        ratio: the shared λ, > 0; one, or one a series (a lag in ms at different sample rates).
        dt: nominal sample periods before each sample, shaped like `series`; None = 1 each.
        r: the common r, unit², > 0, where one is shared too; None = each has its own.

    Raises:
        BadSetting: the series or dt have another shape; ratio or r is not above 0.
    """
    many = series_of(series, dt)
    k = len(many)
    ratios = above_zero_each("ratio", ratio, k)
    common = 0.0 if r is None else above_zero("r", r, MAX_VARIANCE)
    own_ratio, own_loglik = fitted_ratios(many, many.starts[1:])
    half_ratio, _ = fitted_ratios(many, (many.starts[:-1] + many.starts[1:]) // 2)
    numbers, counted = np.full((k, kernels.SHARED), math.nan), np.zeros(k, np.bool_)
    if k:
        kernels.share_each(many.values, many.steps, many.starts, ratios, common, half_ratio, numbers, counted)
    shared = np.ascontiguousarray(numbers.T)
    return FleetLoss(
        counted=counted,
        ratio=ratios,
        own_ratio=np.where(counted, own_ratio, math.nan),
        r=shared[kernels.NOISE],
        loglik_loss=own_loglik - shared[kernels.LOGLIK],
        error=shared[kernels.ERROR],
        own_error=shared[kernels.OWN_ERROR],
        slope=shared[kernels.SLOPE],
    )


def share_served(error_ratio: ArrayLike, within: float = 0.1) -> float:
    """Share of the judged devices whose prediction error grows by at most `within`, 0 … 1; 1 where none is judged.

    Args:
        error_ratio: of `FleetLoss`, NaN where not judged.
        within: allowed growth, 0.1 = 10 %.
    """
    ratios = np.asarray(error_ratio, dtype=np.float64)
    judged = ratios[np.isfinite(ratios)]
    return float(np.mean(judged <= 1.0 + within)) if len(judged) else 1.0
