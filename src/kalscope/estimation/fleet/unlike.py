"""Which devices of a fleet are unlike the others: robust z scores, and how many chance alone would show."""

from __future__ import annotations

import math
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np
from numpy.typing import ArrayLike

from kalscope.common.array import Array, Indices
from kalscope.errors import BadSetting

_MAD = NormalDist().inv_cdf(0.75)
"""Median distance from the median of a normal law, standard deviations: 0.6745."""

MIN_DEVICES = 8
"""Devices from which a spread can be judged."""


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


def unlike(values: ArrayLike, errors: ArrayLike | None = None, expected: float = 0.05) -> Unlike:
    """The devices whose value is unlike that of the others.

    Args:
        values: one a device, on a scale on which they scatter normally (ln r, ln λ, ln of the rate), shape (k,);
            NaN for a device without one.
        errors: standard error of each, ≥ 0, shape (k,): a short recording scatters more; None = all alike.
        expected: devices that may be named by chance in the whole fleet, > 0: 0.05 names one in one fleet of
            twenty.

    Raises:
        BadSetting: values or errors have another shape, or expected is out of range.

    Source: Iglewicz & Hoaglin (1993), How to detect and handle outliers, for the robust z.
    """
    values = np.asarray(values, dtype=np.float64)
    if values.ndim != 1:
        raise BadSetting(f"values must have one number a device, shape (k,) (got {values.shape})")
    errors = np.zeros(len(values)) if errors is None else np.asarray(errors, dtype=np.float64)
    if errors.shape != values.shape:
        raise BadSetting(f"errors must have one number a device, {values.shape} (got {errors.shape})")
    given = ~np.isnan(values)
    count = int(given.sum())
    if not 0.0 < expected <= max(0.5 * count, 1.0):
        raise BadSetting(f"expected must be above 0 and at most half of the devices (got {expected})")
    if count < MIN_DEVICES:
        return Unlike(np.full(len(values), math.nan), np.empty(0, np.intp), math.inf, 0.0, math.nan, math.nan)
    threshold = -NormalDist().inv_cdf(0.5 * expected / count)
    middle = float(np.median(values[given]))
    known = np.where(given & np.isfinite(errors), errors, np.nan)
    usual = float(np.nanmedian(known)) if not np.all(np.isnan(known)) else 0.0
    whole = float(np.median(np.abs(values[given] - middle))) / _MAD
    spread = math.sqrt(max(whole * whole - usual * usual, 0.0))
    sizes = np.hypot(spread, np.maximum(np.where(np.isnan(known), usual, known), 0.0))
    with np.errstate(divide="ignore", invalid="ignore"):
        z = np.where(values == middle, 0.0, (values - middle) / sizes)
    z[~given] = math.nan
    beyond = np.flatnonzero(np.abs(z) > threshold)
    return Unlike(z, beyond[np.argsort(-np.abs(z[beyond]), kind="stable")], threshold, expected, middle, spread)
