"""What each device loses by a filter for all: its prediction errors on samples that no fit has seen."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from kalscope.common.array import Array, Mask
from kalscope.common.checks import above_zero
from kalscope.errors import BadSetting
from kalscope.estimation.estimate import estimate
from kalscope.estimation.fleet import kernels
from kalscope.estimation.fleet.many.plain import fitted_ratios
from kalscope.estimation.fleet.many.series import Series, series_of
from kalscope.estimation.fleet.many.table import lags_of, reductions_of
from kalscope.filtering.filter import kalman_filter
from kalscope.filtering.params import MAX_VARIANCE, FilterParams
from kalscope.filtering.steady_state import steady_state

LOG_RATIOS = np.linspace(-15.0, 7.0, 23)
"""ln λ at which the errors are kept, from a lag of 1,800 samples to none."""
LOG_RATIOS.setflags(write=False)


def held_out(
    series: Series | ArrayLike | Sequence[ArrayLike],
    dt: ArrayLike | Sequence[ArrayLike] | None = None,
    momentum: Mask | None = None,
) -> Array:
    """What each device would lose by any shared λ: prediction error over that of a filter of its own.

    The device's own filter is the most likely one for the first half of its samples; the errors of both, root mean
    squares of predicting the next sample, are those on the second half.

    Args:
        series: as `estimate_many` takes them.
        dt: nominal sample periods before each sample, shaped like `series`; None = 1 each.
        momentum: whose own filter may have momentum, shape (series,); None = none. Such a fit takes as long as in
            `estimate`.

    Returns:
        The ratio at each of LOG_RATIOS, shape (series, 23), above 1 where the device would do better alone; NaN
        where the first half cannot be fitted.

    Raises:
        BadSetting: the series or dt have another shape.
    """
    many = series_of(series, dt)
    k = len(many)
    errors, own_error = np.full((k, len(LOG_RATIOS)), math.nan), np.full(k, math.nan)
    own = fitted_ratios(many, (many.starts[:-1] + many.starts[1:]) // 2)
    if k:
        kernels.errors_of_each(many.values, many.steps, many.starts, np.exp(LOG_RATIOS), own, errors, own_error)
    for i in () if momentum is None else np.flatnonzero(momentum & np.isfinite(own_error)).tolist():
        own_error[i] = _error_with_momentum(*many.one(i), own_error[i])
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(own_error[:, None] > 0.0, errors / own_error[:, None], math.nan)


def _error_with_momentum(z: Array, steps: Array, otherwise: float) -> float:
    """The error on the second half of the filter fitted to the first half, which may have momentum."""
    half, dt = len(z) // 2, steps if len(steps) else None
    found = estimate(z[:half], dt=None if dt is None else dt[:half], momentum="auto", robust=False)
    if found.params is None or not float(found.momentum) > 0.0:
        return otherwise
    seen = kalman_filter(z, found.params, dt).innovation[half:]
    return math.sqrt(float(np.nanmean(seen**2)))


def held_out_at(growth: ArrayLike, ratio: float) -> Array:
    """The ratio of errors at one λ, shape (k,), by a cubic spline through those of `held_out`.

    Between those points it is good to 0.1 %; beyond them the nearest one is used.

    Args:
        growth: of `held_out`, shape (k, 23), also as float32.
        ratio: λ that all share, > 0.

    Raises:
        BadSetting: growth has another shape; ratio is not above 0.
    """
    from scipy.interpolate import CubicSpline

    growth = np.asarray(growth, dtype=np.float64)
    if growth.ndim != 2 or growth.shape[1] != len(LOG_RATIOS):
        raise BadSetting(f"growth must be of shape (devices, {len(LOG_RATIOS)}) (got {growth.shape})")
    place = min(max(math.log(above_zero("ratio", ratio, MAX_VARIANCE)), LOG_RATIOS[0]), LOG_RATIOS[-1])
    judged = np.isfinite(growth).all(axis=1) & (growth > 0.0).all(axis=1)
    out = np.full(len(growth), math.nan)
    if judged.any():
        out[judged] = np.exp(CubicSpline(LOG_RATIOS, np.log(growth[judged]), axis=1)(place))
    return out


def share_served(growth: ArrayLike, within: float = 0.1) -> float:
    """Share of the judged devices whose prediction error grows by at most `within`, 0 … 1; 1 where none is judged.

    Args:
        growth: by which share the error grows, shape (k,); NaN where not judged.
        within: allowed growth, 0.1 = 10 %.
    """
    shares = np.asarray(growth, dtype=np.float64)
    judged = shares[np.isfinite(shares)]
    return float(np.mean(judged <= within)) if len(judged) else 1.0


LOG_RATIO, MOMENTUM, GROWTH = range(3)
"""Columns of what a fit stores: ln λ and momentum of the device's own filter; from GROWTH on `held_out`."""
WIDTH = GROWTH + len(LOG_RATIOS)
"""How many there are."""


@dataclass(frozen=True)
class Losses:
    """What k devices lose by a shared filter, arrays of shape (k,), NaN where not known; below 0 they gain."""

    lag_samples: Array
    """By how many samples it lags a ramp more than the device's own filter."""
    noise_db: Array
    """How much more white noise it leaves than the device's own filter, dB."""
    error: Array
    """By which share its error of predicting the next sample, on the second half of the samples, is larger than
    that of the filter that suits the first half best."""


def loss_inputs(own_ratio: Array, own_momentum: Array, growth: Array) -> Array:
    """What the fits of k devices store, shape (k, WIDTH).

    Args:
        own_ratio: λ of each device's own filter, > 0, shape (k,).
        own_momentum: its momentum, sample periods, 0 = none.
        growth: of `held_out`, shape (k, 23).
    """
    return np.column_stack([np.log(own_ratio), own_momentum, growth])


def losses_of(inputs: Array, params: FilterParams) -> Losses:
    """What each device loses by a filter.

    Args:
        inputs: of `loss_inputs`, shape (k, WIDTH); NaN where not known.
        params: the filter that all share, q and r above 0. With momentum the errors are not known.
    """
    ratio, tau = params.q / float(params.r), params.momentum
    shared = steady_state(params)
    own_lag, own_reduction = _settled(inputs)
    error = np.full(len(inputs), math.nan) if tau > 0.0 else held_out_at(inputs[:, GROWTH:], ratio) - 1.0
    return Losses(shared.lag_samples - own_lag, own_reduction - shared.noise_reduction_db, error)


def _settled(inputs: Array) -> tuple[Array, Array]:
    """Lag in samples and noise reduction in dB of each device's own filter."""
    ratio, tau = np.exp(inputs[:, LOG_RATIO]), inputs[:, MOMENTUM]
    lag, reduction = lags_of(ratio), reductions_of(ratio)
    lag[np.isnan(ratio)] = math.nan
    for i in np.flatnonzero((tau > 0.0) & np.isfinite(ratio)).tolist():
        own = steady_state(FilterParams(float(ratio[i]), 1.0, momentum=float(tau[i])))
        lag[i], reduction[i] = own.lag_samples, own.noise_reduction_db
    return lag, reduction
