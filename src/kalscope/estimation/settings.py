"""What smoothing costs a record, and three settings by that: light, medium and strong.

Movement lost, the one measure: the filter runs over the two-sided smoother of the best fit, which has the movement
and hardly any noise. The RMS of what it changes there, over the standard deviation of that movement, is lost.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from kalscope.common.numbers import Array
from kalscope.errors import BadSetting
from kalscope.estimation.result import Estimate
from kalscope.filtering.filter import denoise, kalman_filter, smooth
from kalscope.filtering.params import MAX_VARIANCE, FilterParams
from kalscope.filtering.steady import ratio_for, steady_state

SETTINGS = {"light": (0.05, 5.0), "medium": (0.1, 10.0), "strong": (0.2, 20.0)}
"""Movement that each setting may lose, as a share, and its largest lag in samples."""

FIRST_LAG = 0.02
"""First lag of the curve, samples; each of the next is twice as long."""

MOST_LOST, SLOWEST = 0.5, 40.0
"""Share of the movement, and lag in samples, at which the curve ends."""

SHARPEST = 1e-6
"""Least r over q of the smoother: without noise it only bridges missing samples."""

GATES = (None, 4.0, 5.0, 6.0, 7.0, 8.0, 10.0)
"""Gates that are compared where samples were set aside, σ."""

CODES, FEWEST, LONGEST_CODE = (0.05, 0.4), 3, 3.0
"""Least and largest share of the samples that are a code; least number of them; longest mean run."""

KEPT_OUT = 0.1
"""Share of the movement that a gate may keep out: more is a light that is switched rather than spikes."""

BETTER = 0.9
"""An error must be this much smaller than that of the gate already chosen, to replace it."""


@dataclass(frozen=True)
class Cost:
    """A filter without momentum, by what it removes and what it costs."""

    lag_samples: float
    """Lag on a ramp, samples."""
    noise_left: float
    """Share of the standard deviation of white noise that it leaves."""
    movement_lost: float
    """Share of the movement that it loses."""
    name: str = ""
    """One of SETTINGS; "" for another point of the curve."""


def noise_left(params: FilterParams) -> float:
    """Share of the standard deviation of white noise that a settled filter leaves."""
    return 10.0 ** (-0.05 * steady_state(params).noise_reduction_db)


def movement_of(z: Array, dt: Array | None, one: Estimate) -> Array:
    """The movement of a record, shape (n,): the smoother of its estimate, over the samples not set aside.

    It is 0 where the estimate finds none.
    """
    if one.q <= 0.0:
        return np.zeros(len(z))
    kept = z if one.outliers is None else np.where(one.outliers, np.nan, z)
    r = max(float(one.r), SHARPEST * one.q)
    return smooth(kept, FilterParams(q=one.q, r=r, momentum=float(one.momentum)), dt).x


def movement_lost(movement: Array, params: FilterParams, dt: Array | None) -> float:
    """The share that a filter loses of the movement, of `movement_of`; 0 where nothing moves."""
    if not movement.any():
        return 0.0
    size = float(np.nanstd(movement))
    return _rms(denoise(movement, params, dt) - movement) / size if size > 0.0 else 0.0


def expected_error(movement: Array, params: FilterParams, r: float, dt: Array | None) -> float:
    """The RMS error that a filter leaves: what it changes of the movement, and of noise of variance r, unit²."""
    return math.hypot(_rms(denoise(movement, params, dt) - movement), math.sqrt(r) * noise_left(params))


def momentum_gain(z: Array, dt: Array | None, params: FilterParams, one: Estimate) -> float:
    """The share by which the momentum of an estimate makes the error of a filter smaller at the same lag.

    It is below 0 where momentum makes it larger, and 0 where the filter has momentum, the estimate has none, or
    the estimate is of a part of the record.
    """
    r, tau, aside = float(one.r), float(one.momentum), one.outliers
    if params.momentum or not tau or not r > 0.0 or (aside is not None and len(aside) != len(z)):
        return 0.0
    try:
        ratio = ratio_for(lag_samples=steady_state(params).lag_samples, momentum=tau)
    except BadSetting:  # it follows at once, or never
        return 0.0
    movement, moving = movement_of(z, dt, one), FilterParams(q=ratio, r=1.0, momentum=tau)
    return 1.0 - expected_error(movement, moving, r, dt) / expected_error(movement, params, r, dt)


def cost_curve(movement: Array, dt: Array | None) -> tuple[Cost, ...]:
    """What each lag costs, shortest first, the settings among them; () where nothing moves."""
    if not movement.any():
        return ()

    def cost(lag: float, name: str = "") -> Cost:
        params = FilterParams(q=ratio_for(lag_samples=lag), r=1.0)
        return Cost(lag, noise_left(params), movement_lost(movement, params, dt), name)

    points, slowest = [cost(FIRST_LAG)], min(max(len(movement) / 4.0, 1.0), SLOWEST)
    while points[-1].movement_lost < MOST_LOST and points[-1].lag_samples < slowest:
        points.append(cost(2.0 * points[-1].lag_samples))
    lags = np.log([each.lag_samples for each in points])
    lost = np.log(np.maximum.accumulate([max(each.movement_lost, 1e-12) for each in points]))
    for name, (share, longest) in SETTINGS.items():
        lag = math.exp(float(np.interp(math.log(share), lost, lags)))
        points.append(cost(min(lag, longest), name))
    return tuple(sorted(points, key=lambda each: each.lag_samples))


def params_at(lag: float, z: Array, dt: Array | None) -> FilterParams:
    """The filter of this lag in samples, without momentum, with the r that predicts the size of its errors."""
    return with_matching_r(FilterParams(q=ratio_for(lag_samples=lag), r=1.0), z, dt)


def with_matching_r(params: FilterParams, z: Array, dt: Array | None) -> FilterParams:
    """The same q/r, with the r at which v²/s is 1 on average; as it is where the record shows no error."""
    run = kalman_filter(z, params, dt)
    scored = np.isfinite(run.innovation) & np.isfinite(run.s)
    factor = float(np.mean(run.innovation[scored] ** 2 / run.s[scored])) if scored.any() else 0.0
    q, r = params.q * factor, float(params.r) * factor
    return replace(params, q=q, r=r) if min(q, r) > 1e-290 and max(q, r) <= MAX_VARIANCE else params


def with_gate_and_start(
    z: Array, dt: Array | None, params: FilterParams, one: Estimate, movement: Array
) -> FilterParams:
    """The filter with the start and the gate that bring it nearest to the movement, where samples were set aside.

    A gate keeps spikes out but delays steps, so a wider one may leave less error, and none where each would keep
    movement out. Where the first sample is a spike
    the filter begins with the first good one, which the gate then lets it keep.
    """
    if one.outliers is None or not one.outliers.any() or one.q <= 0.0:
        return params
    good = z[np.isfinite(z) & ~one.outliers]
    if len(good) and one.outliers[np.argmax(np.isfinite(z))]:
        params = replace(params, x0=float(good[0]), p0=float(params.r))
    most = KEPT_OUT + movement_lost(movement, replace(params, gate=None, x0=None, p0=None), dt)

    def error_of(one: FilterParams) -> float:
        keeps_out = one.gate is not None and movement_lost(movement, replace(one, x0=None, p0=None), dt) > most
        return math.inf if keeps_out else _rms(denoise(z, one, dt) - movement)

    best, least = params, BETTER * error_of(params)
    for sigma in GATES:
        other = replace(params, gate=None if sigma is None else sigma * sigma)
        error = error_of(other)
        if error < least:
            best, least = other, error
    return best


@np.errstate(over="ignore")
def code_in(z: Array) -> float | None:
    """The reading that stands for none, such as 400 for no echo, where it comes too often for a spike.

    It is at one end of the range, farther from the others than these from each other, and only comes for moments.
    """
    good = z[np.isfinite(z)]
    for value in (good.max(), good.min()) if len(good) else ():
        coded = good == value
        rest, times = good[~coded], np.count_nonzero(coded)
        runs = np.count_nonzero(coded[1:] & ~coded[:-1]) + int(coded[0])
        often = max(FEWEST, CODES[0] * len(good)) <= times <= CODES[1] * len(good) and times <= LONGEST_CODE * runs
        if often and np.abs(rest - value).min() > np.ptp(rest) > 0.0:
            return float(value)
    return None


def _rms(errors: Array) -> float:
    size = float(np.nanmax(np.abs(errors)))
    return size * math.sqrt(float(np.nanmean((errors / size) ** 2))) if size > 0.0 else 0.0
