"""The maximum of the likelihood over q, r and τ: a coarse table, then patches around its highest places.

The likelihood is smooth in ln(step variance / r) and in ln τ, so a polynomial through a small patch of points
replaces it there. The patch moves until its top lies inside, and then shrinks around the top.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import Chebyshev, chebyshev

from kalscope.common.array import Array
from kalscope.common.progress import Progress
from kalscope.estimation.momentum.likelihood import Samples
from kalscope.filtering.params import MAX_MOMENTUM

MIN_MOMENTUM = 0.1
"""Shortest τ searched, in samples: a velocity that is forgotten faster cannot be distinguished from none."""

HIGHEST = 24.0
"""Largest finite ln(step variance / r) searched: no noise, as far as a double can tell."""

_PLACES = 16
"""Momenta of the table: steps of 0.92 in ln τ."""
_TABLE_STEP = 1.6
"""Step of the table in ln(step variance / r)."""
_WIDE = 0.9
"""Half the stretch of ln τ that is searched first where r = 0: one step of the table."""
_NODES = 5, 8
"""Points of a patch along the two; eight lanes of the kernel have one τ."""
_SIZES = 0.7, 0.2, 0.05
"""Half the side of the patches, one after the other."""
_MAX_PEAKS = 3
"""Local maxima of the table to examine."""
_MAX_MOVES = 12
"""Moves of a patch of one size."""


def _from_values(count: int) -> Array:
    """The matrix that makes the coefficients of one variable from its values at the Chebyshev points."""
    weights = np.full((count, 1), 2.0 / count)
    weights[0] /= 2.0
    vander = chebyshev.chebvander(chebyshev.chebpts1(count), count - 1)
    return np.multiply(weights, vander.T, dtype=np.float64)


_RAYS = np.linspace(-1.0, 1.0, 41)
_ON_RAYS = [chebyshev.chebvander(_RAYS, count - 1) for count in _NODES]
_FROM_VALUES = [_from_values(count) for count in _NODES]
_RAYS_FINE = np.linspace(-1.0, 1.0, 2001)
_PATCH = [part.ravel() for part in np.meshgrid(*map(chebyshev.chebpts1, _NODES), indexing="ij")]
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


def search(data: Samples, progress: Progress) -> Top:
    """The highest place over all τ and all ratios."""
    log_taus = np.linspace(math.log(MIN_MOMENTUM), math.log(MAX_MOMENTUM), _PLACES)
    rows: list[Array] = []
    heights: list[Array] = []
    for i, log_tau in enumerate(log_taus.tolist()):
        progress(0.7 * i / len(log_taus), "likelihood over all momenta")
        rows.append(ratios_for(data.m, log_tau))
        heights.append(
            data.concentrated(np.append(rows[-1], math.inf), np.full(len(rows[-1]) + 1, math.exp(log_tau)))[0]
        )
    inner = _climb(data, _starts(log_taus, rows, heights), progress.part(0.7, 0.9))
    at = int(np.argmax([row[-1] for row in heights]))
    return _better(inner, _climb_without_noise(data, float(log_taus[at]), _WIDE, progress.part(0.9, 1.0)))


def climb(data: Samples, start: Top, progress: Progress) -> Top:
    """The highest place near that of almost the same record."""
    inner = _climb(data, [(start.log_tau, min(start.log_moves, HIGHEST))], progress.part(0.0, 0.8))
    return _better(inner, _climb_without_noise(data, start.log_tau, _SIZES[0], progress.part(0.8, 1.0)))


def _better(inner: Top, edge: Top) -> Top:
    slack = 1e-9 + 1e-12 * abs(inner.loglik)  # an inner maximum must exceed the rounding of the sums
    return edge if edge.loglik >= inner.loglik - slack else inner


def ratios_for(m: int, log_tau: float) -> Array:
    """The ln(step variance / r) of the table at one τ: from a lag beyond m samples to no noise."""
    log_m = math.log(m)
    lowest = -2.0 * log_m - max(log_tau, 0.0) if log_tau < log_m else -4.0 * log_m + log_tau
    return np.arange(HIGHEST, min(lowest, 0.0) - 4.0, -_TABLE_STEP)[::-1]


def _starts(log_taus: Array, rows: list[Array], heights: list[Array]) -> list[tuple[float, float]]:
    """The highest places of the table that top their row and the rows beside it."""
    best = [int(np.argmax(row[:-1])) for row in heights]
    tops = [-math.inf, *(float(row[at]) for row, at in zip(heights, best, strict=True)), -math.inf]
    peaks = [i for i in range(len(rows)) if tops[i] <= tops[i + 1] >= tops[i + 2]]
    peaks = sorted(peaks, key=lambda i: -tops[i + 1])[:_MAX_PEAKS]
    return [(float(log_taus[i]), float(rows[i][best[i]])) for i in peaks]


def _climb(data: Samples, starts: list[tuple[float, float]], progress: Progress) -> Top:
    """The highest place near several starts: that of the highest large patch, refined step by step."""
    count = len(starts) + len(_SIZES) - 1
    parts = [progress.part(i / count, (i + 1) / count) for i in range(count)]
    tops = [_move(data, *start, _SIZES[0], part) for start, part in zip(starts, parts, strict=False)]
    top = max(tops, key=lambda one: one.loglik)
    for size, part in zip(_SIZES[1:], parts[len(starts) :], strict=True):
        top = _move(data, top.log_tau, top.log_moves, size, part)
    return top


def _move(data: Samples, log_tau: float, log_moves: float, size: float, progress: Progress) -> Top:
    """The highest place that patches of one size come to."""
    for moves in range(_MAX_MOVES - 1):
        progress.step(moves, "likelihood around the best momentum")
        top, inside = _patch_top(data, log_tau, log_moves, size)
        moved = abs(top.log_tau - log_tau) + abs(top.log_moves - log_moves)
        if inside or moved < 1e-9:
            return top
        log_tau, log_moves = top.log_tau, top.log_moves
    return _patch_top(data, log_tau, log_moves, size)[0]


def _patch_top(data: Samples, log_tau: float, log_moves: float, size: float) -> tuple[Top, bool]:
    """The highest place of a patch, and whether it lies inside; the border of what is searched counts as inside."""
    low, high = math.log(MIN_MOMENTUM), math.log(MAX_MOMENTUM)
    log_tau = min(max(log_tau, low + size), high - size)
    log_moves = min(log_moves, HIGHEST - size)
    t, y = _PATCH
    height, _ = data.concentrated(log_moves + size * y, np.exp(log_tau + size * t))
    shape = _coefficients(height.reshape(_NODES))
    at = _highest(shape)
    place = log_tau + size * at[0], log_moves + size * at[1]
    inside = abs(at[0]) < 0.98 or not low + 0.05 * size < place[0] < high - 0.05 * size
    inside = inside and (abs(at[1]) < 0.98 or place[1] > HIGHEST - 0.05 * size)
    bent = _derivatives(shape, at)
    curvature = np.array([[bent[2, 0], bent[1, 1]], [bent[1, 1], bent[0, 2]]]) / size**2
    return Top(place[0], place[1], float(bent[0, 0]), curvature), inside


def _coefficients(values: Array) -> Array:
    """The Chebyshev polynomial through the values of a patch."""
    return _FROM_VALUES[0] @ values @ _FROM_VALUES[1].T


def _highest(shape: Array) -> tuple[float, float]:
    """The top of the polynomial on the patch: the best of a fine grid, and Newton's steps from there."""
    grid = _ON_RAYS[0] @ shape @ _ON_RAYS[1].T
    i, j = divmod(int(np.argmax(grid)), len(_RAYS))
    x, y = float(_RAYS[i]), float(_RAYS[j])
    here = _derivatives(shape, (x, y))
    for _ in range(6):
        a, b, c = float(here[2, 0]), float(here[1, 1]), float(here[0, 2])
        if not (a < 0.0 and a * c > b * b):
            break
        u, v, det = float(here[1, 0]), float(here[0, 1]), a * c - b * b
        x_next, y_next = x - (c * u - b * v) / det, y - (a * v - b * u) / det
        if max(abs(x_next), abs(y_next)) > 1.0:
            break
        there = _derivatives(shape, (x_next, y_next))
        if there[0, 0] < here[0, 0]:
            break
        x, y, here = x_next, y_next, there
    return x, y


