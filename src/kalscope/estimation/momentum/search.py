"""The maximum of the likelihood over q, r and τ: a coarse table, then patches around its highest places.

The table is of a part of a long record: only its places are used, and the whole record decides between them. The
likelihood is smooth in ln(step variance / r) and in ln τ, so a polynomial through a small patch of points replaces
it there. The patch moves until its top lies inside, and then shrinks around the top.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import Chebyshev, chebyshev

from kalscope.common.array import Array
from kalscope.common.progress import Progress
from kalscope.estimation.likelihood.profile import Differences
from kalscope.estimation.momentum.likelihood import concentrated
from kalscope.filtering.params import MAX_MOMENTUM

MIN_MOMENTUM = 0.1
"""Shortest τ searched, in samples: a velocity that is forgotten faster cannot be distinguished from none."""

HIGHEST = 24.0
"""Largest finite ln(step variance / r) searched: no noise, as far as a double can tell."""

_PLACES = 16
"""Momenta of the table: steps of 0.92 in ln τ."""
_TABLE_STEP = 1.6
"""Step of the table in ln(step variance / r)."""
_STRETCHES, _STRETCH = 8, 512
"""Stretches of a long record, and samples of each, that the table is made of."""
_NODES = 4
"""Points of a patch along each of the two: the lanes of the kernel."""
_SIZES = 0.7, 0.15, 0.02
"""Half the side of the patches, one after the other."""
_MIDDLE = 0.03
"""Share of the last patch in which its top must lie: only there it is exact to the fourth power of its size."""
_REACH = 10.0
"""Longest of Newton's steps from the middle of the last patch, in halves of its side: ridges are long."""
_PLATEAU = 8.0
"""ln(step variance / r) from which the noise of a part of the record is too little to show where it is."""
_MAX_PEAKS = 3
"""Local maxima of the table to examine."""
_MAX_MOVES = 12
"""Moves of a patch of one size."""
_FAR_FROM_EDGE = 1e4
"""Samples times (r / step variance)², about the loss of log-likelihood by r = 0, from which that is not tried."""
_NODES_EDGE = 8
"""Points of a curve along ln τ where r = 0."""
_SIZES_EDGE = 0.7, 0.2, 0.05
"""Half its length, one after the other."""
_WIDE = 0.9
"""Half the length that is searched first: one step of the table."""

_NODES_1D = chebyshev.chebpts1(_NODES)
_WEIGHTS = np.full((_NODES, 1), 2.0 / _NODES)
_WEIGHTS[0] /= 2.0
_FROM_VALUES = np.multiply(_WEIGHTS, chebyshev.chebvander(_NODES_1D, _NODES - 1).T, dtype=np.float64)
"""The matrix that makes the coefficients of one variable from its values at the Chebyshev points."""
_RAYS = np.linspace(-1.0, 1.0, 41)
_ON_RAYS = chebyshev.chebvander(_RAYS, _NODES - 1)
_RAYS_FINE = np.linspace(-1.0, 1.0, 2001)
_PATCH = [part.ravel() for part in np.meshgrid(_NODES_1D, _NODES_1D, indexing="ij")]
"""The points of a patch of half the side 1 around 0, each of the two in a row."""


@dataclass(frozen=True)
class Top:
    """The best place of a likelihood, and the shape around it."""

    log_tau: float
    """ln τ."""
    log_moves: float
    """ln(step variance / r); inf for r = 0."""
    loglik: float
    """Log-likelihood there."""
    curvature: Array
    """Second derivatives of the log-likelihood by (ln τ, ln(step variance / r)), shape (2, 2); 0 at an edge."""

    @property
    def tau(self) -> float:
        """τ in samples, within what the filter takes."""
        return momentum_of(self.log_tau)


def momentum_of(log_tau: float) -> float:
    """τ of ln τ, not rounded beyond what the filter takes."""
    return min(math.exp(log_tau), MAX_MOMENTUM)


