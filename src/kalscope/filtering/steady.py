"""What q, r and momentum mean once the filter has settled: gain, lag, cut-off and noise reduction, and back."""

from __future__ import annotations

import cmath
import functools
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from kalscope.common.numbers import Array, above_zero, bisect
from kalscope.errors import BadSetting
from kalscope.filtering.kernels import transition
from kalscope.filtering.params import MAX_MOMENTUM, FilterParams, require_params, scalar

# λ ⇄ gain ⇄ lag ⇄ hertz ⇄ decibel: what a pair (q, r) means once the filter has settled.
#
# Only λ = q/r and the momentum shape the steady filter. Without momentum it is x += K (z − x), exponential
# smoothing with α = K; with it, see `WithMomentum`. Formulas: K solves K² = λ(1 − K) (Durbin & Koopman 2012,
# section 2.11); computed from √q and √r, so that 1e300 and 1e-300 neither overflow nor lose digits.


SETTLED = 0.01
"""Share of a step that is left at the settling time."""


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


@lru_cache(256)
def _one(q: float, r: float, momentum: float, period: float | None) -> SteadyState:
    return at_period(_with_momentum(q, r, momentum) if momentum > 0.0 < q else _plain(q, r), period)


def at_period(in_samples: SteadyState, sample_period: float | None) -> SteadyState:
    """A state whose s and Hz are those of a period of 1, at this sample period; None where it is not known."""
    if sample_period is None:
        return replace(in_samples, lag_s=None, cutoff_hz=None)
    lag, cutoff = in_samples.lag_samples * sample_period, scalar(in_samples.cutoff_hz) / sample_period
    return replace(in_samples, lag_s=lag, cutoff_hz=cutoff)


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

    The formulas are those without momentum; with it λ is searched for.

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
    targets = {"gain": gain, "lag_samples": lag_samples, "lag_s": lag_s}
    targets |= {"cutoff_hz": cutoff_hz, "noise_reduction_db": noise_reduction_db}
    given = {name: value for name, value in targets.items() if value is not None}
    if len(given) != 1:
        raise BadSetting(f"exactly one of {', '.join(targets)} must be given (got {', '.join(given) or 'none'})")
    ((name, value),) = given.items()
    tau = float(FilterParams(q=1.0, r=1.0, momentum=momentum).momentum)
    value = _in_samples(name, above_zero(name, value), sample_period)
    if tau:
        return _ratio_with_momentum(name, value, tau)
    if name == "gain":
        return value * value / (1.0 - value)
    if name == "cutoff_hz":
        return value
    if name == "noise_reduction_db":
        rho = 10.0 ** (-value / 10.0)
        return -4.0 * rho * rho / math.expm1(-0.2 * math.log(10.0) * value)
    return 1.0 / value / (1.0 + value)


def params_of_gain(gain: float) -> FilterParams:
    """The random walk whose filter settles at this gain, 0 … 1."""
    return FilterParams(1.0, 0.0) if gain >= 1.0 else FilterParams(gain * gain / (1.0 - gain), 1.0)


def _in_samples(name: str, value: float, sample_period: float | None) -> float:
    """A lag in samples, a cut-off f as 4 sin²(π f T); a gain and a noise reduction as they are."""
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


def _plain(q: float, r: float) -> SteadyState:
    """The settled random walk, for a period of 1."""
    root_q, root_r = math.sqrt(q), math.sqrt(r)
    widest = root_q + math.hypot(root_q, 2.0 * root_r)  # √q + √(q + 4r)
    gain = 2.0 * root_q / widest
    lag = math.inf if q == 0.0 else 2.0 * (root_r / root_q) * (root_r / widest)
    kept = 2.0 * (root_r / widest) * (2.0 * root_r / widest)  # 1 − K = K²/λ without cancellation
    decay = -math.log1p(-gain) if gain < 0.5 else (-math.log(kept) if kept > 0.0 else math.inf)
    settle = math.inf if decay == 0.0 else -math.log(SETTLED) / decay
    reduction = math.inf if gain == 0.0 else 10.0 * math.log10((2.0 - gain) / gain)
    cutoff = math.asin(0.5 * root_q / root_r) / math.pi if 0.5 * root_q <= root_r else math.nan
    return SteadyState(gain, gain * r, lag, lag, reduction, cutoff, settle)


# What a device must know about a momentum: the constants of one sample period, which never change.


