"""Many series in one piece of memory: what every compiled loop over a fleet takes."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kalscope.common.array import Array
from kalscope.errors import BadSetting
from kalscope.filtering.arrays import samples_of
from kalscope.filtering.params import MAX_VARIANCE


@dataclass(frozen=True)
class Series:
    """k series of different lengths, one after the other."""

    values: Array
    """All samples, shape (total,), NaN where missing."""
    starts: NDArray[np.int64]
    """Where each series begins, shape (k + 1,); the last is the end of all."""
    steps: Array
    """Nominal sample periods before each sample, shape (total,); empty = 1 each."""

    def __len__(self) -> int:
        return len(self.starts) - 1

    def one(self, index: int) -> tuple[Array, Array]:
        """The samples and the steps of one series, views."""
        here = slice(int(self.starts[index]), int(self.starts[index + 1]))
        return self.values[here], self.steps[here] if len(self.steps) else self.steps

    def some(self, rows: NDArray[np.intp]) -> Series:
        """Some of the series, in memory of their own."""
        pieces = [self.one(int(i)) for i in rows]
        starts = np.cumsum([0, *(len(values) for values, _ in pieces)], dtype=np.int64)
        values, steps = (np.concatenate([np.empty(0), *column]) for column in zip(*pieces, strict=True))
        return Series(values, starts, steps)

    def parts(self, samples: int) -> Iterator[tuple[int, int]]:
        """First and one past the last of stretches of about that many samples, at least one series each."""
        first = 0
        while first < len(self):
            end = int(np.searchsorted(self.starts, int(self.starts[first]) + samples, side="right")) - 1
            stop = min(max(end, first + 1), len(self))
            yield first, stop
            first = stop


def series_of(
    series: Series | ArrayLike | Sequence[ArrayLike], dt: ArrayLike | Sequence[ArrayLike] | None
) -> Series:
    """The series as one piece of memory.

    Args:
        series: a list of 1-D arrays of any lengths, a 2-D array with one series a row, or a Series.
        dt: the steps, shaped like the series; None = 1 each, or those of the Series.

    Raises:
        BadSetting: a series is not 1-D or holds no numbers; the steps have other shapes; an array of complex
            numbers.
    """
    if isinstance(series, Series):
        if dt is not None:
            raise BadSetting("dt must be None beside a Series, which holds its steps (got both)")
        _check(series)
        return Series(*map(_writeable, (series.values, series.starts, series.steps)))
    values, starts = _joined(series, "series")
    if dt is None:
        return Series(_writeable(values), starts, np.empty(0))
    steps, others = _joined(dt, "dt")
    if not np.array_equal(starts, others):
        raise BadSetting("dt must have one value per sample of each series (got other lengths)")
    return Series(_writeable(values), starts, _writeable(steps))


def _writeable(array: Any) -> Any:
    """The array, or a copy of a read-only one (an Arrow buffer), for which the loops would be compiled again."""
    return array if array.flags.writeable else array.copy()


def above_zero_each(name: str, value: ArrayLike | None, count: int) -> Array:
    """One number above 0 a series, shape (count,), of one for all or one each; NaN each for None."""
    if value is None:
        return np.full(count, np.nan)
    try:
        array: Array = np.array(np.broadcast_to(np.asarray(value, dtype=np.float64), (count,)))
    except (TypeError, ValueError):
        raise BadSetting(f"{name} must be one number, or one a series, {count} (got something else)") from None
    if count and not (array.min() > 0.0 and array.max() <= MAX_VARIANCE):
        raise BadSetting(f"{name} must be finite and above 0 (got {array.min():g} to {array.max():g})")
    return array


def _joined(series: ArrayLike | Sequence[ArrayLike], name: str) -> tuple[Array, NDArray[np.int64]]:
    if isinstance(series, np.ndarray) and cast("Array", series).dtype != object:
        array = samples_of(cast("Array", series))
        if array.ndim != 2:
            raise BadSetting(
                f"{name} must be a list of 1-D arrays or a 2-D array, one series a row (got shape {array.shape})"
            )
        return np.ascontiguousarray(array).ravel(), np.arange(len(array) + 1, dtype=np.int64) * array.shape[1]
    if not isinstance(series, Iterable):
        raise BadSetting(f"{name} must be a list of 1-D arrays or a 2-D array (got {series})")
    rows = [samples_of(one) for one in cast("Sequence[ArrayLike]", series)]
    wrong = next((i for i, row in enumerate(rows) if row.ndim != 1), None)
    if wrong is not None:
        raise BadSetting(f"{name} must be 1-D each (got shape {rows[wrong].shape} at index {wrong})")
    starts = np.zeros(len(rows) + 1, dtype=np.int64)
    np.cumsum([len(row) for row in rows], out=starts[1:])
    return (np.concatenate(rows) if rows else np.empty(0)), starts


def _check(series: Series) -> None:
    """What the compiled loops rely on: they would read beyond the end of the memory."""
    values, starts, steps = series.values, series.starts, series.steps
    if values.dtype != np.float64 or values.ndim != 1 or not values.flags.c_contiguous:
        raise BadSetting("values of a Series must be one contiguous array of float64")
    if starts.dtype != np.int64 or starts.ndim != 1 or len(starts) < 1 or starts[0] < 0:
        raise BadSetting("starts of a Series must be int64, from 0 on (got something else)")
    if np.any(np.diff(starts) < 0) or starts[-1] > len(values):
        raise BadSetting(f"starts of a Series must rise up to at most {len(values)}, its samples (got others)")
    if len(steps) and (steps.dtype != np.float64 or steps.shape != values.shape or not steps.flags.c_contiguous):
        raise BadSetting("steps of a Series must be empty or one float64 a sample (got something else)")
