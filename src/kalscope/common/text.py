"""One way to write numbers, units, durations and lags."""

from __future__ import annotations

import math
import re

_DURATIONS = ((10.0, 1e-3, "ms"), (7200.0, 1.0, "s"), (172_800.0, 3600.0, "h"), (63_115_200.0, 86400.0, "d"))
"""Durations below the first are said in the second, all in s; longer ones in years."""


def number(value: float) -> str:
    """Four significant digits, without an exponent from 0.0001 to 10 million."""
    rounded = float(f"{value:.4g}")
    return f"{rounded:.0f}" if 1e4 <= abs(rounded) < 1e7 else f"{rounded:.4g}"


def squared(unit: str) -> str:
    """The unit of a variance: V², (m/s²)², "unit²" where the unit is not known."""
    if not unit:
        return "unit²"
    return f"{unit}²" if re.fullmatch(r"[^\W\d_]+|°C|°F|%", unit) else f"({unit})²"


def duration(seconds: float) -> str:
    """A time in s as a person says it: 12.3 ms, 45 s, 3.2 d."""
    for below, one, word in _DURATIONS:
        if seconds < below:
            return f"{number(seconds / one)} {word}"
    return "inf" if math.isinf(seconds) else f"{number(seconds / 31_557_600.0)} years"


def _samples(samples: float, period: float | None) -> str:
    text = f"{number(samples)} samples"
    return text if period is None else f"{duration(samples * period)} = {text}"


def scalar(value: object) -> float:
    """A number of one channel; NaN for None."""
    return math.nan if value is None else float(value)  # pyright: ignore[reportArgumentType]
