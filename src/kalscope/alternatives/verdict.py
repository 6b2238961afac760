"""Which filter is better, by how much, and whether that is more than chance; in words. Pure."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

BLOCKS = 100
"""Most blocks that a recording is cut into."""

LEAST_BLOCKS = 8
"""Fewer say nothing."""

TOGETHER = 0.95
"""Chance that none of all the intervals of one comparison is wrong."""


@dataclass(frozen=True)
class Difference:
    """Mean squared error of one filter against the present one."""

    ratio: float
    """RMS error over that of the present filter; below 1 it is better. NaN where there is nothing to judge."""
    low: float
    """Lower end of the interval of `ratio`."""
    high: float
    """Upper end of it; inf where too few blocks are there."""

    @property
    def real(self) -> bool:
        """Whether the difference is more than chance."""
        return self.high < 1.0 or self.low > 1.0


def difference(error: Array, present: Array, lag: float, comparisons: int = 1) -> Difference:
    """Compare squared errors sample by sample, block by block.

    Errors follow each other for about as long as the filter lags, so the blocks are at least ten lags long; the
    means of their differences then count as independent (Student's t, shared among the comparisons).

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
    ratio = math.sqrt(float(a.mean() / b.mean()))
    length = max(math.ceil(10.0 * (lag + 1.0)), len(b) // BLOCKS)
    blocks = len(b) // length
    if blocks < LEAST_BLOCKS:
        return Difference(ratio, 0.0, math.inf)
    gaps = (a - b)[: blocks * length].reshape(blocks, length).mean(axis=1)
    middle, spread = float(gaps.mean()), float(gaps.std(ddof=1)) / math.sqrt(blocks)
    from scipy.stats import t

    reach = float(t.ppf(1.0 - 0.5 * (1.0 - TOGETHER) / comparisons, blocks - 1)) * spread
    level = float(b.mean())
    low, high = (math.sqrt(max(0.0, 1.0 + end / level)) for end in (middle - reach, middle + reach))
    return Difference(ratio, low, high)


def verdict(names: Sequence[str], found: Sequence[Difference], what: str, equal: str) -> str:
    """Two or three sentences on the candidates that a device can run.

    Args:
        names: of the candidates.
        found: their differences to the present filter.
        what: what the error is, such as "RMS error against the truth".
        equal: what they were made equal in, such as "lag".
    """
    judged = [(d, name) for d, name in zip(found, names, strict=True) if not math.isnan(d.ratio)]
    if not judged:
        return "There is nothing to judge the filters by in this stretch."
    if all(math.isinf(d.high) for d, _ in judged):
        return "The stretch is too short for a verdict: differences in it may be chance. Record longer."
    better = sorted((d.ratio, name, d) for d, name in judged if d.high < 1.0)
    worse = [name for d, name in judged if d.low > 1.0]
    same = [name for d, name in judged if not d.real]
    parts: list[str] = []
    if better:
        ratio, name, d = better[0]
        others = f" (so {_are(better)} {_listed([name for _, name, _ in better[1:]])})" if better[1:] else ""
        parts.append(
            f"At equal {equal}, {_lower(name)} does better than your filter here: its {what} is "
            f"{_percent(ratio)} smaller ({_interval(d)}){others}. More than chance."
        )
    else:
        parts.append(f"At equal {equal}, nothing simpler does better than your filter here.")
    if same:
        parts.append(f"No real difference: {_listed(same)}.")
    if worse:
        parts.append(f"Worse, by more than chance: {_listed(worse)}; most of all {_worst(judged)}.")
    return " ".join(parts)


def _worst(judged: Sequence[tuple[Difference, str]]) -> str:
    d, name = max((pair for pair in judged if pair[0].low > 1.0), key=lambda pair: pair[0].ratio)
    return f"{_lower(name)}, by {_percent(d.ratio)} ({_interval(d)})"


def _are(better: Sequence[object]) -> str:
    return "does" if len(better) == 2 else "do"


def _percent(ratio: float) -> str:
    """How far from 1: "12 %", "0.4 %"."""
    share = abs(ratio - 1.0) * 100.0
    return f"{share:.0f} %" if share >= 10.0 else f"{share:.2g} %"


def _interval(d: Difference) -> str:
    ends = sorted((d.low, d.high), key=lambda end: abs(end - 1.0))
    return f"95 %: {_percent(ends[0])} to {_percent(ends[1])}"


def _listed(names: Sequence[str]) -> str:
    small = [_lower(name) for name in names]
    return small[0] if len(small) == 1 else f"{', '.join(small[:-1])} and {small[-1]}"


def _lower(name: str) -> str:
    """A name inside a sentence."""
    return name[:1].lower() + name[1:]
