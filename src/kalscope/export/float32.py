"""The filter as a small board computes it: float32, one rounding an operation; one channel, a chain, a fusion."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kalscope.common.compiled import compiled
from kalscope.common.text import number
from kalscope.errors import BadSetting
from kalscope.filtering.classic import Median, RunningStage, RunningStages, Stage
from kalscope.filtering.kernels import GATE_LIMIT
from kalscope.filtering.params import FilterParams, require_one_sensor
from kalscope.filtering.steady import steady_state, step_constants
from kalscope.tuning.tuning import ChannelTuning

# The filter as a small board computes it: float32, one rounding an operation, in the order of the exported code.
#
# `filter_float32` gives the same bits as the exported C++ and C (float) on a processor that rounds as IEEE 754
# says and does not fuse a multiplication with an addition: what a board prints can be compared exactly.


MIN_NORMAL = float(np.finfo(np.float32).tiny)
"""Smallest float32 that keeps its 24 bits."""

STALLING_GAIN = 7e-6
"""Below this settled gain the variance rounds to a stop where the gain is off by 1 % and more: measured."""

Floats = NDArray[np.float32]

_NOTHING, _UNKNOWN, _INFINITE = np.float32(0.0), np.float32(np.nan), np.float32(np.inf)


@dataclass(frozen=True)
class Float32Momentum:
    """The momentum of one channel as a board holds it, see `StepConstants`; each field is a float32 value."""

    momentum: np.float32
    """Momentum τ, sample periods; 0 = the five lines."""
    e: np.float32
    """Share of the velocity that is left after one sample."""
    f: np.float32
    """Distance that a velocity of 1 goes in one sample, sample periods."""
    q11: np.float32
    """Variance added to x, unit²."""
    q12: np.float32
    """Covariance added, unit² per sample."""
    q22: np.float32
    """Variance added to v, (unit per sample)²."""
    w0: np.float32
    """Variance of v before the first sample, (unit per sample)²."""


@dataclass(frozen=True)
class Float32Params:
    """Parameters of one channel as a board holds them; each field is a float32 value."""

    q: np.float32
    """Process-noise variance per sample period, unit²."""
    r: np.float32
    """Measurement-noise variance, unit²."""
    p0: np.float32 = _INFINITE
    """Variance before the first predict, unit²; inf = diffuse, the first sample sets x = z and p = r."""
    x0: np.float32 = _UNKNOWN
    """Estimate before the first predict, unit; NaN = the first sample."""
    gate: np.float32 = _NOTHING
    """Outlier gate on v²/s; 0 = off."""
    settled_gain: np.float32 = _NOTHING
    """Gain to use once the variance repeats itself to the last bit; 0 = the one that the variance gives."""
    momentum: Float32Momentum | None = None
    """The second state; None = the five lines."""
    median: int = 1
    """Samples whose median goes into the filter; 1 = each sample itself."""


def float32_params(params: FilterParams, median: int = 1) -> Float32Params:
    """The parameters of one channel, rounded to float32, and the settled gain where float32 would miss it.

    Args:
        params: Scalars.
        median: Window of the median before the filter, samples; 1 = none.

    Raises:
        BadSetting: float32 cannot hold a value (the message names it); `params` are not those of one sensor.
    """
    require_one_sensor(params)
    q, r, p0, x0, gate = (cast("float | None", getattr(params, name)) for name in ("q", "r", "p0", "x0", "gate"))
    rounded = Float32Params(
        q=to_float32("q", q or 0.0),
        r=to_float32("r", r or 0.0),
        p0=_INFINITE if p0 is None else to_float32("p0", p0),
        x0=_UNKNOWN if x0 is None else to_float32("x0", x0),
        gate=_NOTHING if gate is None else to_float32("gate", gate),
        settled_gain=_settled_gain(params),
        momentum=float32_momentum(params.q, params.momentum),
        median=median,
    )
    parts = [v for v in (rounded.q, rounded.r, rounded.p0) if np.isfinite(v)]
    if sum(map(float, parts)) > float(np.finfo(np.float32).max):
        raise BadSetting(f"q + r + p0 must fit float32, up to 3.4e38 (got {sum(map(float, parts)):.6g})")
    return rounded


def without_momentum(q: np.float32) -> Float32Momentum:
    """The five lines as a filter with momentum computes them: to the last bit, but slower."""
    none = np.float32(0.0)
    return Float32Momentum(none, e=none, f=none, q11=q, q12=none, q22=none, w0=none)


def float32_text(value: np.float32) -> str:
    """A float32 as C and C++ read it back bit for bit: nine digits, a point, an f; `INFINITY` and `NAN` as such."""
    if np.isnan(value):
        return "NAN"
    if np.isinf(value):
        return "INFINITY"
    digits = f"{float(value):.9g}"
    return f"{digits}f" if "." in digits or "e" in digits else f"{digits}.0f"


def filter_float32(z: ArrayLike, params: FilterParams | Float32Params) -> Floats:
    """The filtered signal of one channel as a board with float32 computes it, bit for bit.

    Args:
        z: Samples since the filter was (re)started, shape (n,), rounded to float32; NaN where missing.
        params: The parameters of one channel, or those that a board reported.

    Returns:
        x, float32, shape (n,).

    Raises:
        BadSetting: z is not of shape (n,); float32 cannot hold a parameter.
    """
    samples = np.ascontiguousarray(z, dtype=np.float32)
    if samples.ndim != 1:
        raise BadSetting(f"z must have shape (n,) (got {samples.shape})")
    held = params if isinstance(params, Float32Params) else float32_params(params)
    out = np.empty_like(samples)
    if held.median > 1:
        middle = RunningStage(Median(held.median), np.float32).take(samples, out[:0])
        samples = np.where(np.isnan(samples), samples, middle)
    if held.momentum is None:
        _filter(samples, held.q, held.r, held.gate, held.settled_gain, held.x0, held.p0, out)
    else:
        m = held.momentum
        over = m.e, m.f, m.q11, m.q12, m.q22
        _filter_with_momentum(samples, over, held.r, held.gate, held.settled_gain, held.x0, held.p0, m.w0, out)
    return out


def to_float32(name: str, value: float) -> np.float32:
    """`value` rounded once; BadSetting names it where float32 cannot hold it with its 24 bits."""
    with np.errstate(over="ignore", under="ignore"):
        rounded = np.float32(value)
    if math.isinf(rounded) or (value != 0.0 and abs(float(rounded)) < MIN_NORMAL):
        raise BadSetting(f"{name} must fit float32: 0, or a size from 1.2e-38 to 3.4e38 (got {value:.6g})")
    return rounded


def float32_momentum(q: float, momentum: float) -> Float32Momentum | None:
    """The constants, computed in double and rounded; None without momentum."""
    if momentum == 0.0:
        return None
    held = asdict(step_constants(q, momentum))
    begin = {"momentum": np.float32(momentum), "w0": to_float32("q / (2 momentum)", held["w0"])}
    rest = {
        name: to_float32(f"{name} of q and momentum", value) for name, value in held.items() if name not in begin
    }
    return Float32Momentum(**begin, **rest)


def _settled_gain(params: FilterParams) -> np.float32:
    gain = float(np.asarray(steady_state(params).gain))
    return np.float32(gain if 0.0 < gain < STALLING_GAIN else 0.0)


@compiled()
def _filter(
    z: Floats,
    q: np.float32,
    r: np.float32,
    gate: np.float32,
    settled_gain: np.float32,
    x: np.float32,
    p: np.float32,
    out: Floats,
) -> None:
    """`kernels.step` in float32. Every constant is a float32: with a plain 1.0 numba would compute in double."""
    zero = np.float32(0.0)
    rejected = 0
    for i in range(z.shape[0]):
        predicted = p + q
        s = predicted + r
        before, p = p, predicted
        if math.isnan(z[i]):
            pass
        elif math.isinf(predicted):
            x, p, rejected = z[i], r, 0
        elif math.isnan(x):
            k = predicted / s if s > zero else zero
            x, p, rejected = z[i], k * r, 0
        elif s > zero:
            v = z[i] - x
            if gate > zero and v * v > gate * s and rejected < GATE_LIMIT:
                rejected += 1
            else:
                k = predicted / s
                p = k * r
                if settled_gain > zero and p == before:
                    k = settled_gain
                x = x + k * v
                rejected = 0
        out[i] = x


@compiled()
def _filter_with_momentum(
    z: Floats,
    over: tuple[np.float32, np.float32, np.float32, np.float32, np.float32],
    r: np.float32,
    gate: np.float32,
    settled_gain: np.float32,
    x: np.float32,
    p: np.float32,
    w: np.float32,
    out: Floats,
) -> None:
    """`momentum.kernels.step` in float32: v is the velocity, w its variance, g the covariance of x and v."""
    two, zero = np.float32(2.0), np.float32(0.0)
    e, f, q11, q12, q22 = over
    v = g = zero
    rejected = 0
    for i in range(z.shape[0]):
        before = p
        fw = f * w
        p = p + f * (two * g + fw) + q11
        g = e * (g + fw) + q12
        w = e * e * w + q22
        x = x + f * v
        v = e * v
        s = p + r
        if math.isnan(z[i]):
            pass
        elif math.isinf(p):
            x, p, g, rejected = z[i], r, zero, 0
        elif s > zero:
            innovation = z[i] - x
            if gate > zero and innovation * innovation > gate * s and rejected < GATE_LIMIT:
                rejected += 1
            else:
                k, ell = p / s, g / s
                p, g, w = k * r, ell * r, w - ell * g
                if settled_gain > zero and p == before:
                    k = settled_gain
                if math.isnan(x):
                    x = z[i]
                else:
                    x, v = x + k * innovation, v + ell * innovation
                rejected = 0
        elif math.isnan(x):
            x, rejected = z[i], 0
        out[i] = x


# A channel as a small board filters it, in float32: by Kalman or a classic filter, or either after a median.


def runs_kalman(channel: ChannelTuning) -> bool:
    """Whether the last filter of a channel is its Kalman filter."""
    return channel.chain is None or channel.chain.then is None


def float32_tuning(channel: ChannelTuning) -> Float32Params | None:
    """What a board holds of a channel's Kalman filter, its median included; None where a classic filter is last.

    Raises:
        BadSetting: float32 cannot hold a value (the message names it).
    """
    chain = channel.chain
    if chain is None or chain.then is None:
        return float32_params(channel.params, 1 if chain is None else chain.median)
    _check(chain.then)
    return None


def filter_channel_float32(z: ArrayLike, channel: ChannelTuning) -> Floats:
    """The filtered signal of a channel as a board with float32 computes it, bit for bit.

    Args:
        z: Samples since the start, shape (n,), rounded to float32; NaN where missing.
        channel: The filter.

    Returns:
        x, float32, shape (n,).

    Raises:
        BadSetting: float32 cannot hold a value.
    """
    held = float32_tuning(channel)
    if held is not None or channel.chain is None:
        return filter_float32(z, held or channel.params)
    return RunningStages(channel.chain.stages, np.float32).take(np.asarray(z, dtype=np.float32), np.empty(0))


def _check(stage: Stage) -> None:
    for value in stage.constants:
        try:
            to_float32("a number", value)
        except BadSetting:
            raise BadSetting(
                f"{stage.name} must compute with numbers that float32 holds, up to 3.4e38 (got {number(value)},"
                f" {stage.words})"
            ) from None


# The fused filter as a small board computes it: in float32, in the order of the exported code.


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
