"""The pairs (q, r) that a record allows together: the contour of its likelihood around the best pair.

A pair lies inside the 95 % region when twice its log-likelihood falls short of the best by less than 5.99, the
95 % point of χ² with two degrees of freedom. Along one λ the log-likelihood in r is −½ m (ln r + r̂/r) + const, so
the two r on the contour follow from u − 1 − ln u = c with u = r̂/r, which Lambert's W solves.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from kalscope.common.array import Array
from kalscope.estimation.likelihood.profile import MAX_LOG_RATIO, Profile, walk_profile
from kalscope.estimation.result import Estimate

DROP_95 = 5.991464547107979
"""Twice the drop in log-likelihood on the 95 % contour: the 95 % point of χ² with two degrees of freedom."""

_NODES = 48
"""λ at which the record is scanned; between them the profile is as smooth as a parabola."""
_OPEN_REACH = 12.0
"""ln λ to search beyond the finite end of a half-open interval."""


@dataclass(frozen=True)
class Contour:
    """A line around the allowed pairs, in natural logarithms."""

    log_q: Array
    """ln q (q in unit²) along the line, shape (k,)."""
    log_r: Array
    """ln r (r in unit²) along the line, shape (k,)."""
    closed: bool
    """Whether the line is closed; it is open where the record allows λ → 0 or λ → ∞."""


Scan = Callable[[ArrayLike, ArrayLike | None, ArrayLike | None], Profile]
"""`likelihood_profile` of a model: z, ln λ, dt -> Profile."""


def likelihood_contour(
    z: ArrayLike, best: Estimate, dt: ArrayLike | None = None, drop: float = DROP_95, scan: Scan = walk_profile
) -> Contour | None:
    """The line on which twice the log-likelihood is `drop` below its maximum.

    Args:
        z: measurements of one channel, shape (n,), unit; NaN is a missing sample.
        best: what `estimate(z, "ml", dt)` gave.
        dt: nominal sample periods before each sample, shape (n,), ≥ 0; None = 1 each.
        drop: see `DROP_95`, > 0.
        scan: scans the record; another than the default where `best` has momentum.

    Returns:
        The contour; None where the likelihood has no maximum.

    Raises:
        BadSetting: as `likelihood_profile`.

    Source: likelihood-ratio regions, e.g. Pawitan 2001, section 2.6; the concentrated r as in `likelihood`.
    """
    if best.verdict in ("too_few", "constant", "bad_unit", "not_converged") or not math.isfinite(
        float(best.loglik)
    ):
        return None
    low, high = _first_reach(best)
    for _ in range(6):
        profile = scan(z, np.linspace(low, high, _NODES), dt)
        short = 2.0 * (float(best.loglik) - profile.loglik)
        wider = (
            low - (high - low) if short[0] < drop and low > -_edge(best) else low,
            high + (high - low) if short[-1] < drop and high < _edge(best) else high,
        )
        if wider == (low, high):
            break
        low, high = max(wider[0], -_edge(best)), min(wider[1], _edge(best))
    else:
        return None
    return _around(profile, short, drop)


def _edge(best: Estimate) -> float:
    """The largest |ln λ| to search."""
    finite = [abs(math.log(ratio)) for ratio in (*best.ratio_interval, best.ratio) if 0.0 < ratio < math.inf]
    return min(MAX_LOG_RATIO, max(24.0, max(finite, default=0.0) + 2.0 * _OPEN_REACH))


def _first_reach(best: Estimate) -> tuple[float, float]:
    """First range of ln λ: the interval of λ alone, 1.5 times as wide, because q and r vary together."""
    low, high = (math.log(end) if 0.0 < end < math.inf else math.nan for end in best.ratio_interval)
    if math.isnan(low) and math.isnan(high):
        return -_OPEN_REACH, _OPEN_REACH
    if math.isnan(low):
        return high - _OPEN_REACH, high + 1.0
    if math.isnan(high):
        return low - 1.0, low + _OPEN_REACH
    half = max(0.75 * (high - low), 1e-6)
    middle = 0.5 * (low + high)
    return max(middle - half, -MAX_LOG_RATIO), min(middle + half, MAX_LOG_RATIO)


def _around(profile: Profile, short: Array, drop: float) -> Contour | None:
    """Up along the smaller r of each λ and back along the larger."""
    from scipy.interpolate import CubicSpline
    from scipy.special import lambertw

    nodes = profile.log_ratios
    inside = np.flatnonzero(short < drop)
    if len(inside) == 0:
        return None
    excess = CubicSpline(nodes, short - drop)
    ends = excess.roots(extrapolate=False)
    before, after = ends[ends <= nodes[inside[0]]], ends[ends >= nodes[inside[-1]]]
    first = float(before[-1]) if len(before) else float(nodes[0])
    last = float(after[0]) if len(after) else float(nodes[-1])
    # Close together at both ends, where the line turns.
    log_ratio = 0.5 * (first + last) - 0.5 * (last - first) * np.cos(np.linspace(0.0, np.pi, 61))
    room = np.maximum(-excess(log_ratio), 0.0) / profile.m
    log_r = CubicSpline(nodes, np.log(profile.r))(log_ratio)
    # At both ends u = 1, where rounding may push the argument past the branch point −1/e.
    less, more = (np.nan_to_num(-np.real(lambertw(-np.exp(-1.0 - room), b)), nan=1.0) for b in (0, -1))
    r = np.concatenate([log_r - np.log(more), (log_r - np.log(less))[::-1]])
    ratio = np.concatenate([log_ratio, log_ratio[::-1]])
    return Contour(ratio + r, r, closed=bool(len(before) and len(after)))
