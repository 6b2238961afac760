"""Devices compared: which lie apart from the others, and which have changed from file to file."""

from __future__ import annotations

import math
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kalscope.common.array import Array, Indices, Mask
from kalscope.errors import BadSetting

NORMAL = 1.959963984540054
"""Standard errors from an estimate to the end of its 95 % interval."""

EDGE = 1.5
"""Least standard deviation, in ln, beyond the end of an interval whose estimate is 0: short recordings without any
movement are more frequent than a likelihood that is quadratic in the logarithm predicts."""

Interval = tuple[ArrayLike, ArrayLike]


def checked(values: ArrayLike, interval: Interval | None) -> tuple[Array, Array, Array]:
    """Values, shape (k,), and their standard errors downwards and upwards; 0 without an interval.

    Raises:
        BadSetting: the shapes differ, or a value lies outside its interval.
    """
    values = np.asarray(values, dtype=np.float64)
    if values.ndim != 1:
        raise BadSetting(f"values must be one array, shape (k,) (got {values.shape})")
    if interval is None:
        return values, np.zeros(len(values)), np.zeros(len(values))
    low, high = (np.asarray(end, dtype=np.float64) for end in interval)
    if low.shape != values.shape or high.shape != values.shape:
        raise BadSetting(f"interval must have two arrays of shape {values.shape} (got {low.shape}, {high.shape})")
    if np.any((low > values) | (high < values)):
        raise BadSetting("interval must hold its value (got values outside)")
    with np.errstate(invalid="ignore"):
        down, up = (values - low) / NORMAL, (high - values) / NORMAL
    return values, np.where(np.isnan(down), np.inf, down), np.where(np.isnan(up), np.inf, up)


def usual_error(down: Array, up: Array) -> float:
    """Median of the finite standard errors, 0 without any."""
    both = np.where(np.isinf(down), up, np.where(np.isinf(up), down, 0.5 * (down + up)))
    known = both[np.isfinite(both)]
    return float(np.median(known)) if len(known) else 0.0


def distances(
    values: Array, interval: Interval | None, down: Array, up: Array, middle: Array, spread: float
) -> Array:
    """Each value's distance from `middle` in its own standard deviations, with `spread` added; NaN stays.

    The side of the interval that faces the middle counts. A value at ∓inf (ln of 0) is 1.96 away where its interval
    holds the middle, and farther by how far the interval ends before it.
    """
    sizes = np.hypot(spread, np.where(values < middle, up, down))
    with np.errstate(divide="ignore", invalid="ignore"):
        z = np.where(values == middle, 0.0, (values - middle) / sizes)
    if interval is not None:
        size = max(float(np.hypot(spread, usual_error(down, up))), EDGE)
        low, high = (np.asarray(end, dtype=np.float64) for end in interval)
        with np.errstate(divide="ignore", invalid="ignore"):
            below = -NORMAL - np.maximum(middle - high, 0.0) / size
            above = NORMAL + np.maximum(low - middle, 0.0) / size
        z = np.where(np.isneginf(values), below, np.where(np.isposinf(values), above, z))
    return np.where(np.isnan(values), np.nan, z)


_MAD = NormalDist().inv_cdf(0.75)
"""Median distance from the median of a normal distribution, standard deviations: 0.6745."""

MIN_DEVICES = 8
"""Minimum number of devices whose spread can be judged."""


@dataclass(frozen=True)
class Outliers:
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


def outliers(values: ArrayLike, interval: Interval | None = None, expected: float = 0.05) -> Outliers:
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
        return Outliers(np.full(len(values), math.nan), np.empty(0, np.intp), math.inf, 0.0, math.nan, math.nan)
    if not 0.0 < expected <= max(0.05 * count, 1.0):
        raise BadSetting(f"expected must be above 0 and at most a twentieth of the devices (got {expected})")
    threshold = -NormalDist().inv_cdf(0.5 * expected / count)
    middle = float(np.median(values[given]))
    if not math.isfinite(middle):  # most have q = 0: what is unlike them cannot be measured on this scale
        return Outliers(np.full(len(values), math.nan), np.empty(0, np.intp), threshold, 0.0, middle, math.nan)
    whole = float(np.median(np.abs(values[given] - middle))) / _MAD
    usual = usual_error(down[given], up[given])
    spread = math.sqrt(max(whole * whole - usual * usual, 0.0)) if math.isfinite(whole) else 0.0
    z = distances(values, interval, down, up, np.full(len(values), middle), spread)
    beyond = np.flatnonzero(np.abs(z) > threshold)
    order = np.argsort(-np.abs(z[beyond]), kind="stable")
    return Outliers(z, beyond[order], threshold, expected, middle, spread)


FALSE_ALARM = 0.05
"""Chance that any device of a fleet in which none changes is called changed."""


