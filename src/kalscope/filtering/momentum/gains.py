"""The gains that the filter with momentum settles to, in closed forms in which nothing cancels.

With u = 2 - 2 cos ω the spectrum of (1 - L)(1 - eL) z, over r, is e u² + (φ² - λβ) u + λφ², where φ = 1 - e and
β = τ e (sinh 1/τ - 1/τ). The poles z1, z2 of the settled filter are the roots of its factor inside the unit circle
(the reduced form: Harvey 1989, section 2.4): two quadratic equations, so nothing iterates. Their product π is
e (1 - K), and P = (1 - z1)(1 - z2) is φ R with the reach R = K + τ L, R² = λ (1 - K). The Riccati equation then is

    e² K² + φ (1 + e + e R) K = R (1 - e² - β R)      e τ/(1 + e) L² + (φ + e K) L = φ R²/2

K small or L small would lose their digits as differences of the poles; here every term is positive.
"""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass

import numpy as np

from kalscope.common.array import Array

MIN_SHARE = 1e-100
"""A share of the velocity that is smaller counts as this one: its pole is at 0, but nothing divides by 0."""


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
        return (
            0.5 * math.log1p(abs(self.d) ** 2 - 2.0 * self.d.real) if abs(self.z) > 0.5 else math.log(abs(self.z))
        )

    def power(self, n: Array) -> Array:
        """zⁿ of a real pole."""
        size = np.exp(self.log_radius * n)
        return size if self.z.real > 0.0 else size * (1.0 - 2.0 * np.mod(n, 2.0))


@dataclass(frozen=True)
class Model:
    """All settled filters of one momentum; `kept` is 1 - K, whose digits K near 1 would lose, `product` is P."""

    tau: float
    """τ in sample periods, above 0."""
    e: float
    """Share of the velocity that is left after a sample."""
    forgotten: float
    """φ = 1 - e."""
    bend: float
    """β, what the spectrum of the signal lacks at high frequencies, over q."""

    @classmethod
    def of(cls, tau: float) -> Model:
        """The model of a momentum in sample periods, above 0."""
        h = 1.0 / tau
        return cls(tau, math.exp(-h), -math.expm1(-h), tau * _bend(h))

    def poles(self, ratio: float) -> tuple[Pole, Pole]:
        """The poles of λ = `ratio`, above 0."""
        root = math.sqrt(ratio)
        top, bottom = max(self.e, MIN_SHARE) / root, root * self.forgotten**2
        middle = self.forgotten**2 / root - root * self.bend
        inner = cmath.sqrt(middle * middle - 4.0 * top * bottom)
        large = (middle + (inner if middle >= 0.0 else -inner)) / (2.0 * top)
        return Pole.of(large), Pole.of(bottom / (top * large))

    def gain(self, reach: float) -> float:
        """K of R."""
        linear = self.forgotten * (1.0 + self.e + self.e * reach)
        right = reach * (self.forgotten * (1.0 + self.e) - self.bend * reach)
        return min(1.0, 2.0 * right / (linear + math.sqrt(linear * linear + 4.0 * self.e * self.e * right)))

    def velocity_gain(self, gain: float, reach: float) -> float:
        """L of K and R."""
        right, lost = self.forgotten * reach * reach, self.forgotten + self.e * gain
        return right / (lost + math.sqrt(lost * lost + 2.0 * self.e * self.tau / (1.0 + self.e) * right))

    def reach_without_noise(self) -> float:
        """R of a sensor without noise, K = 1: β R² - φ R + 1 = 0."""
        return 2.0 / (self.forgotten + math.sqrt(self.forgotten**2 - 4.0 * self.bend))

    def product(self, gain: float, kept: float) -> float:
        """P of K."""
        right = gain * (self.forgotten * (1.0 + self.e) + self.e * self.e * gain)
        linear, slope = 1.0 + self.e * kept, -self.bend / self.forgotten**2
        return 2.0 * right / (linear + math.sqrt(linear * linear + 4.0 * slope * right))

    def ratio(self, gain: float, kept: float) -> float:
        """λ of K."""
        return (self.product(gain, kept) / self.forgotten) ** 2 / kept

    def ratio_of_lag(self, lag: float) -> float:
        """λ of the lag (1 - K)/R in samples: 1 - K solves a quadratic equation with one root below 1."""
        double, slope = 1.0 + self.e, -self.bend / self.forgotten**2
        inner = double * double * (1.0 + 2.0 / self.forgotten / lag) + (1.0 + 4.0 * slope) / lag / lag
        kept = 2.0 / (1.0 + self.e**2 + self.forgotten / lag + self.forgotten * math.sqrt(inner))
        return kept / lag / lag

    def noise(self, gain: float, kept: float, product: float) -> float:
        """Share of white noise that is left, Σh² (ARMA variance: Brockwell & Davis 1991, section 3.3).

        It rises with λ, as in every optimal filter: the filter of λ has the least N + λ B, where B is the
        distortion of the signal. Two such inequalities, each filter in place of the other, add up to
        (λ1 - λ2)(B1 - B2) ≤ 0; so B falls with λ, and N rises.
        """
        both, lost = self.e * kept, self.forgotten + self.e * gain
        return (product * (1.0 + both) + 2.0 * gain * (gain - product)) / (lost * (2.0 * (1.0 + both) - product))

    def cutoff(self, gain: float, kept: float, product: float) -> float:
        """4 sin²(π f) at the frequency f at which |H|² = ½; above 4 there is none."""
        both, lost = self.e * kept, self.forgotten + self.e * gain
        middle = lost * lost - product * (1.0 + both) + 2.0 * gain * (product - gain)
        root = math.sqrt(middle * middle + 4.0 * both * product * product)
        return (
            2.0 * product * product / (middle + root) if middle > 0.0 else (root - middle) / max(2.0 * both, 1e-300)
        )


def _bend(h: float) -> float:
    """exp(-h) (sinh h - h), by its series where the closed form loses digits."""
    if h > 1.0:
        return -0.5 * math.expm1(-2.0 * h) - h * math.exp(-h)
    term = total = h * h * h / 6.0
    for n in range(4, 22, 2):
        term *= h * h / (n * (n + 1))
        total += term
    return total * math.exp(-h)
