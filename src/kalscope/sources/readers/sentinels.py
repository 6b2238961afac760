"""Values that may stand for "no sample", such as −200 or 400: found and asked about, never removed unasked.

A code is a number that nothing measures by chance, far from all that is measured. Some numbers are always codes
there (−999, 32767). Others are readings as well (0, 400): they are codes only where they appear for a moment, and
the signal then continues where it was. A stopped motor or a lamp that is off stays so.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from kalscope.common.array import Array

Extremes = tuple[Array, Array]
"""Smallest and largest sample of each channel, shape (channels,) each; NaN where all are missing."""

MIN_SURE = 2
"""Least count of a number that is always a code."""
MIN_UNSURE = 3
"""Least count of any other, and in a long recording one sample in 2000."""
MAX_ZEROS = 0.1
"""Largest share of the samples that may be a code of 0; more is a state."""
MAX_RUN = 3
"""Longest run in samples, in the median, of a code that may be a reading."""
MIN_RETURNS = 0.75
"""Least share of its runs after which the signal continues where it was."""
MAX_CODES = 4
"""Most codes of one channel."""
_MIN_DISTINCT = 3
"""With fewer values beside it there is nothing to be far from: a switch, an event marker."""
_SAMPLE = 20_000

_LIMITS = {32767.0, -32768.0, 65535.0, 8388607.0, -8388608.0, 2147483647.0, -2147483648.0, 4294967295.0}
"""Limits of a processor's integers."""
_KNOWN = {-127.0, 85.0, -7999.0, 7999.0, -6999.0, 6999.0, -273.15, -273.0, 8190.0, 8191.0}
"""DS18B20: not connected, not converted; Campbell: NAN; absolute zero; VL53L0X: out of range."""
_UNSURE = {0.0, -1.0, 99.0, -99.0, 255.0, 1023.0, 4095.0}
"""Zero, an error value of C, and limits of short integers."""
HUGE = 1e20
"""Fill values of binary formats are beyond this: 1e30, 9.97e36, 3.4e38."""


def suggest_missing(values: Array, names: Sequence[str], ends: Extremes) -> list[str]:
    """Questions about values that may be missing samples.

    Args:
        values: Samples, shape (n, channels), NaN where missing.
        names: Channel names.
        ends: Their smallest and largest samples.

    Returns:
        One sentence for each value that is the smallest or largest of a channel, a code, and further from the rest
        than the middle half of the rest is wide, and half of all of it.
    """
    pairs = [(float(low), float(high)) for low, high in zip(*ends, strict=True)]
    found = dict.fromkeys(value for i, (low, high) in enumerate(pairs) for value in _codes(values[:, i], low, high))
    questions: list[str] = []
    for value in found:
        # One channel shows that it is a code; those that only have it as smallest or largest sample count as well.
        channels = [i for i, ends_of_one in enumerate(pairs) if value in ends_of_one]
        channels = channels or [i for i in range(len(pairs)) if np.any(values[:, i] == value)]  # behind another
        count = sum(int(np.count_nonzero(values[:, i] == value)) for i in channels)
        questions.append(
            f"is {value:.15g} a missing value? It occurs {count} times in {_listed([names[i] for i in channels])},"
            f" far from the rest; if so, read with --missing {value:.15g}"
        )
    return questions


def _listed(channels: list[str]) -> str:
    shown = ", ".join(f'"{name}"' for name in channels[:4])
    return shown if len(channels) <= 4 else f"{shown} and {len(channels) - 4} more"


def _codes(samples: Array, low: float, high: float) -> list[float]:
    """The codes of one channel, from the ends of its samples inwards: each hides how far the next one is."""
    found: list[float] = []
    rest = samples
    while len(found) < MAX_CODES:
        ends = [value for value in dict.fromkeys((low, high)) if _is_code(value)]
        codes = [value for value in ends if _stands_out(rest, value, {other for other in ends if _is_sure(other)})]
        if not codes:
            break
        found += codes
        rest = np.where(np.isin(rest, codes), np.nan, rest)
        low, high = float(np.nanmin(rest)), float(np.nanmax(rest))
    return found


def _is_code(value: float) -> bool:
    return _is_sure(value) or value in _UNSURE or _is_round(value)


def _is_sure(value: float) -> bool:
    """Whether nothing measures this number by chance: −9999.9, 888.8, 32767, 1e30."""
    digits = f"{abs(value):.10g}".replace(".", "")
    repeated = len(digits) >= 3 and set(digits) in ({"9"}, {"8"})
    return (
        repeated or value in _LIMITS or value in _KNOWN or abs(value) >= HUGE or (value < 0.0 and _is_round(value))
    )


def _is_round(value: float) -> bool:
    """One digit and two zeros at least: 400, −200, 20000."""
    digits = f"{abs(value):.10g}"
    return digits.isdecimal() and len(digits) >= 3 and not digits[1:].strip("0")


def _stands_out(samples: Array, value: float, sure: set[float]) -> bool:
    """Whether a code occurs often enough, far from the rest, and, unless it is sure, only for moments."""
    times = int(np.count_nonzero(samples == value))
    if times < (MIN_SURE if value in sure else max(MIN_UNSURE, samples.size // 2000)):
        return False
    rest = samples[np.isfinite(samples) & ~np.isin(samples, [value, *sure])]
    some = rest[:: max(1, rest.size // _SAMPLE)]
    if np.unique(some).size < _MIN_DISTINCT:
        return False
    nearest = float(np.min(np.abs(rest - value)))
    lower, upper = np.quantile(some, (0.25, 0.75))
    if nearest <= max(float(upper - lower), 0.5 * float(np.ptp(some))):
        return False
    usual = value != 0.0 or times <= MAX_ZEROS * samples.size
    return value in sure or (usual and _comes_for_moments(samples, value, nearest))


def _comes_for_moments(samples: Array, value: float, nearest: float) -> bool:
    """Whether the signal jumps to the value and soon back to where it was."""
    edges = np.diff(np.concatenate(([0], (samples == value).astype(np.int8), [0])))
    first, stop = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    inner = (first > 0) & (stop < samples.size)
    jumps = np.abs(samples[stop[inner]] - samples[first[inner] - 1])
    returns = int(np.count_nonzero(jumps <= 0.5 * nearest))
    return float(np.median(stop - first)) <= MAX_RUN and returns >= max(2, MIN_RETURNS * len(jumps))
