"""Starting values for tuning: a first guess of q and r from the samples."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from kalscope.common.array import Array
from kalscope.filtering.arrays import samples_of
from kalscope.filtering.params import MAX_VARIANCE, FilterParams

EVEN = 1e-9
"""Steps whose relative difference is smaller are equal."""


ROUNDING = 1e-15
"""Steps, relative to the largest sample, whose difference is smaller differ only by rounding."""


def starting_params(z: ArrayLike) -> FilterParams:
    """The starting values for the samples z, shape (n,), NaN where missing: r = var(Δz)/2, q = r/100.

    White noise alone gives var(Δz) = 2r; the ratio 100 is the advice of Ma'arif et al. (2019), section 4. An
    even ramp, such as a counter, shows no noise: r is then (Δz)²/2, because var(Δz) is only rounding. Nor does a
    constant signal: r is then (|z|/1000)², or 1 where z is 0.
    """
    finite = samples_of(z)
    finite = finite[np.isfinite(finite)]
    size = float(np.abs(finite).max(initial=0.0))
    half_variance = 0.0
    if len(finite) > 2 and size > 0.0:
        steps = np.diff(finite / size)
        if is_even_ramp(finite):
            step = abs(float(np.mean(steps)))
            half_variance = step * step / 2.0 if step > ROUNDING else 0.0
        else:
            half_variance = float(np.var(steps, ddof=1)) / 2.0
    if half_variance == 0.0:
        half_variance = 1e-6 if size > 0.0 else 1.0
    scale = size if size > 0.0 else 1.0
    r = min(max(half_variance * scale * scale, 1e-290), MAX_VARIANCE)
    return FilterParams(q=r / 100.0, r=r)


def is_even_ramp(z: Array) -> bool:
    """Whether the finite samples z, shape (n,), n ≥ 2, are constant or rise or fall by equal steps."""
    size = float(np.abs(z).max())
    if size == 0.0:
        return True
    steps = np.diff(z / size)
    return float(np.ptp(steps)) <= EVEN * float(np.abs(steps).max()) + ROUNDING
