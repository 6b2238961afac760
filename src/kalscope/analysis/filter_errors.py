"""The error of a filtered curve, against the truth or the next sample, and which filter has the smaller one."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from kalscope.common.numbers import Array, Mask
from kalscope.common.text import count, number, percent
from kalscope.estimation.fusion import listed

SPIKE = 6.0
"""Distance from the median of five around it, in robust standard deviations, from which a sample is a spike."""


class Errors:
    """Squared errors of curves over the judged samples of a stretch.

    No filter should predict a spike: without the truth, spikes are left out, the same ones for every filter. What a
    spike does to the samples after it counts.
    """

    def __init__(self, z: Array, truth: Array | None, first: int) -> None:
        """Args: the samples; the truth or None; first sample to judge."""
        self.z, self.truth, self._first = z, truth, first
        self.judged = max(len(z) - first, 0)
        self.words = "error in predicting the next sample" if truth is None else "error against the truth"
        aside = np.append(spikes_in(z)[1:], False)
        self._next = np.where(aside, np.nan, np.append(z[1:], np.nan))
        self.spikes = 0 if truth is not None else int(aside[first:].sum())
        """Samples that are not judged because they are spikes."""

    def squared(self, curve: Array) -> Array:
        """Against the truth if it is known, else against the next sample, which no causal filter has seen."""
        return ((curve - (self._next if self.truth is None else self.truth)) ** 2)[self._first :]

    def rmse(self, curve: Array) -> float | None:
        """RMS error against the truth; None where it is not known."""
        return None if self.truth is None else root_mean(self.squared(curve))

    def prediction(self, curve: Array) -> float:
        """RMS error against the next sample."""
        return root_mean(((curve - self._next) ** 2)[self._first :])


def spikes_in(z: Array) -> Mask:
    """Which samples lie far from the median of five around them, shape of z; a step or a slope never does.

    The standard deviation is that of z less the mean of its neighbours, by its median, so a slope does not count;
    where most readings repeat, it is their smallest change.
    """
    from scipy.ndimage import median_filter

    seen, marked = np.isfinite(z), np.zeros(z.shape, dtype=np.bool_)
    there = z[seen]
    if len(there) > 2:
        apart = np.abs(there - median_filter(there, size=5, mode="nearest"))
        rough = there[1:-1] - 0.5 * (there[:-2] + there[2:])
        usual = 1.4826 * math.sqrt(2.0 / 3.0) * float(np.median(np.abs(rough)))
        moved = np.abs(np.diff(there))
        marked[seen] = apart > SPIKE * (usual or np.min(moved, where=moved > 0.0, initial=np.inf))
    return marked


def root_mean(squares: Array) -> float:
    """Square root of the mean of what is finite; NaN where nothing is."""
    good = squares[np.isfinite(squares)]
    return math.sqrt(float(good.mean())) if len(good) else math.nan


MAX_BLOCKS = 100
"""Blocks that a recording is divided into at most."""

MIN_BLOCKS = 8
"""Blocks that an interval needs."""

NEGLIGIBLE = 1e-4
"""A ratio this close to 1 makes no practical difference, however significant."""

MAX_VALUE = 1e120
"""Fourth powers of larger values, or of values below its inverse, overflow or underflow a double."""

CONFIDENCE = 0.95
"""Joint confidence of all intervals of one comparison."""


@dataclass(frozen=True)
class Difference:
    """Mean squared error of one filter against the present one."""

    ratio: float
    """RMS error over that of the present filter; below 1 it is better. NaN where there is nothing to judge."""
    low: float
    """Lower end of the interval of `ratio`."""
    high: float
    """Upper end of it; inf where there are too few blocks."""

    @property
    def real(self) -> bool:
        """Whether the difference is significant and not negligible."""
        return self.better or self.worse

    @property
    def better(self) -> bool:
        """Whether the error is significantly smaller than the current filter's."""
        return self.high < 1.0 and self.ratio < 1.0 - NEGLIGIBLE

    @property
    def worse(self) -> bool:
        """Whether it is significantly larger."""
        return self.low > 1.0 and self.ratio > 1.0 + NEGLIGIBLE


