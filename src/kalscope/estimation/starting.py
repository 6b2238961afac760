"""Where tuning starts: a first guess of q and r from the samples."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from kalscope.common.array import Array
from kalscope.filtering.arrays import samples_of
from kalscope.filtering.params import LARGEST, FilterParams

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

EVEN = 1e-9
"""Steps that differ by a smaller share are the same step."""


ROUNDING = 1e-15
"""Steps, relative to the largest sample, that differ by less differ by rounding."""


def starting_params(z: ArrayLike) -> FilterParams:
    """Where tuning starts on the samples z, shape (n,), NaN where missing: r = var(Δz)/2, q = r/100.

    White noise alone gives var(Δz) = 2r; the ratio 100 is the advice of Ma'arif et al. (2019), section 4. An
    even ramp, such as a counter, says nothing of noise: r is then (Δz)²/2, for var(Δz) is but the rounding of its
    steps. Nor does a signal that never moves: r is then (|z|/1000)², or 1 where z is 0.
    """
    finite = samples_of(z)
    finite = finite[np.isfinite(finite)]
    size = float(np.abs(finite).max(initial=0.0))
    half_variance = 0.0
    if len(finite) > 2 and size > 0.0:
        steps = np.diff(finite / size)
        if goes_evenly(finite):
            step = abs(float(np.mean(steps)))
            half_variance = step * step / 2.0 if step > ROUNDING else 0.0
        else:
            half_variance = float(np.var(steps, ddof=1)) / 2.0
    if half_variance == 0.0:
        half_variance = 1e-6 if size > 0.0 else 1.0
    scale = size if size > 0.0 else 1.0
    r = min(max(half_variance * scale * scale, 1e-290), LARGEST)
    return FilterParams(q=r / 100.0, r=r)


def goes_evenly(z: Array) -> bool:
    """Whether the finite samples z, shape (n,), n ≥ 2, stand still or climb in equal steps, but for rounding."""
    size = float(np.abs(z).max())
    if size == 0.0:
        return True
    steps = np.diff(z / size)
    return float(np.ptp(steps)) <= EVEN * float(np.abs(steps).max()) + ROUNDING
