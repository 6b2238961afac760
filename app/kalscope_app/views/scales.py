"""Units and factors of chart axes, so that three decimals suffice, and ticks of logarithmic ones."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from kalscope.common.array import Array
from kalscope.common.text import TIME_UNITS, trimmed

PREFIXES = {-12: "p", -9: "n", -6: "µ", -3: "m", 0: "", 3: "k", 6: "M", 9: "G"}
"""SI prefixes by power of ten."""


PREFIXABLE = {"V", "A", "g", "Pa", "Hz", "m", "W", "N", "T", "Ω", "F", "s", "lx", "m/s", "m/s²", "m/s^2"}
"""Units that take a prefix; before any other the factor is written out."""


@dataclass(frozen=True)
class Scale:
    """How numbers of one quantity are written on an axis."""

    factor: float
    """Drawn value = value × factor."""
    unit: str
    """Unit of the drawn value, "" if none."""

    def label(self, quantity: str) -> str:
        """Axis label, such as "ax (mV)"."""
        return f"{quantity} ({self.unit})" if self.unit else quantity


def scale_for(values: Array, unit: str) -> Scale:
    """A factor that brings the largest of `values` between 1 and 10,000, where three decimals suffice.

    Units without a prefix get a power of ten only where decimals do not suffice: 0.3 is easier to read.
    """
    finite = np.abs(values[np.isfinite(values)])
    largest = float(finite.max(initial=0.0))
    if largest == 0.0 or (0.5 if unit in PREFIXABLE else 0.05) <= largest < 1e5:
        return Scale(1.0, unit)
    power = 3 * math.floor(math.log10(largest) / 3)
    power = min(max(power, -300), 300)
    if unit in PREFIXABLE and power in PREFIXES:
        return Scale(10.0**-power, PREFIXES[power] + unit)
    return Scale(10.0**-power, f"1e{power} {unit}".strip())


def time_scale_for(span: float, sample_period: float | None) -> Scale:
    """Unit of a time axis that shows `span` seconds: the largest one that fits four times into it."""
    if sample_period is None:
        return Scale(1.0, "samples")
    for unit, length in reversed(TIME_UNITS):
        if span >= 4.0 * length:
            return Scale(1.0 / length, unit)
    return Scale(1000.0, "ms")


def range_text(first: float, last: float) -> str:
    """Both ends to about a hundredth of what lies between them: "0 to 4.55" also where the first is -0.000446."""
    span = abs(last - first)
    decimals = 2 - math.floor(math.log10(span)) if math.isfinite(span) and span > 0.0 else 3
    return f"{_to_decimals(first, decimals)} to {_to_decimals(last, decimals)}"


def _to_decimals(value: float, decimals: int) -> str:
    if abs(value) < 0.5 * 10.0**-decimals:
        return "0"
    return trimmed(value, min(max(math.floor(math.log10(abs(value))) + 1 + decimals, 1), 12))


def log_scale_for(values: Array, unit: str) -> Scale:
    """The prefix that suits the middle of a logarithmic axis from the lowest to the highest value > 0.

    A unit that takes no prefix stays as it is: the ticks of such an axis are written as 1e-9 where they must be.
    """
    good = values[np.isfinite(values) & (values > 0.0)]
    if unit not in PREFIXABLE or not len(good):
        return Scale(1.0, unit)
    middle = 0.5 * (math.log10(float(good.min())) + math.log10(float(good.max())))
    power = min(max(3 * math.floor((middle + 1.0) / 3.0), min(PREFIXES)), max(PREFIXES))
    return Scale(10.0**-power, PREFIXES[power] + unit)


def log_time_scale(times: Array) -> Scale:
    """Unit of a logarithmic axis of ascending times > 0, s: seconds up to ten minutes, else as fits the middle."""
    if not len(times) or times[-1] < 600.0:
        return log_scale_for(times, "s")
    middle = math.sqrt(float(times[0]) * float(times[-1]))
    unit, length = next((one for one in reversed(TIME_UNITS) if one[1] <= middle), TIME_UNITS[0])
    return Scale(1.0 / length, unit)


def log_ticks(low: float, high: float, room: int = 9) -> tuple[float, ...]:
    """Round values from low to high, > 0, for a logarithmic axis: decades, with 2 and 5 between if few."""
    first, last = math.floor(math.log10(low)), math.ceil(math.log10(high))
    step = max(1, math.ceil((last - first) / room))
    fine = (1.0, 2.0, 5.0) if last - first <= 3 else (1.0,)
    ticks = (mantissa * 10.0**power for power in range(first, last + 1, step) for mantissa in fine)
    return tuple(tick for tick in ticks if 0.999 * low <= tick <= 1.001 * high)
