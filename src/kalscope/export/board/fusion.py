"""The fused filter as a small board computes it: in float32, in the order of the exported code."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kalscope.common.compiled import compiled
from kalscope.errors import BadSetting
from kalscope.export.float32 import Float32Momentum, float32_momentum, to_float32, without_momentum
from kalscope.filtering.kernels import GATE_LIMIT
from kalscope.filtering.params import FilterParams

Floats = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Float32Fusion:
    """Parameters of a fused filter as a board holds them; each value is a float32."""

    q: np.float32
    """Process-noise variance per row, unit²."""
    p0: np.float32
    """Variance before the first predict, unit²; inf = diffuse."""
    x0: np.float32
    """Estimate before the first predict, unit; NaN = the first reading."""
    gate: np.float32
    """Outlier gate on v²/s; 0 = off."""
    momentum: Float32Momentum
    """The second state; with momentum 0 it gives the five lines to the last bit."""
    r: Floats
    """Measurement-noise variance on the scale of x, r/gain², shape (sensors,)."""
    offset: Floats
    """What each sensor reads where x is 0, shape (sensors,)."""
    gain: Floats
    """By how much its reading grows with x, shape (sensors,)."""


def fusion_on_board(params: FilterParams) -> Float32Fusion:
    """The parameters rounded to float32.

    Raises:
        BadSetting: float32 cannot hold a value (the message names it).
    """
    q = to_float32("q", params.q)
    held = Float32Fusion(
        q=q,
        p0=np.float32(np.inf) if params.p0 is None else to_float32("p0", params.p0),
        x0=np.float32(np.nan) if params.x0 is None else to_float32("x0", params.x0),
        gate=np.float32(0.0) if params.gate is None else to_float32("gate", params.gate),
        momentum=float32_momentum(params.q, params.momentum) or without_momentum(q),
        r=_each("r / gain²", params.scaled_r),
        offset=_each("offset", params.offset),
        gain=_each("gain", params.gain),
    )
    largest = params.q + float(params.scaled_r.max()) + (params.p0 or 0.0)
    if largest > float(np.finfo(np.float32).max):
        raise BadSetting(f"q + r / gain² + p0 must fit float32, up to 3.4e38 (got {largest:.6g})")
    return held


def fuse_float32(z: ArrayLike, params: FilterParams | Float32Fusion) -> Floats:
    """The fused value of each row in float32, shape (n,).

    Args:
        z: Readings, shape (n, sensors); NaN where a sensor has none. Rounded to float32.
        params: The parameters, rounded here or before.

    Raises:
        BadSetting: z has another shape; float32 cannot hold a parameter.
    """
    held = params if isinstance(params, Float32Fusion) else fusion_on_board(params)
    samples = np.ascontiguousarray(z, dtype=np.float32)
    if samples.ndim != 2 or samples.shape[1] != len(held.r):
        raise BadSetting(f"z must have shape (n, {len(held.r)}) (got {samples.shape})")
    readings = (samples - held.offset) / held.gain  # as the board does, a rounding each
    m, out = held.momentum, np.empty(len(samples), np.float32)
    over = m.e, m.f, m.q11, m.q12, m.q22
    _fuse(readings, over, held.r, held.gate, held.x0, held.p0, m.w0, out)
    return out


def _each(name: str, values: NDArray[np.float64]) -> Floats:
    return np.array([to_float32(name, value) for value in values.tolist()], np.float32)


@compiled()
def _fuse(
    z: Floats,
    over: tuple[np.float32, np.float32, np.float32, np.float32, np.float32],
    r: Floats,
    gate: np.float32,
    x: np.float32,
    p: np.float32,
    w: np.float32,
    out: Floats,
) -> None:
    """`fuse_rows_with_momentum` in float32: v is the velocity, w its variance, g the covariance of x and v."""
    two, zero = np.float32(2.0), np.float32(0.0)
    e, f, q11, q12, q22 = over
    v = g = zero
    rejected = np.zeros(r.shape[0], np.int64)
    for i in range(z.shape[0]):
        fw = f * w
        p = p + f * (two * g + fw) + q11
        g = e * (g + fw) + q12
        w = e * e * w + q22
        x = x + f * v
        v = e * v
        for j in range(r.shape[0]):
            s = p + r[j]
            if math.isnan(z[i, j]) or (s == zero and not math.isnan(x)):
                continue
            if math.isinf(p):
                x, p, g, rejected[j] = z[i, j], r[j], zero, 0
                continue
            innovation = z[i, j] - x
            if gate > zero and innovation * innovation > gate * s and rejected[j] < GATE_LIMIT:
                rejected[j] += 1
                continue
            k, ell = zero, zero
            if s > zero:
                k, ell = p / s, g / s
            p, g, w = k * r[j], ell * r[j], w - ell * g
            if math.isnan(x):
                x = z[i, j]
            else:
                x, v = x + k * innovation, v + ell * innovation
            rejected[j] = 0
        out[i] = x
