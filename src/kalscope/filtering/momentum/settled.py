"""What the filter with momentum settles to: its gains, and its answers to a step, a ramp and white noise.

With u = 2 - 2 cos ω the spectrum of (1 - L)(1 - eL) z is A u² + B u + C, and the poles of the settled filter are
the roots of its factor inside the unit circle (the reduced form: Harvey 1989, section 2.4). Both follow from
quadratic equations, so nothing iterates. A pole is kept with its distance d = 1 - z, small for slow filters.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from kalscope.common.array import Array
from kalscope.filtering.momentum.kernels import transition

MIN_MOMENTUM = 1.0 / 500.0
"""Shorter ones settle as this one: the velocity is forgotten long before the next sample."""

MIN_RATIO, MAX_RATIO = 1e-40, 1e40
"""q/r beyond these is no filter: lags of 1e20 samples, or noise in the twentieth digit."""

_EXACT, _GRID = 2000, 6000
"""The first samples of a step are all looked at; later ones on a grid that rises evenly in its logarithm."""
_LEFT = 1e-5
"""Share of a step that is left where the grid ends."""


@dataclass(frozen=True)
class Settled:
    """The settled filter x += K (z - ahead), v += L (z - ahead), and what it does; times in samples."""

    gain: float
    """K, the share of each innovation that is added to the estimate, 0 … 1."""
    velocity_gain: float
    """L, the share that is added to the velocity, per sample."""
    lag: float
    """Lag on a ramp."""
    noise: float
    """White noise, variance out to in, 0 … 1."""
    cutoff: float
    """-3 dB frequency in cycles per sample; NaN where there is none below ½."""
    overshoot: float
    """How far the answer to a step goes beyond it, share of the step."""
    settling: float
    """Time after which no more than the share `left` of a step is missing or too much."""
    time_constant: float
    """Time until 63 % of a step is reached."""


def settle(q: float, r: float, tau: float, left: float) -> Settled:
    """The settled filter of q > 0, r ≥ 0 and τ > 0; `left` is the share of a step at the settling time."""
    tau = max(tau, MIN_MOMENTUM)
    if r == 0.0:
        return Settled(1.0, _velocity_gain_without_noise(tau), 0.0, 1.0, math.nan, 0.0, 0.0, 0.0)
    forgotten = -math.expm1(-1.0 / tau)  # 1 - e
    first, second = _poles_of(q / r, tau)
    kept = (first.z * second.z).real / math.exp(-1.0 / tau)  # 1 - K
    product = (first.d * second.d).real
    gain = max(0.0, 1.0 - kept)
    step = StepError(kept, product, first, second)
    return Settled(
        gain=gain,
        velocity_gain=(product - gain * forgotten) / (tau * forgotten),
        lag=forgotten * kept / product,
        noise=_noise(gain, product, first, second),
        cutoff=_cutoff(gain, product, first, second),
        overshoot=step.overshoot(),
        settling=step.last_above(left),
        time_constant=step.first_below(math.exp(-1.0)),
    )


def overshoot_of(ratio: float, tau: float) -> float:
    """The overshoot of `settle` alone, for q/r = `ratio`."""
    tau = max(tau, MIN_MOMENTUM)
    first, second = _poles_of(ratio, tau)
    kept = (first.z * second.z).real / math.exp(-1.0 / tau)
    return StepError(kept, (first.d * second.d).real, first, second).overshoot()


def _poles_of(ratio: float, tau: float) -> tuple[Pole, Pole]:
    """The poles of the settled filter of q/r = `ratio`, > 0, and tau ≥ MIN_MOMENTUM."""
    root = math.sqrt(min(max(ratio, MIN_RATIO), MAX_RATIO))  # only the ratio matters: no overflow
    e, f, a, b, c = transition(1.0, root, tau)
    noise, forgotten = 1.0 / root, -math.expm1(-1.0 / tau)
    return poles(
        noise * e,
        noise * forgotten**2 + (a * e - f * b),
        a * forgotten**2 + f * f * c + 2.0 * f * b * forgotten,
    )


def _velocity_gain_without_noise(tau: float) -> float:
    """L of a sensor without noise: each sample is x, and the velocity variance w has a fixed point."""
    e, f, a, b, c = transition(1.0, 1.0, tau)
    half = 0.5 * (e * e * a + c * f * f - a - 2.0 * e * f * b)
    w = (half + math.sqrt(half * half + f * f * (c * a - b * b))) / (f * f)
    return (e * f * w + b) / (f * f * w + a)


@dataclass(frozen=True)
class Pole:
    """A pole of the settled filter."""

    z: complex
    """Its place, inside the unit circle."""
    d: complex
    """1 - z, without cancellation."""

    @property
    def log_radius(self) -> float:
        """Ln |z|."""
        return (
            0.5 * math.log1p(abs(self.d) ** 2 - 2.0 * self.d.real) if abs(self.z) > 0.5 else math.log(abs(self.z))
        )

    def power(self, n: Array) -> Array:
        """zⁿ of a real pole."""
        size = np.exp(self.log_radius * n)
        return size if self.z.real > 0.0 else size * (1.0 - 2.0 * np.mod(n, 2.0))


def poles(top: float, middle: float, bottom: float) -> tuple[Pole, Pole]:
    """The poles of the spectrum top·u² + middle·u + bottom, top and bottom > 0."""
    root = cmath.sqrt(middle * middle - 4.0 * top * bottom)
    large = (middle + (root if middle >= 0.0 else -root)) / (2.0 * top)
    return _pole(large), _pole(bottom / (top * large))


def _pole(m: complex) -> Pole:
    """Z and 1 - z of (1 - z)²/z = m with |z| < 1."""
    root = cmath.sqrt(m) * cmath.sqrt(m + 4.0)
    if abs(2.0 + m + root) < abs(2.0 + m - root):
        root = -root
    return Pole(2.0 / (2.0 + m + root), 2.0 * m / (m + root) if abs(m + root) > 0.0 else 0.0)


def _noise(gain: float, product: float, first: Pole, second: Pole) -> float:
    """Σh² of the answer h to one sample (ARMA variance: Brockwell & Davis 1991, section 3.3)."""
    both, total = (first.z * second.z).real, (first.z + second.z).real
    lost = (first.d + second.d).real - product  # 1 - both
    return (product * (1.0 + both) + 2.0 * gain * (gain - product)) / (lost * (1.0 + total + both))


def _cutoff(gain: float, product: float, first: Pole, second: Pole) -> float:
    """The frequency at which |H|² = ½: a quadratic equation in u."""
    both = (first.z * second.z).real
    middle = (first.d**2 * second.z + second.d**2 * first.z).real + 2.0 * gain * (product - gain)
    root = math.sqrt(middle * middle + 4.0 * both * product * product)
    u = 2.0 * product * product / (middle + root) if middle >= 0.0 else (root - middle) / (2.0 * both)
    return math.asin(0.5 * math.sqrt(u)) / math.pi if u <= 4.0 else math.nan


class StepError:
    """What is missing of a step after n + 1 samples: e(n) = e(0) S(n) - (t e(0) - e(1)) S(n - 1)."""

    def __init__(self, kept: float, product: float, first: Pole, second: Pole) -> None:
        """Args: 1 - K, the product of the distances of the poles from 1, and the poles."""
        self._poles = first, second
        total = (first.z + second.z).real
        after_two = kept - (product - (1.0 - kept) * (1.0 - total))
        self._weights = kept, total * kept - after_two
        decay = -max(pole.log_radius for pole in self._poles)
        end = max(-math.log(_LEFT) / decay, 2.0 * _EXACT)
        grid = np.unique(np.rint(np.geomspace(_EXACT, end, _GRID)))
        samples = np.concatenate([np.arange(float(_EXACT)), grid[1:]])
        self._times = np.concatenate([[0.0], samples + 1.0])
        self._errors = np.concatenate([[1.0], self._after(samples)])

    def _after(self, n: Array) -> Array:
        """Error after n + 1 samples."""
        return self._weights[0] * self._powers(n) - self._weights[1] * self._powers(n - 1.0)

    def _powers(self, n: Array) -> Array:
        """S(n) = (z1^(n+1) - z2^(n+1)) / (z1 - z2), also for poles that are equal."""
        first, second = self._poles
        if first.z.imag:
            angle = abs(cmath.phase(first.z))
            return np.exp(first.log_radius * n) * np.sin((n + 1.0) * angle) / math.sin(angle)
        gap = (second.d - first.d).real
        if gap == 0.0:
            return (n + 1.0) * first.power(n)
        return (first.power(n + 1.0) - second.power(n + 1.0)) / gap

    def overshoot(self) -> float:
        """How far it goes below 0."""
        return max(0.0, -float(self._errors.min()), -float(self._after(self._valley()).min()))

    def _valley(self) -> Array:
        """The whole samples around the first valley of e(n) between complex poles; 0 where there is none.

        With z = exp(-s ± ia) the error is exp(-sn) (A sin an + B cos an), up to a factor: its slope is 0 where
        tan an = (aA - sB)/(sA + aB). The first valley is the deepest one.
        """
        first, _ = self._poles
        if not first.z.imag:
            return np.zeros(1)
        s, angle = -first.log_radius, abs(cmath.phase(first.z))
        a, b = (
            self._weights[0] * math.cos(angle) - self._weights[1] * math.exp(s),
            self._weights[0] * math.sin(angle),
        )
        n = math.atan2(angle * a - s * b, s * a + angle * b) % math.pi / angle
        around = [n, n + math.pi / angle]
        return np.array([value for each in around for value in (math.floor(each), math.floor(each) + 1.0)])

    def first_below(self, share: float) -> float:
        """Time until no more than `share` is missing, between samples as on an exponential."""
        at = self._first_whole(int(np.argmax(self._errors <= share)), lambda error: error <= share)
        before, after = self._at(at - 1.0), max(self._at(at), 1e-300)
        if before <= after:  # a sample is nothing beside times of 1e16
            return at
        return at - 1.0 + math.log(before / share) / math.log(before / after)

    def last_above(self, share: float) -> float:
        """Time after which the error stays within ± `share`, in whole samples."""
        last = int(np.flatnonzero(np.abs(self._errors) > share)[-1])
        return self._first_whole(last + 1, lambda error: abs(error) <= share)

    def _first_whole(self, at: int, holds: Callable[[float], bool]) -> float:
        """The first whole time at which `holds`, after the one of the grid before `at`, where it does not yet."""
        low, high = float(self._times[at - 1]), float(self._times[at])
        for _ in range(64):
            if high - low <= 1.0:
                break
            middle = math.floor(0.5 * (low + high))
            low, high = (low, middle) if holds(self._at(middle)) else (middle, high)
        return high

    def _at(self, time: float) -> float:
        """The error after `time` samples."""
        return 1.0 if time == 0.0 else float(self._after(np.array([time - 1.0]))[0])
