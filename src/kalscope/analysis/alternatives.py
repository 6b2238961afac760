"""Is there a simpler filter? The classic filters, tuned to the lag or noise reduction of yours.

The steady Kalman filter of this model is exponential smoothing with α = K, no more and no less; what it adds is
the start-up, the gaps, and that K follows from two variances. The comparison says so, with numbers.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kalscope.analysis.candidates import Candidate, Description, at_lag, at_noise, settled
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


def measured(curve: Array, errors: Errors, *, causal: bool = True) -> dict[str, Any]:
    """A curve with its errors, as an `Alternative` has them."""
    prediction = errors.prediction(curve) if causal else None
    return {
        "curve": curve,
        "rmse": errors.rmse(curve),
        "prediction": prediction,
        "roughness": errors.roughness(curve),
    }


def present_row(result: FilterResult, steady: SteadyState, errors: Errors, moves: bool) -> Alternative:
    """The present filter."""
    close = np.abs(result.k - steady.gain) <= 0.01 * steady.gain
    less = " Lags less for the same noise, because it keeps the direction, and overshoots for it."
    return Alternative(
        name="Kalman (present)",
        parameters=f"K = {steady.gain:.4g}" + (f", L = {steady.velocity_gain:.4g}" if moves else ""),
        **measured(result.x, errors),
        lag_samples=steady.lag_samples,
        noise_reduction_db=steady.noise_reduction_db,
        start_samples=int(np.argmax(close)) if close.any() else len(result.k),
        gaps="lets its variance grow, and weights the next sample more",
        memory=5 if moves else 2,
        overshoot=steady.overshoot,
        sentence="Starts as fast as the noise allows, and knows its own uncertainty, also across gaps."
        + (less if steady.overshoot > 0.0 else ""),
    )


def candidate_rows(chosen: tuple[Candidate, ...], stretch: Stretch, match: Match) -> tuple[Alternative, ...]:
    """Each candidate, as a device runs it where one can."""
    errors, present = stretch.errors, stretch.present
    present_errors = errors.squared(present.curve)
    causal = sum(one.causal for one in chosen)

    def row(one: Candidate) -> Alternative:
        curve = one.run(errors.z) if one.chain is None else stretch.run(one.chain)
        decibel = -10.0 * math.log10(one.noise_gain) if one.noise_gain > 0.0 else math.inf
        near = abs(decibel - present.noise_reduction_db) <= MAX_MISS_DB
        if match == "lag":
            near = is_matched(one.lag_samples - present.lag_samples, present.lag_samples)
        against = difference(errors.squared(curve), present_errors, stretch.memory, causal) if one.causal else None
        return Alternative(
            **{each.name: getattr(one, each.name) for each in fields(Description)},
            **measured(curve, errors, causal=one.causal),
            noise_reduction_db=decibel,
            matched=near and one.noise_gain < MAX_NOISE_GAIN,
            against=against,
        )

    return tuple(map(row, chosen))


def smoother_row(stretch: Stretch) -> Alternative:
    """The smoother, which takes later samples too."""
    errors, params = stretch.errors, stretch.params
    curve = smooth(errors.z, params, stretch.steps).x
    return Alternative(
        name="Smoother (offline bound)",
        parameters="same parameters, both ways" if params.momentum else "same q and r, both ways",
        **measured(curve, errors, causal=False),
        causal=False,
        lag_samples=0.0,
        noise_reduction_db=math.nan,
        start_samples=0,
        gaps="interpolates from both sides",
        memory=0,
        overshoot=math.nan,
        sentence="The best estimate that q and r allow for a finished recording; no device can run it.",
    )


def is_matched(miss: float, lag: float) -> bool:
    """Whether a lag that misses the one asked for by `miss` samples counts as equal to it."""
    return abs(miss) <= max(0.05 * lag, 0.5 + 1e-9)


WINDOWS = (3, 5)
"""Windows of the median that are tried, samples."""

MIN_GAIN = 1e-3
"""A median that lowers the error by less is not worth a row; prediction errors are mostly the noise of the next
sample."""

BEFORE_PRESENT, BEFORE_BEST = "Median, then Kalman", "Median, then the best"
"""Names of the rows: before the present filter, and before the best other one."""


def helpful_medians(others: tuple[Alternative, ...], stretch: Stretch) -> tuple[tuple[Alternative, str], ...]:
    """The medians that help: before the present filter, and before the best of the others if that does better.

    A median takes out spikes before a filter smears them, for a sample or two more lag. So it is compared as it is,
    not at equal lag, and only where it does more than a smaller q would, which costs the same lag.

    Args:
        others: the candidates.
        stretch: what is compared.

    Returns:
        Both filters as one row, and what the verdict says of it, with a leading space.
    """
    better = [one for one in others if one.matched and one.chain and one.against and one.against.better]
    best = min(better, key=lambda one: one.against.ratio if one.against else 1.0, default=None)
    bases = [(BEFORE_PRESENT, stretch.present)] + ([] if best is None else [(BEFORE_BEST, best)])
    tried = (_median_before(name, one, stretch) for name, one in bases)
    return tuple(one for one in tried if one is not None)


def _median_before(name: str, base: Alternative, stretch: Stretch) -> tuple[Alternative, str] | None:
    """The better of the medians before `base`, or None where none helps it."""
    then = base.chain.then if base.chain else None
    errors, best = stretch.errors, None
    for chain in () if isinstance(then, Median) else (Chain(window, then) for window in WINDOWS):
        curve = stretch.run(chain)
        squared = errors.squared(curve)
        found = _better(squared, errors.squared(base.curve), stretch)
        if found is None or (best and best[0].ratio < found.ratio):
            continue
        steady = chain_response(chain, stretch.params, (errors.z, base.curve))
        if _better(squared, errors.squared(_as_slow(steady.lag_samples, stretch)), stretch):
            best = found, chain, curve, steady
    if best is None:
        return None
    found, chain, curve, steady = best
    window, later = chain.median, plural(float(f"{steady.lag_samples - base.lag_samples:.2g}"), "sample")
    spikes = "one sample" if window == WINDOWS[0] else f"up to {window // 2} samples"
    present = errors.squared(stretch.present.curve)
    row = replace(
        base,
        name=name,
        parameters=f"window of {window}" + (f", {lower(then.name)}: {then.words}" if then else ""),
        chain=chain,
        **measured(curve, errors),
        lag_samples=steady.lag_samples,
        noise_reduction_db=steady.noise_reduction_db,
        start_samples=base.start_samples + window,
        memory=base.memory + Median(window).memory,
        against=difference(errors.squared(curve), present, stretch.memory, 2 * len(WINDOWS)),
        sentence=f"The median takes out spikes of {spikes} before the filter sees them, for {later} more lag.",
    )
    if base is not stretch.present:
        return row, ""
    less = f"{percent_of(found.ratio)} smaller ({interval_words(found)})"
    return row, f" With a median of {window} before your filter its {errors.words} is {less}, for {later} more lag."


def _better(error: Array, than: Array, stretch: Stretch) -> Difference | None:
    """The difference of squared errors where it is significantly for the better and worth a row."""
    found = difference(error, than, stretch.memory, 2 * len(WINDOWS))
    return found if found.better and found.ratio < 1.0 - MIN_GAIN else None


def _as_slow(lag: float, stretch: Stretch) -> Array:
    """The present filter with a smaller q, so that it lags as much: a median must do more than slow it down."""
    params = stretch.params
    ratio = ratio_for(lag_samples=lag, momentum=params.momentum)
    return kalman_filter(stretch.errors.z, replace(params, q=ratio * float(params.r)), stretch.steps).x


def identity_words(z: Array, result: FilterResult, params: FilterParams, smoothed: Array) -> str:
    """Sentences on the current filter and the same with the gains it settles to.

    Args:
        z: measurements, shape (n,), NaN where missing.
        result: the output of the current filter.
        params: its parameters.
        smoothed: fixed gains started at the first sample, shape (n,); without momentum exponential smoothing.
    """
    steady, noise = steady_state(params), math.sqrt(float(params.r))
    apart = np.abs(result.x - smoothed)
    seen = np.flatnonzero(np.isfinite(z))
    gaps = np.flatnonzero(np.diff(seen) > 1) if len(seen) else seen
    until = int(seen[gaps[0]]) + 1 if len(gaps) else len(z)
    parts = [
        f"{_settled(steady, params.momentum)} The Kalman filter differs at the start and at gaps.",
        _start(apart[:until], result.k[:until], steady.gain, noise),
        _gaps(apart, result.k, seen, gaps, steady.gain, noise),
    ]
    if params.gate is not None and result.rejected:
        rejected = plural(int(result.rejected), "sample")
        parts.append(f"Your outlier gate rejected {rejected}, which no other filter here does.")
    return " ".join(parts)


def _settled(steady: SteadyState, tau: float) -> str:
    """The settled filter as a formula."""
    gain = number(steady.gain, 4)
    if not tau:
        return f"Once settled your filter is exponential smoothing with α = K = {gain}: x += {gain}·(z − x)."
    kept, ahead = math.exp(-1.0 / tau), -tau * math.expm1(-1.0 / tau)
    return (
        f"Once settled your filter has fixed gains: x += {number(ahead, 4)}·v and v *= {number(kept, 4)} predict,"
        f" then e = z − x corrects, x += {gain}·e and v += {number(steady.velocity_gain, 4)}·e."
    )


def _start(apart: Array, k: Array, gain: float, noise: float) -> str:
    """How far the two differ at the start, and for how long."""
    good = np.isfinite(apart)
    largest = float(apart[good].max(initial=0.0))
    if largest <= 1e-9 * noise or noise == 0.0:
        return "At the start of this recording the two do not differ."
    far = np.flatnonzero(good & (apart > 0.1 * noise))
    begin = int(np.argmax(good))
    lasting = (
        f" and by more than a tenth of that for the first {int(far[-1]) - begin + 1} samples" if len(far) else ""
    )
    quick = k[np.isfinite(k)]
    second = float(quick[begin + 1]) if len(quick) > begin + 1 else gain
    return (
        f"At the start they differ by up to {number(largest / noise, 2)} standard deviations of the noise"
        f"{lasting}: the Kalman filter averages what it has (second gain {number(second, 2)}), fixed "
        "gains stay biased towards the first sample."
    )


def _gaps(apart: Array, k: Array, seen: NDArray[np.intp], gaps: NDArray[np.intp], gain: float, noise: float) -> str:
    """How many gaps there are, and how the first sample after the longest one is weighted."""
    if len(gaps) == 0:
        return "No samples are missing here, so gaps do not matter."
    after = seen[gaps + 1]
    longest = int(np.argmax(np.diff(seen)[gaps]))
    missing = int(np.diff(seen)[gaps][longest]) - 1
    largest = float(np.nanmax(apart[after])) if np.isfinite(apart[after]).any() else 0.0
    apart_by = f", and the two then differ by up to {number(largest / noise, 2)} standard deviations of the noise"
    places = "1 gap" if len(gaps) == 1 else f"{len(gaps)} gaps"
    return (
        f"There {'is' if len(gaps) == 1 else 'are'} {places}; after the longest ({missing} samples) the gain is "
        f"{number(float(k[after[longest]]))} instead of {number(gain)}{apart_by if noise else ''}."
    )


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
    """The candidates, medians that help, then the smoother; empty where there is nothing to match."""
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
    result = kalman_filter(piece, params, steps)
    steady = steady_state(params)
    lag, moves = steady.lag_samples, params.momentum > 0.0
    refused = refusal(piece, lag, steady.gain)
    if refused is not None:
        present = present_row(result, steady, Errors(piece, true, _start_of(piece, [])), moves)
        return Comparison(match, first, last, 0, present, (), verdict=refused, identity="", note="")
    chosen = _candidates(piece, result, steady, match, moves)
    errors = Errors(piece, true, _start_of(piece, [one for one in chosen if one.causal]))
    present = present_row(result, steady, errors, moves)
    # With momentum, errors stay correlated for longer than the lag: for as long as the filter takes to settle.
    memory = max(lag, steady.settle_samples / math.log(100.0)) if moves else lag
    stretch = Stretch(params, steps, errors, present, memory)
    others = candidate_rows(chosen, stretch, match)
    medians = helpful_medians(others, stretch)
    return Comparison(
        match=match,
        first=first,
        last=last,
        judged=errors.judged,
        present=present,
        others=(*others, *(row for row, _ in medians), smoother_row(stretch)),
        verdict=_verdict(others, stretch, match) + "".join(words for _, words in medians),
        identity=identity_words(piece, result, params, settled(piece, params)),
        note=_note(first, last, len(samples), errors.judged, true, errors.spikes),
    )


def _candidates(
    z: Array, result: FilterResult, steady: SteadyState, match: Match, moves: bool
) -> tuple[Candidate, ...]:
    """The candidates, as tuned to the lag or the noise of the present filter."""
    lag, gain = steady.lag_samples, steady.gain
    share = 10.0 ** (-0.1 * steady.noise_reduction_db) if moves else gain / (2.0 - gain)
    # A filter without momentum lags more than one with momentum at the same noise.
    bench = bench_of(z, result.x, 0.5 * (1.0 / share - 1.0) if moves and match == "noise" else lag)
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
    far = [
        f"{lower(one.name)} "
        f"({plural(one.lag_samples, 'sample') if match == 'lag' else decibels(one.noise_reduction_db)})"
        for one in runnable
        if not one.matched
    ]
    missing = f" Not available at this {words}: {', '.join(far)}." if far else ""
    beyond = [(one.name, one.overshoot) for one in runnable if one.matched]
    return f"{text}{missing}{overshoot_words(stretch.present.overshoot, beyond)}"


def _start_of(z: Array, causal: list[Candidate]) -> int:
    """Sample from which on every causal filter has started; at most half of the stretch."""
    before = int(np.argmax(np.isfinite(z))) if len(z) else 0
    return min(before + max((one.start_samples for one in causal), default=0), len(z) // 2)


def _note(first: int, last: int, n: int, judged: int, truth: Array | None, spikes: int) -> str:
    stretch = f"all {n} samples" if last - first == n else f"samples {first} to {last - 1} of {n}"
    by = "the difference from the known truth"
    if truth is None:
        by = "how well each predicts the next sample, which none has used"
    without = f", without {plural(spikes, 'spike')} that none could predict" if spikes else ""
    later = f" Errors: {by}, over the last {judged} samples, once all have started{without}." if judged else ""
    return f"Compared on {stretch}.{later}"
