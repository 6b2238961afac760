"""The smoother: the best estimate of each sample from the whole record.

It uses later samples too, so a device cannot run it; in the chart it is the bound for any filter.
"""

from __future__ import annotations

from dataclasses import dataclass

from numpy.typing import ArrayLike

from kalscope.common.array import Array
from kalscope.filtering.arrays import columns_of, refuse_infinite, rows_to_fill, shaped_like, steps_of
from kalscope.filtering.channels import channel_filters
from kalscope.filtering.params import FilterParams


@dataclass(frozen=True)
class SmootherResult:
    """What `smooth` computed; arrays have the shape of z, (n,) or (n, channels)."""

    x: Array
    """Smoothed value, the mean given all samples, unit; NaN only where z holds no sample and x0 is None."""
    p: Array
    """Its variance, unit², at most the filter's; inf only where z holds no sample and p0 is None."""
    velocity: Array | None = None
    """Smoothed velocity, unit per nominal sample period; NaN in channels without momentum, None without any."""
    velocity_p: Array | None = None
    """Its variance."""


def smooth(z: ArrayLike, params: FilterParams, dt: ArrayLike | None = None) -> SmootherResult:
    """Smooth a record over its whole length (fixed interval, Rauch–Tung–Striebel).

    The filter runs forward, then each estimate is corrected by the one after it, with j = p / (p + q dt):
    x_s = x + j (x_s' − x), p_s = j q dt + j² p_s'. Samples before a diffuse start, and all missing ones, get
    the value and the variance that follow from their neighbours. A sample that the gate rejects in the
    forward pass counts as missing.

    Args:
        z: measurements, shape (n,) or (n, channels: independent records); NaN is a missing sample.
        params: q, r, p0, x0, gate of the model, scalars or (channels,) arrays.
        dt: nominal sample periods that elapse before each sample, shape (n,), ≥ 0; None = 1 each. dt[0] = 0
            puts the prior at the first sample.

    Raises:
        BadSetting: z holds inf or has another shape; dt or params do not fit z.

    Source: Rauch, Tung & Striebel (1965), AIAA J. 3(8); Durbin & Koopman (2012), section 2.4, same values.
    """
    columns, shape = columns_of(z)
    filters = channel_filters(params, len(columns))
    steps = steps_of(dt, columns.shape[1])
    refuse_infinite(columns)
    out = rows_to_fill(columns, [one.smoothed_rows for one in filters])
    for c, one in enumerate(filters):
        one.smooth(columns[c], steps, [row[c] for row in out[: one.smoothed_rows]])
    return SmootherResult(*(shaped_like(row, shape) for row in out))
