"""Where the search begins: r of each sensor and q from the variances of differences."""

from __future__ import annotations

import numpy as np

from kalscope.common.array import Array, Indices
from kalscope.estimation.fusion.search.fit import Asked, step_sizes
from kalscope.estimation.fusion.search.likelihood import Place, Readings, place_at

_LEAST = 0.02
"""Least share of the differences between sensors that is attributed to one of them."""
_MOVES = 1.0, 0.1, 1e-3
"""q of the starts, as shares of the smallest variance of the steps of a sensor."""
_MIN_PAIRS = 8
"""Rows that two sensors must share to be compared."""


def starting_places(data: Readings, z: Array, asked: Asked, gains: Array) -> list[Place]:
    """Starts on the middle of the record; z is the record itself, shape (n, sensors), NaN where missing."""
    least = float((np.maximum(step_sizes(data), 1e-12) / gains**2).min())
    noises = guessed_noises(z, data, asked, gains)
    part = data.middle()
    return [place_at(part, share * least, 0.0, noise, gains) for noise in noises for share in _MOVES]


def guessed_noises(z: Array, data: Readings, asked: Asked, gains: Array) -> list[Array]:
    """Guesses of r of all sensors, in scale², each shape (sensors,); a known r stays."""
    steps = np.maximum(step_sizes(data), 1e-12) / gains**2
    guesses = _noises((z - data.centre) / data.scale / gains, steps)
    return [
        np.where(np.isnan(asked.known), np.maximum(one * gains**2, asked.floor), asked.known) for one in guesses
    ]


def starting_gains(data: Readings, z: Array, gained: Indices, gauge: int) -> Array:
    """A gain of each sensor that is searched, from the sizes of what it shares with sensor `gauge`."""
    gains = np.ones(data.sensors)
    centred = (z - data.centre) / data.scale
    for i in gained.tolist():
        both = np.isfinite(centred[:, i]) & np.isfinite(centred[:, gauge])
        if both.sum() >= _MIN_PAIRS:
            own, other = centred[both, i], centred[both, gauge]
            size = np.sqrt(np.mean(own**2) / max(float(np.mean(other**2)), 1e-300))
            gains[i] = float(np.clip(size, 0.01, 100.0)) * (1.0 if np.mean(own * other) >= 0.0 else -1.0)
    return gains


def _noises(z: Array, steps: Array) -> list[Array]:
    """Guesses of r: half the steps, what differs between sensors split among them, and each one nearly exact."""
    sensors = len(steps)
    pairs: list[Array] = []
    sums: list[float] = []
    for i in range(sensors):
        for j in range(i):
            moves = np.diff(z[:, i] - z[:, j])
            moves = moves[np.isfinite(moves)]
            if len(moves) >= _MIN_PAIRS:
                row = np.zeros(sensors)
                row[[i, j]] = 1.0
                pairs.append(row)
                sums.append(0.5 * float(np.mean(moves**2)))
    guesses = [0.25 * steps]
    if not pairs:
        return guesses
    shared = np.array(sums)
    least = _LEAST * max(float(shared.min()), 1e-12)
    if sensors > 2:
        solved = np.linalg.lstsq(np.array(pairs), shared, rcond=None)[0]
    else:
        solved = shared[0] * steps / steps.sum()
    guesses.append(np.maximum(solved, least))
    for i in range(sensors if sensors < 9 else 0):
        exact = np.maximum(guesses[1], float(shared.mean()))
        exact[i] = least
        guesses.append(exact)
    return guesses
