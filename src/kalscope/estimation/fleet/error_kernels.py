"""The compiled loops of prediction errors on samples that a fit has not seen, nothing else."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from kalscope.common.compiled import compiled
from kalscope.estimation.fleet.many.fit_kernels import MIN_SAMPLES
from kalscope.estimation.fleet.many.record_kernels import GOOD, take_apart

Array = NDArray[np.float64]

MAX_FINITE = 1e18
"""λ beyond which the filter passes its samples unchanged, as far as a double can tell."""


@compiled(error_model="numpy")
def errors_of_each(
    values: Array,
    steps: Array,
    starts: NDArray[np.int64],
    ratio: Array,
    own: Array,
    errors: Array,
    own_error: Array,
) -> None:
    """Root mean square of the innovations on the second half of each series, at each λ and at its own.

    `ratio` are the λ, shape (j,), `errors` (k, j), `own` and `own_error` (k,); NaN where nothing can be said.
    """
    longest = np.max(starts[1:] - starts[:-1])
    d, gap = np.empty(longest), np.empty(longest)
    lanes = ratio.shape[0] + 1
    ratios, state = np.empty(lanes), np.empty(4 * lanes)
    ratios[: lanes - 1] = ratio
    for i in range(starts.shape[0] - 1):
        first, middle, stop = starts[i], (starts[i] + starts[i + 1]) // 2, starts[i + 1]
        errors[i, :] = math.nan
        own_error[i] = math.nan
        if math.isnan(own[i]):
            continue
        known = take_apart(values[first:middle], steps[first:middle] if len(steps) else steps, d, gap)[1]
        found, m, gaps, n, scale = take_apart(
            values[first:stop], steps[first:stop] if len(steps) else steps, d, gap
        )
        if found != GOOD or n < MIN_SAMPLES or known >= m:
            continue
        ratios[lanes - 1] = min(own[i], MAX_FINITE)
        squares_since(d[:m], gap[:gaps], ratios, known, state)
        for j in range(lanes):
            size = scale * math.sqrt(state[3 * lanes + j] / (m - known))
            if j < lanes - 1:
                errors[i, j] = size
            else:
                own_error[i] = size


@compiled(error_model="numpy", fastmath={"contract"})
def squares_since(d: Array, gap: Array, ratio: Array, since: int, state: Array) -> None:
    """Σv² from the difference `since` on of the filters of several λ with r = 1.

    `state` holds v, p, 1 − k and Σv² of all lanes, one array so that the compiler puts several lanes into a vector.
    """
    lanes = ratio.shape[0]
    for j in range(lanes):
        state[j], state[lanes + j], state[2 * lanes + j], state[3 * lanes + j] = 0.0, 1.0, 0.0, 0.0
    for i in range(d.shape[0]):
        g, counted = gap[i] if gap.shape[0] else 1.0, 1.0 if i >= since else 0.0
        for j in range(lanes):
            v = d[i] + state[2 * lanes + j] * state[j]
            predicted = state[lanes + j] + ratio[j] * g
            kept = 1.0 / (predicted + 1.0)
            state[j], state[lanes + j], state[2 * lanes + j] = v, predicted * kept, kept
            state[3 * lanes + j] += counted * v * v
