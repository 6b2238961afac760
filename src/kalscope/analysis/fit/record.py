"""One channel as the record behind its filter: the samples that went in, ready for other q, r and momentum."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from kalscope.analysis.fit.run import Run
from kalscope.common.array import Array
from kalscope.estimation.likelihood.profile import Differences, differences
from kalscope.filtering.filter import filter_pieces
from kalscope.filtering.params import FilterParams

Indices = NDArray[np.int64]

MAX_SEARCHED = 40_000
"""Samples searched for momentum; a longer record is searched in stretches, and the result tested on all of it."""

MAX_SCALE = 1e150
"""Changes larger than this many √r count as this large: their squares must fit a double."""

LAG = 5.0
"""Samples of lag in the example of a filter that is chosen by its lag."""

STRETCHES = 4
"""Number of those stretches; they are spread evenly and leave the start of the record out."""


@dataclass(frozen=True)
class Record:
    """All samples of one channel, without the filter's prior, its rejected samples and its spikes."""

    z: Array
    """Samples in units of √r (√q where r is 0), shape (n,); NaN where missing."""
    dt: Array | None
    """Nominal sample periods before each, shape (n,); None = 1 each."""
    ratio: float
    """λ of the filter that made it; 0 or inf at the edges."""
    thinned: bool
    """Whether spikes were left out."""

    @staticmethod
    def of(run: Run, scored: Indices, spikes: Indices) -> Record:
        """Invert the filter: z = x + (1 − k) v, r = (1 − k) s, q·dt = k s − p before.

        Args:
            run: the filter over the channel.
            scored: indices of the scored samples, at least one.
            spikes: indices of those to leave out.
        """
        z, steps, k, s = _undo(run, int(scored[-1]))
        r = s - k * s
        r = r if r > 1e-13 * s else 0.0
        z[spikes] = math.nan
        there = steps[steps > 0.0]
        q = float(np.median(there, overwrite_input=True)) if len(there) else 0.0
        regular = not len(there) or bool(np.all(np.abs(np.subtract(there, q, out=there), out=there) <= 1e-3 * q))
        unit = math.sqrt(r or q or s)
        ratio = math.inf if r == 0.0 else q / r
        z /= unit
        z[np.isinf(z)] = math.nan  # undone, a sample near the end of float64 may lie beyond it
        return Record(z, None if regular else steps / q, ratio, len(spikes) > 0)

    @property
    def moves(self) -> bool:
        """Whether z has two values that differ by more than the filter's rounding."""
        z = finite(self.z)
        return len(z) > 0 and float(np.ptp(z)) > 1e-13 * float(np.abs(z).max())

    @property
    def unchanged(self) -> float:
        """Share of the samples that equal the one before, as far as the filter's rounding lets it be seen."""
        d = np.abs(self.data.d)
        return float(np.mean(d <= 1e-9 * float(d.max()))) if len(d) else 0.0

    @cached_property
    def data(self) -> Differences:
        """The record as the likelihood takes it."""
        return differences(self.z, np.empty(0) if self.dt is None else self.dt)

    def searched(self) -> tuple[Differences, ...]:
        """The record, or of a long one the stretches in which momentum is searched."""
        n = len(self.z)
        if n <= MAX_SEARCHED:
            return (self.data,)
        length = MAX_SEARCHED // STRETCHES
        found: list[Differences] = []
        for first in np.linspace(0, n - length, STRETCHES + 1)[1:].astype(int).tolist():
            part = slice(first, first + length)
            one = differences(self.z[part], np.empty(0) if self.dt is None else self.dt[part])
            found += [one] if one.m else []
        return tuple(found) or (self.data,)

    def sums(self, log_ratios: Array) -> tuple[Array, Array]:
        """Σ v²/s and Σ ln s of the whole record at each ln λ with r = 1, shapes of `log_ratios`."""
        chi2, logdet = self.data.sums(np.exp(log_ratios))
        return chi2 * min(self.data.scale, MAX_SCALE) ** 2, logdet

    def residuals(self, ratio: float, momentum: float = 0.0) -> Array:
        """Standardised innovations at λ, size 1, shape (n,); NaN where none was scored."""
        e = np.empty(len(self.z))
        for first, piece in filter_pieces(self.z, FilterParams(ratio, 1.0, momentum=momentum), self.dt):
            e[first : first + len(piece.x)] = piece.innovation / np.sqrt(piece.s)
        e[~np.isfinite(e)] = math.nan
        seen = finite(e)
        size = math.sqrt(float(np.einsum("i,i", seen, seen)) / max(len(seen), 1))
        return np.divide(e, size, out=e) if size > 0.0 else e


def lost_by_lag(record: Record) -> float:
    """What a filter with a lag of `LAG` samples and no momentum loses of the signal, in units of the noise r.

    Its innovation is white on a signal that it can follow; on one that it cannot, neighbouring innovations share
    their error, whose size is the mean of their products. Above 1 a raw reading is nearer the truth than the
    filtered one.
    """
    gain = 1.0 / (1.0 + LAG)
    errors = np.empty(len(record.z))
    for first, piece in filter_pieces(record.z, FilterParams(gain * gain / (1.0 - gain), 1.0), record.dt):
        errors[first : first + len(piece.x)] = piece.innovation
    return float(np.nanmean(errors[1:] * errors[:-1]))


def finite(values: Array) -> Array:
    """Those of the values that are finite; the array itself where all are."""
    there = np.isfinite(values)
    return values if there.all() else values[there]


def _undo(run: Run, last: int) -> tuple[Array, Array, float, float]:
    """Samples and q·dt from x, p, k, innovation and s; then k and s of the sample `last`."""
    z, steps = np.empty(run.n), np.empty(run.n)
    before = last_k = last_s = math.nan
    for first, (x, p, k, v, s) in run.pieces():
        own = slice(first, first + len(x))
        with np.errstate(invalid="ignore"):
            samples = np.where(np.isnan(v), np.where(k > 0.0, x, math.nan), x + (1.0 - k) * v)
            samples[(k == 0.0) & (p > 0.0)] = math.nan
            predicted = np.where(k > 0.0, k * s, p)
            step = predicted - np.concatenate(([before], p[:-1]))
            known = np.isfinite(step) & (step > 1e-12 * predicted)
        z[own], steps[own] = samples, np.where(known, step, 0.0)
        before = p[-1]
        if first <= last < first + len(x):
            last_k, last_s = float(k[last - first]), float(s[last - first])
    return z, steps, last_k, last_s
