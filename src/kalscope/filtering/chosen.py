"""The filter over a whole record, of which only chosen rows are kept: those that a chart draws.

A run that keeps everything writes 40 bytes per sample, and for a million samples it spends most of its time on
memory that is not in the processor's cache. Here the rows of one piece are overwritten again and again. And where
the gain has settled, eight stretches of the record are filtered at once, equal to sample by sample to the last bit:
without missing samples p and k repeat to the last bit after a while, every one or two samples, and from then on x
forgets its start, so that two runs over the same samples converge to the same bits.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from kalscope.common.array import Array, Indices
from kalscope.errors import BadSetting
from kalscope.filtering.arrays import checked_readings, samples_of, steps_of
from kalscope.filtering.filter import PIECE, FilterResult, FilterRows, KalmanFilter
from kalscope.filtering.kernels import LANE_BLOCK, LANES, filter_lanes
from kalscope.filtering.params import FilterParams, require_params

PERIODS = (1, 2)
"""Samples after which p may repeat itself: rounding keeps some 2 % of the filters from a single value."""

FORGOTTEN = 48.0
"""Time constants after which two runs are the same: 36 bring 2⁵² to 1, the others end the last bit's difference."""

MAX_LANE = 16384
"""Samples of a lane, or four times its warm-up: after a missing one the rest of the stretch is filtered twice."""


def filter_at(z: ArrayLike, params: FilterParams, indices: Indices, dt: ArrayLike | None = None) -> FilterResult:
    """What `kalman_filter` gives at some rows, bit for bit.

    Args:
        z: measurements, shape (n,), or with an r per sensor (n, sensors); NaN is a missing one.
        params: the model.
        indices: the rows to keep, ascending, shape (m,).
        dt: nominal sample periods before each row, shape (n,), ≥ 0; None = 1 each.

    Returns:
        Arrays of m rows; the log-likelihood (to the rounding of its sum), m and rejected are of all rows.

    Raises:
        BadSetting: z holds inf or has another shape; dt or params do not fit; indices outside of z.
    """
    samples = samples_of(z)
    checked_readings(samples[:0], require_params(params))
    at = np.ascontiguousarray(indices, dtype=np.intp)
    if len(at) and not 0 <= at[0] <= at[-1] < len(samples):
        raise BadSetting(f"indices must be of z, 0 to {len(samples) - 1} (got {at[0]} to {at[-1]})")
    run = _Run(samples, params, steps_of(dt, len(samples)), at)
    run.filter_all()
    return run.result


class _Run:
    """The run of a filter over a record."""

    def __init__(self, z: Array, params: FilterParams, steps: Array, at: Indices) -> None:
        self._one, self._z, self._steps, self._at = KalmanFilter(params), z, steps, at
        self._first = self._picked = 0
        self._rows = FilterRows.empty(params, min(PIECE, len(z)))
        self.result = self._one.run(z[:0]).at(np.empty(0, dtype=np.intp))
        self._kept = {name: np.empty((len(at), *row.shape[1:])) for name, row in self.result.rows.items()}

    def filter_all(self) -> None:
        """Filter the whole record."""
        params, retry = self._one.params, 0
        has_lanes = params.reads_x and not params.momentum and params.gate is None and not len(self._steps)
        while self._first < len(self._z):
            piece = self._filter_piece()
            cycle = cycle_of(piece.p, piece.k, piece.s) if has_lanes and self._first >= retry else None
            if cycle is not None:
                retry = self._filter_settled(cycle)
        self.result = replace(self.result, **self._kept)

    def _filter_piece(self) -> FilterResult:
        """The next piece, sample by sample."""
        first, last = self._first, min(self._first + PIECE, len(self._z))
        z, params = self._z[first:last], self._one.params
        quick = params.reads_x and params.gate is None  # without a gate an infinite sample spoils what follows it
        readings = np.ascontiguousarray(z)[:, None] if quick else checked_readings(z, params, first)
        piece = self._one.take(readings, self._steps[first:last], self._rows.part(0, last - first))
        if quick and not (math.isfinite(piece.loglik) and abs(piece.x[-1]) < math.inf):
            checked_readings(z, params, first)
        end = int(np.searchsorted(self._at, last))
        for name, row in piece.rows.items():
            self._kept[name][self._picked : end] = row[self._at[self._picked : end] - first]
        self._first, self._picked = last, end
        self._add(piece.loglik, piece.m, piece.rejected)
        return piece

    def _filter_settled(self, cycle: Cycle) -> int:
        """Filter stretches in lanes, up to one with a missing sample; returns where lanes may be tried again."""
        while True:
            first, begin, kept = self._first, self._picked, self._kept
            out = kept["x"][begin:], kept["innovation"][begin:]
            stretch = filter_stretch(self._z[first:], cycle, self._one.x, self._at[begin:], first, out)
            self._first = first + stretch.done
            self._picked = end = begin + int(np.searchsorted(self._at[begin:], self._first))
            phase = (self._at[begin:end] - first) % len(cycle.p)
            for name, repeated in (("p", cycle.p), ("k", cycle.k), ("s", cycle.s)):
                kept[name][begin:end] = repeated[phase]
            self._one.advance(stretch.x)
            self._add(stretch.loglik, stretch.done, 0)
            if stretch.done < stretch.tried or not stretch.tried:
                return first + stretch.tried

    def _add(self, loglik: Any, m: Any, rejected: Any) -> None:
        before = self.result
        self.result = replace(
            before, loglik=before.loglik + loglik, m=before.m + m, rejected=before.rejected + rejected
        )


