"""The comparison: the present filter, every candidate at the same lag or noise, their errors, and what to say."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from kalscope.analysis.alternatives.candidates import Candidate, at_lag, at_noise
from kalscope.analysis.alternatives.error_measures import Errors
from kalscope.analysis.alternatives.filters import settled
from kalscope.analysis.alternatives.median_first import helpful_medians
from kalscope.analysis.alternatives.rows import (
    Alternative,
    Match,
    Stretch,
    candidate_rows,
    present_row,
    smoother_row,
)
from kalscope.analysis.alternatives.verdict import overshoot_words, refusal, verdict
from kalscope.analysis.alternatives.versus_smoothing import identity_words
from kalscope.common.array import Array
from kalscope.common.text import decibels, plural
from kalscope.errors import BadSetting
from kalscope.filtering.arrays import one_channel
from kalscope.filtering.classic.bench import bench_of
from kalscope.filtering.filter import FilterResult, kalman_filter
from kalscope.filtering.params import FilterParams
from kalscope.filtering.steady_state import SteadyState, steady_state

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
        present = present_row(result, steady, Errors(piece, true, _begun(piece, [])), moves)
        return Comparison(match, first, last, 0, present, (), verdict=refused, identity="", note="")
    chosen = _candidates(piece, result, steady, match, moves)
    errors = Errors(piece, true, _begun(piece, [one for one in chosen if one.causal]))
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
        others=(*others, *(one.row for one in medians), smoother_row(stretch)),
        verdict=_verdict(others, stretch, match) + "".join(one.words for one in medians),
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
    """The verdict on those that came near enough to what was asked; the rest are named."""
    runnable = [one for one in others if one.against is not None]
    equal = [one for one in runnable if one.matched]
    words = "lag" if match == "lag" else "noise reduction"
    said = verdict(
        [one.name for one in equal],
        [one.against for one in equal if one.against],
        stretch.errors.words,
        words,
        stretch.memory,
        stretch.errors.judged,
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
    return said + overshoot_words(stretch.present.overshoot, [(one.name, one.overshoot) for one in equal])


def _begun(z: Array, causal: list[Candidate]) -> int:
    """Sample from which on every causal filter has started; at most half of the stretch."""
    before = int(np.argmax(np.isfinite(z))) if len(z) else 0
    return min(before + max((one.start_samples for one in causal), default=0), len(z) // 2)


def _note(first: int, last: int, n: int, judged: int, truth: Array | None, spikes: int) -> str:
    stretch = f"all {n} samples" if last - first == n else f"samples {first} to {last - 1} of {n}"
    by = (
        "how well each predicts the next sample, which none has used"
        if truth is None
        else "the difference from the known truth"
    )
    without = f", without {plural(spikes, 'spike')} that none could predict" if spikes else ""
    later = f" Errors: {by}, over the last {judged} samples, once all have started{without}." if judged else ""
    return f"Compared on {stretch}.{later}"
