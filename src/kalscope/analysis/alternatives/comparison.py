"""The comparison: the present filter, every candidate at the same lag or noise, their errors, and what to say."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from kalscope.analysis.alternatives.candidates import Candidate, Description, at_lag, at_noise
from kalscope.analysis.alternatives.error_measures import Errors
from kalscope.analysis.alternatives.filters import settled
from kalscope.analysis.alternatives.verdict import Difference, difference, overshoot_words, refusal, verdict
from kalscope.analysis.alternatives.versus_smoothing import identity_words
from kalscope.common.array import Array
from kalscope.common.text import decibels, plural
from kalscope.errors import BadSetting
from kalscope.filtering.arrays import one_channel, scalar
from kalscope.filtering.batch import FilterResult, kalman_filter, smooth
from kalscope.filtering.classic.bench import bench_of
from kalscope.filtering.params import FilterParams
from kalscope.filtering.steady_state import SteadyState, steady_state

Match = Literal["lag", "noise"]

MAX_SAMPLES = 200_000
"""Samples of the stretch that is compared at most: seconds matter, and more would change no verdict."""


MAX_MISS_DB = 0.424
"""Noise reductions that differ by less, 5 % of the amplitude that is left, count as equal, dB."""

MAX_NOISE_GAIN = 0.999
"""Share of the noise that a window or a gain of 1 leaves at least: no filter, and so equal to none."""


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
    """Whether it filters at all, and is within 5 % or half a sample of the lag asked for, or 5 % of the noise."""
    against: Difference | None = None
    """Its error against that of the current filter; None for the current one and for those not causal."""


@dataclass(frozen=True)
class Comparison:
    """The present filter and the others over one stretch of a channel."""

    match: Match
    """What they were made equal in."""
    first: int
    """First sample of the stretch."""
    last: int
    """One past its last sample."""
    judged: int
    """Samples of the stretch after every causal filter has started: the errors are theirs."""
    present: Alternative
    """The Kalman filter at the present q and r."""
    others: tuple[Alternative, ...]
    """The candidates, then the smoother; empty where there is nothing to match."""
    verdict: str
    """Which is better, by how much, and whether that is more than chance."""
    identity: str
    """What the present filter is, and what its start and its gaps add, with numbers from this recording."""
    note: str
    """What was compared: stretch, samples, the measure of error."""


@np.errstate(over="ignore")
def compare_alternatives(
    z: ArrayLike,
    params: FilterParams,
    *,
    match: Match = "lag",
    dt: ArrayLike | None = None,
    truth: ArrayLike | None = None,
    window: tuple[int, int] | None = None,
) -> Comparison:
    """Compare the present filter with simpler ones at equal lag or equal noise reduction.

    Args:
        z: measurements of one channel, shape (n,); NaN is a missing sample.
        params: the present setting, scalars.
        match: "lag" or "noise".
        dt: nominal sample periods before each sample, shape (n,); only the Kalman filter and the smoother use it.
        truth: the noise-free signal, shape (n,), where it is known.
        window: samples of interest (first, one past last); a stretch of at most 200,000 around them is compared.

    Raises:
        BadSetting: z or params do not fit; `match` is neither.

    Sources: ramp lag and Σh² from each filter's weights; Casiez et al. (2012) for the one-euro filter; Savitzky &
    Golay (1964), Anal. Chem. 36, 1627; errors by blocks as in Diebold & Mariano (1995), JBES 13, 253.
    """
    if match not in ("lag", "noise"):
        raise BadSetting(f'match must be "lag" or "noise" (got {match!r})')
    samples = one_channel(z, params)
    first, last = stretch_of(len(samples), window)
    part = slice(first, last)
    piece = np.ascontiguousarray(samples[part])
    steps, true = (None if each is None else np.asarray(each, dtype=np.float64)[part] for each in (dt, truth))
    result = kalman_filter(piece, params, steps)
    steady = steady_state(params)
    lag, gain, moves = float(steady.lag_samples), float(steady.gain), scalar(params.momentum) > 0.0
    refused = refusal(piece, lag, gain)
    chosen = _candidates(piece, result, steady, match, moves) if refused is None else ()
    begun = _begun(piece, [one for one in chosen if one.causal])
    errors = Errors(piece, true, begun)
    present = _present(result, steady, errors, moves)
    if refused is not None:
        note = _note(first, last, len(samples), 0, true)
        return Comparison(match, first, last, 0, present, (), verdict=refused, identity="", note=note)
    # Errors with momentum follow each other for longer than the lag: for as long as the filter takes to settle.
    memory = max(lag, float(steady.settle_samples) / math.log(100.0)) if moves else lag
    others = _others(chosen, present, errors, match, memory)
    offline = _smoother(piece, params, steps, errors)
    return Comparison(
        match=match,
        first=first,
        last=last,
        judged=errors.judged,
        present=present,
        others=(*others, offline),
        verdict=_verdict(present, others, match, errors, memory),
        identity=identity_words(piece, result, params, settled(piece, params)),
        note=_note(first, last, len(samples), errors.judged, true),
    )


def _candidates(
    z: Array, result: FilterResult, steady: SteadyState, match: Match, moves: bool
) -> tuple[Candidate, ...]:
    """The candidates, as tuned to the lag or the noise of the present filter."""
    lag, gain = float(steady.lag_samples), float(steady.gain)
    share = 10.0 ** (-0.1 * float(steady.noise_reduction_db)) if moves else gain / (2.0 - gain)
    # What has the noise of a filter with momentum lags more than that does.
    bench = bench_of(z, result.x, 0.5 * (1.0 / share - 1.0) if moves and match == "noise" else lag)
    return at_lag(lag, bench) if match == "lag" else at_noise(share, bench)


def stretch_of(n: int, window: tuple[int, int] | None) -> tuple[int, int]:
    """First sample and one past the last of the stretch to compare: all, or MAX_SAMPLES around the window."""
    if n <= MAX_SAMPLES:
        return 0, n
    low, high = window or (0, n)
    first = min(max((low + high - MAX_SAMPLES) // 2, 0), n - MAX_SAMPLES)
    return first, first + MAX_SAMPLES


def _present(result: FilterResult, steady: SteadyState, errors: Errors, moves: bool) -> Alternative:
    gain, lag = float(steady.gain), float(steady.lag_samples)
    close = np.abs(result.k - gain) <= 0.01 * gain
    less = "Lags less for the same noise, because it keeps the direction, and overshoots for it."
    overshoot = float(steady.overshoot)
    return Alternative(
        name="Kalman (present)",
        parameters=f"K = {gain:.4g}" + (f", L = {float(steady.velocity_gain):.4g}" if moves else ""),
        curve=result.x,
        causal=True,
        lag_samples=lag,
        noise_reduction_db=float(steady.noise_reduction_db),
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


def _others(
    chosen: tuple[Candidate, ...], present: Alternative, errors: Errors, match: Match, memory: float
) -> tuple[Alternative, ...]:
    lag, reduction = present.lag_samples, present.noise_reduction_db
    causal = sum(candidate.causal for candidate in chosen)
    own = errors.squared(present.curve)
    made: list[Alternative] = []
    for candidate in chosen:
        curve = candidate.run(errors.z)
        gain = candidate.noise_gain
        decibel = -10.0 * math.log10(gain) if gain > 0.0 else math.inf
        near = (
            is_matched(candidate.lag_samples - lag, lag)
            if match == "lag"
            else abs(decibel - reduction) <= MAX_MISS_DB
        )
        made.append(
            Alternative(
                **{one.name: getattr(candidate, one.name) for one in fields(Description)},
                curve=curve,
                noise_reduction_db=decibel,
                rmse=errors.rmse(curve),
                prediction=errors.prediction(curve) if candidate.causal else None,
                roughness=errors.roughness(curve),
                matched=near and gain < MAX_NOISE_GAIN,
                against=difference(errors.squared(curve), own, memory, causal) if candidate.causal else None,
            )
        )
    return tuple(made)


def is_matched(miss: float, lag: float) -> bool:
    """Whether a lag that misses the one asked for by so many samples counts as equal to it."""
    return abs(miss) <= max(0.05 * lag, 0.5 + 1e-9)


def _verdict(
    present: Alternative, others: tuple[Alternative, ...], match: Match, errors: Errors, memory: float
) -> str:
    """The verdict on those that came near enough to what was asked; the rest are named."""
    runnable = [one for one in others if one.against is not None]
    equal = [one for one in runnable if one.matched]
    words = "lag" if match == "lag" else "noise reduction"
    said = verdict(
        [one.name for one in equal],
        [one.against for one in equal if one.against],
        errors.words,
        words,
        memory,
        errors.judged,
    )
    far = [
        f"{one.name[:1].lower()}{one.name[1:]} ("
        + (f"{plural(one.lag_samples, 'sample')})" if match == "lag" else f"{decibels(one.noise_reduction_db)})")
        for one in runnable
        if not one.matched
    ]
    if not said.startswith("At equal"):
        return said
    if far:
        said = f"{said} Not available at this {words}: {', '.join(far)}."
    return said + overshoot_words(present.overshoot, [(one.name, one.overshoot) for one in equal])


def _smoother(z: Array, params: FilterParams, steps: Array | None, errors: Errors) -> Alternative:
    curve = smooth(z, params, steps).x
    return Alternative(
        name="Smoother (offline bound)",
        parameters="same parameters, both ways" if scalar(params.momentum) else "same q and r, both ways",
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


def _begun(z: Array, causal: list[Candidate]) -> int:
    """Sample from which on every causal filter has started; at most half of the stretch."""
    before = int(np.argmax(np.isfinite(z))) if len(z) else 0
    return min(before + max((one.start_samples for one in causal), default=0), len(z) // 2)


def _note(first: int, last: int, n: int, judged: int, truth: Array | None) -> str:
    stretch = f"all {n} samples" if last - first == n else f"samples {first} to {last - 1} of {n}"
    by = (
        "how well each predicts the next sample, which none has used"
        if truth is None
        else "the difference from the known truth"
    )
    later = f" Errors: {by}, over the last {judged} samples, once all have started." if judged else ""
    return f"Compared on {stretch}.{later}"
