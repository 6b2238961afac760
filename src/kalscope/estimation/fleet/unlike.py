"""Which devices of a fleet are unlike the others: robust z scores, and how many chance alone would show."""

from __future__ import annotations

import math
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np
from numpy.typing import ArrayLike

from kalscope.common.array import Array, Indices
from kalscope.errors import BadSetting
from kalscope.estimation.fleet.intervals import Interval, checked, distances, usual_error

_MAD = NormalDist().inv_cdf(0.75)
"""Median distance from the median of a normal distribution, standard deviations: 0.6745."""

MIN_DEVICES = 8
"""Minimum number of devices whose spread can be judged."""


@dataclass(frozen=True)
class Unlike:
    """How far each of k devices lies from the others in one quantity."""

    z: Array
    """Distance from the fleet's middle in standard deviations, shape (k,); NaN where the device has no value, ±inf
    where its value is infinite (ln q of q = 0)."""
    devices: Indices
    """Those beyond the threshold, farthest first."""
    threshold: float
    """|z| beyond which a device is named."""
    expected: float
    """How many devices of a fleet without any unlike one lie beyond it by chance, if they scatter normally."""
    middle: float
    """Median of the fleet."""
    spread: float
    """Standard deviation of the fleet by the median distance from the median, without that of the estimates."""


def unlike(values: ArrayLike, interval: Interval | None = None, expected: float = 0.05) -> Unlike:
    """The devices whose value is unlike that of the others.

    Args:
        values: one a device, on a scale on which they scatter normally (ln r, ln q, ln λ, ln of the rate), shape
            (k,); NaN for a device without one.
        interval: the 95 % interval of each, two arrays of shape (k,), ends may be infinite: a short recording
            scatters more. None = the values are exact.
        expected: devices that may be named by chance in the whole fleet, above 0, at most one in twenty: 0.05 names
            one in one fleet of twenty.

    Raises:
        BadSetting: values or interval have another shape, or expected is out of range.

    Source: Iglewicz & Hoaglin (1993), How to detect and handle outliers, for the robust z.
    """
    values, down, up = checked(values, interval)
    given = ~np.isnan(values)
    count = int(given.sum())
    if count < MIN_DEVICES:
        return Unlike(np.full(len(values), math.nan), np.empty(0, np.intp), math.inf, 0.0, math.nan, math.nan)
    if not 0.0 < expected <= max(0.05 * count, 1.0):
        raise BadSetting(f"expected must be above 0 and at most a twentieth of the devices (got {expected})")
    threshold = -NormalDist().inv_cdf(0.5 * expected / count)
    middle = float(np.median(values[given]))
    if not math.isfinite(middle):  # most have q = 0: what is unlike them cannot be measured on this scale
        return Unlike(np.full(len(values), math.nan), np.empty(0, np.intp), threshold, 0.0, middle, math.nan)
    whole = float(np.median(np.abs(values[given] - middle))) / _MAD
    usual = usual_error(down[given], up[given])
    spread = math.sqrt(max(whole * whole - usual * usual, 0.0)) if math.isfinite(whole) else 0.0
    z = distances(values, interval, down, up, np.full(len(values), middle), spread)
    beyond = np.flatnonzero(np.abs(z) > threshold)
    order = np.argsort(-np.abs(z[beyond]), kind="stable")
    return Unlike(z, beyond[order], threshold, expected, middle, spread)
