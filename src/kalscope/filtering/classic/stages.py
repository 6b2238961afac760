"""The classic filters as frozen, checked values: what they are, what they cost, and how a device begins them.

Lag is the lag on a ramp, in samples; noise gain is the variance that is left of white noise, Σh². Both are None
where no formula gives them, because they depend on the signal.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from kalscope.filtering.classic.checks import MAX_WINDOW, number, odd_window, whole

MAX_SHIFT = 30
"""Largest shift accepted: 2^-30 is a time constant of a billion samples."""
MIN_ALPHA = 2.0**-MAX_SHIFT
"""Smallest share of each step accepted."""
MIN_CUTOFF, MAX_CUTOFF = 1e-6, 0.499
"""Cut-offs of the Butterworth filter, cycles per sample."""
MIN_EURO_CUTOFF, MAX_EURO_CUTOFF = 1e-12, 1e9
"""Cut-offs of the one-euro filter, cycles per sample; it may pass everything."""
PER_SAMPLE = " cycles per sample"
MAX_BETA = 1e300
"""Largest growth of a cut-off accepted: the unit of the signal may be anything."""
SETTLED = 0.01
"""A start is forgotten when 1 % of it is left."""
BEYOND = 1e30
"""Angle beyond which the one-euro filter passes the sample itself: 1/(1 + 1e30) is below any rounding."""


@dataclass(frozen=True)
class MovingAverage:
    """Mean of the last `window` samples, or of fewer at the start."""

    window: int
    """Samples, 1 … 100,000."""
    name: ClassVar[str] = "Moving average"

    def __post_init__(self) -> None:
        object.__setattr__(self, "window", whole("window", self.window, 1, MAX_WINDOW))

    @property
    def words(self) -> str:
        """Its setting, for the user."""
        return f"window of {self.window}"

    @property
    def memory(self) -> int:
        """Numbers that it remembers: the window, two sums with their levels, the count and the output."""
        return self.window + 6

    @property
    def constants(self) -> tuple[float, ...]:
        """What its loop needs to know."""
        return (1.0,)

    @property
    def lag(self) -> float:
        """Lag in samples."""
        return 0.5 * (self.window - 1)

    @property
    def noise_gain(self) -> float:
        """Share of the variance of white noise that is left."""
        return 1.0 / self.window

    @property
    def start_samples(self) -> int:
        """Samples until 1 % of the start is left."""
        return self.window


class _Smoothing:
    """What exponential smoothing is, wherever its α comes from."""

    alpha: float
    """Share of each step that is taken."""

    @property
    def memory(self) -> int:
        """Numbers that it remembers: the output, and what rounding left out of it."""
        return 2

    @property
    def constants(self) -> tuple[float, ...]:
        """What its loop needs to know."""
        return (self.alpha,)

    @property
    def lag(self) -> float:
        """Lag in samples."""
        return (1.0 - self.alpha) / self.alpha

    @property
    def noise_gain(self) -> float:
        """Share of the variance of white noise that is left."""
        return self.alpha / (2.0 - self.alpha)

    @property
    def start_samples(self) -> int:
        """Samples until 1 % of the start is left."""
        return 1 if self.alpha >= 1.0 else max(1, math.ceil(math.log(SETTLED) / math.log1p(-self.alpha)))


@dataclass(frozen=True)
class Exponential(_Smoothing):
    """Exponential smoothing, x += α (z − x), begun at the first sample."""

    alpha: float
    """Share of each step that is taken, 2^-30 … 1."""
    name: ClassVar[str] = "Exponential"

    def __post_init__(self) -> None:
        object.__setattr__(self, "alpha", number("alpha", self.alpha, MIN_ALPHA, 1.0))

    @property
    def words(self) -> str:
        """Its setting, for the user."""
        return f"α = {self.alpha:.4g}"


@dataclass(frozen=True)
class PowerOfTwo(_Smoothing):
    """Exponential smoothing with α = 2^-shift: a device shifts bits."""

    shift: int
    """Bits, 0 … 30."""
    name: ClassVar[str] = "Power-of-two gain"

    def __post_init__(self) -> None:
        object.__setattr__(self, "shift", whole("shift", self.shift, 0, MAX_SHIFT))
        object.__setattr__(self, "alpha", 2.0**-self.shift)

    @property
    def words(self) -> str:
        """Its setting, for the user."""
        return f"α = 1/{2**self.shift}"


@dataclass(frozen=True)
class Median:
    """Median of the last `window` samples; the window begins filled with the first one."""

    window: int
    """Samples, an odd number, 1 … 99,999."""
    name: ClassVar[str] = "Median"
    lag: ClassVar[None] = None
    noise_gain: ClassVar[None] = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "window", odd_window("window", self.window))

    @property
    def words(self) -> str:
        """Its setting, for the user."""
        return f"window of {self.window}"

    @property
    def memory(self) -> int:
        """Numbers that it remembers: the window as it came, the same in order of size, and the output."""
        return 2 * self.window + 1

    @property
    def constants(self) -> tuple[float, ...]:
        """What its loop needs to know: nothing."""
        return ()

    @property
    def start_samples(self) -> int:
        """Samples until the start is forgotten."""
        return self.window


@dataclass(frozen=True)
class Butterworth:
    """Second-order low-pass, settled at the first sample."""

    cutoff: float
    """−3 dB frequency in cycles per sample, 1e-6 … 0.499."""
    name: ClassVar[str] = "2nd-order Butterworth"

    def __post_init__(self) -> None:
        object.__setattr__(self, "cutoff", number("cutoff", self.cutoff, MIN_CUTOFF, MAX_CUTOFF, PER_SAMPLE))

    @property
    def words(self) -> str:
        """Its setting, for the user."""
        return f"cut-off {self.cutoff:.3g}"

    @property
    def memory(self) -> int:
        """Numbers that it remembers: output, level, what rounding left out of the level, slope."""
        return 4

    @property
    def constants(self) -> tuple[float, ...]:
        """What its loop needs to know, shares per sample.

        The share of the distance that is added to the slope, and of the slope to the level; the share of the slope
        that is lost; the share of the distance that is added to the level; and 1/2.
        """
        g = self.slope
        whole = 1.0 + g * (g + math.sqrt(2.0))
        return 2.0 * g / whole, 2.0 * g * (g + math.sqrt(2.0)) / whole, 2.0 * g * g / whole, 0.5

    @property
    def slope(self) -> float:
        """Half of the angle Ω that the bilinear transform makes of the cut-off."""
        return math.tan(math.pi * self.cutoff)

    @property
    def lag(self) -> float:
        """Lag in samples: the bilinear transform keeps the delay at frequency 0, √2/Ω."""
        return math.sqrt(0.5) / self.slope

    @property
    def noise_gain(self) -> float:
        """∫|H|² with |H|² = 1/(1 + (tan πf / c)⁴), c = tan πf₀, in closed form."""
        c = self.slope
        return (c**4 + math.sqrt(0.5) * (c - c**3)) / (1.0 + c**4)

    @property
    def start_samples(self) -> int:
        """Samples until 1 % of the start is left: its poles decay by exp(−Ω/√2)."""
        return math.ceil(-math.log(SETTLED) * self.lag) + 1


@dataclass(frozen=True)
class OneEuro:
    """Exponential smoothing whose cut-off grows with the speed: smooth when still, quick when moving."""

    cutoff: float
    """Cut-off at speed 0, cycles per sample, 1e-12 … 1e9."""
    beta: float
    """How much it grows for a speed of 1 unit per sample, cycles per unit, 0 … 1e300."""
    speed_cutoff: float
    """Cut-off of the speed itself, cycles per sample, 1e-12 … 1e9."""
    name: ClassVar[str] = "One-euro"
    lag: ClassVar[None] = None
    noise_gain: ClassVar[None] = None

    def __post_init__(self) -> None:
        for name in ("cutoff", "speed_cutoff"):
            object.__setattr__(
                self, name, number(name, getattr(self, name), MIN_EURO_CUTOFF, MAX_EURO_CUTOFF, PER_SAMPLE)
            )
        object.__setattr__(self, "beta", number("beta", self.beta, 0.0, MAX_BETA))

    @property
    def words(self) -> str:
        """Its setting, for the user."""
        return f"cut-off {self.cutoff:.3g}, β {self.beta:.2g}"

    @property
    def memory(self) -> int:
        """Numbers that it remembers: output, what rounding left out of it, speed, time since the last sample."""
        return 4

    @property
    def constants(self) -> tuple[float, ...]:
        """Angles a sample: at speed 0, their growth with the speed, that of the speed; and two plain numbers."""
        turn = 2.0 * math.pi
        return turn * self.cutoff, turn * self.beta, turn * self.speed_cutoff, 1.0, BEYOND

    @property
    def start_samples(self) -> int:
        """Samples until 1 % of the start is left, at the speed that doubles the cut-off."""
        return max(1, math.ceil(-math.log(SETTLED) / math.log1p(4.0 * math.pi * self.cutoff)))


Stage = MovingAverage | Exponential | PowerOfTwo | Median | Butterworth | OneEuro
