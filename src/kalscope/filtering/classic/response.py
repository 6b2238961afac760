"""What a chain does once its start is forgotten: lag, noise reduction, settling; by formula where there is one."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

from kalscope.filtering.arrays import scalar
from kalscope.filtering.classic.bench import Run, bench_of
from kalscope.filtering.classic.stages import (
    Butterworth,
    Exponential,
    Median,
    MovingAverage,
    OneEuro,
    PowerOfTwo,
    Stage,
)
from kalscope.filtering.params import FilterParams
from kalscope.filtering.steady_state import SETTLED, SteadyState, ratio_for, steady_state

if TYPE_CHECKING:
    from kalscope.common.array import Array

MAX_SAMPLES = 200_000
"""Samples of a record, its last ones, that lag and noise are measured on at most."""

BUTTERWORTH_SETTLED, BUTTERWORTH_TURN = 4.6573, 1.2396
"""Where its answer to a step, 1 − e^(−τ) (cos τ + sin τ), stays within 1 % and where it passes 63 %, in lags."""


def last_response(then: Stage | None, params: FilterParams) -> SteadyState:
    """The last filter of a chain alone, in samples; NaN where only a measurement tells.

    Args:
        then: The classic filter; None = the Kalman filter.
        params: Parameters of that, scalars.
    """
    match then:
        case None:
            return steady_state(params, 1.0)
        case Exponential() | PowerOfTwo():
            return _smoothing(then.alpha)
        case OneEuro():
            angle = 2.0 * math.pi * then.cutoff
            still = _smoothing(angle / (1.0 + angle))  # while the signal stands; faster once it moves
            return replace(still, lag_samples=math.nan, noise_reduction_db=math.nan, cutoff_hz=math.nan)
        case MovingAverage():
            n = then.window
            return _state(1.0 / n, then, _average_cutoff(n), (1.0 - SETTLED) * n, -math.expm1(-1.0) * n)
        case Butterworth():
            gain = 0.5 * then.constants[2]
            settle, turn = BUTTERWORTH_SETTLED * then.lag, BUTTERWORTH_TURN * then.lag
            return replace(_state(gain, then, then.cutoff, settle, turn), overshoot=math.exp(-math.pi))
        case Median():
            half = 0.5 * (then.window + 1)
            return _state(math.nan, then, math.nan, half, half)


def chain_response(
    median: int, then: Stage | None, params: FilterParams, record: tuple[Array, Array], run: Run
) -> SteadyState:
    """A chain, in samples.

    A median passes a step (window − 1)/2 samples later and otherwise unchanged; its lag on a ramp under noise, and
    the noise that it leaves, are measured together with the filter behind it.

    Args:
        median: Window in front; 1 = none.
        then: The classic filter; None = the Kalman filter.
        params: Parameters of that, scalars.
        record: (z, x): the samples and the output, shape (n,) each; their noise and speed are those of the bench.
        run: The whole chain from z to its output.
    """
    last = last_response(then, params)
    if median == 1 and not isinstance(then, Median | OneEuro):
        return last
    late = 0.5 * (median - 1)
    settle, turn = scalar(last.settle_samples) + late, scalar(last.time_constant_s) + late
    z, x = (values[-MAX_SAMPLES:] for values in record)
    guess = late + (0.5 * then.window if isinstance(then, Median) else turn)
    bench = bench_of(z, x, min(guess, 0.25 * MAX_SAMPLES))
    gain = bench.noise_gain(run)
    noise = math.inf if gain == 0.0 else -10.0 * math.log10(gain)
    measured = replace(last, lag_samples=bench.lag(run), noise_reduction_db=noise, cutoff_hz=math.nan)
    return replace(measured, settle_samples=settle, time_constant_s=turn)


def at_period(found: SteadyState, sample_period: float | None) -> SteadyState:
    """What was found in samples, in s and Hz of a sample period; None where that is not known."""
    if sample_period is None:
        return replace(found, lag_s=None, cutoff_hz=None, time_constant_s=None)
    return replace(
        found,
        lag_s=scalar(found.lag_samples) * sample_period,
        cutoff_hz=scalar(found.cutoff_hz) / sample_period,
        time_constant_s=scalar(found.time_constant_s) * sample_period,
    )


def _smoothing(alpha: float) -> SteadyState:
    """Exponential smoothing is the Kalman filter of this gain, which has no variance of its own."""
    passing = alpha >= 1.0
    params = FilterParams(q=1.0, r=0.0) if passing else FilterParams(q=ratio_for(gain=alpha), r=1.0)
    return replace(steady_state(params, 1.0), p=math.nan)


def _state(
    gain: float, stage: MovingAverage | Butterworth | Median, cutoff: float, settle: float, turn: float
) -> SteadyState:
    lag = math.nan if stage.lag is None else stage.lag
    noise_db = math.nan if stage.noise_gain is None else -10.0 * math.log10(stage.noise_gain)
    return SteadyState(
        gain=gain,
        p=math.nan,
        lag_samples=lag,
        lag_s=lag,
        noise_reduction_db=noise_db + 0.0,  # 0 rather than -0
        cutoff_hz=cutoff,
        settle_samples=settle,
        time_constant_s=turn,
    )


def _average_cutoff(window: int) -> float:
    """−3 dB frequency of a moving average, cycles a sample: sin(π f N) = √½ N sin(π f); NaN for a window of 1."""
    if window == 1:
        return math.nan
    low, high = 0.0, 1.0 / window
    for _ in range(60):
        middle = 0.5 * (low + high)
        above = math.sin(math.pi * middle * window) > math.sqrt(0.5) * window * math.sin(math.pi * middle)
        low, high = (middle, high) if above else (low, middle)
    return 0.5 * (low + high)
