"""The compiled loop that finds spikes, nothing else: contiguous float64, no checks, no GIL, cached on disk."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kalscope.common.compiled import compiled

Array = NDArray[np.float64]

LONE, STAYS = 1, 2
"""What a spike was: the signal came back at once; or it stayed where it had gone."""


@compiled()
def find_spikes(v: Array, k: Array, limit: Array, kind: NDArray[np.int8], size: Array) -> None:
    """Mark in `kind` the innovations v beyond `limit` with LONE or STAYS, the rest with 0; steps go to `size`.

    A lone spike of size d leaves −k d in the next innovation, a jump that stays (1 − k) d; halfway between
    lies (½ − k) d. That tail dies away by 1 − k a sample and is taken off first, so it makes no new spikes.
    """
    n, tail = len(v), 0.0
    for i in range(n):
        d = v[i] - tail
        tail *= 1.0 - k[i]
        kind[i], size[i] = 0, d
        if abs(d) <= limit[i] + 0.25 * abs(tail):  # the tail is known only as well as k
            continue
        after = (v[i + 1] - tail) * np.sign(d) if i + 1 < n else -np.inf
        if after > (0.5 - k[i]) * abs(d):
            kind[i] = STAYS
            tail += (1.0 - k[i]) * d
        else:
            kind[i] = LONE
            tail -= k[i] * d
