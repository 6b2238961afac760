"""The array types of signals, and checks of numbers."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kalscope.errors import BadSetting

# The array types of signals, and of positions in them.


Array = NDArray[np.float64]

Indices = NDArray[np.intp]
"""Positions in an array, from 0."""

Mask = NDArray[np.bool_]
"""True for the elements that are chosen."""


# Checks of single numbers that a caller gave.


PERIODS = (1e-50, 1e50)
"""Sample periods in s within which rates and their squares are finite."""


def in_range(name: str, value: Any, least: float, most: float, must: str = "") -> float:
    """`value` as a float; BadSetting unless it is a number from `least` to `most`.

    Args:
        name: What the message calls it.
        value: Anything; a string or a truth value is no number.
        least: The smallest allowed.
        most: The largest allowed.
        must: What it must be, for the message.
    """
    try:
        number = math.nan if isinstance(value, bool | str) else float(value)
    except (TypeError, ValueError, OverflowError):
        number = math.nan
    if not least <= number <= most:
        raise BadSetting(f"{name} must be {must or f'a number from {least:.3g} to {most:.3g}'} (got {value!r})")
    return number


def check_sample_period(period: float) -> None:
    """BadSetting unless this is a sample period, in s, that can be computed with."""
    must = f"a finite number of seconds above 0, from {PERIODS[0]:g} to {PERIODS[1]:g}"
    in_range("sample period", period, *PERIODS, must)


def above_zero(name: str, value: float, largest: float = sys.float_info.max) -> float:
    """`value` as a float; BadSetting unless it is a number above 0 and at most `largest`."""
    most = f", at most {largest:g}" if largest < sys.float_info.max else ""
    return in_range(name, value, math.ulp(0.0), largest, f"a finite number above 0{most}")


def bisect(is_below: Callable[[float], bool], low: float, high: float, steps: int = 64) -> tuple[float, float]:
    """The last number for which `is_below`, and the first for which it is not, between `low` and `high`."""
    for _ in range(steps):  # 64 are more than a double has bits
        middle = 0.5 * (low + high)
        low, high = (middle, high) if is_below(middle) else (low, middle)
    return low, high


class ShortRepr:
    """A dataclass that prints its arrays and long tuples by their size."""

    def __repr__(self) -> str:
        return (
            f"{type(self).__name__}({', '.join(f'{name}={_short(value)}' for name, value in vars(self).items())})"
        )


def _short(value: Any) -> str:
    shape: tuple[int, ...] = getattr(value, "shape", ())
    if math.prod(shape) > MAX_PRINTED:
        return f"<array of {' × '.join(map(str, shape))}>"
    text = repr(value)
    return text if len(text) <= MAX_PRINTED_TEXT else f"{text[:MAX_PRINTED_TEXT]}…"


MAX_PRINTED = 8
"""Items of an array that are printed one by one."""
MAX_PRINTED_TEXT = 200
"""Characters of a value that are printed."""
