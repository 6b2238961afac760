"""The compiled loop of the generalized filter as its paper prints it: one channel, no checks."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from kalscope.common.compiled import compiled

Array = NDArray[np.float64]


@compiled(inline="always")
def step(m: float, sigma_m: float, e: float, sigma_e: float) -> tuple[float, float, float, float, float]:
    """One sample: returns E, σE, K, M − E and σE + σM. NaN for e or inf for sigma_e means "not started".

    Khan et al., equations (1)-(3); (3) multiplies by the estimate before the update, as printed.
    """
    if math.isnan(m):
        return e, sigma_e, 0.0, math.nan, sigma_e + sigma_m
    v = m - e
    if math.isnan(e):  # the first sample is the estimate
        e = m
    if math.isinf(sigma_e):  # what (3) leaves of an estimate that was not corrected, K = 0
        sigma_e = e
    s = sigma_e + sigma_m
    k = sigma_e / s
    before = e
    if not math.isnan(v):
        e = e + k * v
    return e, (1.0 - k) * before, k, v, s


@compiled()
def run(z: Array, sigma_m: float, e: float, sigma_e: float, out: tuple[Array, Array, Array, Array, Array]) -> int:
    """Filter one channel into `out` = (E, σE, K, M − E, σE + σM).

    Returns -1, or the index of the first estimate that is not above 0, where the recursion breaks.
    """
    out_e, out_sigma, out_k, out_v, out_s = out
    for i in range(z.shape[0]):
        e, sigma_e, k, v, s = step(z[i], sigma_m, e, sigma_e)
        if e <= 0.0:
            return i
        out_e[i], out_sigma[i], out_k[i], out_v[i], out_s[i] = e, sigma_e, k, v, s
    return -1