@dataclass(frozen=True)
class Cycle:
    """What repeats itself in a settled filter."""

    p: Array
    """Posterior variance of the next samples, shape (period,)."""
    k: Array
    """Their gain."""
    s: Array
    """Their innovation variance."""

    @cached_property
    def block(self) -> tuple[Array, Array]:
        """Gain, and 1/s, of one block."""
        k, s = (np.tile(row, LANE_BLOCK // len(row)) for row in (self.k, self.s))
        return k, 1.0 / s

    @cached_property
    def warm(self) -> int:
        """Samples after which a lane no longer depends on where it began, most likely."""
        return LANE_BLOCK * math.ceil(FORGOTTEN / (float(self.k.mean()) * LANE_BLOCK))

    @cached_property
    def norm(self) -> float:
        """Mean of ln 2π + ln s."""
        return math.log(2.0 * math.pi) + float(np.log(self.s).mean())


@dataclass(frozen=True)
class Stretch:
    """The result of filtering a stretch in lanes."""

    tried: int
    """Samples tried; 0 = too few are left."""
    done: int
    """Samples that are filtered, from the first on: all, or those before a missing one."""
    x: float
    """Filtered value of the last of these."""
    loglik: float
    """Their log-likelihood."""


def cycle_of(p: Array, k: Array, s: Array) -> Cycle | None:
    """What repeats itself at the end of these rows; None = the filter has not settled, or its gain is 0."""
    for period in PERIODS:
        if len(p) > period and p[-1] == p[-1 - period] and (k[-period:] > 0.0).all():
            return Cycle(p[-period:].copy(), k[-period:].copy(), s[-period:].copy())
    return None


def filter_stretch(
    z: Array, cycle: Cycle, x: float, indices: Indices, first: int, out: tuple[Array, Array]
) -> Stretch:
    """Filter the first samples of z, as many as is worthwhile.

    Args:
        z: the samples that follow, shape (n,), with any strides.
        cycle: the settled gain.
        x: the filtered value before.
        indices: the samples to keep, ascending, none before z; more may follow.
        first: what the first sample of z is counted as there.
        out: where x and innovation of these go, each of the shape of indices.
    """
    warm = cycle.warm
    each = min((len(z) - warm) // LANES, max(MAX_LANE, 4 * warm)) // LANE_BLOCK * LANE_BLOCK
    if each < max(LANE_BLOCK, warm // 4):
        return Stretch(0, 0, x, 0.0)
    ends = warm + each * np.arange(1, LANES + 1)
    end = np.searchsorted(indices, first + ends).astype(np.intp)
    begin = np.concatenate(([0], end[:-1])).astype(np.intp)
    tried = np.ascontiguousarray(z[: ends[-1]])
    lanes, x, chi2 = filter_lanes(tried, warm, *cycle.block, x, indices[: end[-1]] - first, begin, end, out)
    done = int(ends[lanes - 1]) if lanes else 0
    loglik = -0.5 * (done * cycle.norm + chi2)
    return Stretch(len(tried), done, float(x), loglik)
