"""λ ⇄ gain ⇄ lag ⇄ hertz ⇄ decibel: what a pair (q, r) means once the filter has settled.

Only λ = q/r and the momentum shape the steady filter. Without momentum it is x += K (z − x), exponential smoothing
with α = K; with it, see `momentum.settled`. Formulas:
K solves K² = λ(1 − K) (Durbin & Koopman 2012, section 2.11); computed from √q and √r, so that 1e300 and
1e-300 neither overflow nor lose digits.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

from kalscope.common.checks import above_zero
from kalscope.errors import BadSetting
from kalscope.filtering.momentum.settled import Settled, settle
from kalscope.filtering.momentum.specification import Target, ratio_with_momentum
from kalscope.filtering.params import FilterParams, require_params

SETTLED = 0.01
"""Share of a step that is left at the settling time."""

_TARGETS: dict[str, Target] = {
    "gain": "gain",
    "lag_samples": "lag",
    "lag_s": "lag",
    "cutoff_hz": "cutoff",
    "noise_reduction_db": "noise",
}
"""The targets of `ratio_for`, as `ratio_with_momentum` names them."""


@dataclass(frozen=True)
class SteadyState:
    """The settled filter in practical terms."""

    gain: float
    """K, the share of each innovation that is added to the estimate, 0 … 1."""
    p: float
    """Posterior variance K·r, unit²."""
    lag_samples: float
    """Lag on a ramp in samples, (1 − K)/K; inf for q = 0."""
    lag_s: float | None
    """The same in s; None without a sample period."""
    noise_reduction_db: float
    """White noise, in to out: −10·log10(K/(2 − K)) dB, 0 = none."""
    cutoff_hz: float | None
    """−3 dB frequency asin(√λ/2)/(πT) in Hz; NaN above λ = 4, where there is none; None without a period."""
    settle_samples: float
    """Settling time to 1 % of a step, in samples, ln(0.01)/ln(1 − K)."""
    time_constant_s: float | None
    """Time in s after which 63 % of a step is reached, −T/ln(1 − K); None without a sample period."""
    overshoot: float = 0.0
    """Overshoot of the step response, as a share of the step; 0 without momentum."""
    velocity_gain: float = 0.0
    """Share of each innovation that is added to the velocity, per sample; 0 without momentum."""


def steady_state(params: FilterParams, sample_period: float | None = None) -> SteadyState:
    """The settled filter of q and r.

    Args:
        params: q, r and momentum; of several sensors, that of all together; p0 and x0 do not matter.
        sample_period: nominal sample period in s, > 0; None leaves out the results in s and Hz.

    Raises:
        BadSetting: the sample period is not a positive finite number.
    """
    require_params(params)
    period = None if sample_period is None else above_zero("sample_period", sample_period)
    return _one(params.q, float(params.as_single.r if params.fuses else params.r), params.momentum, period)


def settled_transfer(params: FilterParams) -> tuple[float, float, float]:
    """(K, P, π) of the settled filter x = H z, H = (K + (P − K) L) / (1 − (1 + π − P) L + π L²).

    L is the sample before; the poles z₁, z₂ have π = z₁z₂ = e (1 − K) and P = (1 − z₁)(1 − z₂). Without momentum
    π = 0 and P = K.

    Args:
        params: the filter, scalars.
    """
    steady = steady_state(params)
    gain, tau = steady.gain, params.momentum
    if not tau:
        return gain, gain, 0.0
    forgotten = -math.expm1(-1.0 / tau)
    return gain, forgotten * (gain + tau * steady.velocity_gain), math.exp(-1.0 / tau) * (1.0 - gain)


def ratio_for(
    *,
    gain: float | None = None,
    lag_samples: float | None = None,
    lag_s: float | None = None,
    cutoff_hz: float | None = None,
    noise_reduction_db: float | None = None,
    sample_period: float | None = None,
    momentum: float = 0.0,
) -> float:
    """λ = q/r of the steady filter that meets exactly one target.

    The formulas are those without momentum; with it see `momentum.specification`.

    Args:
        gain: K, 0 < K < 1: λ = K²/(1 − K).
        lag_samples: samples behind a ramp, > 0: λ = 1/(lag (1 + lag)).
        lag_s: the same in s; needs sample_period.
        cutoff_hz: −3 dB frequency, > 0 and at most half the sample rate; needs sample_period:
            λ = 4 sin²(π f T).
        noise_reduction_db: white noise in to out, > 0 dB: with ρ = 10^(−dB/10), λ = 4ρ²/(1 − ρ²).
        sample_period: nominal sample period in s.
        momentum: τ of the filter in sample periods, 0 … 1e5.

    Returns:
        λ; 0 where it is too small for a float, as for lags beyond 1e154 samples.

    Raises:
        BadSetting: no target or several, one out of range, or one in s or Hz without a sample period.
    """
    targets = {
        "gain": gain,
        "lag_samples": lag_samples,
        "lag_s": lag_s,
        "cutoff_hz": cutoff_hz,
        "noise_reduction_db": noise_reduction_db,
    }
    given = {name: value for name, value in targets.items() if value is not None}
    if len(given) != 1:
        raise BadSetting(f"exactly one of {', '.join(targets)} must be given (got {', '.join(given) or 'none'})")
    ((name, value),) = given.items()
    tau = float(FilterParams(q=1.0, r=1.0, momentum=momentum).momentum)
    target, value = _TARGETS[name], _in_samples(name, above_zero(name, value), sample_period)
    if not tau:
        return _ratio_without_momentum(target, value)
    return ratio_with_momentum(target, 10.0 ** (-value / 10.0) if target == "noise" else value, tau)


def _in_samples(name: str, value: float, sample_period: float | None) -> float:
    """The target as `ratio_with_momentum` takes it, but a noise reduction in dB."""
    if name == "gain" and value >= 1.0:
        raise BadSetting(f"gain must lie between 0 and 1 (got {value:g})")
    if name in ("lag_s", "cutoff_hz"):
        if sample_period is None:
            raise BadSetting(f"{name} needs sample_period, the time between two samples in s (got None)")
        period = above_zero("sample_period", sample_period)
        if name == "lag_s":
            return above_zero("lag_samples", value / period)
        if value * period > 0.5:
            limit = f"half the sample rate, {0.5 / period:g} Hz"
            raise BadSetting(f"cutoff_hz must be at most {limit} (got {value:g})")
        return 4.0 * math.sin(math.pi * value * period) ** 2
    return value


def _ratio_without_momentum(target: Target, value: float) -> float:
    if target == "gain":
        return value * value / (1.0 - value)
    if target == "lag":
        return 1.0 / value / (1.0 + value)
    if target == "noise":
        rho = 10.0 ** (-value / 10.0)
        return -4.0 * rho * rho / math.expm1(-0.2 * math.log(10.0) * value)
    return value


@lru_cache(256)
def _one(q: float, r: float, momentum: float, period: float | None) -> SteadyState:
    return (
        _with_momentum(settle(q, r, momentum, SETTLED), r, period) if momentum > 0.0 < q else _plain(q, r, period)
    )


def _with_momentum(settled: Settled, r: float, period: float | None) -> SteadyState:
    return SteadyState(
        gain=settled.gain,
        p=settled.gain * r,
        lag_samples=settled.lag,
        lag_s=None if period is None else settled.lag * period,
        noise_reduction_db=0.0 - 10.0 * math.log10(settled.noise),  # 0 rather than -0
        cutoff_hz=None if period is None else settled.cutoff / period,
        settle_samples=settled.settling,
        time_constant_s=None if period is None else settled.time_constant * period,
        overshoot=settled.overshoot,
        velocity_gain=settled.velocity_gain,
    )


def _plain(q: float, r: float, period: float | None) -> SteadyState:
    root_q, root_r = math.sqrt(q), math.sqrt(r)
    widest = root_q + math.hypot(root_q, 2.0 * root_r)  # √q + √(q + 4r)
    gain = 2.0 * root_q / widest
    lag = math.inf if q == 0.0 else 2.0 * (root_r / root_q) * (root_r / widest)
    kept = 2.0 * (root_r / widest) * (2.0 * root_r / widest)  # 1 − K = K²/λ without cancellation
    decay = -math.log1p(-gain) if gain < 0.5 else (-math.log(kept) if kept > 0.0 else math.inf)
    constant = math.inf if decay == 0.0 else 1.0 / decay
    reduction = math.inf if gain == 0.0 else 10.0 * math.log10((2.0 - gain) / gain)
    cutoff = math.asin(0.5 * root_q / root_r) / math.pi if 0.5 * root_q <= root_r else math.nan
    return SteadyState(
        gain=gain,
        p=gain * r,
        lag_samples=lag,
        lag_s=None if period is None else lag * period,
        noise_reduction_db=reduction,
        cutoff_hz=None if period is None else cutoff / period,
        settle_samples=-math.log(SETTLED) * constant,
        time_constant_s=None if period is None else constant * period,
    )
