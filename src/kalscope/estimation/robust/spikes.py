"""Which samples of a record are spikes: those that neither the samples before nor those after them predict.

A genuine step is predicted well from the samples after it, and so is a fast movement: both stay.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kalscope.common.array import Array
from kalscope.common.centred_median import centred_median
from kalscope.estimation.robust.kernels import judge_samples
from kalscope.estimation.sensor.resolution import resolution_of
from kalscope.filtering.kernels import GATE_LIMIT

SIGMAS = 4.0
"""Standard deviations from what both sides together predict, beyond which a sample is set aside."""
SIDE_SIGMAS = 3.5
"""Standard deviations from what either side alone predicts: the sample must be beyond that on both."""
LONGEST = GATE_LIMIT
"""Spikes side by side that are recognised, as many as the gate rejects in a row; more of them are a movement."""
NEAR = 15
"""Samples on either side of one that show how lively the signal is there."""
MOST = 25.0
"""Limit on the v²/s of one neighbour: a single missed spike does not make the signal lively."""
VERY_LIVELY, CROWDED = 2.0, 0.1
"""Mean v²/s around a sample, and share of the samples there, beyond which it takes SIGMAS times as much again:
what looks like several spikes may be movement."""
MIN_RUNS = 6
"""Number of runs of spikes, of any length, from which those of more than two samples are accepted."""
LIVELY = 1.5
"""Mean v²/s of the samples around one from which the signal counts as lively; of normal noise it is 1 or less."""
START_SIGMAS = 3.0
"""Distance from the centred median, in standard deviations of the noise, at which the search starts."""
WINDOW = 2 * LONGEST + 1
"""Samples of the centred median: spikes side by side are fewer than half of them."""
FALSE_ALARM = 1e-3
"""Share of records of normal noise in which a spike is found."""
_NORMAL = 1.8
"""Standard deviation of white normal noise over the median of its distances from the centred median. It is not
1.48: a sample that is the median itself has the distance 0. Where the signal moves fast it is larger."""
_EQUAL_SHARE = 0.2
"""Share of readings equal to the one before from which the record is called quantised."""

Mask = NDArray[np.bool_]


def unpredicted(z: Array, steps: Array, q: float, r: float, tau: float) -> Array:
    """e²/s of each sample that neither side predicts, by both sides together, shape (n,); 0 for all others.

    Where the samples around it are predicted badly too, the signal is lively there: it takes as many times more.

    Args:
        z: one channel, shape (n,), NaN where missing.
        steps: nominal sample periods before each sample; empty = 1 each.
        q: variance of the movement, unit².
        r: variance of the noise, unit².
        tau: momentum in sample periods, 0 for none.
    """
    noise = r + rounding_variance(z)
    v, s = np.empty((2, len(z))), np.empty((2, len(z)))
    refused = np.empty((2, len(z)), dtype=bool)
    back = np.append(1.0, steps[:0:-1]) if len(steps) else steps
    for side, (samples, gaps) in enumerate(((z, steps), (np.ascontiguousarray(z[::-1]), back))):
        start = _start(samples, gaps, q, noise)
        judge_samples(
            samples, gaps, q, noise, tau or None, SIDE_SIGMAS**2, start, LONGEST, v[side], s[side], refused[side]
        )
    for rows in (v, s, refused):
        rows[1] = rows[1, ::-1].copy()
    away, present = refused[0] & refused[1], np.isfinite(z)
    at = np.flatnonzero(away)
    with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
        found = _together(v[:, at], s[:, at], noise)
        s = np.divide(v, s, out=s)  # v²/s, in the memory of s
        s *= v
        del v
        lively = _mean_around(np.minimum(s[0], s[1], out=s[0]).clip(max=MOST, out=s[0]), present & ~away)[at]
    del s
    kept = found > SIGMAS**2 * np.where(lively > LIVELY, lively, 1.0)
    away[at] = kept
    crowded = (lively > VERY_LIVELY) & (_mean_around(away.astype(float), present)[at] > CROWDED)
    away[at] = kept & (~crowded | (found > SIGMAS**4 * lively))
    away[present] &= ~_lone_pulses(away[present])
    scores = np.zeros(len(z))
    scores[at] = np.where(away[at], found, 0.0)
    return scores


def _start(z: Array, steps: Array, q: float, noise: float) -> tuple[float, float]:
    """A level for the first sample, and its variance: the sample itself may be a spike."""
    near = np.flatnonzero(np.isfinite(z))[:WINDOW]
    if not len(near):
        return math.nan, math.inf
    span = steps[near[0] + 1 : near[-1] + 1].sum() if len(steps) else near[-1] - near[0]
    return float(np.median(z[near])), noise + q * float(span)


def _together(v: Array, s: Array, noise: float) -> Array:
    """Squared error of the prediction from both sides over its variance; v and s of either side, shape (2, n)."""
    p = s - noise
    least, most = np.min(p, axis=0), np.max(p, axis=0)
    share = np.where(least == most, 0.5, 1.0 / (1.0 + least / most))  # of the side that knows more
    first = np.where(p[0] == least, share, 1.0 - share)
    return (first * v[0] + (1.0 - first) * v[1]) ** 2 / (noise + share * least)


def _lone_pulses(refused: Mask) -> Mask:
    """The runs of more than two rejected samples, if there are few runs: the signal has moved, and come back."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], refused, [False]])))
    firsts, stops = edges[::2], edges[1::2]
    pulses = np.zeros(len(refused), dtype=bool)
    if len(firsts) < MIN_RUNS:
        for first, stop in zip(firsts, stops, strict=True):
            pulses[first:stop] = stop - first > 2
    return pulses


