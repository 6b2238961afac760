"""A chain in steady state: lag, noise reduction, settling; by formula where there is one."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from kalscope.filtering.arrays import scalar
from kalscope.filtering.classic.bench import Run, bench_of
from kalscope.filtering.classic.chain import Chain
from kalscope.filtering.classic.running import RunningStages
from kalscope.filtering.classic.stages import (
    Butterworth,
    Exponential,
    Median,
    MovingAverage,
    OneEuro,
    PowerOfTwo,
    Stage,
)
from kalscope.filtering.filter import denoise
from kalscope.filtering.params import FilterParams
from kalscope.filtering.steady_state import SETTLED, SteadyState, ratio_for, steady_state

if TYPE_CHECKING:
    from kalscope.common.array import Array

MAX_SAMPLES = 200_000
"""Samples of a record, its last ones, that lag and noise are measured on at most."""

MIN_SLOW, WINDOWS_OF_SLOW = 100.0, 10.0
"""A lag above this many samples, and above this many windows of the median before it, is slow: a median changes the
noise that any slow filter passes by the same factor."""

BUTTERWORTH_SETTLED, BUTTERWORTH_TURN = 4.6573, 1.2396
"""When its step response, 1 − e^(−τ) (cos τ + sin τ), stays within 1 % and when it passes 63 %, in lags."""


def last_response(then: Stage | None, params: FilterParams) -> SteadyState:
    """The last filter of a chain alone, in samples; NaN where it must be measured.

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
            still = _smoothing(angle / (1.0 + angle))  # while the signal does not change; faster once it does
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


def chain_response(chain: Chain, params: FilterParams, record: tuple[Array, Array]) -> SteadyState:
    """A chain, in samples.

    A median passes a step (window − 1)/2 samples later and otherwise unchanged; its lag on a ramp under noise, and
    the noise that it leaves, are measured together with the filter behind it.

    Args:
        chain: The filters.
        params: Parameters of the Kalman filter, scalars.
        record: (z, x): the samples, which give the bench its noise, and a filtered curve of them, which gives its
            speed, shape (n,) each.
    """
    then, late = chain.then, 0.5 * (chain.median - 1)
    last = last_response(then, params)
    if chain.median == 1 and not isinstance(then, Median | OneEuro):
        return last
    settle, turn = last.settle_samples + late, scalar(last.time_constant_s) + late
    lag, noise = _measured(chain, params, record, last, turn)
    found = replace(last, lag_samples=lag, noise_reduction_db=noise, cutoff_hz=math.nan)
    return replace(found, settle_samples=settle, time_constant_s=turn)


def _measured(
    chain: Chain, params: FilterParams, record: tuple[Array, Array], last: SteadyState, turn: float
) -> tuple[float, float]:
    """Lag in samples and noise reduction in dB of a chain that no formula describes."""
    z, x = (values[-MAX_SAMPLES:] for values in record)
    lag, slow = last.lag_samples, max(MIN_SLOW, WINDOWS_OF_SLOW * chain.median)
    if lag > slow:  # no ramp would be long enough
        probe = Exponential(1.0 / (1.0 + slow))
        gain = bench_of(z, x, slow).noise_gain(_run(Chain(chain.median, probe), params))
        noise = last.noise_reduction_db - 10.0 * math.log10(gain / probe.noise_gain)
        return lag + 0.5 * (chain.median - 1), noise
    guess = turn + 0.5 * chain.then.window if isinstance(chain.then, Median) else turn
    bench, run = bench_of(z, x, min(guess, 0.25 * MAX_SAMPLES)), _run(chain, params)
    gain = bench.noise_gain(run)
    return bench.lag(run), math.inf if gain == 0.0 else -10.0 * math.log10(gain)


def _run(chain: Chain, params: FilterParams) -> Run:
    """The chain from z to its output, evenly sampled, from the automatic start and without a gate."""
    plain = FilterParams(params.q, params.r, momentum=params.momentum)

    def run(z: Array) -> Array:
        out = RunningStages(chain.stages).take(z, np.empty(0))
        return denoise(out, plain) if chain.then is None else out

    return run


def at_period(found: SteadyState, sample_period: float | None) -> SteadyState:
    """What was found in samples, in s and Hz of a sample period; None where that is not known."""
    if sample_period is None:
        return replace(found, lag_s=None, cutoff_hz=None, time_constant_s=None)
    return replace(
        found,
        lag_s=found.lag_samples * sample_period,
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
    """−3 dB frequency of a moving average, cycles per sample: sin(π f N) = √½ N sin(π f); NaN for a window of 1."""
    if window == 1:
        return math.nan
    low, high = 0.0, 1.0 / window
    for _ in range(60):
        middle = 0.5 * (low + high)
        above = math.sin(math.pi * middle * window) > math.sqrt(0.5) * window * math.sin(math.pi * middle)
        low, high = (middle, high) if above else (low, middle)
    return 0.5 * (low + high)
