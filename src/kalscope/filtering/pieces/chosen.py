"""The filter over a whole record, of which only chosen samples are kept: those that a chart draws.

A run that keeps everything writes 40 bytes per sample, and for a million samples it spends most of its time on
memory that is not in the processor's cache. Here the rows of one piece are overwritten again and again.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from kalscope.common.array import Array, Indices
from kalscope.errors import BadSetting
from kalscope.filtering.arrays import infinite, one_channel, steps_of
from kalscope.filtering.batch import FilterResult
from kalscope.filtering.channels import ChannelFilter, FiveLines, channel_filters
from kalscope.filtering.params import FilterParams
from kalscope.filtering.pieces.lanes import Cycle, cycle_of, filter_stretch
from kalscope.filtering.pieces.passing import PIECE


def filter_at(z: ArrayLike, params: FilterParams, indices: Indices, dt: ArrayLike | None = None) -> FilterResult:
    """What `kalman_filter` gives at some samples, bit for bit.

    Args:
        z: measurements of one channel, shape (n,); NaN is a missing sample.
        params: the model, scalars.
        indices: the samples to keep, ascending, shape (m,).
        dt: nominal sample periods before each sample, shape (n,), ≥ 0; None = 1 each.

    Returns:
        Arrays of shape (m,); the log-likelihood (to the rounding of its sum), m and rejected are of all samples.

    Raises:
        BadSetting: z holds inf or has another shape; dt or params do not fit; indices outside of z.
    """
    samples = one_channel(z, params)
    steps = steps_of(dt, len(samples))
    at = np.ascontiguousarray(indices, dtype=np.intp)
    if len(at) and not 0 <= at[0] <= at[-1] < len(samples):
        raise BadSetting(f"indices must be of z, 0 to {len(samples) - 1} (got {at[0]} to {at[-1]})")
    (one,) = channel_filters(params, 1)
    run = _Run(one, samples, steps, at)
    run.filter_all()
    x, p, k, innovation, s, *velocity = run.kept
    return FilterResult(x, p, k, innovation, s, run.loglik, run.scored, run.refused, *velocity)


def picked(result: FilterResult, indices: Indices) -> FilterResult:
    """The same from a result with all samples."""
    names = ("x", "p", "k", "innovation", "s", "velocity", "velocity_p")
    rows: dict[str, Array | None] = {name: getattr(result, name) for name in names}
    return replace(result, **{name: None if row is None else row[indices] for name, row in rows.items()})


class _Run:
    """The run of a filter over a record."""

    def __init__(self, one: ChannelFilter, z: Array, steps: Array, at: Indices) -> None:
        self._one, self._z, self._steps, self._at = one, z, steps, at
        self._first, self._picked = 0, 0
        self._rows = np.empty((one.rows, min(PIECE, len(z))))
        self.kept = np.empty((one.rows, len(at)))
        self.loglik, self.scored, self.refused = 0.0, 0, 0

    def filter_all(self) -> None:
        """Filter the whole record."""
        one, retry = self._one, 0
        settling = one if isinstance(one, FiveLines) and not len(self._steps) and np.isinf(one.gate) else None
        while self._first < len(self._z):
            _, p, k, _, s, *_ = self._filter_piece()
            if settling is None or self._first < retry:
                continue
            cycle = cycle_of(p, k, s)
            if cycle is not None:
                retry = self._filter_settled(settling, cycle)

    def _filter_piece(self) -> Array:
        """The next piece, sample by sample; returns its rows."""
        first, last = self._first, min(self._first + PIECE, len(self._z))
        piece = np.ascontiguousarray(self._z[first:last])
        _refuse_infinite(piece, first)
        rows = self._rows[:, : last - first]
        loglik, scored, refused = self._one.filter(piece, self._steps[first:last], list(rows))
        self.loglik, self.scored, self.refused = self.loglik + loglik, self.scored + scored, self.refused + refused
        end = int(np.searchsorted(self._at, last))
        self.kept[:, self._picked : end] = rows[:, self._at[self._picked : end] - first]
        self._first, self._picked = last, end
        return rows

    def _filter_settled(self, one: FiveLines, cycle: Cycle) -> int:
        """Filter stretches in lanes, up to one with a missing sample; returns where lanes may be tried again."""
        while True:
            first, begin = self._first, self._picked
            row = self.kept[:, begin:]
            stretch = filter_stretch(self._z[first:], cycle, one.x, self._at[begin:], first, (row[0], row[3]))
            self._first = first + stretch.done
            self._picked = end = begin + int(np.searchsorted(self._at[begin:], self._first))
            phase = (self._at[begin:end] - first) % len(cycle.p)
            for i, repeated in ((1, cycle.p), (2, cycle.k), (4, cycle.s)):
                self.kept[i, begin:end] = repeated[phase]
            one.x = stretch.x
            self.loglik, self.scored = self.loglik + stretch.loglik, self.scored + stretch.done
            if stretch.done < stretch.tried or not stretch.tried:
                return first + stretch.tried


def _refuse_infinite(piece: Array, first: int) -> None:
    bad = np.flatnonzero(np.isinf(piece))
    if len(bad):
        raise infinite(float(piece[bad[0]]), first + int(bad[0]))
