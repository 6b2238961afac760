"""The comparison: the present filter, every candidate at the same lag or noise, their errors, and what to say."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike

from kalscope.analysis.alternatives.candidates import Candidate, at_lag, at_noise
from kalscope.analysis.alternatives.error_measures import Errors
from kalscope.analysis.alternatives.filters import exponential
from kalscope.analysis.alternatives.measured_response import Bench, bench_of
from kalscope.analysis.alternatives.verdict import Difference, difference, refusal, verdict
from kalscope.analysis.alternatives.versus_smoothing import identity_words
from kalscope.common.array import Array
from kalscope.common.text import decibels, plural
from kalscope.errors import BadSetting
from kalscope.filtering.arrays import one_channel
from kalscope.filtering.batch import FilterResult, kalman_filter
from kalscope.filtering.smoothing import smooth
from kalscope.filtering.steady_state import SteadyState, steady_state

if TYPE_CHECKING:
    from kalscope.filtering.params import FilterParams

Match = Literal["lag", "noise"]

LIMIT = 200_000
"""Samples of the stretch that is compared at most: seconds matter, and more would change no verdict."""


NEAR_DB = 0.424
"""Noise reductions that differ by less, 5 % of the amplitude that is left, count as equal, dB."""

PASSES = 0.999
"""Share of the noise that a window or a gain of 1 leaves at least: no filter, and so equal to none."""


@dataclass(frozen=True)
class Alternative:
    """One filter beside the present one, over the stretch."""

    name: str
    """What it is called."""
    parameters: str
    """Its setting in words; cut-offs in cycles a sample."""
    curve: Array
    """Filtered signal, unit, shape (last − first,); NaN before it has begun."""
    causal: bool
    """Whether a device can run it: it looks ahead at nothing."""
    lag_samples: float
    """Lag on a ramp in samples; measured on a ramp for median and one-euro, at their own noise and speed."""
    lag_s: float | None
    """The same in s; None without a sample period."""
    noise_reduction_db: float
    """White noise, in to out, dB; on the recording's own noise for median and one-euro; NaN for the smoother."""
    rmse: float | None
    """RMS difference from the truth after the start, unit; None where the truth is not known."""
    prediction: float | None
    """RMS difference from the next sample, unit: an error that needs no truth; None for what looks ahead."""
    roughness: float
    """RMS step of the curve over that of the raw signal; below 1 it is smoother."""
    start_samples: int
    """Samples until its start is forgotten (1 % left)."""
    gaps: str
    """What it does where samples are missing."""
    memory: int
    """Numbers that it must remember; 0 = the whole recording."""
    sentence: str
    """What is to be said for it and against it."""
    matched: bool = True
    """Whether it filters at all, and came within 5 % or half a sample of the lag asked for, or 5 % of the noise."""
    against: Difference | None = None
    """Its error against that of the present filter; None for the present one and for what looks ahead."""


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
    sample_period: float | None = None,
    truth: ArrayLike | None = None,
    window: tuple[int, int] | None = None,
) -> Comparison:
    """Compare the present filter with simpler ones at equal lag or equal noise reduction.

    Args:
        z: measurements of one channel, shape (n,); NaN is a missing sample.
        params: the present setting, scalars.
        match: "lag" or "noise".
        dt: nominal sample periods before each sample, shape (n,); only the Kalman filter and the smoother use it.
        sample_period: nominal sample period in s, for the lag in s.
        truth: the noise-free signal, shape (n,), where it is known.
        window: samples of interest (first, one past last); a stretch of at most 200,000 around them is compared.

    Raises:
        BadSetting: z or params do not fit; `match` is neither word.

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
    lag, gain = float(steady.lag_samples), float(steady.gain)
    refused = refusal(piece, lag, gain)
    chosen = () if refused is not None else _chosen(match, lag, gain, bench_of(piece, result.x, lag))
    begun = _begun(piece, [one for one in chosen if one.causal])
    errors = Errors(piece, true, begun, sample_period)
    present = _present(result, steady, errors)
    if refused is not None:
        note = _note(first, last, len(samples), 0, true)
        return Comparison(match, first, last, 0, present, (), verdict=refused, identity="", note=note)
    others = _others(chosen, present, errors, match)
    offline = _smoother(piece, params, steps, errors)
    return Comparison(
        match=match,
        first=first,
        last=last,
        judged=errors.judged,
        present=present,
        others=(*others, offline),
        verdict=_verdict(others, match, errors.words),
        identity=identity_words(piece, result, params, exponential(piece, gain)),
        note=_note(first, last, len(samples), errors.judged, true),
    )


def _chosen(match: Match, lag: float, gain: float, bench: Bench) -> tuple[Candidate, ...]:
    return at_lag(lag, bench) if match == "lag" else at_noise(gain / (2.0 - gain), bench)


def stretch_of(n: int, window: tuple[int, int] | None) -> tuple[int, int]:
    """First sample and one past the last of the stretch to compare: all, or LIMIT around the middle of interest."""
    if n <= LIMIT:
        return 0, n
    low, high = window or (0, n)
    first = min(max((low + high - LIMIT) // 2, 0), n - LIMIT)
    return first, first + LIMIT


def _present(result: FilterResult, steady: SteadyState, errors: Errors) -> Alternative:
    settled, lag = float(steady.gain), float(steady.lag_samples)
    close = np.abs(result.k - settled) <= 0.01 * settled
    return Alternative(
        name="Kalman (present)",
        parameters=f"K = {settled:.4g}",
        curve=result.x,
        causal=True,
        lag_samples=lag,
        lag_s=None if errors.period is None else lag * errors.period,
        noise_reduction_db=float(steady.noise_reduction_db),
        rmse=errors.rmse(result.x),
        prediction=errors.prediction(result.x),
        roughness=errors.roughness(result.x),
        start_samples=int(np.argmax(close)) if close.any() else len(result.k),
        gaps="lets its uncertainty grow, and trusts the next sample more",
        memory=2,
        sentence="Starts as fast as the noise allows, knows its own uncertainty, and grows doubtful over gaps.",
    )


def _others(
    chosen: tuple[Candidate, ...], present: Alternative, errors: Errors, match: Match
) -> tuple[Alternative, ...]:
    lag, reduction = present.lag_samples, present.noise_reduction_db
    causal = sum(candidate.causal for candidate in chosen)
    own = errors.squared(present.curve)
    made: list[Alternative] = []
    for candidate in chosen:
        curve = candidate.run(errors.z)
        behind, gain = candidate.lag, candidate.noise_gain
        decibel = -10.0 * math.log10(gain) if gain > 0.0 else math.inf
        near = is_matched(behind - lag, lag) if match == "lag" else abs(decibel - reduction) <= NEAR_DB
        made.append(
            Alternative(
                name=candidate.name,
                parameters=candidate.words,
                curve=curve,
                causal=candidate.causal,
                lag_samples=behind,
                lag_s=None if errors.period is None else behind * errors.period,
                noise_reduction_db=decibel,
                rmse=errors.rmse(curve),
                prediction=errors.prediction(curve) if candidate.causal else None,
                roughness=errors.roughness(curve),
                start_samples=candidate.start,
                gaps=candidate.gaps,
                memory=candidate.memory,
                sentence=candidate.sentence,
                matched=near and gain < PASSES,
                against=difference(errors.squared(curve), own, lag, causal) if candidate.causal else None,
            )
        )
    return tuple(made)


def is_matched(miss: float, lag: float) -> bool:
    """Whether a lag that misses the one asked for by so many samples counts as equal to it."""
    return abs(miss) <= max(0.05 * lag, 0.5 + 1e-9)


def _verdict(others: tuple[Alternative, ...], match: Match, what: str) -> str:
    """The verdict on those that came near enough to what was asked; the rest are named."""
    runnable = [one for one in others if one.against is not None]
    equal = [one for one in runnable if one.matched]
    words = "lag" if match == "lag" else "noise reduction"
    said = verdict([one.name for one in equal], [one.against for one in equal if one.against], what, words)
    far = [
        f"{one.name[:1].lower()}{one.name[1:]} ("
        + (f"{plural(one.lag_samples, 'sample')})" if match == "lag" else f"{decibels(one.noise_reduction_db)})")
        for one in runnable
        if not one.matched
    ]
    if not far or not said.startswith("At equal"):
        return said
    return f"{said} Not to be had at this {words}, so not judged: {', '.join(far)}."


def _smoother(z: Array, params: FilterParams, steps: Array | None, errors: Errors) -> Alternative:
    curve = smooth(z, params, steps).x
    return Alternative(
        name="Smoother (offline bound)",
        parameters="same q and r, both ways",
        curve=curve,
        causal=False,
        lag_samples=0.0,
        lag_s=None if errors.period is None else 0.0,
        noise_reduction_db=math.nan,
        rmse=errors.rmse(curve),
        prediction=None,
        roughness=errors.roughness(curve),
        start_samples=0,
        gaps="bridges them from both sides",
        memory=0,
        sentence="The best that q and r can say of a finished recording; no device can run it.",
    )


def _begun(z: Array, causal: list[Candidate]) -> int:
    """Sample from which on every causal filter has started; at most half of the stretch."""
    before = int(np.argmax(np.isfinite(z))) if len(z) else 0
    return min(before + max((one.start for one in causal), default=0), len(z) // 2)


def _note(first: int, last: int, n: int, judged: int, truth: Array | None) -> str:
    stretch = f"all {n} samples" if last - first == n else f"samples {first} to {last - 1} of {n}"
    by = (
        "how well each predicts the next sample, which none has seen"
        if truth is None
        else "the difference from the known truth"
    )
    later = f" Errors: {by}, over the last {judged} samples, once all have started." if judged else ""
    return f"Compared on {stretch}.{later}"
