"""A filter over one channel as the judgement reads it: piece by piece, as all of its rows are 40 bytes a sample."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

from numpy.typing import ArrayLike

from kalscope.common.array import Array
from kalscope.errors import BadSetting
from kalscope.filtering.arrays import one_channel, steps_of
from kalscope.filtering.filter import PIECE, FilterResult, filter_pieces
from kalscope.filtering.params import FilterParams

Columns = tuple[Array, ...]
"""x, p, k, innovation and s of one channel."""


@dataclass(frozen=True)
class Run:
    """The rows of a filter, as often as they are asked for."""

    n: int
    """Samples."""
    q: float
    """Of the filter, as r and momentum."""
    r: float
    momentum: float
    dt: Array | None
    """Nominal sample periods before each sample, shape (n,); None = 1 each."""
    pieces: Callable[[], Iterator[tuple[int, Columns]]]
    """From the first to the last: the first sample of a piece, and its rows, which the next one may overwrite."""

    @staticmethod
    def of_result(result: FilterResult, channel: int | None = None) -> Run:
        """A run of `kalman_filter`; of several channels one."""
        params = result.params
        if params is None:
            raise BadSetting("result must be what kalman_filter gave (got that of another filter)")
        rows = (result.x, result.p, result.k, result.innovation, result.s)
        if channel is not None:
            rows = tuple(row[:, channel] for row in rows)
        n = len(rows[0])

        def pieces() -> Iterator[tuple[int, Columns]]:
            for first in range(0, n, PIECE):
                yield first, tuple(row[first : first + PIECE] for row in rows)

        return Run(n, params.q, float(params.r), params.momentum, result.dt, pieces)

    @staticmethod
    def of_samples(z: Array, params: FilterParams, dt: ArrayLike | None = None) -> Run:
        """The run over z, shape (n,): filtered again whenever it is asked for, and never kept."""

        def pieces() -> Iterator[tuple[int, Columns]]:
            for first, one in filter_pieces(z, params, dt):
                yield first, (one.x, one.p, one.k, one.innovation, one.s)

        samples = one_channel(z, params)
        steps = None if dt is None else steps_of(dt, len(samples))
        return Run(len(samples), params.q, float(params.r), params.momentum, steps, pieces)

    def part(self, first: int, last: int) -> Run:
        """The samples from `first` to before `last`, counted from 0 again."""

        def pieces() -> Iterator[tuple[int, Columns]]:
            for begin, rows in self.pieces():
                if begin >= last:
                    return
                low, high = max(first - begin, 0), min(last - begin, len(rows[0]))
                if low < high:
                    yield begin + low - first, tuple(row[low:high] for row in rows)

        return replace(self, n=last - first, dt=None if self.dt is None else self.dt[first:last], pieces=pieces)