FORGOTTEN = 1.2e-38
"""Shares of a velocity below this are 0: float32 cannot hold them, and they change no later value."""


@dataclass(frozen=True)
class StepConstants:
    """Over one sample period x grows by f v, v fades to e v, and their variances grow."""

    momentum: float
    """Momentum τ, sample periods; 0 = the five lines."""
    e: float
    """Share of the velocity that is left after one sample."""
    f: float
    """Distance that a velocity of 1 goes in one sample, sample periods."""
    q11: float
    """Variance added to x, unit²."""
    q12: float
    """Covariance added, unit² per sample."""
    q22: float
    """Variance added to v, (unit per sample)²."""
    w0: float
    """Variance of v before the first sample, q/(2τ), (unit per sample)²."""


def step_constants(q: float, momentum: float) -> StepConstants:
    """The constants of one channel; a velocity that does not last a sample is none, so τ = 0 is the five lines."""
    if momentum == 0.0:
        return StepConstants(0.0, e=0.0, f=0.0, q11=q, q12=0.0, q22=0.0, w0=0.0)
    e, f, q11, q12, q22 = transition(1.0, q, momentum)
    return StepConstants(momentum, e if e > FORGOTTEN else 0.0, f, q11, q12, q22, 0.5 * q / momentum)


# The settled filter with momentum, in closed forms in which nothing cancels.
#
# With u = 2 - 2 cos ω the spectrum of (1 - L)(1 - eL) z, over r, is e u² + (φ² - λβ) u + λφ², where φ = 1 - e and β
# = τ e (sinh 1/τ - 1/τ). The poles z1, z2 of the settled filter are the roots of its factor inside the unit circle
# (the reduced form: Harvey 1989, section 2.4): two quadratic equations, so nothing iterates. Their product π is e
# (1 - K), and P = (1 - z1)(1 - z2) is φ R with the reach R = K + τ L, R² = λ (1 - K). The Riccati equation then is
#
#     e² K² + φ (1 + e + e R) K = R (1 - e² - β R)      e τ/(1 + e) L² + (φ + e K) L = φ R²/2
#
# K small or L small would lose their digits as differences of the poles; here every term is positive.


MIN_SHARE = 1e-100
"""A share of the velocity that is smaller counts as this one: its pole is at 0, but nothing divides by 0."""

MIN_RATIO, MAX_RATIO = 1e-40, 1e40
"""q/r beyond these is not a useful filter: lags of 1e20 samples, or noise in the twentieth digit."""

MIN_MOMENTUM = 1.0 / 500.0
"""The shortest that is searched for an overshoot: such a velocity is forgotten long before the next sample."""

_EXACT, _GRID = 2000, 4000
"""The first samples of a step are all evaluated; later ones on a grid with even steps in its logarithm."""
_GRID_END = 1e-5
"""Share of a step that is left where the grid ends."""


@dataclass(frozen=True)
class Pole:
    """A pole of the settled filter."""

    z: complex
    """Its position, inside the unit circle."""
    d: complex
    """1 - z, without cancellation."""

    @classmethod
    def of(cls, m: complex) -> Pole:
        """Z and 1 - z of (1 - z)²/z = m with |z| < 1."""
        root = cmath.sqrt(m) * cmath.sqrt(m + 4.0)
        if abs(2.0 + m + root) < abs(2.0 + m - root):
            root = -root
        return cls(2.0 / (2.0 + m + root), 2.0 * m / (m + root) if abs(m + root) > 0.0 else 0.0)

    @property
    def log_radius(self) -> float:
        """Ln |z|."""
        near = abs(self.z) > 0.5
        return 0.5 * math.log1p(abs(self.d) ** 2 - 2.0 * self.d.real) if near else math.log(abs(self.z))

    def power(self, n: Array) -> Array:
        """zⁿ of a real pole."""
        size = np.exp(self.log_radius * n)
        return size if self.z.real > 0.0 else size * (1.0 - 2.0 * np.mod(n, 2.0))


