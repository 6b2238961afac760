"""The filter over a record that grows, piece by piece."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from kalscope.common.array import Array
from kalscope.errors import BadSetting
from kalscope.filtering.arrays import refuse_infinite, steps_of
from kalscope.filtering.batch import FilterResult
from kalscope.filtering.channels import Rows, Sums, channel_filters
from kalscope.filtering.params import FilterParams

FIRST_CAPACITY = 4096
"""Samples allocated at first; the capacity doubles."""


class Continued(Protocol):
    """A filter of one channel with its state."""

    @property
    def rows(self) -> int:
        """Arrays that `filter` writes: x, p, k, innovation, s, and with momentum the velocity and its variance."""
        ...

    def filter(self, z: Array, dt: Array, out: Rows) -> Sums:
        """Take the samples z, which follow those before, into the rows of `out`; dt may be empty."""
        ...


class RunningFilter:
    """The result of `kalman_filter` for a record that arrives in pieces, or of another filter; equal bit for bit.

    Earlier results do not change: they are views of rows that are written only once.
    """

    def __init__(self, made_of: FilterParams | Continued) -> None:
        """Args: the parameters of one channel, scalars; or another filter at its start."""
        if isinstance(made_of, FilterParams):
            if made_of.channels is not None:
                raise BadSetting(f"params must be of one channel (got {made_of.channels} channels)")
            (made_of,) = channel_filters(made_of, 1)
        self._filter: Continued = made_of
        self._rows = np.empty((self._filter.rows, FIRST_CAPACITY))
        self._first = self._last = 0
        self._loglik, self._m, self._rejected = 0.0, 0, 0

    def __len__(self) -> int:
        return self._last - self._first

    def extend(self, z: ArrayLike, dt: ArrayLike | None = None) -> None:
        """Filter the samples that follow.

        Args:
            z: measurements, shape (n,); NaN is a missing sample.
            dt: nominal sample periods that elapse before each, shape (n,), ≥ 0; None = 1 each.

        Raises:
            BadSetting: z holds inf; dt does not fit. Nothing is filtered then.
        """
        new = np.ascontiguousarray(z, dtype=np.float64)
        if new.ndim != 1:
            raise BadSetting(f"z must have shape (n,) (got {new.shape})")
        refuse_infinite(new[None])
        steps = steps_of(dt, len(new))
        if not len(new):
            return
        self._make_room(len(new))
        end = self._last + len(new)
        loglik, m, refused = self._filter.filter(new, steps, [row[self._last : end] for row in self._rows])
        self._last = end
        self._loglik, self._m, self._rejected = self._loglik + loglik, self._m + m, self._rejected + refused

    def forget(self, count: int) -> None:
        """Drop the oldest `count` samples, at most all of them; later results do not change."""
        self._first = min(self._first + max(count, 0), self._last)

    @property
    def result(self) -> FilterResult:
        """The samples kept, arrays of shape (len(self),); loglik, m and rejected cover all samples."""
        x, p, k, innovation, s, *velocity = (self._view(row) for row in self._rows)
        return FilterResult(x, p, k, innovation, s, self._loglik, self._m, self._rejected, *velocity)

    def _view(self, row: Array) -> Array:
        view = row[self._first : self._last]
        view.flags.writeable = False
        return view

    def _make_room(self, count: int) -> None:
        """Copy the kept samples into larger rows where these are full: old views must not change."""
        if self._last + count <= self._rows.shape[1]:
            return
        kept = self._last - self._first
        rows = np.empty((self._filter.rows, max(FIRST_CAPACITY, 2 * (kept + count))))
        rows[:, :kept] = self._rows[:, self._first : self._last]
        self._rows, self._first, self._last = rows, 0, kept
