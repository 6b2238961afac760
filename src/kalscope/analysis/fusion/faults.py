"""What a sensor shows by itself: readings far off, one value forever, no reading for a long time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from kalscope.common.array import Array, Mask
from kalscope.filtering.filter import fuse, smooth
from kalscope.filtering.params import FilterParams

MAD = 1.4826
"""Standard deviation of normal numbers over the median of their size."""

FAR_OFF, CONFIRMED = 6.0, 3.0
"""Size of a residual, in its own standard deviations, from which it is far off; and from which that of another
sensor in the same row confirms it: then the quantity has moved."""

MIN_STRETCH, MUCH_LONGER = 30, 20.0
"""Least length in readings, and in multiples of the usual length, of a suspicious stretch of equal or missing
ones."""

USUALLY_NEW = 2.0
"""Readings per value up to which a sensor usually gives new values."""

Stretch = tuple[int, int]
"""First row, and one past the last; (0, 0) for none."""


def spikes(z: Array, dt: Array | None, params: FilterParams) -> list[int]:
    """Readings of each sensor that are far off, by a filter of its own, and that no other sensor confirms."""
    sizes = np.stack([_sizes(z[:, [i]], dt, params.only([i])) for i in range(params.sensors)], axis=1)
    far, confirming = sizes > FAR_OFF, sizes > CONFIRMED
    alone = far & (confirming.sum(axis=1, keepdims=True) == 1)
    alone[1:] &= ~far[:-1]  # the reading after a spike is far from where the filter went
    return alone.sum(axis=0).tolist()


def _sizes(z: Array, dt: Array | None, params: FilterParams) -> Array:
    """|v|/√s of one sensor, over their usual size; 0 where none is scored."""
    run = fuse(z, params, dt)
    with np.errstate(invalid="ignore"):
        size = np.abs(run.innovation[:, 0]) / np.sqrt(run.s[:, 0])
    scored = np.isfinite(size)
    usual = MAD * float(np.median(size[scored])) if scored.any() else 0.0
    return np.where(scored, size, 0.0) / max(usual, 1.0)


def stuck(z: Array, dt: Array | None, params: FilterParams, sensor: int) -> Stretch:
    """The longest stretch of equal readings, where it is far longer than the others of this sensor.

    A sensor that repeats its readings anyway, because it rounds, is stuck only if the others moved at that time.
    """
    rows = np.flatnonzero(np.isfinite(z[:, sensor]))
    if not len(rows):
        return 0, 0
    values = z[rows, sensor]
    starts = np.append(0, np.flatnonzero(np.diff(values)) + 1)
    first, length = _longest(starts, len(values))
    stretch = (int(rows[first]), int(rows[first + length - 1]) + 1) if length else (0, 0)
    if length and len(values) > USUALLY_NEW * len(starts) and not _others_moved(z, dt, params, sensor, stretch):
        return 0, 0
    return stretch


def _others_moved(z: Array, dt: Array | None, params: FilterParams, sensor: int, stretch: Stretch) -> bool:
    """Whether the others show movement of the quantity in this stretch far beyond the noise of this sensor."""
    others = [j for j in range(params.sensors) if j != sensor]
    if not others:
        return False
    smoothed = smooth(z[:, others], params.only(others), dt).x[slice(*stretch)]
    spread = np.nanmax(smoothed) - np.nanmin(smoothed) if np.isfinite(smoothed).any() else 0.0
    return bool(spread > FAR_OFF * np.sqrt(params.scaled_r[sensor]))


def silent(answered: Mask) -> Stretch:
    """The longest stretch of rows without a reading where it is far longer than the others of this sensor."""
    rows = np.flatnonzero(answered)
    if not len(rows):
        return 0, len(answered)
    first, length = _longest(np.append(0, rows), len(answered))  # a reading and the silence after it
    start = first + int(answered[first])
    return (start, first + length) if length else (0, 0)


def _longest(starts: Sequence[int] | Array, end: int) -> Stretch:
    """First place and length of the longest stretch, length 0 where it is as long as the others."""
    starts = np.asarray(starts)
    lengths = np.diff(np.append(starts, end))
    worst = int(lengths.argmax())
    length = int(lengths[worst])
    others = np.delete(lengths, worst)
    usual = float(others.mean()) if len(others) else 1.0
    return (int(starts[worst]), length) if length >= max(MIN_STRETCH, MUCH_LONGER * usual) else (0, 0)
