"""What the model of independent white noise does not describe: noise that sensors share, and slow disagreement."""

from __future__ import annotations

import math

import numpy as np

from kalscope.common.array import Array
from kalscope.estimation.fusion.moving import fused_signal
from kalscope.estimation.fusion.search.fit import Found

MIN_ROWS = 30
"""Minimum number of rows in which all sensors answer."""
SURE = 10.83
"""Rise of twice the log-likelihood that one parameter brings by chance once in a thousand records."""
MUCH = 1.3
"""Factor by which the fused value must be noisier than the sensors explain."""
SLOW = 0.2
"""Correlation of a sensor's difference with that of the row before, beyond which the difference counts as slow."""

EVENLY, MIN_CHANGE = 0.8, 2.0
"""Share of readings that are repeated equally often, and usual change between them over the least, where a logger
repeats the last reading of a slow sensor. One that rounds repeats itself too, but unevenly or in single steps."""


def held_for(readings: Array) -> int:
    """How many rows each new reading of a sensor stays, where a logger repeats it; else 1.

    Args:
        readings: of one sensor, finite, shape (m,).
    """
    changed = np.flatnonzero(np.diff(readings))
    rows = np.diff(changed)
    if len(rows) < MIN_ROWS:
        return 1
    usual, sizes = float(np.median(rows)), np.abs(np.diff(readings)[changed])
    near = np.abs(rows - usual) <= max(1.0, 0.1 * usual)  # the rows need not divide the period of the sensor
    evenly = float(np.mean(near & (rows > 1))) >= EVENLY
    return round(usual) if evenly and float(np.median(sizes)) > MIN_CHANGE * float(sizes.min()) else 1


def slow_sensors(z: Array, found: Found) -> list[int]:
    """The sensors that differ from the fused value by more than white noise: the difference stays for some rows."""
    data, place = found.coordinates.data, found.place
    signal = _complete(z, found)
    if signal is None:
        return []
    apart = (z - data.centre - place.offset * data.scale) / place.c - signal[:, None]
    slow: list[int] = []
    for i in range(data.sensors):
        level: Array = apart[:, i] - np.nanmean(apart[:, i])
        pairs = level[1:] * level[:-1]
        pairs = pairs[np.isfinite(pairs)]
        size = float(np.nanmean(level**2))
        certain = len(pairs) >= MIN_ROWS and size > 0.0
        if certain and float(pairs.mean()) / size > max(SLOW, 4.0 / math.sqrt(len(pairs))):
            slow.append(i)
    return slow


def _complete(z: Array, found: Found) -> Array | None:
    """The fused value of the rows in which all sensors answer, unit, NaN in the others; None if there are few."""
    if z.shape[1] < 2:
        return None
    rows = np.isfinite(z).all(axis=1)
    if int(rows.sum()) < MIN_ROWS:
        return None
    place = found.place
    exact = (place.r == 0.0).astype(np.float64)
    weights = exact if exact.any() else place.c**2 / place.r
    return np.where(rows, fused_signal(z, place, found.coordinates.data, weights), np.nan)