class WithMomentum:
    """The settled filter x += K (z - ahead), v += L (z - ahead) of λ and τ > 0, for a period of 1."""

    def __init__(self, ratio: float, tau: float) -> None:
        """Args: λ = q/r above 0; τ in sample periods."""
        ratio, h = min(max(ratio, MIN_RATIO), MAX_RATIO), 1.0 / tau
        e = math.exp(-h)
        forgotten, bend = -math.expm1(-h), tau * _bend(h)  # φ, and β: what high frequencies of the signal lack
        self.poles = first, second = _poles(math.sqrt(ratio), e, forgotten, bend)
        self.product = (first.d * second.d).real  # P
        reach = self.product / forgotten
        linear = forgotten * (1.0 + e + e * reach)
        right = reach * (forgotten * (1.0 + e) - bend * reach)
        self.gain = min(1.0, 2.0 * right / (linear + math.sqrt(linear * linear + 4.0 * e * e * right)))
        self.kept = min(1.0, reach * reach / ratio)  # 1 - K, whose digits K near 1 would lose
        self.lag = self.kept / reach
        self._both, self._lost = e * self.kept, forgotten + e * self.gain
        right = forgotten * reach * reach
        curve = 2.0 * e * tau / (1.0 + e) * right
        self.velocity_gain = right / (self._lost + math.sqrt(self._lost * self._lost + curve))
        total = (first.z + second.z).real
        self._weights = self.kept, total * self.kept - self.kept + self.product - self.gain * (1.0 - total)

    @property
    def noise(self) -> float:
        """Share of white noise that is left, Σh² (ARMA variance: Brockwell & Davis 1991, section 3.3).

        It rises with λ, as in every optimal filter: the filter of λ has the least N + λ B, where B is the
        distortion of the signal. Two such inequalities, each filter in place of the other, add up to
        (λ1 - λ2)(B1 - B2) ≤ 0; so B falls with λ, and N rises.
        """
        both, product, gain = 1.0 + self._both, self.product, self.gain
        variance = product * both + 2.0 * gain * (gain - product)
        return variance / (self._lost * (2.0 * both - product))

    @property
    def cutoff(self) -> float:
        """4 sin²(π f) at the frequency f at which |H|² = ½; above 4 there is none."""
        product, gain = self.product, self.gain
        middle = self._lost * self._lost - product * (1.0 + self._both) + 2.0 * gain * (product - gain)
        root = math.sqrt(middle * middle + 4.0 * self._both * product * product)
        if middle > 0.0:
            return 2.0 * product * product / (middle + root)
        return (root - middle) / max(2.0 * self._both, 1e-300)

    # What is missing of a step after n + 1 samples: e(n) = e(0) S(n) - (t e(0) - e(1)) S(n - 1).

    def _after(self, n: Array) -> Array:
        """Error after n + 1 samples."""
        return self._weights[0] * self._powers(n) - self._weights[1] * self._powers(n - 1.0)

    def _powers(self, n: Array) -> Array:
        """S(n) = (z1^(n+1) - z2^(n+1)) / (z1 - z2), also for poles that are equal."""
        first, second = self.poles
        if first.z.imag:
            angle = abs(cmath.phase(first.z))
            return np.exp(first.log_radius * n) * np.sin((n + 1.0) * angle) / math.sin(angle)
        gap = (second.d - first.d).real
        if gap == 0.0:
            return (n + 1.0) * first.power(n)
        return (first.power(n + 1.0) - second.power(n + 1.0)) / gap

    @functools.cached_property
    def _grid(self) -> tuple[Array, Array]:
        """Times, and the errors at them."""
        decay = -max(pole.log_radius for pole in self.poles)
        end = max(-math.log(_GRID_END) / decay, 2.0 * _EXACT)
        grid = np.unique(np.rint(np.geomspace(_EXACT, end, _GRID)))
        samples = np.concatenate([np.arange(float(_EXACT)), grid[1:]])
        return np.concatenate([[0.0], samples + 1.0]), np.concatenate([[1.0], self._after(samples)])

    def overshoot(self) -> float:
        """How far the error goes below 0."""
        times, errors = self._grid
        at = int(np.argmin(errors))
        around = np.linspace(float(times[max(at - 1, 1)]), float(times[min(at + 1, len(times) - 1)]), 200)
        return max(0.0, -float(self._after(np.rint(around) - 1.0).min()))

    def last_above(self, share: float) -> float:
        """Time after which the error stays within ± `share`, in whole samples."""
        at = int(np.flatnonzero(np.abs(self._grid[1]) > share)[-1])
        low, high = self._grid[0][at : at + 2]
        steps = 1 + math.ceil(math.log2(high - low))
        return math.floor(bisect(lambda time: abs(self._at(math.floor(time))) > share, low, high, steps)[1])

    def _at(self, time: float) -> float:
        """The error after `time` samples."""
        return 1.0 if time == 0.0 else float(self._after(np.array([time - 1.0]))[0])


