"""Measurements, steps and parameters as the kernels need them, checked once for all drivers."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import cast

import numpy as np
from numpy.typing import ArrayLike

from kalscope.common.array import Array
from kalscope.errors import BadSetting
from kalscope.filtering.params import FilterParams, require_params


def scalar(value: float | Array | None) -> float:
    """A parameter of one channel as a float; NaN for None."""
    return math.nan if value is None else float(value)


def samples_of(z: ArrayLike) -> Array:
    """The samples z as float64, a view where possible; masked samples become NaN, missing."""
    if isinstance(z, np.ndarray) and np.iscomplexobj(cast("Array", z)):  # asarray would drop the imaginary part
        raise BadSetting("z must be an array of real numbers (got complex ones)")
    try:
        array = np.asarray(z, dtype=np.float64)
    except (TypeError, ValueError):
        raise BadSetting("z must be an array of numbers (got something else)") from None
    if isinstance(z, np.ma.MaskedArray):
        return np.where(np.ma.getmaskarray(cast("Array", z)), np.nan, array)
    return array


def one_channel(z: ArrayLike, params: FilterParams) -> Array:
    """The samples z as float64, shape (n,), for functions of one signal with scalar parameters."""
    require_params(params)
    samples = samples_of(z)
    if samples.ndim != 1 or params.channels is not None:
        raise BadSetting(f"z must be one channel, shape (n,), with scalar parameters (got {samples.shape})")
    return samples


def columns_of(z: ArrayLike) -> tuple[Array, tuple[int, ...]]:
    """The samples z as contiguous rows, one per channel (a view where possible), and z's own shape."""
    array = samples_of(z)
    if array.ndim not in (1, 2) or (array.ndim == 2 and array.shape[1] == 0):
        raise BadSetting(f"z must have shape (n,) or (n, channels) (got {array.shape})")
    rows = array.reshape(1, -1) if array.ndim == 1 else array.T
    return np.ascontiguousarray(rows), array.shape


def shaped_like(rows: Array, shape: tuple[int, ...]) -> Array:
    """Rows of channels back in the shape of z."""
    return rows[0] if len(shape) == 1 else np.ascontiguousarray(rows.T)


def rows_to_fill(columns: Array, counts: Sequence[int]) -> list[Array]:
    """As many arrays like `columns` as the longest count; NaN where channel c fills only the first counts[c]."""
    rows = [np.empty_like(columns) for _ in range(max(counts))]
    for c, count in enumerate(counts):
        for row in rows[count:]:
            row[c] = np.nan
    return rows


def steps_of(dt: ArrayLike | None, n: int) -> Array:
    """The steps dt as the kernels need it: empty for regular sampling."""
    if dt is None:
        return np.empty(0)
    try:
        steps = np.ascontiguousarray(dt, dtype=np.float64)
    except (TypeError, ValueError):
        raise BadSetting("dt must be an array of numbers (got something else)") from None
    if steps.shape != (n,):
        raise BadSetting(f"dt must have one value per sample, shape ({n},) (got {steps.shape})")
    if n and not (np.all(np.isfinite(steps)) and steps.min() >= 0.0):
        raise BadSetting(f"dt must be finite and not negative (got {steps.min()} to {steps.max()})")
    return steps


def step_of(dt: float | None) -> float:
    """One step dt as the kernels need it: 1 where it is None."""
    try:
        step = 1.0 if dt is None else float(dt)
    except (TypeError, ValueError):
        step = math.nan
    if not (0.0 <= step < math.inf):
        raise BadSetting(f"dt must be finite and not negative (got {dt!r})")
    return step


def refuse_infinite(columns: Array) -> None:
    """BadSetting where z holds inf; NaN is a missing sample."""
    for column in columns:
        with np.errstate(over="ignore", invalid="ignore"):
            if math.isfinite(column.sum()):
                continue
        where = np.flatnonzero(np.isinf(column))
        if len(where):
            raise infinite(column[where[0]], int(where[0]))


def infinite(value: float, index: int) -> BadSetting:
    """The error that names an infinite sample."""
    return BadSetting(f"z must be finite, or NaN where missing (got {value} at sample {index})")
