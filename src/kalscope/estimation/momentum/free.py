"""Maximum likelihood of q, r and τ together, with standard errors and the interval of τ."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from kalscope.common.progress import Progress
from kalscope.estimation.likelihood.search import DROP
from kalscope.estimation.momentum.fit import MomentumFit
from kalscope.estimation.momentum.given import fit_at
from kalscope.estimation.momentum.interval import End, momentum_ends
from kalscope.estimation.momentum.likelihood import Samples, pairs, ratio_of
from kalscope.estimation.momentum.search import Top

_NORMAL = math.sqrt(2.0 * DROP)
"""Standard errors from the middle to the end of a 95 % interval, 1.96."""


def fit_around(data: Samples, top: Top, progress: Progress) -> MomentumFit:
    """The fit at the highest place of the likelihood, and how well the record determines it.

    Of the τ longer than the record only the shortest that the record allows is taken: the record cannot show how
    much longer the signal keeps its direction.
    """
    low, high = momentum_ends(data, top, progress.part(0.0, 0.6))
    tau = top.tau
    there = fit_at(data, tau, progress.part(0.6, 0.8))
    shortest = max(data.span, low.tau)
    if tau > shortest:
        there = fit_at(data, shortest, progress.part(0.8, 1.0))
    else:
        unit = data.scale * data.scale
        qs, rs = zip(*(params_at(data, end)[:2] for end in (low, high)), strict=True)
        there = replace(
            there,
            q_se=widened(there.q, there.q_se, [unit * q for q in qs]),
            r_se=widened(there.r, there.r_se, [unit * r for r in rs]),
        )
    border = [(ratio_of(end.log_moves, end.tau), end.tau) for end in (low, high)]
    border += [_farthest(there, end) for end in border]
    return replace(
        there,
        tau_interval=(low.tau if low.crossed else 0.0, high.tau if high.crossed else math.inf),
        region=(*there.region, *border),
    )


def _farthest(there: MomentumFit, end: tuple[float, float]) -> tuple[float, float]:
    """The pair (q/r, τ) of the largest change of q/r towards one end of the interval of τ.

    The border is an ellipse in the logarithms: it goes beyond q/r at the end of τ, and beyond that of the known τ.
    """
    edges = (there.region[0][0], there.r and there.q / there.r, there.region[1][0], end[0])
    if not (min(edges) > 0.0 and max(edges) < math.inf):
        return end
    low, middle, high, moved = map(math.log, edges)
    shift, known = moved - middle, (high if moved > middle else low) - middle
    size = math.hypot(shift, known) or 1.0
    share = abs(shift) / size
    return math.exp(middle + math.copysign(size, shift)), there.tau * (end[1] / there.tau) ** share


def params_at(data: Samples, top: Top | End) -> tuple[float, float, float]:
    """q, r (both in scale²) and τ of a place of the likelihood."""
    tau = np.array([top.tau])
    moves = np.array([top.log_moves])
    q, r = pairs(moves, tau)
    unit = float(data.concentrated(moves, tau)[1][0])
    return float(q[0]) * unit, float(r[0]) * unit, float(tau[0])


def widened(value: float, error: float, ends: Sequence[float]) -> float:
    """Standard error of a variance where τ is not known either; inf at an edge.

    The curvature at the top would be too small: a record that is a few τ long and by chance shows a short τ shows a
    small q too. So the limits are combined, on the scale of the logarithm: those where τ is known, and what the
    variance is at both ends of the interval of τ (Zou & Donner 2008, Statistics in Medicine 27, 1693-1702).

    Args:
        value: the variance at the top.
        error: its standard error where τ is known.
        ends: the best variances at the ends of the interval of τ.
    """
    low, high = min(*ends, value), max(*ends, value)
    if not low > 0.0:
        return math.inf
    known = _NORMAL * error / value
    both = math.hypot(math.log(value / low), known) + math.hypot(math.log(high / value), known)
    return value * both / (2.0 * _NORMAL)
