"""Fused sensors over a whole record of which chosen rows are kept, and over a record that grows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from kalscope.common.array import Array, Indices
from kalscope.filtering.arrays import steps_of
from kalscope.filtering.fusion.params import FusionParams
from kalscope.filtering.fusion.running import FusedRows, RunningFusion, checked_readings

PIECE = 8192
"""Rows that are fused at once: what is not kept of them stays in the processor's cache."""

FIRST_CAPACITY = 4096
"""Rows allocated at first; the capacity doubles."""


@dataclass(frozen=True)
class FusedSignal:
    """What a chart draws of fused sensors, one value per row."""

    x: Array
    """Fused value, unit."""
    p: Array
    """Its posterior variance, unit²."""
    rejected: int
    """Readings that the outlier gate rejected, in all rows."""
    velocity: Array | None = None
    """Velocity, unit per nominal sample period; None without momentum."""
    velocity_p: Array | None = None
    """Its posterior variance."""

    def at(self, indices: Indices) -> FusedSignal:
        """The same at some rows, shape (m,)."""
        v, w = (None if row is None else row[indices] for row in (self.velocity, self.velocity_p))
        return FusedSignal(self.x[indices], self.p[indices], self.rejected, v, w)


def fused_at(z: Array, params: FusionParams, indices: Indices, dt: ArrayLike | None = None) -> FusedSignal:
    """What `fuse` gives at some rows, bit for bit, without the arrays of all rows.

    Args:
        z: readings, shape (n, sensors); NaN where a sensor has none.
        params: the model.
        indices: the rows to keep, ascending, shape (m,).
        dt: nominal sample periods before each row, shape (n,), ≥ 0; None = 1 each.

    Raises:
        BadSetting: z holds inf or has another shape; dt does not fit z.
    """
    steps, running = steps_of(dt, len(z)), RunningFusion(params)
    rows = FusedRows.empty(params, min(PIECE, len(z)))
    kept = np.empty((len(rows.states), len(indices)))
    for first in range(0, len(z), PIECE):
        piece = checked_readings(z[first : first + PIECE], params)
        out = _part(rows, 0, len(piece))
        running.take(piece, steps[first : first + PIECE], out)
        begin, end = np.searchsorted(indices, (first, first + len(piece)))
        for row, state in zip(kept, out.states, strict=True):
            row[begin:end] = state[indices[begin:end] - first]
    return _signal(tuple(kept), running)


class GrowingFusion:
    """The fused value of a record that arrives in pieces, equal to `fuse` bit for bit; earlier results stay."""

    def __init__(self, params: FusionParams) -> None:
        """Args: the model."""
        self._running = RunningFusion(params)
        self._states = self._empty(FIRST_CAPACITY)
        self._first = self._last = 0

    def __len__(self) -> int:
        return self._last - self._first

    def extend(self, z: Array) -> None:
        """Fuse the rows that follow, one sample period apart: readings of shape (n, sensors), NaN where missing.

        Raises:
            BadSetting: z holds inf or has another shape. Nothing is fused then.
        """
        params = self._running.params
        new = checked_readings(z, params)
        self._make_room(len(new))
        for first in range(0, len(new), PIECE):  # what is not kept of a row needs room for one piece only
            piece = new[first : first + PIECE]
            readings = FusedRows.empty(params, len(piece)).readings
            states = tuple(row[self._last : self._last + len(piece)] for row in self._states)
            self._running.take(piece, np.empty(0), FusedRows(states, readings))
            self._last += len(piece)

    def forget(self, count: int) -> None:
        """Drop the oldest `count` rows, at most all of them; later results do not change."""
        self._first = min(self._first + max(count, 0), self._last)

    @property
    def result(self) -> FusedSignal:
        """The rows kept, arrays of shape (len(self),); `rejected` covers all rows."""
        return _signal(tuple(row[self._first : self._last] for row in self._states), self._running)

    def _empty(self, rows: int) -> tuple[Array, ...]:
        return tuple(np.empty(rows) for _ in range(5 if self._running.params.momentum else 2))

    def _make_room(self, count: int) -> None:
        if self._last + count <= len(self._states[0]):
            return
        kept = [row[self._first : self._last] for row in self._states]
        self._states = self._empty(max(FIRST_CAPACITY, 2 * (len(self) + count)))
        for row, old in zip(self._states, kept, strict=True):
            row[: len(old)] = old
        self._first, self._last = 0, len(kept[0])


def _part(rows: FusedRows, first: int, last: int) -> FusedRows:
    k, innovation, s = (column[first:last] for column in rows.readings)
    return FusedRows(tuple(state[first:last] for state in rows.states), (k, innovation, s))


def _signal(states: tuple[Array, ...], running: RunningFusion) -> FusedSignal:
    rejected = int(running.rejected.sum())
    if len(states) == 2:
        return FusedSignal(*states, rejected)
    x, v, p, _, w = states
    return FusedSignal(x, p, rejected, v, w)
