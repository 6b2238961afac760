"""Allan variance: averages over M samples, compared with the average before.

Under the model AVAR(M) = r/M + q(2M² + 1)/(6M) (Zhang 2008, Metrologia 45, 549; in R's avar `av_wn`, `av_rw`):
the noise falls with M, the movement rises, and the two slopes separate them.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from kalscope.common.array import Array
from kalscope.estimation.likelihood.profile import Differences
from kalscope.estimation.methods.innovation_correlations import TOO_SHORT, solve
from kalscope.estimation.methods.pair import Pair

_ROUNDS = 3
_CORRELATED = 1.5
"""Neighbouring octaves share samples: standard errors are widened by this."""


def fit(data: Differences) -> Pair:
    """The pair from the Allan variance over octaves of M, weighted by their standard errors."""
    gap = data.gap if len(data.gap) else np.ones(data.m)
    length = gap.sum() + 1.0
    if np.any(gap != np.rint(gap)) or np.any(gap < 1.0) or length > 20 * data.m + 1000:
        text = "This method averages over M samples in a row: it needs regular sampling."
        return Pair(0.0, 0.0, math.inf, math.inf, verdict="irregular", text=text)
    row = np.zeros(int(length))
    there = np.zeros(int(length), dtype=bool)
    where = np.concatenate([[0], np.cumsum(gap).astype(np.int64)])
    row[where], there[where] = np.concatenate([[0.0], np.cumsum(data.d)]), True
    sizes, seen, degrees = allan_variances(row, there)
    if len(sizes) < 2 or seen.max() == 0.0:  # or: all change lies across the gaps
        return Pair(0.0, 0.0, math.inf, math.inf, verdict="too_few", text=TOO_SHORT)
    design = np.stack([(2.0 * sizes**2 + 1.0) / (6.0 * sizes), 1.0 / sizes], axis=1)
    spread = np.sqrt(2.0 / degrees)
    least = 1e-6 * seen.max()  # the averages of an oscillation may be 0
    expected = seen.clip(least)
    pair = solve(design, seen, expected * spread)
    for _ in range(_ROUNDS):
        expected = (design @ [pair.q, pair.r]).clip(least)
        pair = solve(design, seen, expected * spread)
    return Pair(pair.q, pair.r, _CORRELATED * pair.q_se, _CORRELATED * pair.r_se)


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
    found: list[tuple[float, float, float]] = []
    for size in map(int, sizes):
        end = len(sums) - 2 * size
        full = counts[2 * size :] - counts[:end] == 2 * size
        jumps = (sums[2 * size :] - 2.0 * sums[size : size + end] + sums[:end])[full] / size
        if len(jumps) < 2 * size:
            break
        found.append((float(size), 0.5 * float(np.mean(jumps**2)), max(len(jumps) / size, 1.0)))
    columns = np.array(found).reshape(-1, 3).T
    return columns[0], columns[1], columns[2]
