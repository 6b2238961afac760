"""The maximum-likelihood pair of one record and its standard errors; what its differences say of the model."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from kalscope.common.numbers import Array
from kalscope.common.progress import Progress
from kalscope.common.text import correlation
from kalscope.estimation.likelihood import MAX_LOG_RATIO, ONE, Differences, Peak, find_top_near, search_records
from kalscope.estimation.result import Pair

# Maximum likelihood with the exact diffuse start and the scale concentrated out: one search over ln λ.
#
# Durbin & Koopman (2012), section 2.10. Nothing in it depends on the unit of the signal.


_DERIVATIVE_STEP = 1e-3
"""Step in ln λ for the slope of ln r̂(λ), which only feeds standard errors."""


def search(data: Differences, progress: Progress) -> Peak:
    """The peak of the concentrated likelihood over λ, with its 95 % interval."""
    return search_records(data.records, progress=progress).one()


def fit_near(data: Differences, ratio: float, progress: Progress) -> Pair:
    """The pair of a record whose λ is probably near `ratio`: searched there first."""
    peak = find_top_near(data, math.log(ratio)) if 0.0 < ratio < math.inf else None
    return fit_maximum_likelihood(data, peak or search(data, progress))


def fit_maximum_likelihood(data: Differences, peak: Peak) -> Pair:
    """The pair at the peak of the likelihood, and their standard errors."""
    place = np.array([peak.log_ratio])
    chi2, _ = data.records.sums(ONE, ratios_near(place))
    q_error, r_error = (float(one[0]) for one in relative_errors(place, np.array([peak.curvature]), chi2, data.m))
    if peak.log_ratio == math.inf:
        q = data.random_walk()[1]
        return Pair(q, 0.0, q * q_error, math.inf)
    r = float(chi2[0, 0]) / data.m
    q = math.exp(peak.log_ratio) * r
    return Pair(q, r, q * q_error if q else math.inf, r * r_error)


def logs_near(log_ratios: Array) -> Array:
    """Each ln λ, and a small step before and after it, shape (k, 3), for `relative_errors`."""
    return log_ratios[:, None] + _DERIVATIVE_STEP * np.array([0.0, -1.0, 1.0])


def ratios_near(log_ratios: Array) -> Array:
    """The λ of `logs_near`."""
    return np.exp(np.minimum(logs_near(log_ratios), MAX_LOG_RATIO))


def relative_errors(log_ratios: Array, curvature: Array, chi2: Array, m: Array | int) -> tuple[Array, Array]:
    """Standard errors of ln q and ln r from the observed information in (ln r, ln λ), shape (k,).

    There var(ln λ) = −1/ℓ″, and r given λ has var(ln r) = 2/m (m squared innovations), while the best r moves
    with λ by the slope b: var(ln r) = 2/m + b² var(ln λ), var(ln q) = 2/m + (1 + b)² var(ln λ).

    Args:
        log_ratios: ln λ of each peak.
        curvature: second derivative of its log-likelihood.
        chi2: Σv²/f of `ratios_near`, shape (k, 3).
        m: scored innovations.
    """
    slope = np.log(chi2[:, 2] / chi2[:, 1]) / (2.0 * _DERIVATIVE_STEP)
    variance = np.divide(-1.0, curvature, out=np.full(len(slope), math.inf), where=curvature < 0.0)
    variance[np.isinf(log_ratios)] = 0.0
    return np.sqrt(2.0 / m + (1.0 + slope) ** 2 * variance), np.sqrt(2.0 / m + slope**2 * variance)


def note_on_differences(data: Differences) -> str:
    """How the differences of neighbouring samples contradict the model; "" where they do not."""
    m = data.m
    g0, g1, g2 = _products(data)
    if m < 20 or g0 == 0.0:
        return ""
    r1, r2 = g1 / g0, g2 / g0
    if r1 > 3.0 / math.sqrt(m):
        return (
            f"Successive changes have the same sign (correlation {correlation(r1)}; a random walk plus noise has 0 "
            "or less): the signal moves smoothly, or the sensor already smooths it."
        )
    if r1 < -0.5 - 3.0 / math.sqrt(m):
        return f"Successive changes alternate (correlation {correlation(r1)}, below −0.5): an oscillation or hum."
    if abs(r2) > 4.0 * math.sqrt((1.0 + 2.0 * r1**2) / m) + 0.02:
        return (
            f"Changes two samples apart are correlated ({correlation(r2)}): a trend, an oscillation or slow noise."
        )
    return ""


def _products(data: Differences) -> list[float]:
    """Mean products of differences 0, 1 and 2 apart, scale²."""
    d, m = data.d, data.m  # BLAS would start threads for it
    return [float(np.einsum("i,i", d[j:], d[: m - j])) / (m - j) if j < m else 0.0 for j in range(3)]


# Allan variance: averages over M samples, compared with the average before.


def allan_variances(
    row: Array, there: NDArray[np.bool_], sizes: NDArray[np.int64] | None = None
) -> tuple[Array, Array, Array]:
    """M, overlapping Allan variances, and their degrees of freedom; shape (k,) each.

    `row` has one value per sample period, `there` says which exist; windows with a missing sample are left out.
    `sizes` are the M asked for, ascending; None = powers of two. Those with too few windows are left out.
    """
    sums = np.concatenate([[0.0], np.cumsum(np.where(there, row, 0.0))])
    counts = np.concatenate([[0], np.cumsum(there)])
    if sizes is None:
        sizes = 2 ** np.arange(max(len(row) // 4, 0).bit_length())
    points: list[tuple[float, float, float]] = []
    for size in map(int, sizes):
        end = len(sums) - 2 * size
        full = counts[2 * size :] - counts[:end] == 2 * size
        jumps = (sums[2 * size :] - 2.0 * sums[size : size + end] + sums[:end])[full] / size
        if len(jumps) < 2 * size:
            break
        points.append((float(size), 0.5 * float(np.mean(jumps**2)), max(len(jumps) / size, 1.0)))
    columns = np.array(points).reshape(-1, 3).T
    return columns[0], columns[1], columns[2]
