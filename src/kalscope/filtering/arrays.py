"""Measurements, steps and parameters as the kernels need them, checked once for all drivers."""

from __future__ import annotations

import math
from typing import cast

import numpy as np
from numpy.typing import ArrayLike

from kalscope.common.array import Array
from kalscope.errors import BadSetting
from kalscope.filtering.params import MAX_OFFSET, FilterParams, require_one_sensor


def scalar(value: float | None) -> float:
    """The value; NaN for None."""
    return math.nan if value is None else value


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
    """The samples z as float64, shape (n,), for functions of one signal of one sensor."""
    require_one_sensor(params)
    samples = samples_of(z)
    if samples.ndim != 1:
        raise BadSetting(f"z must be one channel, shape (n,) (got {samples.shape})")
    return samples


def checked_readings(z: Array, params: FilterParams, first: int = 0) -> Array:
    """The readings z as rows of shape (n, sensors), contiguous, a view where possible.

    Args:
        z: readings, shape (n,), or with an r per sensor (n, sensors).
        params: the model.
        first: the number of the first row, for the message.

    Raises:
        BadSetting: z has another shape, or a reading that is infinite as a value of x, (z − offset)/gain.
    """
    if z.ndim != 1 + params.fuses or (params.fuses and z.shape[1] != params.sensors):
        must = f"have a column for each of the {params.sensors} sensors" if params.fuses else "have shape (n,)"
        raise BadSetting(f"z must {must} (got shape {z.shape})")
    rows = np.ascontiguousarray(z).reshape(-1, params.sensors)
    if not params.fuses and params.reads_x:
        refuse_infinite(rows[:, 0], first)
    elif max(np.fmax.reduce(rows.ravel(), initial=0.0), -np.fmin.reduce(rows.ravel(), initial=0.0)) > MAX_OFFSET:
        # the usual case is smaller: no gain or offset can make these infinite
        with np.errstate(over="ignore"):
            values = (rows - params.offset) / params.gain
        where = np.argwhere(np.isinf(values))
        if len(where):
            row, sensor = where[0]
            raise BadSetting(
                "z must be finite, or NaN where missing "
                f"(got {rows[row, sensor]} at row {first + row}, sensor {sensor})"
            )
    return rows


def one_record(z: ArrayLike, dt: ArrayLike | None) -> tuple[Array, Array]:
    """The samples z of one channel, shape (n,), and the steps dt, checked and contiguous."""
    samples = samples_of(z)
    if samples.ndim != 1:
        raise BadSetting(f"z must be one channel, shape (n,) (got shape {samples.shape})")
    refuse_infinite(samples)
    return np.ascontiguousarray(samples), steps_of(dt, len(samples))


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


def refuse_infinite(column: Array, first: int = 0) -> None:
    """BadSetting where z holds inf; NaN is a missing sample."""
    with np.errstate(over="ignore", invalid="ignore"):
        if math.isfinite(column.sum()):
            return
    where = np.flatnonzero(np.isinf(column))
    if len(where):
        raise infinite(float(column[where[0]]), first + int(where[0]))


def infinite(value: float, index: int) -> BadSetting:
    """The error that names an infinite sample."""
    return BadSetting(f"z must be finite, or NaN where missing (got {value} at sample {index})")
