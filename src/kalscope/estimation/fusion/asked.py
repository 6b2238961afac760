"""The arguments of `estimate_fusion`, checked once."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from kalscope.common.array import Array, Mask
from kalscope.errors import BadSetting
from kalscope.estimation.fusion import words
from kalscope.estimation.verdict.words import BAD_UNIT, MIN_SAMPLES, OTHER_UNIT
from kalscope.filtering.arrays import refuse_infinite, samples_of, steps_of
from kalscope.filtering.params import MAX_VARIANCE

_MAX_SIZE = 1e140
"""Readings that vary by more, or by less than its inverse, have variances that do not fit a double."""
_MAX_FACTOR = 1e20
"""A known r this many times above or below what readings vary by, squared, has another unit."""
_SAME = 1e-12
"""Relative difference up to which two sensors are copies: that of rounding."""


@dataclass(frozen=True)
class Question:
    """A record of several sensors, and what is known of them."""

    z: Array
    """Readings, NaN where missing, shape (n, sensors)."""
    steps: Array
    """Nominal sample periods before each row; empty = 1 each."""
    names: tuple[str, ...]
    """The sensors."""
    reference: int | None
    """The sensor whose offset is 0 and whose gain is 1."""
    known: Array
    """Known r, unit², NaN where not known, shape (sensors,)."""

    @property
    def gauge(self) -> int:
        """The sensor whose offset and gain stay while the others are searched."""
        return 0 if self.reference is None else self.reference

    def without(self, away: Mask) -> Question:
        """The record without some readings, shape (n, sensors)."""
        return replace(self, z=np.where(away, np.nan, self.z)) if away.any() else self

    def unusable(self, gains: bool) -> tuple[str, str] | None:
        """Verdict and words where a sensor makes the fit meaningless; a copy may have another gain with `gains`."""
        for name, column in zip(self.names, self.z.T, strict=True):
            readings = column[np.isfinite(column)]
            if len(readings) < MIN_SAMPLES:
                return "too_few", words.too_few(name, len(readings))
            if np.all(readings == readings[0]):
                return "constant", words.constant(name)
            size = float(np.ptp(0.5 * readings))
            if not 1.0 / _MAX_SIZE < size < _MAX_SIZE:
                return "bad_unit", BAD_UNIT
            if np.any((self.known > _MAX_FACTOR * size * size) | (self.known < size * size / _MAX_FACTOR)):
                return "bad_unit", OTHER_UNIT
        for i in range(len(self.names)):
            for j in range(i):
                if _are_copies(self.z[:, j], self.z[:, i], gains):
                    return "copies", words.copies(self.names[j], self.names[i])
        return None


def question(
    z: ArrayLike,
    dt: ArrayLike | None,
    names: Sequence[str] | None,
    reference: int | str | None,
    known_r: ArrayLike | None,
) -> Question:
    """Check what was given; BadSetting as in `estimate_fusion`."""
    readings = samples_of(z)
    readings = readings[:, None] if readings.ndim == 1 else readings
    if readings.ndim != 2 or readings.shape[1] == 0:
        raise BadSetting(f"z must have shape (n, sensors) (got {readings.shape})")
    n, sensors = readings.shape
    for column in readings.T:
        refuse_infinite(column)
    given = tuple(f"sensor {i + 1}" for i in range(sensors)) if names is None else tuple(map(str, names))
    if len(given) != sensors or len(set(given)) != sensors:
        raise BadSetting(f"names must be {sensors} different ones, one per sensor (got {', '.join(given)})")
    try:
        known = np.full(sensors, math.nan) if known_r is None else np.array(known_r, dtype=np.float64)
    except (TypeError, ValueError):
        known = np.empty(0)
    if known.shape != (sensors,) or np.any((known <= 0.0) | (known > MAX_VARIANCE)):
        raise BadSetting(f"known_r must be one variance above 0 a sensor, or NaN (got {known_r})")
    return Question(readings, steps_of(dt, n), given, _index(reference, given), known)


def _index(reference: int | str | None, names: tuple[str, ...]) -> int | None:
    if reference is None:
        return None
    if isinstance(reference, str) and reference in names:
        return names.index(reference)
    whole = isinstance(reference, int | np.integer) and not isinstance(reference, bool)
    if whole and 0 <= int(reference) < len(names):
        return int(reference)
    raise BadSetting(
        f"reference must be a sensor, its name or its index from 0 to {len(names) - 1} (got {reference!r})"
    )


def _are_copies(first: Array, second: Array, gains: bool) -> bool:
    """Whether two sensors differ by the same value wherever both answer; with `gains` by a factor too."""
    both = np.isfinite(first) & np.isfinite(second)
    if both.sum() < MIN_SAMPLES:
        return False
    one, other = first[both], second[both]
    size = max(float(np.abs(one).max()), float(np.abs(other).max()))
    one, other = (one - one[0]) / size, (other - other[0]) / size
    squares = float(one @ one)
    factor = float(one @ other) / squares if gains and squares > 0.0 else 1.0
    return float(np.ptp(other - factor * one)) <= _SAME
