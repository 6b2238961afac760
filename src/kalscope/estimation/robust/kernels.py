"""The compiled loop of the spike-proof fit, nothing else: which samples the past does not predict.

One run of the filter over a record, in which the samples beyond the gate change nothing. A spike, or a few side by
side, is refused, and the sample after it is predicted well again. Where more than `longest` adjacent samples are
refused, the signal has moved: the filter starts again at the first of them, and they count as predicted.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from kalscope.common.compiled import compiled
from kalscope.filtering.kernels import MISSING, REJECTED, START, step, transition

Array = NDArray[np.float64]

AT_END = 2
"""Adjacent spikes that are recognised at either end of the record."""


@compiled()
def judge_samples(
    z: Array,
    dt: Array,
    q: float,
    r: float,
    tau: float | None,
    gate: float,
    start: tuple[float, float],
    longest: int,
    error: Array,
    variance: Array,
    refused: NDArray[np.bool_],
) -> None:
    """Write v and s of each sample, and whether it is refused; `longest` may be refused side by side.

    `z` holds NaN where missing, `dt` may be empty, `tau` None is the filter without momentum, and `start` the level
    before the first sample and its variance. Samples refused before one is taken have no past to be predicted from:
    s = inf. More than AT_END rejected samples at the end may be a step, and count as predicted.
    """
    n, regular = z.shape[0], dt.shape[0] == 0
    last = 1.0
    over = transition(last, q, tau)
    w = 0.0
    if tau is not None:
        w = 0.5 * q / tau
    state = (start[0], 0.0, start[1], 0.0, w)
    first = run = taken = i = 0
    while i < n:
        if not regular and dt[i] != last:
            last = dt[i]
            over = transition(last, q, tau)
        state, _, _, v, s, done = step(z[i], over, r, gate, state, 0, tau)
        refused[i] = done == REJECTED
        if done == REJECTED:
            first = i if run == 0 else first
            run += 1
        elif done != MISSING:
            run = 0
            taken += 1
        if done != START:
            error[i], variance[i] = 0.0 if done == MISSING else v, math.inf if refused[i] and taken == 0 else s
        if run > longest:
            refused[first : i + 1] = False
            state, run, i = (math.nan, 0.0, math.inf, 0.0, w), 0, first
            continue
        i += 1
    if run > AT_END:
        refused[first:] = False
