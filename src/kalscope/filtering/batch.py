"""The filter over a whole record, with everything it knows or x only, and the smoother.

The streaming filter agrees bit for bit. The smoother uses later samples too, so a device cannot run it; in the
chart it is the bound for any filter.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kalscope.common.array import Array, Mask
from kalscope.errors import BadSetting
from kalscope.filtering.arrays import columns_of, infinite, refuse_infinite, rows_to_fill, shaped_like, steps_of
from kalscope.filtering.channels import channel_filters
from kalscope.filtering.params import FilterParams


@dataclass(frozen=True)
class FilterResult:
    """What `kalman_filter` computed; arrays have the shape of z, (n,) or (n, channels)."""

    x: Array
    """Filtered value (posterior mean), unit; NaN before the first finite sample of an automatic start."""
    p: Array
    """Posterior variance, unit²; inf before the first finite sample of a diffuse start."""
    k: Array
    """Kalman gain, 0 … 1; 0 where a sample was missing or rejected by the gate."""
    innovation: Array
    """z minus the predicted x, unit; NaN where z is missing or sets the start."""
    s: Array
    """Innovation variance, predicted p + r, unit²; inf where a diffuse start is set."""
    loglik: float | Array
    """Log-likelihood: sum over the m scored innovations of −½(ln 2π + ln s + v²/s); (channels,) for 2-D z."""
    m: int | NDArray[np.int64]
    """Scored innovations: neither missing, nor rejected, nor the sample that sets the start."""
    rejected: int | NDArray[np.int64]
    """Samples rejected by the outlier gate."""
    velocity: Array | None = None
    """Filtered velocity, unit per nominal sample period; NaN in channels without momentum, None without any."""
    velocity_p: Array | None = None
    """Its posterior variance."""


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


def was_rejected(k: Array, p: Array, innovation: Array) -> Mask:
    """Which samples the outlier gate rejected: there is an innovation and p > 0, but K = 0."""
    return (k == 0.0) & (p > 0.0) & np.isfinite(innovation)


def kalman_filter(z: ArrayLike, params: FilterParams, dt: ArrayLike | None = None) -> FilterResult:
    """Filter a record and keep the whole state at each sample.

    Args:
        z: measurements, shape (n,) or (n, channels: independent filters); NaN is a missing sample.
        params: q, r, p0, x0 of the model, scalars or (channels,) arrays.
        dt: nominal sample periods that elapse before each sample, shape (n,), ≥ 0; None = 1 each. dt[0] = 0
            puts the prior at the first sample.

    Raises:
        BadSetting: z holds inf or has another shape; dt or params do not fit z.

    Source: Ma'arif et al. (2019), equations (11)–(15); Durbin & Koopman (2012), section 2.2.
    """
    columns, shape = columns_of(z)
    filters = channel_filters(params, len(columns))
    steps = steps_of(dt, columns.shape[1])
    refuse_infinite(columns)
    out = rows_to_fill(columns, [one.rows for one in filters])
    sums = [one.filter(columns[c], steps, [row[c] for row in out[: one.rows]]) for c, one in enumerate(filters)]
    x, p, k, innovation, s, *velocity = (shaped_like(row, shape) for row in out)
    loglik, m, rejected = zip(*sums, strict=True)
    if len(shape) == 1:
        return FilterResult(x, p, k, innovation, s, loglik[0], m[0], rejected[0], *velocity)
    return FilterResult(x, p, k, innovation, s, np.array(loglik), np.array(m), np.array(rejected), *velocity)


def denoise(z: ArrayLike, params: FilterParams, dt: ArrayLike | None = None, out: Array | None = None) -> Array:
    """The filtered signal only, as fast as memory allows; within 1e-12 · max|z| of `kalman_filter`.

    Args:
        z: measurements, shape (n,) or (n, channels); NaN is a missing sample.
        params: q, r, p0, x0 of the model, scalars or (channels,) arrays.
        dt: nominal sample periods before each sample, shape (n,), ≥ 0; None = 1 each.
        out: float64 array of z's shape to write into (may be z itself); None = a new one.

    Returns:
        x, float64, shape of z.

    Raises:
        BadSetting: z holds inf or has another shape; dt, params or out do not fit z.
    """
    columns, shape = columns_of(z)
    if out is not None:
        _check_out(out, shape)
    direct = out is not None and out.ndim == 1 and out.flags.c_contiguous and not np.may_share_memory(out, z)
    target = out.reshape(1, -1) if out is not None and direct else np.empty_like(columns)
    steps = steps_of(dt, columns.shape[1])
    for c, one in enumerate(channel_filters(params, len(columns))):
        stopped = one.denoise(columns[c], steps, target[c])
        if stopped >= 0:
            raise infinite(columns[c, stopped], stopped)
    if out is None:
        return shaped_like(target, shape)
    if not direct:
        out[...] = shaped_like(target, shape)
    return out


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


def _check_out(out: Any, shape: tuple[int, ...]) -> None:
    kind, size = getattr(out, "dtype", None), getattr(out, "shape", None)
    if not isinstance(out, np.ndarray) or kind != np.float64 or size != shape:
        what = f"{kind} {size}" if kind else type(cast("object", out)).__name__
        raise BadSetting(f"out must be a float64 array of z's shape {shape} (got {what})")
    if not out.flags.writeable:
        raise BadSetting("out must be writeable (got a read-only array)")
