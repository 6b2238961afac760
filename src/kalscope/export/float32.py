"""The filter as a small board computes it: float32, one rounding an operation; for one sensor, several, or a chain.

`filter_float32` gives the same bits as the exported C++ and C (float) on a processor that rounds as IEEE 754
says and does not fuse a multiplication with an addition: what a board prints can be compared exactly.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kalscope.common.compiled import compiled
from kalscope.common.text import number
from kalscope.errors import BadSetting
from kalscope.filtering.classic import Median, RunningStages
from kalscope.filtering.kernels import GATE_LIMIT
from kalscope.filtering.params import FilterParams, require_params
from kalscope.filtering.steady import step_constants
from kalscope.filtering.two_speeds import LASTING, NEVER, SHARE, SPIKE
from kalscope.tuning.tuning import ChannelTuning

MIN_NORMAL = float(np.finfo(np.float32).tiny)
"""Smallest float32 that keeps its 24 bits."""

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
    """Parameters of a filter as a board holds them; each value is a float32."""

    q: np.float32
    """Process-noise variance per sample period, unit²."""
    r: np.float32 | Floats
    """Measurement-noise variance, unit²; of several sensors r/gain², shape (sensors,)."""
    p0: np.float32 = _INFINITE
    """Variance before the first predict, unit²; inf = diffuse, the first sample sets x = z and p = r."""
    x0: np.float32 = _UNKNOWN
    """Estimate before the first predict, unit; NaN = the first sample."""
    gate: np.float32 = _NOTHING
    """Outlier gate on v²/s; 0 = off."""
    fast: np.float32 | None = None
    """Two speeds: how much larger q is while the signal moves; None = one speed."""
    spikes: np.float32 = _NOTHING
    """With two speeds, the probability of a spike."""
    momentum: Float32Momentum | None = None
    """The second state; None = the five lines."""
    median: int = 1
    """Samples whose median goes into the filter; 1 = each sample itself."""
    offset: Floats | None = None
    """What each sensor reads where x is 0, shape (sensors,); None = the one sensor reads x itself."""
    gain: Floats | None = None
    """By how much its reading grows with x, shape (sensors,)."""


def float32_params(params: FilterParams, median: int = 1) -> Float32Params:
    """The parameters rounded to float32.

    Args:
        params: Those of one sensor or several.
        median: Window of the median before the filter, samples; 1 = none.

    Raises:
        BadSetting: float32 cannot hold a value (the message names it).
    """
    require_params(params)
    noise, alone = ("r", True) if params.reads_x else ("r / gain²", False)
    q, r = to_float32("q", params.q), _each(noise, params.scaled_r)
    held = Float32Params(
        q=q,
        r=r[0] if alone else r,
        p0=_INFINITE if params.p0 is None else to_float32("p0", params.p0),
        x0=_UNKNOWN if params.x0 is None else to_float32("x0", params.x0),
        gate=_NOTHING if params.gate is None else to_float32("gate", params.gate),
        fast=None if params.fast is None else to_float32("fast", params.fast),
        spikes=to_float32("spikes", params.spikes),
        momentum=_momentum(params.q, params.momentum),
        median=median,
        offset=None if alone else _each("offset", params.offset),
        gain=None if alone else _each("gain", params.gain),
    )
    largest = params.moving.q + float(params.scaled_r.max()) + (params.p0 or 0.0)
    if largest > float(np.finfo(np.float32).max):
        raise BadSetting(f"q + {noise} + p0 must fit float32, up to 3.4e38 (got {largest:.6g})")
    return held


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


def filter_float32(z: ArrayLike, params: FilterParams | Float32Params | ChannelTuning) -> Floats:
    """The filtered signal as a board with float32 computes it, bit for bit.

    Args:
        z: Samples since the filter was (re)started, shape (n,), or (n, sensors) of sensors that are fused; rounded
            to float32; NaN where missing.
        params: The parameters, those that a board reported, or a channel with its chain.

    Returns:
        x, float32, shape (n,).

    Raises:
        BadSetting: z has another shape; float32 cannot hold a parameter.
    """
    samples: Floats = np.ascontiguousarray(z, dtype=np.float32)
    notch = None
    if isinstance(params, ChannelTuning):
        notch = params.chain and params.chain.notch
        kalman = float32_tuning(params)
        if params.chain is not None and kalman is None:
            return RunningStages(params.chain.stages, np.float32).take(samples, np.empty(0))
        params = kalman or params.params
    held = params if isinstance(params, Float32Params) else float32_params(params)
    if samples.ndim != 1 + np.ndim(held.r) or samples.shape[1:] != np.shape(held.r):
        raise BadSetting(f"z must have shape {('n', *np.shape(held.r))} (got {samples.shape})")
    first = (*((Median(held.median),) if held.median > 1 else ()), *((notch,) if notch else ()))
    if first:
        samples = np.where(np.isnan(samples), samples, RunningStages(first, np.float32).take(samples, samples[:0]))
    if held.offset is not None and held.gain is not None:
        samples = (samples - held.offset) / held.gain  # as the board does, a rounding each
    if held.fast is not None:
        start = held.x0, np.float32(SHARE), held.p0
        return _filter_two_speeds(samples, held.q, held.fast, np.float32(held.r), held.spikes, start)
    m, out = held.momentum or without_momentum(held.q), np.empty(len(samples), np.float32)
    over = m.e, m.f, m.q11, m.q12, m.q22
    rows = samples.reshape(len(samples), -1)
    _filter(rows, over, np.atleast_1d(held.r), held.gate, held.x0, held.p0, m.w0, out)
    return out


def to_float32(name: str, value: float) -> np.float32:
    """`value` rounded once; BadSetting names it where float32 cannot hold it with its 24 bits."""
    with np.errstate(over="ignore", under="ignore"):
        rounded = np.float32(value)
    if math.isinf(rounded) or (value != 0.0 and abs(float(rounded)) < MIN_NORMAL):
        raise BadSetting(f"{name} must fit float32: 0, or a size from 1.2e-38 to 3.4e38 (got {value:.6g})")
    return rounded


def _each(name: str, values: NDArray[np.float64]) -> Floats:
    return np.array([to_float32(name, value) for value in values.tolist()], np.float32)


def _momentum(q: float, momentum: float) -> Float32Momentum | None:
    """The constants, computed in double and rounded; None without momentum."""
    if momentum == 0.0:
        return None
    constants = asdict(step_constants(q, momentum)).items()
    return Float32Momentum(**{name: to_float32(f"{name} of q and momentum", value) for name, value in constants})


@compiled()
def _filter(
    z: Floats,
    over: tuple[np.float32, np.float32, np.float32, np.float32, np.float32],
    r: Floats,
    gate: np.float32,
    x: np.float32,
    p: np.float32,
    w: np.float32,
    out: Floats,
) -> None:
    """`kernels.step` in float32: v is the velocity, w its variance, g the covariance of x and v.

    Every constant is a float32: with a plain 1.0 numba would compute in double.
    """
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


@compiled()
def _filter_two_speeds(
    z: Floats,
    q: np.float32,
    fast: np.float32,
    r: np.float32,
    spikes: np.float32,
    state: tuple[np.float32, np.float32, np.float32],
) -> Floats:
    """`two_speeds.step_two_speeds` in float32."""
    one, half, zero = np.float32(1.0), np.float32(0.5), np.float32(0.0)
    share, lasting = np.float32(SHARE), np.float32(LASTING)
    spike = np.float32(SPIKE)
    x, moving, p = state
    grown_fast, out = fast * q, np.empty(len(z), np.float32)
    for i in range(len(z)):
        moving = share + lasting * (moving - share)
        before, ahead = p, p + q + moving * (grown_fast - q)
        if math.isnan(z[i]):
            p = ahead
        elif math.isinf(before):
            x, p = z[i], r
        elif math.isnan(x):
            x, p = z[i], ahead / (ahead + r * (one + spikes * (spike - one))) * r
        else:
            v = z[i] - x
            square, slow, quick, good = v * v, before + q, before + grown_fast, one - spikes
            half_square, wide, w0, c0 = half * square, quick + r, zero, zero
            c1, c2 = one / wide, one / (slow + r)
            least = half_square * c1
            if spikes > zero:
                c0 = one / (ahead + spike * r)
                least = min(least, half_square * c0)
                w0 = spikes * np.sqrt(c0 * wide) * _exp_minus(half_square * c0 - least)
            w1 = good * moving * _exp_minus(half_square * c1 - least)
            w2 = good * (one - moving) * np.sqrt(c2 * wide) * _exp_minus(half_square * c2 - least)
            whole = one / (w0 + w1 + w2)
            w0, w1, w2 = w0 * whole, w1 * whole, w2 * whole
            k0, k1, k2 = ahead * c0, quick * c1, slow * c2
            a0, a1, a2 = w0 * k0, w1 * k1, w2 * k2
            k = a0 + a1 + a2
            spread = max(a0 * k0 + a1 * k1 + a2 * k2 - k * k, zero)
            x, moving, p = x + k * v, w1 + w0 * moving, (spike * a0 + a1 + a2) * r + spread * square
        out[i] = x
    return out


@compiled(inner=True)
def _exp_minus(u: np.float32) -> np.float32:
    """`two_speeds.exp_minus` in float32."""
    if u >= np.float32(NEVER):
        return np.float32(0.0)
    even, odd = np.float32(1.0) + u * u * np.float32(1.0 / 3072.0), u * np.float32(0.03125)
    power = (even - odd) / (even + odd)
    for _ in range(4):
        power = power * power
    return power


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
    for value in chain.then.constants:
        try:
            to_float32("a number", value)
        except BadSetting:
            raise BadSetting(
                f"{chain.then.name} must compute with numbers that float32 holds, up to 3.4e38 (got"
                f" {number(value)}, {chain.then.words})"
            ) from None
    return None
