"""The filter over a record piece by piece: of a live one that grows, or kept at chosen samples only.

A run that keeps everything writes 40 bytes a sample, and for a million samples most of its time goes into memory
that the processor has not seen before. For a chart the rows of one piece are written again and again.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from kalscope.common.array import Array, Indices
from kalscope.errors import BadSetting
from kalscope.filtering.arrays import infinite, one_channel, refuse_infinite, steps_of
from kalscope.filtering.batch import FilterResult
from kalscope.filtering.channels import channel_filters
from kalscope.filtering.params import FilterParams

FIRST_CAPACITY = 4096
"""Samples allocated at first; the capacity doubles."""

PIECE = 16384
"""Samples that are filtered at once: their rows, 0.9 MB with momentum, stay in the processor's cache."""


class RunningFilter:
    """The result of `kalman_filter` for a record that arrives in pieces, equal to it bit for bit.

    Earlier results do not change: they are views of rows that are written only once.
    """

    def __init__(self, params: FilterParams) -> None:
        """Args: the parameters of one channel, scalars."""
        if params.channels is not None:
            raise BadSetting(f"params must be of one channel (got {params.channels} channels)")
        self.params = params
        (self._filter,) = channel_filters(params, 1)
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
    if len(indices) and not 0 <= indices[0] <= indices[-1] < len(samples):
        raise BadSetting(f"indices must be of z, 0 to {len(samples) - 1} (got {indices[0]} to {indices[-1]})")
    (one,) = channel_filters(params, 1)
    rows, kept = np.empty((one.rows, min(PIECE, len(samples)))), np.empty((one.rows, len(indices)))
    loglik, scored, refused, done = 0.0, 0, 0, 0
    for first in range(0, len(samples), PIECE):
        piece = np.ascontiguousarray(samples[first : first + PIECE])
        _refuse_infinite(piece, first)
        out = rows[:, : len(piece)]
        sums = one.filter(piece, steps[first : first + PIECE], list(out))
        loglik, scored, refused = loglik + sums[0], scored + sums[1], refused + sums[2]
        end = int(np.searchsorted(indices, first + len(piece)))
        kept[:, done:end] = out[:, indices[done:end] - first]
        done = end
    x, p, k, innovation, s, *velocity = kept
    return FilterResult(x, p, k, innovation, s, loglik, scored, refused, *velocity)


def picked(result: FilterResult, indices: Indices) -> FilterResult:
    """The same of a run that kept everything."""
    names = ("x", "p", "k", "innovation", "s", "velocity", "velocity_p")
    rows: dict[str, Array | None] = {name: getattr(result, name) for name in names}
    return replace(result, **{name: None if row is None else row[indices] for name, row in rows.items()})


def _refuse_infinite(piece: Array, first: int) -> None:
    bad = np.flatnonzero(np.isinf(piece))
    if len(bad):
        raise infinite(float(piece[bad[0]]), first + int(bad[0]))
