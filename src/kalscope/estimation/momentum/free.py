"""Maximum likelihood of q, r and τ together, with standard errors and the interval of τ."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from kalscope.common.array import Array
from kalscope.common.progress import Progress
from kalscope.estimation.momentum.fit import MomentumFit
from kalscope.estimation.momentum.given import fit_at
from kalscope.estimation.momentum.interval import momentum_ends
from kalscope.estimation.momentum.likelihood import Samples, pairs, ratio_of, step_variance
from kalscope.estimation.momentum.search import MIN_MOMENTUM, Top
from kalscope.filtering.params import MAX_MOMENTUM

_SLOPE_STEP = 1e-4
"""Step in ln τ for the slope of the step variance."""


def fit_around(data: Samples, top: Top, progress: Progress) -> MomentumFit:
    """The fit at the highest place of the likelihood, and how well the record knows it.

    Of the τ longer than the record only the shortest that the record allows is taken: how much longer the signal
    keeps its direction is something that the record cannot have seen.
    """
    low, high = momentum_ends(data, top, progress.part(0.0, 0.6))
    tau = top.tau
    there = fit_at(data, tau, progress.part(0.6, 0.8))
    shortest = max(data.span, low.tau)
    if tau > shortest:
        there = fit_at(data, shortest, progress.part(0.8, 1.0))
    else:
        q_error, r_error = relative_errors(data.m, top)
        there = replace(there, q_se=_error(there.q, q_error), r_se=_error(there.r, r_error))
    border = tuple((ratio_of(end.log_moves, end.tau), end.tau) for end in (low, high))
    return replace(
        there,
        tau_interval=(low.tau if low.crossed else 0.0, high.tau if high.crossed else math.inf),
        region=(*there.region, *border),
    )


def params_at(data: Samples, top: Top) -> tuple[float, float, float]:
    """q, r (both in scale²) and τ of a place of the likelihood."""
    tau = np.array([top.tau])
    moves = np.array([top.log_moves])
    q, r = pairs(moves, tau)
    unit = float(data.concentrated(moves, tau)[1][0])
    return float(q[0]) * unit, float(r[0]) * unit, float(tau[0])


def relative_errors(m: int, top: Top) -> tuple[float, float]:
    """Standard errors of ln q and ln r by the observed information; inf where it is not positive.

    As in `maximum_likelihood.fit`: the scale given the place has the variance 2/m, and q and r move with the place.
    """
    moves = math.exp(min(top.log_moves, 700.0))
    q_slope = top.unit_slope + np.array([-_step_slope(top.log_tau), 1.0 / (1.0 + moves)])
    r_slope = top.unit_slope - np.array([0.0, moves / (1.0 + moves)])
    free = [math.log(MIN_MOMENTUM) + 1e-6 < top.log_tau < math.log(MAX_MOMENTUM) - 1e-6, top.log_moves < math.inf]
    at = np.flatnonzero(free)
    information = -top.curvature[np.ix_(at, at)]
    if len(at) and np.linalg.eigvalsh(information)[0] <= 0.0:
        return math.inf, math.inf
    return _spread(m, information, q_slope[at]), _spread(m, information, r_slope[at])


def _spread(m: int, information: Array, slope: Array) -> float:
    moved = float(slope @ np.linalg.solve(information, slope)) if len(slope) else 0.0
    return math.sqrt(2.0 / m + moved)


def _step_slope(log_tau: float) -> float:
    """Slope of ln(step variance for q = 1) over ln τ."""
    near = [math.log(step_variance(math.exp(log_tau + step))) for step in (-_SLOPE_STEP, _SLOPE_STEP)]
    return (near[1] - near[0]) / (2.0 * _SLOPE_STEP)


def _error(value: float, relative: float) -> float:
    return value * relative if value > 0.0 else math.inf