def _poles(root: float, e: float, forgotten: float, bend: float) -> tuple[Pole, Pole]:
    """The poles of λ = root²."""
    top, bottom = max(e, MIN_SHARE) / root, root * forgotten**2
    middle = forgotten**2 / root - root * bend
    inner = cmath.sqrt(middle * middle - 4.0 * top * bottom)
    large = (middle + (inner if middle >= 0.0 else -inner)) / (2.0 * top)
    return Pole.of(large), Pole.of(bottom / (top * large))


def _bend(h: float) -> float:
    """exp(-h) (sinh h - h), by its series where the closed form loses digits."""
    if h > 1.0:
        return -0.5 * math.expm1(-2.0 * h) - h * math.exp(-h)
    term = total = h * h * h / 6.0
    for n in range(4, 22, 2):
        term *= h * h / (n * (n + 1))
        total += term
    return total * math.exp(-h)


def _with_momentum(q: float, r: float, tau: float) -> SteadyState:
    """The settled filter of q > 0, r ≥ 0 and τ > 0, for a period of 1."""
    if r == 0.0:
        velocity_gain = WithMomentum(MAX_RATIO, tau).velocity_gain
        return SteadyState(1.0, 0.0, 0.0, 0.0, 0.0, math.nan, 0.0, 0.0, velocity_gain)
    one = WithMomentum(q / r, tau)
    return SteadyState(
        gain=one.gain,
        p=one.gain * r,
        lag_samples=one.lag,
        lag_s=one.lag,
        noise_reduction_db=0.0 - 10.0 * math.log10(one.noise),  # 0 rather than -0
        cutoff_hz=math.asin(0.5 * math.sqrt(one.cutoff)) / math.pi if one.cutoff <= 4.0 else math.nan,
        settle_samples=one.last_above(SETTLED),
        overshoot=one.overshoot(),
        velocity_gain=one.velocity_gain,
    )


def _ratio_with_momentum(name: str, value: float, tau: float) -> float:
    """The λ at which the settled filter of a momentum meets a target of `_in_samples`.

    What the target names rises with λ, but a lag falls.
    """

    def is_below(log_ratio: float) -> bool:
        one = WithMomentum(math.exp(log_ratio), tau)
        if name == "noise_reduction_db":
            return one.noise < 10.0 ** (-value / 10.0)
        if name == "cutoff_hz":
            return one.cutoff < value
        return one.gain < value if name == "gain" else one.lag > value

    return math.exp(bisect(is_below, math.log(MIN_RATIO), math.log(MAX_RATIO))[1])


def momentum_for_overshoot(overshoot: float, ratio_at: Callable[[float], float]) -> float:
    """The momentum at which the step response overshoots by the share `overshoot`.

    0 for no overshoot: momentum up to half of the lag has none either, but saves only 0.2 dB of noise.

    Along every curve of equal lag, noise, cut-off or gain the overshoot rises with the momentum; at lags below 0.2
    samples not strictly, because a step is seen at whole samples only. The bisection ends within the target in any
    case, and a larger target never ends at less momentum.

    Args:
        overshoot: share of the step, ≥ 0.
        ratio_at: λ that keeps the other target, by momentum.

    Raises:
        BadSetting: the overshoot is not from 0 to 1, or more than any momentum has.
    """
    if not 0.0 <= overshoot < 1.0:
        raise BadSetting(f"overshoot must be a share of the step from 0 to 1, such as 0.1 (got {overshoot:g})")

    def reached(momentum: float) -> float:
        return WithMomentum(ratio_at(momentum), momentum).overshoot()

    if overshoot == 0.0 or reached(MIN_MOMENTUM) > overshoot:
        return 0.0
    largest = reached(MAX_MOMENTUM)
    if overshoot > largest:
        possible = 100.0 * 0.9995 * largest  # still possible when it is rounded
        raise BadSetting(
            f"overshoot must be at most {possible:.4g} % of a step with this target (got {100.0 * overshoot:g} %)"
        )
    ends = math.log(MIN_MOMENTUM), math.log(MAX_MOMENTUM)
    return math.exp(bisect(lambda log: reached(math.exp(log)) <= overshoot, *ends, steps=48)[0])