def _mean_around(values: Array, counted: Mask) -> Array:
    """Mean of the values that count within NEAR samples of each, shape (n,); 0 where there are none."""
    sums = _sum_around(np.cumsum(np.where(counted, values, 0.0)))
    return np.divide(sums, np.maximum(_sum_around(np.cumsum(counted)), 1), out=sums)


def _sum_around(total: NDArray[Any]) -> NDArray[Any]:
    """The sum within NEAR samples of each, shape (n,), from the sums up to each."""
    ends = np.zeros(NEAR + 1, total.dtype), np.full(NEAR, total[-1] if len(total) else 0, total.dtype)
    padded = np.concatenate((ends[0], total, ends[1]))
    return padded[2 * NEAR + 1 :] - padded[: -2 * NEAR - 1]


@dataclass(frozen=True)
class Start:
    """Where the search for spikes starts."""

    far: Mask
    """The samples far from the centred median, shape (n,)."""
    looks_spiky: bool
    """Whether they are more, or farther away, than normal noise explains."""


def far_from_median(z: Array) -> Start:
    """The samples of z, shape (n,), that are far from the centred median."""
    present = np.isfinite(z)
    samples = z if present.all() else z[present]
    away = centred_median(samples, WINDOW)
    np.abs(np.subtract(samples, away, out=away), out=away)
    scale = _NORMAL * float(np.median(away))
    if scale == 0.0 and away.any():
        scale = float(np.median(away[away > 0.0]))
    far = np.zeros(len(z), dtype=bool)
    far[present] = away > START_SIGMAS * scale
    return Start(far, _beyond_chance(away / scale if scale > 0.0 else away, START_SIGMAS))


def more_than_chance(scores: Array, z: Array) -> bool:
    """Whether the samples that neither side predicts are more, or farther away, than normal noise explains.

    Args:
        scores: of `unpredicted`.
        z: the record, shape (n,).
    """
    return _beyond_chance(np.sqrt(scores[np.isfinite(z)]), SIGMAS)


def _beyond_chance(distances: Array, least: float) -> bool:
    """Whether fewer than one record in a thousand of normal noise has one so far, or so many beyond `least`."""
    n = len(distances)
    expected = n * math.erfc(least / math.sqrt(2.0))
    many = np.count_nonzero(distances > least) > expected + 4.0 * math.sqrt(expected) + 2.0
    return bool(many) or n * math.erfc(float(distances.max(initial=0.0)) / math.sqrt(2.0)) < FALSE_ALARM


def rounding_variance(z: Array) -> float:
    """Δ²/12 of a record of which many readings equal the one before, else 0: one step of Δ is not a spike."""
    present = np.isfinite(z)
    readings = z if present.all() else z[present]
    if np.count_nonzero(np.diff(readings) == 0.0) <= _EQUAL_SHARE * (len(readings) - 1):
        return 0.0
    return resolution_of(readings) ** 2 / 12.0
