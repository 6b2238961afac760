"""The momenta that a record allows: where the profile of the likelihood over τ falls below the 95 % mark."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import Chebyshev, chebyshev

from kalscope.common.progress import Progress
from kalscope.estimation.likelihood.profile import Differences
from kalscope.estimation.likelihood.search import DROP
from kalscope.estimation.momentum.likelihood import concentrated
from kalscope.estimation.momentum.search import HIGHEST, MIN_MOMENTUM, Top, momentum_of
from kalscope.filtering.params import MAX_MOMENTUM

_NODES = 7
"""Points of the curve over ln(step variance / r); with the point r = 0 they fill the eight lanes of the kernel."""
_SIZE = 1.0
"""Half the stretch of that curve."""
_MAX_MOVES = 20
"""Moves of the curve until its top lies inside."""
_WIDENING = 1.6
"""Factor between two steps outwards, until the end is bracketed."""
_HALVINGS = 8
"""Steps towards the end within its bracket."""


@dataclass(frozen=True)
class End:
    """One end of the interval."""

    tau: float
    """The momentum, in samples."""
    log_moves: float
    """The best ln(step variance / r) there; inf for r = 0."""
    crossed: bool
    """Whether the likelihood falls below the mark there; False at the border of what is searched."""


def momentum_ends(data: Differences, top: Top, progress: Progress) -> tuple[End, End]:
    """The lower and the upper end of the 95 % interval of τ."""
    return _end(data, top, -1.0, progress.part(0.0, 0.5)), _end(data, top, 1.0, progress.part(0.5, 1.0))


def profile(data: Differences, log_tau: float, log_moves: float, progress: Progress) -> tuple[float, float]:
    """The highest log-likelihood of one τ, and its ln(step variance / r), searched from `log_moves` on."""
    nodes = chebyshev.chebpts1(_NODES)
    fine = np.linspace(-1.0, 1.0, 401)
    tau = np.full(_NODES + 1, math.exp(log_tau))
    best, place, at_edge = -math.inf, log_moves, -math.inf
    for moves in range(_MAX_MOVES):
        progress.step(moves, "interval of the momentum")
        middle = min(place, HIGHEST - _SIZE)
        heights = concentrated(data, np.append(middle + _SIZE * nodes, math.inf), tau)[0]
        at_edge = float(heights[-1])
        curve = Chebyshev.fit(nodes, heights[:-1], _NODES - 1, domain=[-1.0, 1.0])(fine)
        at = int(np.argmax(curve))
        best, place = float(curve[at]), middle + _SIZE * float(fine[at])
        if 0 < at < len(fine) - 1 or place >= HIGHEST:
            break
    return (at_edge, math.inf) if at_edge >= best - 1e-9 else (best, place)


def _end(data: Differences, top: Top, side: float, progress: Progress) -> End:
    """Go outwards until the likelihood has fallen, then towards the mark; √drop is almost straight in ln τ."""
    border = math.log(MIN_MOMENTUM if side < 0.0 else MAX_MOMENTUM)
    inside, moves, fallen = top.log_tau, top.log_moves, 0.0
    stride = _first_stride(top)
    left = progress  # of a number of steps that is not known
    while True:
        part, left = left.part(0.0, 0.2), left.part(0.2, 1.0)
        outside = border if side * (inside + side * stride - border) >= 0.0 else inside + side * stride
        height, there = profile(data, outside, moves, part)
        drop = top.loglik - height
        if drop >= DROP:
            break
        if outside == border:
            return End(momentum_of(border), there, crossed=False)
        inside, moves, fallen, stride = outside, there, max(drop, 0.0), stride * _WIDENING
    end, beyond = End(momentum_of(outside), there, crossed=True), drop
    for step in range(_HALVINGS):
        share = (math.sqrt(DROP) - math.sqrt(fallen)) / (math.sqrt(beyond) - math.sqrt(fallen))
        middle = inside + (min(max(share, 0.02), 0.98) if step % 3 < 2 else 0.5) * (outside - inside)
        height, there = profile(data, middle, moves, left.part(step / _HALVINGS, (step + 1) / _HALVINGS))
        drop = top.loglik - height
        end = End(momentum_of(middle), there, crossed=True)
        if abs(drop - DROP) < 1e-3:
            break
        if drop < DROP:
            inside, fallen = middle, max(drop, 0.0)
        else:
            outside, beyond = middle, drop
    return end


def _first_stride(top: Top) -> float:
    """Half the interval if the likelihood were a parabola."""
    (a, b), (_, c) = top.curvature.tolist()
    bent = a - b * b / c if c < 0.0 else a
    return min(math.sqrt(-2.0 * DROP / bent), 1.0) if bent < 0.0 else 0.5
