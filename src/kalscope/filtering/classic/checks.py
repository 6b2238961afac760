"""Checks of the settings of the classic filters."""

from __future__ import annotations

import math
import operator
from typing import Any

from kalscope.errors import BadSetting

MAX_WINDOW = 100_000
"""Longest window accepted, samples."""


def odd_window(name: str, value: Any) -> int:
    """A window of a median: an odd number of samples."""
    window = whole(name, value, 1, MAX_WINDOW - 1)
    if window % 2 == 0:
        raise BadSetting(f"{name} must be an odd number of samples, such as {window + 1} (got {window})")
    return window


def whole(name: str, value: Any, least: int, most: int) -> int:
    """`value` as an int from `least` to `most`; 9.0 is one too."""
    given: Any = int(value) if isinstance(value, float) and value.is_integer() else value
    try:
        found = None if isinstance(given, bool) else operator.index(given)
    except TypeError:
        found = None
    if found is None or not least <= found <= most:
        raise BadSetting(f"{name} must be a whole number from {least} to {most} (got {value!r})")
    return found


def number(name: str, value: Any, least: float, most: float, unit: str = "") -> float:
    """`value` as a float from `least` to `most`."""
    try:
        found = math.nan if isinstance(value, bool | str) else float(value)
    except (TypeError, ValueError, OverflowError):
        found = math.nan
    if not least <= found <= most:
        raise BadSetting(f"{name} must be a number from {least:.3g} to {most:.3g}{unit} (got {value!r})")
    return found