def search(data: Differences, progress: Progress) -> Top:
    """The highest place over all τ and all ratios."""
    log_taus = np.linspace(math.log(MIN_MOMENTUM), math.log(MAX_MOMENTUM), _PLACES)
    progress(0.0, "likelihood over all momenta")
    rows = [ratios_for(data.m, log_tau) for log_tau in log_taus.tolist()]
    taus = np.exp(np.repeat(log_taus, [len(row) for row in rows]))
    table, _ = concentrated(_part_of(data), np.concatenate(rows), taus)
    progress(0.2, "likelihood over all momenta")
    heights = np.split(table, np.cumsum([len(row) for row in rows])[:-1])
    starts = _starts(log_taus, rows, heights)
    for i, (log_tau, log_moves) in enumerate(starts):
        if log_moves > _PLATEAU:
            row = ratios_for(data.m, log_tau)
            height, _ = concentrated(data, row, np.full(len(row), math.exp(log_tau)))
            starts[i] = log_tau, float(row[int(np.argmax(height))])
    inner = _climb(data, starts, progress.part(0.3, 0.8))
    progress(0.8, "likelihood without noise")
    edge, _ = concentrated(data, np.full(_PLACES, math.inf), np.exp(log_taus))
    at = int(np.argmax(edge))
    if _at_most(edge[max(at - 1, 0) : at + 2]) < inner.loglik:
        return inner
    return _without_noise(data, float(log_taus[at]), _WIDE, inner, progress.part(0.8, 1.0))


def climb(data: Differences, start: Top, progress: Progress) -> Top:
    """The highest place near that of almost the same record."""
    near = start.log_tau, min(start.log_moves, HIGHEST)
    inner, inside = _patch_top(data, *near, _SIZES[1])
    if inside:
        inner = _move(data, inner.log_tau, inner.log_moves, _SIZES[2], progress.part(0.1, 0.8))
    else:
        inner = _climb(data, [near], progress.part(0.1, 0.8))
    if data.m * math.exp(-2.0 * inner.log_moves) > _FAR_FROM_EDGE:
        return inner
    return _without_noise(data, start.log_tau, _SIZES_EDGE[0], inner, progress.part(0.8, 1.0))


def _part_of(data: Differences) -> Differences:
    """Stretches of a long record, spread over all of it: it shows both what is near and what is far."""
    if data.m <= 1.5 * _STRETCHES * _STRETCH:
        return data
    firsts = np.linspace(0, data.m + 1 - _STRETCH, _STRETCHES).astype(int).tolist()
    return data.parts((first, first + _STRETCH) for first in firsts)


def _at_most(heights: Array) -> float:
    """What the maximum between such heights of a smooth curve stays below."""
    highest = float(heights.max())
    return highest + (highest - float(heights.min())) + 1.0 if highest > -math.inf else highest


def ratios_for(m: int, log_tau: float) -> Array:
    """The ln(step variance / r) of the table at one τ: from a lag beyond m samples to no noise."""
    log_m = math.log(m)
    lowest = -2.0 * log_m - max(log_tau, 0.0) if log_tau < log_m else -4.0 * log_m + log_tau
    return np.arange(HIGHEST, min(lowest, 0.0) - 4.0, -_TABLE_STEP)[::-1]


def _starts(log_taus: Array, rows: list[Array], heights: list[Array]) -> list[tuple[float, float]]:
    """The highest places of the table that top their row and the rows beside it."""
    best = [int(np.argmax(row)) for row in heights]
    tops = [-math.inf, *(float(row[at]) for row, at in zip(heights, best, strict=True)), -math.inf]
    peaks = [i for i in range(len(rows)) if tops[i] <= tops[i + 1] >= tops[i + 2]]
    peaks = sorted(peaks, key=lambda i: -tops[i + 1])[:_MAX_PEAKS]
    return [(float(log_taus[i]), float(rows[i][best[i]])) for i in peaks]


def _climb(data: Differences, starts: list[tuple[float, float]], progress: Progress) -> Top:
    """The highest place near several starts: that of the highest large patch, refined step by step."""
    count = len(starts) + len(_SIZES) - 1
    parts = [progress.part(i / count, (i + 1) / count) for i in range(count)]
    tops = [_move(data, *start, _SIZES[0], part) for start, part in zip(starts, parts, strict=False)]
    top = max(tops, key=lambda one: one.loglik)
    for size, part in zip(_SIZES[1:], parts[len(starts) :], strict=True):
        top = _move(data, top.log_tau, top.log_moves, size, part)
    return top


def _move(data: Differences, log_tau: float, log_moves: float, size: float, progress: Progress) -> Top:
    """The highest place that patches of one size come to."""
    for moves in range(_MAX_MOVES - 1):
        progress.step(moves, "likelihood around the best momentum")
        top, inside = _patch_top(data, log_tau, log_moves, size)
        moved = abs(top.log_tau - log_tau) + abs(top.log_moves - log_moves)
        if inside or moved < 1e-9:
            return top
        log_tau, log_moves = top.log_tau, top.log_moves
    return _patch_top(data, log_tau, log_moves, size)[0]


