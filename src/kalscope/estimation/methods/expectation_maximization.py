"""EM: smooth with the current pair, take the variances of the smoothed signal as the next pair, repeat.

Monotone and robust, but slow: it reaches the maximum of the same likelihood as "ml" in hundreds of passes, and
an edge (q = 0, r = 0) never. Shumway & Stoffer (1982).
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from kalscope.common.progress import Progress
from kalscope.estimation.likelihood.profile import Differences
from kalscope.estimation.methods.kernels import em_pass
from kalscope.estimation.methods.pair import Pair

SETTLED = 1e-8
"""Relative change of q and r in one pass at which EM has converged."""

_MAX_PASSES = 3000
_MAX_SAMPLES = 20_000_000
"""Passes, and passes × samples, at which EM gives up: one to two seconds."""


def passes(data: Differences) -> Iterator[tuple[float, float, float]]:
    """The passes of EM without end: (q, r, log-likelihood of that pair), in scale² and for the scaled data."""
    z = np.concatenate([[0.0], np.cumsum(data.d)])
    x, p = np.empty_like(z), np.empty_like(z)
    q = r = float(np.mean(data.d**2)) / 3.0  # the variance of a difference is q + 2r
    while True:
        q_next, r_next, loglik = em_pass(z, data.gap, q, r, x, p)
        yield q, r, loglik
        q, r = q_next, r_next


def fit(data: Differences, progress: Progress) -> Pair:
    """The pair where EM converges, or that of its last pass ("not_converged")."""
    limit = max(50, min(_MAX_PASSES, _MAX_SAMPLES // (data.m + 1)))
    q_before = r_before = q = r = math.nan
    for i, (q, r, _) in enumerate(passes(data)):
        if abs(q - q_before) <= SETTLED * q and abs(r - r_before) <= SETTLED * r:
            return Pair(q, r, math.inf, math.inf)
        if i >= limit or not (q > 0.0 and r > 0.0):
            break
        q_before, r_before = q, r
        if i % 10 == 0:
            progress(i / limit, f"EM pass {i} of at most {limit}")
    return Pair(q, r, math.inf, math.inf, verdict="not_converged" if q > 0.0 and r > 0.0 else "")
