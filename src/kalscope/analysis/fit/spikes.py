"""Spikes among residuals: isolated ones, short excursions that come back, and jumps that stay."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kalscope.analysis import residual_kernels, residual_tests
from kalscope.common.array import Array

ALARM = 0.001
"""p-value below which a test reports a misfit."""

MAX_OUTLIERS = 0.1
"""Share of the residuals up to which spikes are outliers; more of them belong to the noise or to the signal. Spikes
widen the σ by which they are found: where 25 % are off by 60 σ, half of them are detected."""

MAX_REFUSED = 0.2
"""Share of the samples up to which those that a gate rejects are outliers."""

MIN_COUNT, CLEAR = 5, 5.0
"""Number of spikes that count whatever their size, and the size in σ from which fewer count."""

MIN_BURST, MAX_BURST = 8, 0.1
"""Spikes that make a burst, and the share of the record that it may be."""

MAX_JOINED, SLOPE = 2, 50
"""Most jumps of one sign, each within this many samples of the one before, that may be steps; more are a slope."""

MAX_EXCURSION = 8
"""A signal that comes back within this many samples has not stepped: it was a longer spike."""


@dataclass(frozen=True)
class Spikes:
    """Spikes among the N scored residuals."""

    at: NDArray[np.int64]
    """Which residuals, largest first."""
    stays: NDArray[np.bool_]
    """Whether the signal stayed at its new level, one value a spike."""
    size: Array
    """Size in local σ, one value a spike."""
    off: NDArray[np.int64]
    """Residuals of samples off the signal: the isolated spikes and all samples of the excursions, ascending."""
    start: float
    """Size in local σ of the first residual where a given start makes a spike of it, not among `at`; else 0."""

    @staticmethod
    def among(e: Array, k: Array, v: Array, s: Array, prior: bool) -> Spikes:
        """Spikes by `residual_kernels.find_spikes`; all arrays of shape (N,), scored samples only."""
        kind = np.empty(len(e), dtype=np.int8)
        limit = residual_tests.spike_limits(e)
        step = np.empty(len(e))
        reach = np.sqrt(s)
        reach *= limit
        residual_kernels.find_spikes(v, k, reach, kind, step)
        del reach
        start = residual_tests.SPIKE * abs(float(e[0])) / float(limit[0]) if prior and kind[0] else 0.0
        if start:
            kind[0] = 0
        within = _mark_excursions(kind, step)
        _unmark_slopes(kind, step)
        at = np.flatnonzero(kind)
        off = np.union1d(within, np.flatnonzero(kind == residual_kernels.LONE))
        at = at[np.argsort(-np.abs(e[at]), kind="stable")]
        size = residual_tests.SPIKE * np.abs(e[at]) / limit[at]
        return Spikes(at, kind[at] == residual_kernels.STAYS, size, off, start)

    @property
    def lone(self) -> int:
        """Spikes that did not stay."""
        return int(np.count_nonzero(~self.stays))

    @property
    def jumps(self) -> int:
        """Those that stayed."""
        return int(np.count_nonzero(self.stays))

    def too_many(self, n: int, lone: bool = False) -> bool:
        """Whether they, or the lone ones, are more than chance among n: by number, or one beyond 8 σ.

        A few just above the limit do not count: the local σ is known to a few percent only.
        """
        sizes = self.size[~self.stays] if lone else self.size
        expected, chance = residual_tests.spike_chance(len(sizes), n)
        many = chance < ALARM and len(sizes) > 3.0 * expected
        many = many and (len(sizes) >= MIN_COUNT or bool(sizes.max() > CLEAR))
        return many or bool(np.any(sizes > 2.0 * residual_tests.SPIKE))


def burst_of(at: NDArray[np.int64], n: int) -> tuple[int, int] | None:
    """First and last of the shortest stretch with three quarters of the indices `at` among n; None if long.

    Args:
        at: indices, shape (spikes,), ascending.
        n: how many there are.
    """
    if len(at) < MIN_BURST:
        return None
    held = math.ceil(0.75 * len(at))
    spans = at[held - 1 :] - at[: len(at) - held + 1]
    first = int(np.argmin(spans))
    return (int(at[first]), int(at[first + held - 1])) if spans[first] <= MAX_BURST * n else None


def _mark_excursions(kind: NDArray[np.int8], step: Array) -> NDArray[np.int64]:
    """Mark jumps that are soon undone as one lone spike; returns the samples off the signal, the first included."""
    marked = np.flatnonzero(kind)
    within: list[NDArray[np.int64]] = []
    i = 0
    while i + 1 < len(marked):
        there, back = int(marked[i]), int(marked[i + 1])
        undone = step[there] * step[back] < 0.0 and abs(step[there] + step[back]) < 0.5 * abs(step[there])
        if kind[there] == residual_kernels.STAYS and undone and back - there <= MAX_EXCURSION:
            kind[there], kind[back] = residual_kernels.LONE, 0
            within.append(np.arange(there, back))
            i += 1
        i += 1
    return np.concatenate(within) if within else np.zeros(0, dtype=np.int64)


def _unmark_slopes(kind: NDArray[np.int8], step: Array) -> None:
    """Unmark three or more close jumps of one sign: the filter lags behind a slope, which is not a step."""
    jumps = np.flatnonzero(kind == residual_kernels.STAYS)
    joined = (np.diff(jumps) <= SLOPE) & (np.diff(np.sign(step[jumps])) == 0.0)
    for run in np.split(jumps, np.flatnonzero(~joined) + 1):
        if len(run) > MAX_JOINED:
            kind[run] = 0