def _derivatives(shape: Array, at: tuple[float, float]) -> Array:
    """The derivatives of the polynomial at a place, shape (3, 3): how often by ln τ, and by the other."""
    return _basis(at[0], _NODES[0]) @ shape @ _basis(at[1], _NODES[1]).T


def _basis(x: float, count: int) -> Array:
    """The first Chebyshev polynomials and their first two derivatives at x, shape (3, count)."""
    rows = [[1.0, x], [0.0, 1.0], [0.0, 0.0]]
    for k in range(2, count):
        for order, row in enumerate(rows):
            lower = 2.0 * order * rows[order - 1][k - 1] if order else 0.0
            row.append(2.0 * x * row[k - 1] + lower - row[k - 2])
    return np.array(rows)


def _climb_without_noise(data: Samples, log_tau: float, first: float, progress: Progress) -> Top:
    """The best τ near one where r = 0; `first` is half the stretch that is searched first."""
    low, high = math.log(MIN_MOMENTUM), math.log(MAX_MOMENTUM)
    nodes = chebyshev.chebpts1(_NODES[1])
    edge = np.full(len(nodes), math.inf)
    top = Top(log_tau, math.inf, -math.inf, np.zeros((2, 2)))
    for i, size in enumerate((first, *_SIZES)):
        progress(i / (len(_SIZES) + 1), "likelihood without noise")
        middle = min(max(top.log_tau, low + size), high - size)
        places = middle + size * nodes
        height, _ = data.concentrated(edge, np.exp(places))
        domain = [middle - size, middle + size]
        curve = Chebyshev.fit(places, height, len(nodes) - 1, domain=domain)
        fine = middle + size * _RAYS_FINE
        at = float(fine[int(np.argmax(curve(fine)))])
        bent = np.array([[float(curve.deriv(2)(at)), 0.0], [0.0, 0.0]])
        top = Top(at, math.inf, float(curve(at)), bent)
    return top