def _patch_top(data: Differences, log_tau: float, log_moves: float, size: float) -> tuple[Top, bool]:
    """The highest place of a patch, and whether it lies inside; the border of what is searched counts as inside."""
    low, high = math.log(MIN_MOMENTUM), math.log(MAX_MOMENTUM)
    log_tau = min(max(log_tau, low + size), high - size)
    log_moves = min(log_moves, HIGHEST - size)
    t, y = _PATCH
    height, _ = concentrated(data, log_moves + size * y, np.exp(log_tau + size * t))
    shape = _FROM_VALUES @ height.reshape(_NODES, _NODES) @ _FROM_VALUES.T
    last = size == _SIZES[-1]
    at = _newton(_derivatives(shape, (0.0, 0.0))) if last else None
    if at is None or not (low < log_tau + size * at[0] < high and log_moves + size * at[1] < HIGHEST):
        at = _highest(shape)
    place = log_tau + size * at[0], log_moves + size * at[1]
    most = _MIDDLE if last else 0.98
    inside = abs(at[0]) < most or not low + 0.05 * size < place[0] < high - 0.05 * size
    inside = inside and (abs(at[1]) < most or place[1] > HIGHEST - 0.05 * size)
    bent = _derivatives(shape, at)
    curvature = np.array([[bent[2, 0], bent[1, 1]], [bent[1, 1], bent[0, 2]]]) / size**2
    return Top(place[0], place[1], float(bent[0, 0]), curvature), inside


def _newton(here: Array) -> tuple[float, float] | None:
    """Newton's step from the derivatives of a place; None where they have no maximum within reach."""
    a, b, c = float(here[2, 0]), float(here[1, 1]), float(here[0, 2])
    if not (a < 0.0 and a * c > b * b):
        return None
    u, v, det = float(here[1, 0]), float(here[0, 1]), a * c - b * b
    step = (b * v - c * u) / det, (b * u - a * v) / det
    return step if max(abs(step[0]), abs(step[1])) < _REACH else None


def _highest(shape: Array) -> tuple[float, float]:
    """The top of the polynomial on the patch: the best of a fine grid, and Newton's steps from there."""
    i, j = divmod(int(np.argmax(_ON_RAYS @ shape @ _ON_RAYS.T)), len(_RAYS))
    x, y = float(_RAYS[i]), float(_RAYS[j])
    here = _derivatives(shape, (x, y))
    for _ in range(6):
        step = _newton(here)
        if step is None:
            break
        x_next, y_next = x + step[0], y + step[1]
        if max(abs(x_next), abs(y_next)) > 1.0:
            break
        there = _derivatives(shape, (x_next, y_next))
        if there[0, 0] < here[0, 0]:
            break
        x, y, here = x_next, y_next, there
    return x, y


def _derivatives(shape: Array, at: tuple[float, float]) -> Array:
    """The derivatives of the polynomial at a place, shape (3, 3): how often by ln τ, and by the other."""
    return _basis(at[0]) @ shape @ _basis(at[1]).T


def _basis(x: float) -> Array:
    """The first Chebyshev polynomials and their first two derivatives at x, shape (3, _NODES)."""
    rows = [[1.0, x], [0.0, 1.0], [0.0, 0.0]]
    for k in range(2, _NODES):
        for order, row in enumerate(rows):
            lower = 2.0 * order * rows[order - 1][k - 1] if order else 0.0
            row.append(2.0 * x * row[k - 1] + lower - row[k - 2])
    return np.array(rows)


def _without_noise(data: Differences, log_tau: float, first: float, inner: Top, progress: Progress) -> Top:
    """The best τ near one where r = 0, or `inner` if that is better; `first` is half the length searched first."""
    low, high = math.log(MIN_MOMENTUM), math.log(MAX_MOMENTUM)
    nodes = chebyshev.chebpts1(_NODES_EDGE)
    edge = np.full(len(nodes), math.inf)
    top = Top(log_tau, math.inf, -math.inf, np.zeros((2, 2)))
    for i, size in enumerate((first, *_SIZES_EDGE)):
        progress(i / (len(_SIZES_EDGE) + 1), "likelihood without noise")
        middle = min(max(top.log_tau, low + size), high - size)
        places = middle + size * nodes
        height, _ = concentrated(data, edge, np.exp(places))
        if _at_most(height) < inner.loglik:
            return inner
        domain = [middle - size, middle + size]
        curve = Chebyshev.fit(places, height, len(nodes) - 1, domain=domain)
        fine = middle + size * _RAYS_FINE
        at = float(fine[int(np.argmax(curve(fine)))])
        bent = np.array([[float(curve.deriv(2)(at)), 0.0], [0.0, 0.0]])
        top = Top(at, math.inf, float(curve(at)), bent)
    slack = 1e-9 + 1e-12 * abs(inner.loglik)  # an inner maximum must exceed the rounding of the sums
    return top if top.loglik >= inner.loglik - slack else inner
