"""Which device has changed: its files in order of date, compared with the intervals of their q and r."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kalscope.common.array import Array, Indices, Mask
from kalscope.errors import BadSetting
from kalscope.estimation.fleet.intervals import NORMAL, Interval, checked, distances

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
