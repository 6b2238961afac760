"""Which series that look spiky have no spikes after all: the loop of `robust.fit`, for many series at once.

A signal that moves far more than the noise looks spiky to the centred median. Each round fits all such series in
one compiled call, so that only those with true spikes are left to the fit of a single one.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from kalscope.common.array import Array, Mask
from kalscope.estimation.fleet.many.series import Series
from kalscope.estimation.robust import kernels
from kalscope.estimation.robust.fit import MAX_FITS
from kalscope.estimation.robust.spikes import more_than_chance

Fit = Callable[[Series, NDArray[np.intp]], tuple[Array, Array, Mask]]
"""q, r and whether they can be trusted of some series, which are at these places among those given."""


def spike_free(many: Series, fit: Fit) -> Mask:
    """Whether `estimate` would return the plain fit of each series, shape (series,). False where it is not sure.

    Args:
        many: the series that look spiky, and can be fitted, in memory of their own.
        fit: how.
    """
    far, repeated = np.zeros(len(many.values), np.bool_), np.zeros(len(many), np.bool_)
    kernels.far_each(many.values, many.starts, far, repeated)
    free, seen = np.zeros(len(many), np.bool_), [set[bytes]() for _ in range(len(many))]
    active, away, last = np.flatnonzero(~repeated), far, np.zeros(len(many), np.bool_)
    for _ in range(MAX_FITS + 1):
        if not len(active):
            break
        some = many.some(active)
        now = np.concatenate([away[many.starts[i] : many.starts[i + 1]] for i in active])
        q, r, good = fit(Series(np.where(now, np.nan, some.values), some.starts, some.steps), active)
        scores = np.empty(len(some.values))
        kernels.unpredicted_each(some.values, some.steps, some.starts, q, r, scores)
        going = good.copy()
        for k in np.flatnonzero(good):
            i, here = int(active[k]), slice(int(some.starts[k]), int(some.starts[k + 1]))
            before, after = now[here], scores[here] > 0.0
            if last[i] or np.array_equal(before, after):
                free[i] = not more_than_chance(np.where(before, scores[here], 0.0), some.values[here])
                going[k] = False
                continue
            if after.tobytes() in seen[i]:  # a few doubtful samples come and go: they stay in
                last[i], after = True, before & after
            seen[i].add(before.tobytes())
            away[many.starts[i] : many.starts[i + 1]] = after
        active = active[going]
    return free