def difference(error: Array, present: Array, lag: float, comparisons: int = 1) -> Difference:
    """Compare squared errors sample by sample, block by block.

    Errors are correlated for about as long as the filter lags, so the blocks are at least ten lags long; their
    means then count as independent. The interval is that of the ratio of two paired means (delta method), with
    Student's t at a Bonferroni level; it excludes 1 where a paired t test would.

    Args:
        error: squared errors of one filter, shape (n,); NaN where it has none.
        present: the same of the present filter.
        lag: its lag in samples.
        comparisons: how many are made at once (Bonferroni).
    """
    both = np.isfinite(error) & np.isfinite(present)
    a, b = error[both], present[both]
    if len(b) == 0 or b.sum() == 0.0:
        return Difference(math.nan, 0.0, math.inf)
    blocks = min(len(b) // block_of(lag), MAX_BLOCKS)
    if blocks < MIN_BLOCKS:
        return Difference(math.sqrt(float(a.mean() / b.mean())), 0.0, math.inf)
    from scipy.stats import t

    square = float(a.mean() / b.mean())
    apart = a / b.mean() - square * (b / b.mean())  # around the ratio itself: two equal filters lose no digits
    means = np.array([part.mean() for part in np.array_split(apart, blocks)])
    reach = float(t.ppf(1.0 - 0.5 * (1.0 - CONFIDENCE) / comparisons, blocks - 1))
    half = reach * float(means.std(ddof=1)) / math.sqrt(blocks)
    return Difference(math.sqrt(square), math.sqrt(max(0.0, square - half)), math.sqrt(square + half))


def block_of(lag: float) -> int:
    """Samples of a block: ten lags of the filter, after which its errors are uncorrelated."""
    return math.ceil(10.0 * (lag + 1.0))


def verdict(differences: Sequence[tuple[str, Difference]], what: str, equal: str, lag: float, samples: int) -> str:
    """Two or three sentences on the candidates that a device can run.

    Args:
        differences: names of the candidates, and their differences to the present filter.
        what: what the error is, such as "RMS error against the truth".
        equal: what they were made equal in, such as "lag".
        lag: what `difference` was given, samples.
        samples: how many the errors are of.
    """
    judged = [(name, d) for name, d in differences if not math.isnan(d.ratio)]
    if not judged:
        return "The filters cannot be compared on this stretch: all errors are 0."
    if all(math.isinf(d.high) for _, d in judged):
        needed = MIN_BLOCKS * block_of(lag)
        if samples >= needed:
            return "No verdict: the errors differ so much from block to block that any difference may be chance."
        return (
            "The stretch is too short for a verdict: the errors of your filter are correlated over about "
            f"{number(lag)} samples, so {count(needed)} are needed, {MIN_BLOCKS} blocks of {count(block_of(lag))}, "
            f"and {count(samples)} were judged. Record longer, or compare a faster filter."
        )
    better = sorted(((name, d) for name, d in judged if d.better), key=lambda one: (one[1].ratio, one[0]))
    worse = [(name, d) for name, d in judged if d.worse]
    same = [name for name, d in judged if not d.real]
    parts = [f"At equal {equal}, nothing simpler does better than your filter here."]
    if better:
        (name, d), *others = better
        rest = [other for other, _ in others]
        also = f" (so {'does' if len(rest) == 1 else 'do'} {_listed(rest)})" if rest else ""
        parts = [
            f"At equal {equal}, {lower(name)} does better than your filter here: its {what} is "
            f"{percent_of(d.ratio)} smaller ({interval_words(d)}){also}. The difference is significant."
        ]
    if same:
        parts.append(f"No significant difference: {_listed(same)}.")
    if worse:
        name, d = max(worse, key=lambda one: one[1].ratio)
        worst = "" if len(worse) == 1 else f"; worst {lower(name)}"
        by = f"{worst}, by {percent_of(d.ratio)} ({interval_words(d)})"
        parts.append(f"Significantly worse: {_listed([name for name, _ in worse])}{by}.")
    return " ".join(parts)


def percent_of(ratio: float) -> str:
    """How far from 1: "12 %", "0.40 %"."""
    return percent(abs(ratio - 1.0))


def interval_words(d: Difference) -> str:
    """The interval: "95 %: 3.3 % to 5.3 %"."""
    ends = sorted((d.low, d.high), key=lambda end: abs(end - 1.0))
    return f"95 %: {percent_of(ends[0])} to {percent_of(ends[1])}"


def _listed(names: Sequence[str]) -> str:
    return listed([lower(name) for name in names])


def lower(name: str) -> str:
    """A name within a sentence."""
    return name[:1].lower() + name[1:]


def refusal(z: Array, lag: float, gain: float) -> str | None:
    """Why nothing can be compared, or None; from the samples and the current filter's lag (samples) and gain."""
    finite = int(np.isfinite(z).sum())
    if finite < 16:
        return f"The stretch has only {finite} finite samples: a comparison needs 16."
    largest = float(np.nanmax(np.abs(z)))
    if largest > MAX_VALUE or 0.0 < largest < 1.0 / MAX_VALUE:
        return f"The values go up to {number(largest)}: use a unit in which they lie between 1e-120 and 1e120."
    if math.isinf(lag):
        return "With q = 0 the filter never settles, so it has no lag to match. Set q above 0."
    if gain >= 1.0 - 1e-9:
        return "Your filter passes the signal unchanged (gain 1), so nothing can be simpler."
    if lag > 0.25 * len(z):
        return (
            f"The lag of your filter, {number(lag)} samples, is more than a quarter of the {len(z)} samples"
            ": too long to compare. Record longer, or set q higher."
        )
    return None
