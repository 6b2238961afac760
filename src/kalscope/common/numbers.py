"""The array types of signals, and checks and medians of numbers."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable

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


def check_sample_period(period: float) -> None:
    """BadSetting unless this is a sample period, in s, that can be computed with."""
    if not PERIODS[0] <= _number(period) <= PERIODS[1]:
        raise BadSetting(
            f"sample period must be a finite number of seconds above 0, from {PERIODS[0]:g} to {PERIODS[1]:g}"
            f" (got {period})"
        )


def above_zero(name: str, value: float, largest: float = sys.float_info.max) -> float:
    """`value` as a float; BadSetting unless it is a number above 0 and at most `largest`."""
    number = _number(value)
    if not 0.0 < number <= largest:
        most = f", at most {largest:g}" if largest < number < math.inf else ""
        raise BadSetting(f"{name} must be a finite number above 0{most} (got {value})")
    return number


def _number(value: object) -> float:
    """`value` as a float; NaN where it is not a number; a string counts as none."""
    if isinstance(value, str):
        return math.nan
    try:
        return float(value)  # pyright: ignore[reportArgumentType] (the error is caught)
    except (TypeError, ValueError, OverflowError):
        return math.nan


def bisect(is_below: Callable[[float], bool], low: float, high: float, steps: int = 64) -> tuple[float, float]:
    """The last number for which `is_below`, and the first for which it is not, between `low` and `high`."""
    for _ in range(steps):  # 64 are more than a double has bits
        middle = 0.5 * (low + high)
        low, high = (middle, high) if is_below(middle) else (low, middle)
    return low, high