@dataclass(frozen=True)
class Changes:
    """What several files of each of d devices say about one quantity, arrays of shape (d,)."""

    device: NDArray[np.generic]
    """The devices, sorted."""
    files: NDArray[np.int64]
    """Files of each that give a value for it."""
    mean: Array
    """Their mean, weighted by their standard errors; NaN without any."""
    chi2: Array
    """Σ(value − mean)²/error²; for a device that does not change it follows χ² with `files` − 1 degrees of
    freedom."""
    p: Array
    """Chance of so large a value of a device that does not change, 0 … 1; 1 with fewer than two files."""
    adjusted_p: Array
    """The same for the whole fleet (Holm): below 0.05 the device has changed; at most one fleet in twenty names one
    wrongly."""
    step: Array
    """Largest difference between the means before and after one date, later minus earlier; 0 with fewer than
    two."""
    step_at: Indices
    """The file (its place in the arrays given) from which on that holds; −1 of others."""
    changed: Indices
    """Devices whose `adjusted_p` is below 0.05, smallest first."""
    expected: float
    """Devices with p below 0.05 that chance alone would show."""


def changes(values: ArrayLike, interval: Interval, device: ArrayLike, date: ArrayLike) -> Changes:
    """Which devices have changed by more than the intervals of their files allow.

    Args:
        values: ln r or ln q of each file, shape (f,); NaN where there is none.
        interval: the 95 % interval of each, two arrays of shape (f,), ends may be infinite.
        device: the device of each file, numbers or names, shape (f,).
        date: the order of the files of one device, shape (f,).

    Raises:
        BadSetting: the arrays have different lengths, or a value lies outside its interval.

    Source: Cochran (1954), Biometrics 10, 101, for Σ(value − mean)²/error²; Holm (1979), Scand. J. Statist. 6, 65.
    """
    from scipy.special import chdtrc  # pyright: ignore[reportUnknownVariableType]

    values, down, up = checked(values, interval)
    names, group = np.unique(np.asarray(device), return_inverse=True)
    dates, k = np.asarray(date), len(names)
    if not values.shape == group.shape == dates.shape:
        raise BadSetting(f"device and date must have one entry a file, {values.shape} (got {group.shape})")
    both = np.where(np.isinf(down), up, np.where(np.isinf(up), down, 0.5 * (down + up)))
    informative = np.isfinite(values) & np.isfinite(both) & (both > 0.0)
    weights = np.where(informative, 1.0 / np.maximum(both, 1e-150) ** 2, 0.0)
    total = np.bincount(group, weights, k)
    with np.errstate(divide="ignore", invalid="ignore"):
        mean = np.bincount(group, weights * np.where(informative, values, 0.0), k) / total
    z = distances(values, interval, down, up, mean[group], 0.0)
    used = np.isfinite(z) & (informative | (np.abs(z) > NORMAL))  # an edge counts where it excludes the mean
    files = np.bincount(group[used], minlength=k)
    chi2 = np.asarray(np.bincount(group[used], z[used] ** 2, k), dtype=np.float64)
    p = np.where(files > 1, np.asarray(chdtrc(np.maximum(files - 1, 1), chi2), dtype=np.float64), 1.0)
    order = np.lexsort((dates, group))
    order = order[weights[order] > 0.0]
    step, step_at = _steps(values[order], weights[order], group[order], order, p < FALSE_ALARM)
    adjusted = holm(p)
    low = np.flatnonzero(adjusted < FALSE_ALARM)
    changed = low[np.lexsort((-chi2[low], adjusted[low]))]
    return Changes(
        names, files, mean, chi2, p, adjusted, step, step_at, changed, FALSE_ALARM * int((files > 1).sum())
    )


def holm(p: Array) -> Array:
    """Holm's adjusted p of each of several tests, shape (k,): those below α hold together at the false alarm α."""
    order = np.argsort(p, kind="stable")
    raised = np.maximum.accumulate(np.minimum(p[order] * (len(p) - np.arange(len(p))), 1.0))
    out = np.empty_like(p)
    out[order] = raised
    return out


def _steps(
    values: Array, weights: Array, group: NDArray[np.intp], files: Indices, wanted: Mask
) -> tuple[Array, Indices]:
    """The split of each wanted device's files, in order, that explains most of their scatter: its step, where."""
    step, at = np.zeros(len(wanted)), np.full(len(wanted), -1, np.intp)
    for k in np.flatnonzero(wanted).tolist():
        low, high = np.searchsorted(group, [k, k + 1])
        v, w = values[low:high], weights[low:high]
        if len(v) < 2:
            continue
        before_w, before = np.cumsum(w)[:-1], np.cumsum(w * v)[:-1]
        after_w, after = w.sum() - before_w, (w * v).sum() - before
        jumps = after / after_w - before / before_w
        i = int(np.argmax(jumps**2 * before_w * after_w))
        step[k], at[k] = jumps[i], files[low + i + 1]
    return step, at
