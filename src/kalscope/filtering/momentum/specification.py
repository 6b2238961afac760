"""From a target to the filter with momentum: the ratio at a given momentum, and the momentum of an overshoot.

The poles z1, z2 of the settled filter have the product π = e (1 - K), and P = (1 - z1)(1 - z2) follows from the
factor of the spectrum in `settled`: ρ P² + (1 + π) P = K (1 - π e). Lag, noise and cut-off follow in closed form.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from kalscope.errors import BadSetting
from kalscope.filtering.momentum.kernels import transition
from kalscope.filtering.momentum.settled import MIN_MOMENTUM, overshoot_of
from kalscope.filtering.params import MAX_MOMENTUM

Target = Literal["gain", "lag", "noise", "cutoff"]

MAX_LOGIT = 700.0
"""Gains are sought where |ln K/(1 - K)| is smaller: beyond, K or 1 - K vanishes in a double."""
STEPS = 64
"""Halvings of an interval: more than a double has digits."""


def ratio_with_momentum(target: Target, value: float, momentum: float) -> float:
    """The ratio λ = q/r of the settled filter that meets a target at a given momentum.

    Args:
        target: what `value` is: the gain K, 0 < K < 1; the lag on a ramp in samples; the share of white noise that
            is left, below 1; or 4 sin²(π f) of the -3 dB frequency f in cycles a sample, at most 4.
        value: above 0.
        momentum: τ in sample periods, above 0.
    """
    family = _Family.of(momentum)
    if target == "lag":
        return family.ratio_of_lag(value)
    if target == "gain":
        return family.ratio(value, 1.0 - value)
    seen = family.noise if target == "noise" else family.cutoff
    return family.ratio(*_gain_where(lambda gain, kept: seen(gain, kept) >= value))


def momentum_for_overshoot(overshoot: float, ratio_at: Callable[[float], float]) -> float:
    """The momentum at which the answer to a step goes beyond it by the share `overshoot`.

    0 for no overshoot: momentum up to half of the lag has none either, but saves only 0.2 dB of noise.

    Along every curve of equal lag, noise, cut-off or gain the overshoot rises with the momentum; at lags below 0.2
    samples not strictly, because a step is seen at whole samples only. The halving ends within the target in any
    case, and a larger target never ends at less momentum.

    Args:
        overshoot: share of the step, ≥ 0.
        ratio_at: λ that keeps the other target, by momentum.

    Raises:
        BadSetting: the overshoot is not from 0 to 1, or more than any momentum has.
    """
    if not 0.0 <= overshoot < 1.0:
        raise BadSetting(f"overshoot must be a share of the step from 0 to 1, such as 0.1 (got {overshoot:g})")

    def within(momentum: float) -> bool:
        return overshoot_of(ratio_at(momentum), momentum) <= overshoot

    if overshoot == 0.0 or not within(MIN_MOMENTUM):
        return 0.0
    largest = overshoot_of(ratio_at(MAX_MOMENTUM), MAX_MOMENTUM)
    if overshoot > largest:
        possible = 100.0 * 0.9995 * largest  # still possible when it is rounded
        raise BadSetting(
            f"overshoot must be at most {possible:.4g} % of a step with this target (got {100.0 * overshoot:g} %)"
        )
    low, high = math.log(MIN_MOMENTUM), math.log(MAX_MOMENTUM)
    for _ in range(STEPS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if within(math.exp(middle)) else (low, middle)
    return math.exp(low)


@dataclass(frozen=True)
class _Family:
    """All settled filters of one momentum, by their gain; `kept` is 1 - K, which K near 1 does not hold."""

    e: float
    """Share of the velocity that is left after a sample."""
    forgotten: float
    """1 - e."""
    level: float
    """Spectrum of (1 - L)(1 - eL) x at frequency 0, for q = 1."""
    slope: float
    """How it grows with u, over `level`: ρ."""

    @classmethod
    def of(cls, momentum: float) -> _Family:
        tau = max(momentum, MIN_MOMENTUM)
        e, f, a, b, c = transition(1.0, 1.0, tau)
        forgotten = -math.expm1(-1.0 / tau)
        level = a * forgotten**2 + f * f * c + 2.0 * f * b * forgotten
        return cls(e, forgotten, level, (a * e - f * b) / level)

    def ratio(self, gain: float, kept: float) -> float:
        """λ of a gain."""
        return self._distance(gain, kept) ** 2 / (kept * self.level)

    def ratio_of_lag(self, lag: float) -> float:
        """λ of a lag: (1 - K) solves a quadratic equation with one root below 1."""
        share, double = self.forgotten / lag, 1.0 + self.e
        inner = double * double * (1.0 + 2.0 / self.forgotten / lag) + (1.0 + 4.0 * self.slope) / lag / lag
        kept = 2.0 / (1.0 + self.e**2 + share + self.forgotten * math.sqrt(inner))
        return share * share * kept / self.level

    def noise(self, gain: float, kept: float) -> float:
        """Share of white noise that is left, as in `settled`. It rises with λ, as in every optimal filter.

        The filter of λ has the least N + λ B, where B is the distortion of the signal. Two such inequalities, each
        filter in place of the other, add up to (λ1 - λ2)(B1 - B2) ≤ 0; so B falls with λ, and N rises.
        """
        product, both = self._distance(gain, kept), self.e * kept
        lost = self.forgotten + self.e * gain
        return (product * (1.0 + both) + 2.0 * gain * (gain - product)) / (lost * (2.0 * (1.0 + both) - product))

    def cutoff(self, gain: float, kept: float) -> float:
        """4 sin²(π f) at the -3 dB frequency f; 4 where there is none below ½."""
        product, both = self._distance(gain, kept), self.e * kept
        lost = self.forgotten + self.e * gain
        middle = lost * lost - product * (1.0 + both) + 2.0 * gain * (product - gain)
        root = math.sqrt(middle * middle + 4.0 * both * product * product)
        u = 2.0 * product * product / (middle + root) if middle > 0.0 else 0.5 * (root - middle) / max(both, 1e-300)
        return min(u, 4.0)

    def _distance(self, gain: float, kept: float) -> float:
        """P, the product of the distances of the poles from 1."""
        right = gain * (self.forgotten * (1.0 + self.e) + self.e * self.e * gain)
        linear = 1.0 + self.e * kept
        return 2.0 * right / (linear + math.sqrt(linear * linear + 4.0 * self.slope * right))


def _gain_where(reached: Callable[[float, float], bool]) -> tuple[float, float]:
    """The least K, and 1 - K, for which `reached` is true, false below and true above."""
    low, high = -MAX_LOGIT, MAX_LOGIT
    for _ in range(STEPS):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if reached(*_logistic(middle)) else (middle, high)
    return _logistic(high)


def _logistic(x: float) -> tuple[float, float]:
    """K and 1 - K of ln K/(1 - K) = x."""
    return 1.0 / (1.0 + math.exp(-x)), 1.0 / (1.0 + math.exp(x))
