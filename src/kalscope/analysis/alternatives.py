"""Is there a simpler filter? The classic filters, tuned to the lag or noise reduction of yours.

The steady Kalman filter of this model is exponential smoothing with α = K, no more and no less; what it adds is
the start-up, the gaps, and that K follows from two variances. The comparison says so, with numbers.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from kalscope.analysis.candidates import Candidate, at_lag, at_noise, settled
from kalscope.analysis.filter_errors import (
    Difference,
    Errors,
    difference,
    interval_words,
    lower,
    overshoot_words,
    percent_of,
    refusal,
    verdict,
)
from kalscope.common.numbers import Array
from kalscope.common.text import decibels, number, plural
from kalscope.errors import BadSetting
from kalscope.filtering.classic import Chain, ChainFilter, Median, bench_of, chain_response
from kalscope.filtering.filter import FilterResult, kalman_filter, smooth
from kalscope.filtering.params import FilterParams, one_channel
from kalscope.filtering.steady import SteadyState, ratio_for, steady_state

Match = Literal["lag", "noise"]
"""What the candidates are matched in."""

MAX_MISS_DB = 0.424
"""Noise reductions that differ by less, 5 % of the amplitude that is left, count as equal, dB."""

MAX_NOISE_GAIN = 0.999
"""Share of the noise from which a candidate does not filter, as with a window or a gain of 1: it matches no
filter."""


@dataclass(frozen=True, kw_only=True)
class Alternative(Candidate):
    """One filter beside the current one, over the stretch."""

    curve: Array
    """Filtered signal, unit, shape (last − first,); NaN before its first output."""
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


def measured(one: Candidate, curve: Array, errors: Errors, **compared: Any) -> Alternative:
    """A candidate with its curve and the errors of it."""
    return Alternative(
        **vars(one),
        curve=curve,
        rmse=errors.rmse(curve),
        prediction=errors.prediction(curve) if one.causal else None,
        roughness=errors.roughness(curve),
        **compared,
    )


@dataclass(frozen=True)
class Stretch:
    """What is compared, and with what."""

    params: FilterParams
    """The present filter."""
    steps: Array | None
    """Sample periods before each sample, shape (n,); None = 1 each."""
    errors: Errors
    """The samples, and which of them are judged by what."""
    present: Candidate
    """The present filter."""
    curve: Array
    """The samples, filtered by it."""
    memory: float
    """Number of samples for which its errors stay correlated."""

    def filtered(self, one: Candidate) -> Array:
        """The samples, filtered by a candidate as a device runs it where one can."""
        if one.chain is None:
            return one.run(self.errors.z)
        return ChainFilter(one.chain, self.params).denoise(self.errors.z, self.steps)

    def against(self, curve: Array, than: Array, comparisons: int) -> Difference:
        """The error of one curve against that of another."""
        errors = self.errors
        return difference(errors.squared(curve), errors.squared(than), self.memory, comparisons)


def present_filter(
    params: FilterParams, steps: Array | None, result: FilterResult, steady: SteadyState
) -> Candidate:
    """The present filter, which gave `result`, in the words of a candidate."""
    close, moves = np.abs(result.k - steady.gain) <= 0.01 * steady.gain, params.momentum > 0.0
    less = " Lags less for the same noise, because it keeps the direction, and overshoots for it."
    return Candidate(
        name="Kalman (present)",
        parameters=f"K = {steady.gain:.4g}" + (f", L = {steady.velocity_gain:.4g}" if moves else ""),
        run=lambda z: kalman_filter(z, params, steps).x,
        lag_samples=steady.lag_samples,
        noise_gain=10.0 ** (-0.1 * steady.noise_reduction_db),
        start_samples=int(np.argmax(close)) if close.any() else len(result.k),
        gaps="lets its variance grow, and weights the next sample more",
        memory=5 if moves else 2,
        overshoot=steady.overshoot,
        sentence="Starts as fast as the noise allows, and knows its own uncertainty, also across gaps."
        + (less if steady.overshoot > 0.0 else ""),
    )


def smoother(params: FilterParams, steps: Array | None) -> Candidate:
    """The smoother, which takes later samples too."""
    return Candidate(
        name="Smoother (offline bound)",
        parameters="same parameters, both ways" if params.momentum else "same q and r, both ways",
        run=lambda z: smooth(z, params, steps).x,
        causal=False,
        lag_samples=0.0,
        noise_gain=math.nan,
        start_samples=0,
        gaps="interpolates from both sides",
        memory=0,
        overshoot=math.nan,
        sentence="The best estimate that q and r allow for a finished recording; no device can run it.",
    )


def candidate_rows(chosen: Sequence[Candidate], stretch: Stretch, match: Match) -> tuple[Alternative, ...]:
    """Each candidate over the stretch."""
    causal = sum(one.causal for one in chosen)

    def row(one: Candidate) -> Alternative:
        curve, present = stretch.filtered(one), stretch.present
        near = abs(one.noise_reduction_db - present.noise_reduction_db) <= MAX_MISS_DB
        if match == "lag":
            near = is_matched(one.lag_samples - present.lag_samples, present.lag_samples)
        matched = near and one.noise_gain < MAX_NOISE_GAIN
        against = stretch.against(curve, stretch.curve, causal) if one.causal else None
        return measured(one, curve, stretch.errors, matched=matched, against=against)

    return tuple(map(row, chosen))


def is_matched(miss: float, lag: float) -> bool:
    """Whether a lag that misses the one asked for by `miss` samples counts as equal to it."""
    return abs(miss) <= max(0.05 * lag, 0.5 + 1e-9)


WINDOWS = (3, 5)
"""Windows of the median that are tried, samples."""

MIN_GAIN = 1e-3
"""A median that lowers the error by less is not worth a row; prediction errors are mostly the noise of the next
sample."""


def helpful_median(stretch: Stretch) -> tuple[Alternative, str] | None:
    """The median that helps most before the present filter, and what the verdict says of it; None = none helps.

    A median takes out spikes before a filter smears them, for a sample or two more lag. So it is compared as it is,
    not at equal lag, and only where it does more than a smaller q would, which costs the same lag.
    """
    params, errors, present = stretch.params, stretch.errors, stretch.present
    rows = list[tuple[float, Alternative, str]]()
    comparisons = 2 * len(WINDOWS)  # each with the present filter and with one that is as slow
    for window in WINDOWS:
        chain = Chain(window)
        one = replace(present, name="Median, then Kalman", parameters=f"window of {window}", chain=chain)
        curve = stretch.filtered(one)
        against = stretch.against(curve, stretch.curve, comparisons)
        if not _is_worth_it(against):
            continue
        response = chain_response(chain, params, (errors.z, stretch.curve))
        ratio = ratio_for(lag_samples=response.lag_samples, momentum=params.momentum)
        as_slow = kalman_filter(errors.z, replace(params, q=ratio * float(params.r)), stretch.steps).x
        if not _is_worth_it(stretch.against(curve, as_slow, comparisons)):
            continue
        later = plural(float(f"{response.lag_samples - present.lag_samples:.2g}"), "sample")
        spikes = "one sample" if window == WINDOWS[0] else f"up to {window // 2} samples"
        one = replace(
            one,
            lag_samples=response.lag_samples,
            noise_gain=10.0 ** (-0.1 * response.noise_reduction_db),
            start_samples=present.start_samples + window,
            memory=present.memory + Median(window).memory,
            sentence=f"The median takes out spikes of {spikes} before the filter sees them, for {later} more lag.",
        )
        less = f"{percent_of(against.ratio)} smaller ({interval_words(against)})"
        words = f" With a median of {window} before your filter its {errors.words} is {less}, for {later} more lag."
        rows.append((against.ratio, measured(one, curve, errors, against=against), words))
    return min(rows, key=lambda row: row[0])[1:] if rows else None


def _is_worth_it(one: Difference) -> bool:
    """Whether an error is smaller, significantly and by enough for a row."""
    return one.better and one.ratio < 1.0 - MIN_GAIN


def identity_words(z: Array, result: FilterResult, params: FilterParams) -> str:
    """Sentences on the current filter and the same with the gains it settles to, started at the first sample.

    Args:
        z: measurements, shape (n,), NaN where missing.
        result: the output of the current filter.
        params: its parameters.
    """
    steady, noise, tau = steady_state(params), math.sqrt(float(params.r)), params.momentum
    gain, seen = number(steady.gain, 4), np.flatnonzero(np.isfinite(z))
    form = f"Once settled your filter is exponential smoothing with α = K = {gain}: x += {gain}·(z − x)."
    if tau:
        kept, ahead = math.exp(-1.0 / tau), -tau * math.expm1(-1.0 / tau)
        predicts = f"x += {number(ahead, 4)}·v and v *= {number(kept, 4)} predict"
        corrects = f"e = z − x corrects, x += {gain}·e and v += {number(steady.velocity_gain, 4)}·e"
        form = f"Once settled your filter has fixed gains: {predicts}, then {corrects}."
    parts = [f"{form} The Kalman filter differs at the start and at gaps."]
    gaps = np.flatnonzero(np.diff(seen) > 1)
    until = int(seen[gaps[0]]) + 1 if len(gaps) else len(z)
    apart = np.abs(result.x - settled(z, params))[:until]
    largest = float(apart[np.isfinite(apart)].max(initial=0.0))
    if largest <= 1e-9 * noise or noise == 0.0:
        parts.append("At the start of this recording the two do not differ.")
    else:
        parts.append(
            f"At the start they differ by up to {number(largest / noise, 2)} standard deviations of the noise: "
            "the Kalman filter averages what it has, fixed gains stay biased towards the first sample."
        )
    if len(gaps):
        longest = int(gaps[np.argmax(np.diff(seen)[gaps])])
        after = int(seen[longest + 1])
        parts.append(
            f"There {'is' if len(gaps) == 1 else 'are'} {plural(len(gaps), 'gap')}; after the longest"
            f" ({after - int(seen[longest]) - 1} samples) the gain is {number(float(result.k[after]))} instead of"
            f" {number(steady.gain)}."
        )
    else:
        parts.append("No samples are missing here, so gaps do not matter.")
    if params.gate is not None and result.rejected:
        rejected = plural(int(result.rejected), "sample")
        parts.append(f"Your outlier gate rejected {rejected}, which no other filter here does.")
    return " ".join(parts)


MAX_SAMPLES = 200_000
"""Maximum number of samples compared: seconds matter, and more would change no verdict."""


@dataclass(frozen=True)
class Comparison:
    """The present filter and the others over one stretch of a channel."""

    match: Match
    """What they were matched in."""
    first: int
    """First sample of the stretch."""
    last: int
    """One past its last sample."""
    judged: int
    """Samples of the stretch after every causal filter has started: the errors are computed over these."""
    present: Alternative
    """The Kalman filter at the present q and r."""
    others: tuple[Alternative, ...]
    """The candidates, a median that helps, then the smoother; empty where there is nothing to match."""
    verdict: str
    """Which is better, by how much, and whether that is more than chance."""
    identity: str
    """What the present filter is, and what its start and its gaps add, with numbers from this recording."""
    note: str
    """What was compared: stretch, samples, the measure of error; "" where the verdict is why nothing was."""


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
        dt: nominal sample periods before each sample, shape (n,); only the Kalman filter, the
            smoother and the one-euro filter use it.
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
    result, steady = kalman_filter(piece, params, steps), steady_state(params)
    yours = present_filter(params, steps, result, steady)
    refused = refusal(piece, steady.lag_samples, steady.gain)
    chosen = () if refused is not None else _candidates(piece, result.x, steady, match, params.momentum > 0.0)
    slowest = max((one.start_samples for one in chosen if one.causal), default=0)
    begun = int(np.argmax(np.isfinite(piece))) if len(piece) else 0
    errors = Errors(piece, true, min(begun + slowest, len(piece) // 2))  # once every causal filter has started
    present = measured(yours, result.x, errors)
    if refused is not None:
        return Comparison(match, first, last, 0, present, (), refused, "", "")
    # With momentum, errors stay correlated for longer than the lag: for as long as the filter takes to settle.
    settling = steady.settle_samples / math.log(100.0) if params.momentum else 0.0
    stretch = Stretch(params, steps, errors, yours, result.x, max(steady.lag_samples, settling))
    others, median = candidate_rows(chosen, stretch, match), helpful_median(stretch)
    both_ways = smoother(params, steps)
    rows = (*others, *(() if median is None else median[:1]), measured(both_ways, both_ways.run(piece), errors))
    words = _verdict(others, stretch, match) + ("" if median is None else median[1])
    identity, note = identity_words(piece, result, params), _note(first, last, len(samples), errors)
    return Comparison(match, first, last, errors.judged, present, rows, words, identity, note)


def _candidates(z: Array, x: Array, steady: SteadyState, match: Match, moves: bool) -> tuple[Candidate, ...]:
    """The candidates, as tuned to the lag or the noise of the present filter, whose curve is x."""
    lag, gain = steady.lag_samples, steady.gain
    share = 10.0 ** (-0.1 * steady.noise_reduction_db) if moves else gain / (2.0 - gain)
    # A filter without momentum lags more than one with momentum at the same noise.
    bench = bench_of(z, x, 0.5 * (1.0 / share - 1.0) if moves and match == "noise" else lag)
    return at_lag(lag, bench) if match == "lag" else at_noise(share, bench)


def stretch_of(n: int, window: tuple[int, int] | None) -> tuple[int, int]:
    """First sample and one past the last of the stretch to compare: all, or MAX_SAMPLES around the window."""
    if n <= MAX_SAMPLES:
        return 0, n
    low, high = window or (0, n)
    first = min(max((low + high - MAX_SAMPLES) // 2, 0), n - MAX_SAMPLES)
    return first, first + MAX_SAMPLES


def _verdict(others: tuple[Alternative, ...], stretch: Stretch, match: Match) -> str:
    """The verdict on those that came near enough to the lag or the noise; the rest are named."""
    errors, words = stretch.errors, "lag" if match == "lag" else "noise reduction"
    runnable = [one for one in others if one.against is not None]
    equal = [(one.name, one.against) for one in runnable if one.matched and one.against]
    text = verdict(equal, errors.words, words, stretch.memory, errors.judged)
    if not text.startswith("At equal"):
        return text
    reached = {
        one.name: plural(one.lag_samples, "sample") if match == "lag" else decibels(one.noise_reduction_db)
        for one in runnable
        if not one.matched
    }
    far = [f"{lower(name)} ({value})" for name, value in reached.items()]
    missing = f" Not available at this {words}: {', '.join(far)}." if far else ""
    beyond = [(one.name, one.overshoot) for one in runnable if one.matched]
    return f"{text}{missing}{overshoot_words(stretch.present.overshoot, beyond)}"


def _note(first: int, last: int, n: int, errors: Errors) -> str:
    stretch = f"all {n} samples" if last - first == n else f"samples {first} to {last - 1} of {n}"
    by = "the difference from the known truth"
    if errors.truth is None:
        by = "how well each predicts the next sample, which none has used"
    without = f", without {plural(errors.spikes, 'spike')} that none could predict" if errors.spikes else ""
    judged = f"over the last {errors.judged} samples, once all have started{without}."
    return f"Compared on {stretch}." + (f" Errors: {by}, {judged}" if errors.judged else "")
