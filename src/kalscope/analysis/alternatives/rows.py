"""The rows of the comparison: the present filter, each candidate and the smoother, with their errors."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Literal

import numpy as np

from kalscope.analysis.alternatives.candidates import Candidate, Description
from kalscope.analysis.alternatives.error_measures import Errors
from kalscope.analysis.alternatives.verdict import Difference, difference
from kalscope.common.array import Array
from kalscope.filtering.classic.chain import Chain
from kalscope.filtering.classic.chain_filter import ChainFilter
from kalscope.filtering.filter import FilterResult, smooth
from kalscope.filtering.params import FilterParams
from kalscope.filtering.steady_state import SteadyState

Match = Literal["lag", "noise"]
"""What the candidates are matched in."""

MAX_MISS_DB = 0.424
"""Noise reductions that differ by less, 5 % of the amplitude that is left, count as equal, dB."""

MAX_NOISE_GAIN = 0.999
"""Share of the noise from which a candidate does not filter, as with a window or a gain of 1: it matches no
filter."""


@dataclass(frozen=True, kw_only=True)
class Alternative(Description):
    """One filter beside the current one, over the stretch."""

    curve: Array
    """Filtered signal, unit, shape (last − first,); NaN before its first output."""
    noise_reduction_db: float
    """White noise, in to out, dB; on the recording's own noise for median and one-euro; NaN for the smoother."""
    rmse: float | None
    """RMS difference from the truth after the start, unit; None where the truth is not known."""
    prediction: float | None
    """RMS difference from the next sample, unit: an error that needs no truth; None if not causal."""
    roughness: float
    """RMS step of the curve over that of the raw signal; below 1 it is smoother."""
    matched: bool = True
    """Whether it filters at all, and is within 5 % or half a sample of the lag asked for, or 5 % of the noise; a
    median before another filter is compared as it is."""
    against: Difference | None = None
    """Its error against that of the current filter; None for the current one and for those not causal."""


@dataclass(frozen=True)
class Stretch:
    """What is compared, and with what."""

    params: FilterParams
    """The present filter."""
    steps: Array | None
    """Sample periods before each sample, shape (n,); None = 1 each."""
    errors: Errors
    """The samples, and which of them are judged by what."""
    present: Alternative
    """The present filter over them."""
    memory: float
    """Number of samples for which its errors stay correlated."""

    def run(self, chain: Chain) -> Array:
        """A chain over the samples; its Kalman filter is the present one."""
        return ChainFilter(chain, self.params).denoise(self.errors.z, self.steps)


def present_row(result: FilterResult, steady: SteadyState, errors: Errors, moves: bool) -> Alternative:
    """The present filter."""
    gain, lag = steady.gain, steady.lag_samples
    close = np.abs(result.k - gain) <= 0.01 * gain
    less = "Lags less for the same noise, because it keeps the direction, and overshoots for it."
    overshoot = steady.overshoot
    return Alternative(
        name="Kalman (present)",
        parameters=f"K = {gain:.4g}" + (f", L = {steady.velocity_gain:.4g}" if moves else ""),
        curve=result.x,
        causal=True,
        lag_samples=lag,
        noise_reduction_db=steady.noise_reduction_db,
        rmse=errors.rmse(result.x),
        prediction=errors.prediction(result.x),
        roughness=errors.roughness(result.x),
        start_samples=int(np.argmax(close)) if close.any() else len(result.k),
        gaps="lets its variance grow, and weights the next sample more",
        memory=5 if moves else 2,
        overshoot=overshoot,
        sentence="Starts as fast as the noise allows, and knows its own uncertainty, also across gaps."
        + (f" {less}" if overshoot > 0.0 else ""),
    )


def candidate_rows(chosen: tuple[Candidate, ...], stretch: Stretch, match: Match) -> tuple[Alternative, ...]:
    """Each candidate, as a device runs it where one can."""
    own = stretch.errors.squared(stretch.present.curve)
    causal = sum(one.causal for one in chosen)

    def row(one: Candidate) -> Alternative:
        curve = one.run(stretch.errors.z) if one.chain is None else stretch.run(one.chain)
        squared = stretch.errors.squared(curve)
        against = difference(squared, own, stretch.memory, causal) if one.causal else None
        return _candidate_row(one, curve, stretch, match, against)

    return tuple(map(row, chosen))


def _candidate_row(
    one: Candidate, curve: Array, stretch: Stretch, match: Match, against: Difference | None
) -> Alternative:
    errors, present = stretch.errors, stretch.present
    decibel = decibels_of(one.noise_gain)
    near = (
        is_matched(one.lag_samples - present.lag_samples, present.lag_samples)
        if match == "lag"
        else abs(decibel - present.noise_reduction_db) <= MAX_MISS_DB
    )
    return Alternative(
        **{each.name: getattr(one, each.name) for each in fields(Description)},
        curve=curve,
        noise_reduction_db=decibel,
        rmse=errors.rmse(curve),
        prediction=errors.prediction(curve) if one.causal else None,
        roughness=errors.roughness(curve),
        matched=near and one.noise_gain < MAX_NOISE_GAIN,
        against=against,
    )


def decibels_of(gain: float) -> float:
    """A share of the variance that is left as a noise reduction, dB."""
    return -10.0 * math.log10(gain) if gain > 0.0 else math.inf


def smoother_row(stretch: Stretch) -> Alternative:
    """The smoother, which takes later samples too."""
    errors, params = stretch.errors, stretch.params
    curve = smooth(errors.z, params, stretch.steps).x
    return Alternative(
        name="Smoother (offline bound)",
        parameters="same parameters, both ways" if params.momentum else "same q and r, both ways",
        curve=curve,
        causal=False,
        lag_samples=0.0,
        noise_reduction_db=math.nan,
        rmse=errors.rmse(curve),
        prediction=None,
        roughness=errors.roughness(curve),
        start_samples=0,
        gaps="interpolates from both sides",
        memory=0,
        overshoot=math.nan,
        sentence="The best estimate that q and r allow for a finished recording; no device can run it.",
    )


def is_matched(miss: float, lag: float) -> bool:
    """Whether a lag that misses the one asked for by `miss` samples counts as equal to it."""
    return abs(miss) <= max(0.05 * lag, 0.5 + 1e-9)
