"""Checks of single numbers that a caller gave."""

from __future__ import annotations

import sys

from kalscope.errors import BadSetting


def above_zero(name: str, value: float, largest: float = sys.float_info.max) -> float:
    """`value` as a float; BadSetting unless it is a number above 0 and at most `largest`."""
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = 0.0
    if not 0.0 < number <= largest:
        raise BadSetting(f"{name} must be a finite number above 0 (got {value})")
    return number
