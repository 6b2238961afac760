"""What each device loses by one filter that all share, read from a few numbers that its fit stored.

The filter for all is known only once every recording has been fitted. So each fit stores the errors that any shared
λ would have on samples that it has not seen, and the filter of its own to compare with: nothing is read twice.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from kalscope.common.array import Array
from kalscope.estimation.fleet.held_out import LOG_RATIOS, held_out_at
from kalscope.estimation.fleet.many.table import lags_of, reductions_of
from kalscope.filtering.params import FilterParams
from kalscope.filtering.steady_state import steady_state

LOG_OWN, OWN_MOMENTUM, GROWTH = range(3)
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


def left_by(own_ratio: Array, own_momentum: Array, growth: Array) -> Array:
    """What the fits of k devices store, shape (k, WIDTH).

    Args:
        own_ratio: λ of each device's own filter, > 0, shape (k,).
        own_momentum: its momentum, sample periods, 0 = none.
        growth: of `held_out`, shape (k, 23).
    """
    return np.column_stack([np.log(own_ratio), own_momentum, growth])


def losses_of(left: Array, params: FilterParams) -> Losses:
    """What each device loses by a filter.

    Args:
        left: of `left_by`, shape (k, WIDTH); NaN where not known.
        params: the filter that all share, q and r above 0. With momentum the errors are not known.
    """
    ratio, tau = params.q / float(params.r), params.momentum
    shared = steady_state(params)
    own_lag, own_reduction = _settled(left)
    error = np.full(len(left), math.nan) if tau > 0.0 else held_out_at(left[:, GROWTH:], ratio) - 1.0
    return Losses(shared.lag_samples - own_lag, own_reduction - shared.noise_reduction_db, error)


def _settled(left: Array) -> tuple[Array, Array]:
    """Lag in samples and noise reduction in dB of each device's own filter."""
    ratio, tau = np.exp(left[:, LOG_OWN]), left[:, OWN_MOMENTUM]
    lag, reduction = lags_of(ratio), reductions_of(ratio)
    lag[np.isnan(ratio)] = math.nan
    for i in np.flatnonzero((tau > 0.0) & np.isfinite(ratio)).tolist():
        own = steady_state(FilterParams(float(ratio[i]), 1.0, momentum=float(tau[i])))
        lag[i], reduction[i] = own.lag_samples, own.noise_reduction_db
    return lag, reduction
