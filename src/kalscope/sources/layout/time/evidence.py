"""How well the stamps of a candidate show that they are the time: fill, order, resolution, evenness."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kalscope.common.array import Array

_WEIGHT_FILL, _WEIGHT_BACK = 10.0, 20.0
_WEIGHT_DISTINCT, _WEIGHT_EVEN = 3.0, 1.0
_EVEN_WITHIN = 0.2
_COUNTERS = (2.0**16, 2.0**32)


@dataclass(frozen=True)
class Evidence:
    """What the stamps of the sampled rows show, each as a share of 1."""

    fill: float
    """Rows whose stamp can be read."""
    back: float
    """Of the steps that move, those against the direction of most; a clock that passes midnight moves forward."""
    distinct: float
    """Stamps that do not repeat the one before: below 1 the clock is coarser than the sampling."""
    even: float
    """Steps within a fifth of the median step."""
    moves: bool
    """True where any two stamps differ."""

    @property
    def weight(self) -> float:
        """Points of a candidate; those for its name and form are added."""
        lost = _WEIGHT_FILL * (1.0 - self.fill) + _WEIGHT_BACK * self.back
        return _WEIGHT_DISTINCT * self.distinct + _WEIGHT_EVEN * self.even - lost


def judge(stamps: Array, turn: float = 0.0) -> Evidence:
    """What stamps show.

    Args:
        stamps: Of the sampled rows, shape (n,), NaN where unreadable.
        turn: Where a clock wraps to 0, in the unit of the stamps; 0 where it never does.
    """
    read = stamps[np.isfinite(stamps)]
    if not read.size:
        return Evidence(0.0, 0.0, 0.0, 0.0, moves=False)
    steps = np.diff(read)
    for size in (turn,) if turn else _COUNTERS:
        if float(read.max()) < size:
            steps = np.where(steps < -size / 2, steps + size, steps)
    ahead, back = int(np.count_nonzero(steps > 0)), int(np.count_nonzero(steps < 0))
    sizes = np.abs(steps[steps != 0])
    usual = float(np.median(sizes)) if sizes.size else 0.0
    even = float(np.mean(np.abs(steps - usual) <= _EVEN_WITHIN * usual)) if sizes.size else 0.0
    return Evidence(
        fill=read.size / stamps.size,
        back=min(ahead, back) / max(ahead + back, 1),
        distinct=np.count_nonzero(steps) / max(steps.size, 1) if steps.size else 1.0,
        even=even,
        moves=bool(sizes.size),
    )


def is_since_1970(stamps: Array) -> bool:
    """True where the first stamp is one of 2001 to 2100, counted from 1970 in s, ms, µs or ns."""
    return bool(stamps.size) and any(size <= float(stamps[0]) < 4.2 * size for size in (1e9, 1e12, 1e15, 1e18))
