"""Values that may stand for "no sample", such as −200 or 400: found and asked about, never removed unasked."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from kalscope.common.array import Array

Extremes = tuple[Array, Array]
"""Smallest and largest sample of each channel, shape (channels,) each; NaN where all are missing."""

_MIN_COUNT = 3
_MIN_DISTINCT = 3
"""Fewer values beside it and there is nothing to be far from: a switch, an event marker."""
_SAMPLE = 20_000


def suggest_missing(values: Array, names: Sequence[str], ends: Extremes) -> list[str]:
    """Questions about values that may be missing samples.

    Args:
        values: Samples, shape (n, channels), NaN where missing.
        names: Channel names.
        ends: Their smallest and largest samples.

    Returns:
        One sentence for each value that is the smallest or largest of a channel, comes at least three times,
        and lies further from the rest than the middle half of the rest is wide, and half of all of it.
    """
    pairs = [(float(low), float(high)) for low, high in zip(*ends, strict=True)]
    found = dict.fromkeys(
        value for i, (low, high) in enumerate(pairs) for value in _far_extremes(values[:, i], low, high)
    )
    questions: list[str] = []
    for value in found:
        # One channel betrays the value; those that merely begin or end with it hold it as well.
        channels = [i for i, ends_of_one in enumerate(pairs) if value in ends_of_one]
        count = sum(int(np.count_nonzero(values[:, i] == value)) for i in channels)
        questions.append(
            f"is {value:.15g} a missing value? It occurs {count} times in {_listed([names[i] for i in channels])},"
            f" far from the rest; if so, read with --missing {value:.15g}"
        )
    return questions


def _listed(channels: list[str]) -> str:
    shown = ", ".join(f'"{name}"' for name in channels[:4])
    return shown if len(channels) <= 4 else f"{shown} and {len(channels) - 4} more"


def _far_extremes(samples: Array, low: float, high: float) -> list[float]:
    """The smallest and the largest sample, where they come often and are far from the rest."""
    return [
        value
        for value, other in ((low, high), (high, low))
        if value != other and np.isfinite(value) and _is_far(samples, value)
    ]


def _is_far(samples: Array, value: float) -> bool:
    least = max(_MIN_COUNT, samples.size // 2000)
    if np.count_nonzero(samples == value) < least:
        return False
    rest = samples[np.isfinite(samples) & (samples != value)]
    nearest = float(np.min(np.abs(rest - value)))
    some = rest[:: max(1, rest.size // _SAMPLE)]
    if np.unique(some).size < _MIN_DISTINCT:
        return False
    lower, upper = np.quantile(some, (0.25, 0.75))
    return nearest > max(float(upper - lower), 0.5 * float(np.ptp(some)))
