"""The compiled loops that take one series apart, nothing else: `likelihood.profile.differences`, compiled."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from kalscope.common.compiled import compiled

Array = NDArray[np.float64]

GOOD, INFINITE, BAD_TIMES = 0, 1, 2
"""What `take_apart` finds: differences; an infinite sample; a step that is negative or not finite."""

_MAX_GAP = 1e150
"""Periods; a longer gap changes nothing, and its product with λ must fit a double."""


@compiled(error_model="numpy")
def take_apart(z: Array, steps: Array, d: Array, gap: Array) -> tuple[int, int, int, int, float]:
    """The differences of neighbouring finite samples into `d`, the periods between them into `gap`.

    `z` is one series, NaN where missing, `steps` empty for regular sampling. Repeated lines of the same time and
    value are left out. Returns what was found, m, the number of gaps (0 = 1 each), the finite samples, and the
    scale that `d` was divided by, a power of two.
    """
    m, finite, waited = 0, 0, 0.0
    last, largest, even = 0.0, 0.0, True
    has_steps = steps.shape[0] > 0
    for i in range(z.shape[0]):
        step = steps[i] if has_steps else 1.0
        if not 0.0 <= step < math.inf:
            return BAD_TIMES, 0, 0, 0, 1.0
        waited += step
        if math.isnan(z[i]):
            continue
        if math.isinf(z[i]):
            return INFINITE, 0, 0, 0, 1.0
        finite += 1
        if finite > 1:
            half = 0.5 * z[i] - 0.5 * last  # halved: they may lie two of the largest doubles apart
            even = even and waited == 1.0
            if waited > 0.0 or half != 0.0:
                d[m], gap[m] = half, min(waited, _MAX_GAP)
                m += 1
            largest = max(largest, abs(half))
        last, waited = z[i], 0.0
    if largest == 0.0:
        return GOOD, m, 0 if even else m, min(m + 1, finite), 1.0
    exponent = min(math.frexp(largest)[1], 1022)
    for i in range(m):
        d[i] = math.ldexp(d[i], -exponent)
    return GOOD, m, 0 if even else m, min(m + 1, finite), math.ldexp(1.0, exponent + 1)


@compiled()
def shows_steps(d: Array, least: int, most: float) -> bool:
    """Whether many readings repeat, and enough do not."""
    changes = 0
    for value in d:
        changes += value != 0.0
    return least <= changes <= most * d.shape[0]
