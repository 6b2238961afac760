"""Noise that sensors have in common: whether the noises of two are correlated, or one noise is in all of them."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from kalscope.common.array import Array
from kalscope.estimation.fusion.moving import fused_signal
from kalscope.estimation.fusion.search.fit import Asked, Found, climbed
from kalscope.estimation.fusion.search.likelihood import Place, Readings, place_at
from kalscope.filtering.params import FilterParams

MIN_ROWS = 30
"""Least number of rows in which the sensors that are compared answer together."""
SURE = 10.83
"""Rise of twice the log-likelihood that one parameter brings by chance once in a thousand records."""
MIN_CORRELATION = 0.2
"""Least correlation of noises that is worth reporting."""
QUIET, EVEN = 0.01, 0.5
"""Start of the search: q as a share of that found, and the least r as a share of the largest."""
RATIOS, FACTORS = (0.03, 0.1, 0.3, 1.0), (1.8, 1.35, 1.15, 1.07)
"""β where its search begins, over the ratio of the steps of the two sensors; the factors by which it goes on."""
COMPARED = 6000
"""Readings in the middle of the record that are enough to find shared noise."""
LIGHT = 0.05
"""Least r of the other sensors for their weights, as a share of the largest."""
FINE = 0.01
"""Rise of the log-likelihood that matters here."""


@dataclass(frozen=True)
class Shared:
    """White noise that sensors have in common."""

    sensors: tuple[int, ...]
    """Two of them, or all."""
    correlation: float
    """Of the noises of these two, or the largest of any two of all, 0 … 1."""
    rise: float
    """By how much it raises twice the log-likelihood."""


def shared_by_params(z: Array, steps: Array, params: FilterParams) -> Shared | None:
    """As `shared_noise` of the best fit near a filter; None where a sensor has hardly a reading."""
    if np.isfinite(z).sum(axis=0).min(initial=len(z)) < MIN_ROWS:
        return None
    data = Readings.of(z, steps)
    unit = data.scale * data.scale
    start = place_at(data, params.q / unit, params.momentum, params.sensor_r / unit, params.gain)
    free = np.full(data.sensors, math.nan)
    asked = Asked(free, np.zeros(data.sensors), params.momentum > 0.0, np.empty(0, np.intp))
    return shared_noise(z, steps, climbed(data, asked, start, FINE))


def shared_noise(z: Array, steps: Array, found: Found) -> Shared | None:
    """The noise that two sensors share, or all of them, whichever explains more; None where none shows.

    Args:
        z: readings, shape (n, sensors), NaN where missing.
        steps: nominal sample periods before each row; empty = 1 each.
        found: the best fit with independent noises.
    """
    share = min(1.0, COMPARED / len(found.coordinates.data.value))
    part = slice(int(0.5 * (1.0 - share) * len(z)), math.ceil(0.5 * (1.0 + share) * len(z)))
    z, steps, sensors = z[part], steps[part], z.shape[1]
    tried = [_shared_by_two(z, steps, found, pair) for pair in combinations(range(sensors), 2)]
    tried += [_shared_by_all(z, steps, found)] if sensors > 2 else []
    best = max((one for one in tried if one is not None), key=lambda one: one.rise, default=None)
    return best if best is not None and best.rise > SURE and best.correlation >= MIN_CORRELATION else None


def _shared_by_two(z: Array, steps: Array, found: Found, pair: tuple[int, ...]) -> Shared | None:
    """The noise that sensors i and j share.

    Reading j less β times reading i has a noise independent of that of i where β = ρ σ_j/σ_i. In place of reading
    j it makes all noises independent, so that the same likelihood serves. Readings j without one of i in their row
    are left out. The search starts from a slow signal, because shared noise may have been fitted as movement.
    """
    data, place = found.coordinates.data, found.place
    i, j = sorted(pair, key=lambda one: -float(place.r[one]))
    both = np.isfinite(z[:, [i, j]]).all(axis=1)
    moves = [float(np.mean(np.diff(z[both, one]) ** 2)) for one in (i, j)] if both.sum() >= MIN_ROWS else [0.0]
    if not min(moves) > 0.0:
        return None
    if data.sensors == 2 and (place.r.min() == 0.0 or place.q == 0.0):  # as where all share it
        return None
    weights = place.c**2 / np.maximum(place.r, LIGHT * place.r.max())
    weights[[i, j]] = 0.0
    columns, gain, r = [z[:, i], z[:, j]], place.c[[i, j]], place.r[[i, j]]
    if weights.any():  # the others, as one sensor
        columns.append(fused_signal(z, place, data, weights))
        gain, r = np.append(gain, 1.0), np.append(r, 1.0 / weights.sum())
    if not np.isfinite(columns[-1]).any():
        return None
    asked = Asked(np.full(len(r), math.nan), np.zeros(len(r)), found.coordinates.keeps, np.empty(0, np.intp))

    def fitted(beta: float, q: float, noise: Array) -> Place:
        turned = np.stack([columns[0], columns[1] - beta * columns[0], *columns[2:]], axis=1)
        part = Readings.of(turned, steps, data.scale)
        gains = np.array([gain[0], gain[1] - beta * gain[0], *gain[2:]])
        return climbed(part, asked, place_at(part, q, place.tau, noise, gains), FINE).place

    def correlated(beta: float) -> tuple[float, float, Place]:
        one = fitted(beta, QUIET * place.q, np.maximum(r, EVEN * r.max()))
        return one.loglik, beta, one

    alone = fitted(0.0, place.q, r).loglik
    best = max(correlated(one * math.sqrt(moves[1] / moves[0])) for one in RATIOS)
    for factor in FACTORS if best[0] > alone else ():
        best = max(best, correlated(best[1] / factor), correlated(best[1] * factor))
    explained = best[1] ** 2 * float(best[2].r[0])
    correlation = math.sqrt(explained / max(explained + float(best[2].r[1]), 1e-300))
    return Shared(tuple(sorted(pair)), correlation, 2.0 * (best[0] - alone))


def _shared_by_all(z: Array, steps: Array, found: Found) -> Shared | None:
    """The noise that all sensors share.

    Over the rows in which all sensors answer, the fused value is one signal of which the noise is known, 1/Σ c²/r.
    Where it shows more, that is common to all: it counts as movement.
    """
    data, place = found.coordinates.data, found.place
    rows = np.isfinite(z).all(axis=1)
    if rows.sum() < MIN_ROWS or place.r.min() == 0.0 or place.q == 0.0:
        return None
    signal = np.where(rows, fused_signal(z, place, data, place.c**2 / place.r), np.nan)
    one = Readings.of(signal[:, None], steps)
    expected = data.scale**2 / float(np.sum(place.c**2 / place.r)) / one.scale**2
    step = place.q * data.scale**2 / one.scale**2
    start = place_at(one, step, place.tau, np.array([expected]), np.ones(1))
    asked = Asked(np.array([expected]), np.zeros(1), False, np.empty(0, np.intp))
    fixed = climbed(one, asked, start).place
    free = climbed(one, replace(asked, known=np.array([math.nan])), fixed).place
    common = float(free.r[0] - expected) * one.scale**2 / data.scale**2
    least = np.sort(place.r / place.c**2)[:2]
    correlation = common / math.sqrt(float(np.prod(least + common))) if common > 0.0 else 0.0
    return Shared(tuple(range(data.sensors)), correlation, 2.0 * (free.loglik - fixed.loglik))
