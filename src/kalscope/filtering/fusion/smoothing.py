"""The smoother of a fused filter: the best estimate of each row from the whole record."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from kalscope.common.array import Array
from kalscope.filtering import kernels
from kalscope.filtering.arrays import samples_of, steps_of
from kalscope.filtering.batch import SmootherResult
from kalscope.filtering.fusion.params import FusionParams
from kalscope.filtering.fusion.running import FusedRows, RunningFusion, checked_readings
from kalscope.filtering.momentum import smoothing_kernels as momentum_kernels


def smooth_fusion(z: ArrayLike, params: FusionParams, dt: ArrayLike | None = None) -> SmootherResult:
    """Smooth the fused readings of several sensors over the whole record, as `smooth` does for one sensor.

    The backward pass needs only the fused states: it is that of one sensor. A reading that the gate rejects in the
    forward pass counts as missing.

    Args:
        z: readings, shape (n, sensors); NaN where a sensor has none.
        params: the model.
        dt: nominal sample periods that elapse before each row, shape (n,), ≥ 0; None = 1 each.

    Raises:
        BadSetting: z holds inf or has another shape; dt does not fit z.
    """
    readings = checked_readings(samples_of(z), params)
    steps = steps_of(dt, len(readings))
    rows = FusedRows.empty(params, len(readings))
    RunningFusion(params).take(readings, steps, rows)
    start = _start(readings, params)
    if not params.momentum:
        x, p = rows.states
        if not math.isnan(start) and len(x):
            kernels.smooth_backwards(steps, params.q, start, x, p)
        return SmootherResult(x, p)
    x, v, p, g, w = rows.states
    if not math.isnan(start) and len(x):
        momentum_kernels.smooth_backwards(steps, params.q, params.momentum, start, (x, v, p, g, w))
    return SmootherResult(x, p, v, w)


def _start(readings: Array, params: FusionParams) -> float:
    """The value used for x before it is known: x0, or that of the first reading; NaN without any."""
    if params.x0 is not None:
        return params.x0
    known = np.argwhere(np.isfinite(readings))
    if not len(known):
        return math.nan
    row, sensor = known[0]
    return float((readings[row, sensor] - params.offset[sensor]) / params.gain[sensor])
