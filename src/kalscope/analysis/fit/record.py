"""One channel as the record behind its filter: the samples that went in, ready for other q, r and momentum.

A pair is measured by the variance of one step of the signal over r, as in `estimation.momentum.likelihood`; without
momentum that is q/r.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from kalscope.analysis.fit.run import Run
from kalscope.common.array import Array
from kalscope.estimation.likelihood.profile import Differences, differences
from kalscope.estimation.momentum.likelihood import concentrated, moving_sums, step_variance
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
    """Samples in units of √r (of a step's standard deviation where r is 0), shape (n,); NaN where missing."""
    dt: Array | None
    """Nominal sample periods before each, shape (n,); None = 1 each."""
    ratio: float
    """Step variance over r of the filter that made it; 0 or inf at the edges."""
    momentum: float
    """Of that filter, sample periods."""
    thinned: bool
    """Whether spikes were left out."""

    @staticmethod
    def of(run: Run, spikes: Indices) -> Record:
        """Invert the filter: z = x + (1 − k) v.

        Args:
            run: the filter over the channel.
            spikes: indices of those to leave out.
        """
        z = _undo(run)
        z[spikes] = math.nan
        step = run.q * variance_of_step(run.momentum)
        ratio = step / run.r if run.r > 1e-13 * step else math.inf
        ratio = ratio if ratio > 1e-24 else 0.0
        z /= math.sqrt(run.r if ratio < math.inf else step or 1.0)
        z[np.isinf(z)] = math.nan  # undone, a sample near the end of float64 may lie beyond it
        regular = run.dt is None or bool(np.all(np.abs(run.dt[1:] - 1.0) <= 1e-3))
        return Record(z, None if regular else run.dt, ratio, run.momentum, len(spikes) > 0)

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
        """Σ v²/s and Σ ln s of the whole record at each ln(step variance / r), r = 1, shapes of `log_ratios`."""
        ratios = np.exp(log_ratios) / variance_of_step(self.momentum)
        if self.momentum:
            ones = np.ones(len(ratios))
            chi2, logdet = moving_sums(self.data, ratios, ones, self.momentum * ones)
        else:
            chi2, logdet = self.data.sums(ratios)
        return chi2 * min(self.data.scale, MAX_SCALE) ** 2, logdet

    def without_noise(self) -> float:
        """Log-likelihood at r = 0 with the best q; −inf where that is impossible."""
        if not self.momentum:
            return self.data.random_walk()[0]
        return float(concentrated(self.data, np.array([math.inf]), np.array([self.momentum]))[0][0])

    def residuals(self, log_ratio: float, momentum: float) -> Array:
        """Standardised innovations at ln(step variance / r), size 1, shape (n,); NaN where none was scored."""
        e = np.empty(len(self.z))
        params = FilterParams(math.exp(log_ratio) / variance_of_step(momentum), 1.0, momentum=momentum)
        for first, piece in filter_pieces(self.z, params, self.dt):
            e[first : first + len(piece.x)] = piece.innovation / np.sqrt(piece.s)
        e[~np.isfinite(e)] = math.nan
        seen = finite(e)
        size = math.sqrt(float(np.einsum("i,i", seen, seen)) / max(len(seen), 1))
        return np.divide(e, size, out=e) if size > 0.0 else e


def variance_of_step(momentum: float) -> float:
    """Variance of one step of the signal for q = 1."""
    return step_variance(momentum) if momentum else 1.0


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
    products = finite(errors[1:] * errors[:-1])
    return float(products.mean()) if len(products) else 0.0  # none where every second reading is missing


def finite(values: Array) -> Array:
    """Those of the values that are finite; the array itself where all are."""
    there = np.isfinite(values)
    return values if there.all() else values[there]


def _undo(run: Run) -> Array:
    """The samples, from x, p, k and the innovation; NaN where missing or rejected."""
    z = np.empty(run.n)
    for first, (x, p, k, v, _) in run.pieces():
        with np.errstate(invalid="ignore"):
            samples = np.where(np.isnan(v), np.where(k > 0.0, x, math.nan), x + (1.0 - k) * v)
        samples[(k == 0.0) & (p > 0.0)] = math.nan
        z[first : first + len(x)] = samples
    return z
