"""The fit without momentum and without a search for spikes, of many series in one compiled call."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from kalscope.common.array import Array, Mask
from kalscope.estimation.fleet.many import fit_kernels as kernels
from kalscope.estimation.fleet.many.series import Series
from kalscope.estimation.result import Estimate

KINDS = {"ml": kernels.FREE, "fixed_r": kernels.KNOWN_R, "fixed_ratio": kernels.KNOWN_RATIO}
"""What each method of `Estimate` knows, as the kernels name it."""

EQUAL = 1e-6
"""Relative difference between the q/r of two fits that are the same."""


def fit_plain(
    many: Series, kind: int, known: Array, ends: NDArray[np.int64]
) -> tuple[Array, NDArray[np.uint8], NDArray[np.int64], Mask]:
    """Fit each series up to one of `ends`, indices into the values, shape (series,).

    Returns:
        The columns of numbers and the codes of the kernels, the finite samples, and whether readings repeat.
    """
    k = len(many)
    numbers, codes = np.empty((k, kernels.NUMBERS)), np.empty(k, np.uint8)
    samples, stepped = np.empty(k, np.int64), np.empty(k, np.bool_)
    kernels.fit_each(many.values, many.steps, many.starts[:-1], ends, kind, known, numbers, codes, samples, stepped)
    return numbers, codes, samples, stepped


def fitted_ratios(many: Series, ends: NDArray[np.int64]) -> Array:
    """The most likely λ of each series up to one of `ends`, 0 … inf; NaN without any."""
    numbers, codes, _, _ = fit_plain(many, kernels.FREE, np.empty(len(many)), ends)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(codes <= kernels.NO_MOVEMENT, numbers[:, kernels.Q] / numbers[:, kernels.R], math.nan)


def pair_intervals(one: Estimate, z: Array, steps: Array) -> tuple[float, float, float, float]:
    """The 95 % intervals of q and r of one series, as `estimate_many` finds them: by the profile of the likelihood.

    With momentum, or where r is not that of the likelihood (below the resolution, only spikes), they follow from
    the standard errors.

    Args:
        one: its estimate, of one channel.
        z: the series, shape (n,).
        steps: nominal sample periods before each sample, shape (n,); empty = 1 each.

    Returns:
        Least and largest q, least and largest r, unit²; 0 and inf where nothing is excluded.
    """
    wald = (*_around(one.q, one.q_se), *_around(one.r, one.r_se))
    kind = KINDS.get(one.method)
    if kind is None or float(one.momentum) > 0.0 or not (float(one.q) > 0.0 and float(one.r) > 0.0):
        return wald
    used = z if one.outliers is None else np.where(one.outliers, np.nan, z)
    many = Series(np.array(used, dtype=np.float64), np.array([0, len(z)]), steps)
    known = np.array([{kernels.KNOWN_R: one.r, kernels.KNOWN_RATIO: one.ratio}.get(kind, math.nan)], np.float64)
    (found,), (code,), _, _ = fit_plain(many, kind, known, many.starts[1:])
    if (
        code not in (kernels.OK, kernels.FLAT)
        or abs(found[kernels.Q] / found[kernels.R] / float(one.ratio) - 1.0) > EQUAL
    ):
        return wald
    # The spike-proof fit corrects r for the good samples that its rule removes.
    factor = 1.0 if kind == kernels.KNOWN_R else float(one.r) / found[kernels.R]
    low, high, r_low, r_high = (factor * found[kernels.Q_LOW :]).tolist()
    return low, high, r_low, r_high


def _around(value: float, error: float) -> tuple[float, float]:
    """The 95 % interval of a variance from its standard error, on the scale of the logarithm."""
    size, spread = value, error
    if not (size > 0.0 and math.isfinite(spread)):
        return 0.0, math.inf
    factor = math.exp(min(kernels.NORMAL * spread / size, 700.0))
    return size / factor, size * factor
