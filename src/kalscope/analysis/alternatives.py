"""Is there a simpler filter? The classic filters, tuned to the lag or noise reduction of yours.

The steady Kalman filter of this model is exponential smoothing with α = K, no more and no less; what it adds is
the start-up, the gaps, and that K follows from two variances. The comparison says so, with numbers.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from kalscope.analysis.candidates import Alternative, at_lag, at_noise
from kalscope.analysis.filter_errors import Errors, difference, lower, refusal, root_mean, verdict
from kalscope.common.numbers import Array
from kalscope.common.text import count, decibels, number, percent, plural
from kalscope.errors import BadSetting
from kalscope.filtering.classic import ChainFilter, bench_of
from kalscope.filtering.filter import FilterResult, denoise, kalman_filter, smooth
from kalscope.filtering.params import FilterParams, one_channel
from kalscope.filtering.steady import SteadyState, steady_state

Match = Literal["lag", "noise"]
"""What the candidates are matched in."""

MAX_MISS_DB = 0.424
"""Noise reductions that differ by less, 5 % of the amplitude that is left, count as equal, dB."""

MAX_NOISE_GAIN = 0.999
"""Share of the noise from which a candidate does not filter, as with a window or a gain of 1: it matches no
filter."""


def measured(one: Alternative, curve: Array, errors: Errors, **compared: Any) -> Alternative:
    """A filter with its curve and the errors of it."""
    prediction = errors.prediction(curve) if one.causal else None
    return replace(one, curve=curve, rmse=errors.rmse(curve), prediction=prediction, **compared)


def present_filter(
    params: FilterParams, steps: Array | None, result: FilterResult, steady: SteadyState
) -> Alternative:
    """The present filter, which gave `result`, in the words of a candidate."""
    close, moves = np.abs(result.k - steady.gain) <= 0.01 * steady.gain, params.momentum > 0.0
    less = " Lags less for the same noise, because it keeps the direction, and overshoots for it."
    return Alternative(
        name="Kalman (present)",
        parameters="two speeds"
        if params.fast is not None
        else f"K = {steady.gain:.4g}" + (f", L = {steady.velocity_gain:.4g}" if moves else ""),
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


def smoother(params: FilterParams, steps: Array | None) -> Alternative:
    """The smoother, which takes later samples too."""
    return Alternative(
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


LONGEST = 1000
"""Samples before the one that is estimated, at most, that a fixed-lag smoother takes."""


@np.errstate(over="ignore", invalid="ignore")
def fixed_lag(
    z: Array, params: FilterParams, model: FilterParams | None = None, truth: Array | None = None
) -> Alternative | None:
    """The smoother of a model whose output comes as late as that of a filter, and what that gains.

    The filter's output counts for the earlier sample that it describes best. Without the truth each estimates every
    reading without it, as in cross-validation: what is left beside the noise r is the error.

    Args:
        z: one channel, shape (n,); NaN is a missing sample.
        params: the filter.
        model: what the record follows; None = params.
        truth: the noise-free signal, shape (n,), where it is known.

    Returns:
        None where the record is too short or shows no error beside the noise, and where nothing is gained.
    """
    model = replace(params if model is None else model, gate=None, p0=None, x0=None)
    steady, there = steady_state(params), np.isfinite(z)
    slow = max(steady.settle_samples, steady_state(model).settle_samples)
    if not (there.any() and steady.lag_samples < len(z) / 4 and slow < len(z) / 2):
        return None
    delay, before = max(round(float(steady.lag_samples)), 1), min(math.ceil(slow), LONGEST)
    pulse = np.zeros(before + delay + 1)
    pulse[before] = 1.0
    weights = smooth(pulse, model).x  # what one sample adds to all is what all add to it

    def run(z: Array) -> Array:
        there = np.isfinite(z)
        filled = np.interp(np.arange(len(z)), np.flatnonzero(there), z[there])
        return np.correlate(np.pad(filled, (before, delay), mode="edge"), weights, "valid")

    curve = run(z)
    target, known = (z, 0.0) if truth is None else (truth, 1.0)

    def error(estimates: Array, own: float) -> float:
        missed = (estimates - target)[before:-delay] / (1.0 - own * (1.0 - known))
        return root_mean(missed * missed) ** 2 - (1.0 - known) * float(model.r)

    later = np.append(denoise(z, replace(params, gate=None)), np.full(delay, np.nan))
    answer = denoise(pulse, replace(params, gate=None, p0=None, x0=None))[before:]
    mine = error(curve, float(weights[before]))
    yours = min(error(later[shift : shift + len(z)], float(own)) for shift, own in enumerate(answer))
    if not yours > mine > 0.0:
        return None
    late, less = plural(delay, "sample"), f"{percent(1.0 - math.sqrt(mine / yours))} less error"
    by = "the readings that each was not given" if truth is None else "the truth"
    return Alternative(
        name="Fixed lag",
        parameters=f"{late} later: {less}",
        run=run,
        causal=False,
        lag_samples=float(delay),
        noise_gain=float(weights @ weights),
        start_samples=before,
        memory=len(pulse),
        overshoot=math.nan,
        sentence=f"The smoother of the best fit, {late} late, has {less} than yours as late, by {by}.",
        curve=curve,
        rmse=None if truth is None else math.sqrt(mine),
    )


def identity_words(params: FilterParams) -> str:
    """Sentences on what the current filter is once it has settled."""
    if params.fast is not None:
        return "Your filter has two speeds: its lag is that while the signal moves, its noise that at rest."
    steady, tau = steady_state(params), params.momentum
    gain = number(steady.gain, 4)
    form = f"is exponential smoothing with α = K = {gain}: x += {gain}·(z − x)."
    if tau:
        kept, ahead = math.exp(-1.0 / tau), -tau * math.expm1(-1.0 / tau)
        predicts = f"x += {number(ahead, 4)}·v and v *= {number(kept, 4)} predict"
        corrects = f"e = z − x corrects, x += {gain}·e and v += {number(steady.velocity_gain, 4)}·e"
        form = f"has fixed gains: {predicts}, then {corrects}."
    return (
        f"Once settled your filter {form} The Kalman filter differs at the start, where it averages what it has, "
        "and after gaps, where it gives the next sample more weight."
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
    """The candidates, then the smoother; empty where there is nothing to match."""
    verdict: str
    """Which is better, by how much, and whether that is more than chance."""
    identity: str
    """What the present filter is, and where it differs from that."""
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
    model: FilterParams | None = None,
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
        model: the best fit, for the fixed-lag smoother; None = params.

    Raises:
        BadSetting: z or params do not fit; `match` is neither.

    Sources: ramp lag and Σh² from each filter's weights; Casiez et al. (2012) for the one-euro filter; errors by
    blocks as in Diebold & Mariano (1995), JBES 13, 253.
    """
    if match not in ("lag", "noise"):
        raise BadSetting(f'match must be "lag" or "noise" (got {match!r})')
    samples = one_channel(z, params)
    first, last = stretch_of(len(samples), window)
    part = slice(first, last)
    piece = np.ascontiguousarray(samples[part])
    steps, true = (None if each is None else np.asarray(each, dtype=np.float64)[part] for each in (dt, truth))
    result, steady = kalman_filter(piece, params, steps), steady_state(params)
    if params.fast is not None:  # its lag while the signal moves, its noise at rest
        steady = replace(steady_state(params.moving), noise_reduction_db=steady.noise_reduction_db)
    yours = present_filter(params, steps, result, steady)
    refused = refusal(piece, steady.lag_samples, steady.gain)
    chosen = (
        ()
        if refused is not None
        else _candidates(piece, result.x, steady, match, params.momentum > 0.0 or params.fast is not None)
    )
    slowest = max((one.start_samples for one in chosen), default=0)
    start_at = int(np.argmax(np.isfinite(piece))) if len(piece) else 0
    errors = Errors(piece, true, min(start_at + slowest, len(piece) // 2))  # once every causal filter has started
    present = measured(yours, result.x, errors)
    if refused is not None:
        return Comparison(match, first, last, 0, present, (), refused, "", "")
    # With momentum, errors stay correlated for longer than the lag: for as long as the filter takes to settle.
    settling = steady.settle_samples / math.log(100.0) if params.momentum else 0.0
    memory = max(steady.lag_samples, settling)

    def row(one: Alternative) -> Alternative:
        curve = one.run(piece) if one.chain is None else ChainFilter(one.chain, params).denoise(piece, steps)
        miss_db, miss = one.noise_reduction_db - yours.noise_reduction_db, one.lag_samples - yours.lag_samples
        near = abs(miss_db) <= MAX_MISS_DB
        if match == "lag":
            near = abs(miss) <= max(0.05 * yours.lag_samples, 0.5 + 1e-9)
        against = difference(errors.squared(curve), errors.squared(result.x), memory, len(chosen))
        matched = near and one.noise_gain < MAX_NOISE_GAIN
        return measured(one, curve, errors, matched=matched, against=against)

    others, both_ways = tuple(map(row, chosen)), smoother(params, steps)
    late = fixed_lag(piece, params, model, true)
    rows = (*others, *((late,) if late else ()), measured(both_ways, both_ways.run(piece), errors))
    words, note = _verdict(others, errors, memory, match), _note(first, last, len(samples), errors)
    return Comparison(match, first, last, errors.judged, present, rows, words, identity_words(params), note)


def _candidates(z: Array, x: Array, steady: SteadyState, match: Match, moves: bool) -> tuple[Alternative, ...]:
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


def _verdict(others: tuple[Alternative, ...], errors: Errors, memory: float, match: Match) -> str:
    """The verdict on those that came near enough to the lag or the noise; the rest are named."""
    words = "lag" if match == "lag" else "noise reduction"
    equal = [one for one in others if one.matched]
    differences = [(one.name, one.against) for one in equal if one.against]
    text = verdict(differences, errors.words, words, memory, errors.judged)
    if not text.startswith("At equal"):
        return text
    other = [one for one in others if not one.matched]
    reached = [plural(one.lag_samples, "sample") for one in other]
    if match == "noise":
        reached = [decibels(one.noise_reduction_db) for one in other]
    far = [f"{lower(one.name)} ({value})" for one, value in zip(other, reached, strict=True)]
    missing = f" Not available at this {words}: {', '.join(far)}." if far else ""
    return f"{text}{missing}"


def _note(first: int, last: int, n: int, errors: Errors) -> str:
    part = f"samples {count(first)} to {count(last - 1)} of {count(n)}"
    stretch = f"all {count(n)} samples" if last - first == n else part
    by = "the difference from the known truth"
    if errors.truth is None:
        by = "how well each predicts the next sample, which none has used"
    without = f", without {plural(errors.spikes, 'spike')} that none could predict" if errors.spikes else ""
    judged = f"over the last {count(errors.judged)} samples, once all have started{without}."
    return f"Compared on {stretch}." + (f" Errors: {by}, {judged}" if errors.judged else "")
