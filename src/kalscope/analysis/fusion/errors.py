"""The error of the fused value: predicted by the model, and measured by predicting later readings."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from kalscope.analysis.fusion.result import HeldOut
from kalscope.common.array import Array, Mask
from kalscope.filtering.filter import fuse
from kalscope.filtering.params import FilterParams

BLOCKS = 16
"""Blocks from whose scatter the standard error of a mean comes."""

CERTAIN = 2.0
"""Standard errors beyond which a difference is not chance."""

FAR, TRIED = 100.0, 1000
"""A stuck sensor is simulated this many standard deviations away, for this many rows."""

SETTLED_AFTER = 0.1
"""Share of the rows that the start may take."""


def started(z: Array) -> int:
    """The row from which errors are compared: the start is over, and every sensor that ever answers has begun."""
    begins = int(np.isfinite(z).argmax(axis=0).max()) if len(z) else 0
    return max(int(SETTLED_AFTER * len(z)), begins)


def predicted_error(z: Array, dt: Array | None, params: FilterParams, first: int) -> float:
    """√ of the mean variance that the model gives to x, from row `first` on; inf without a reading."""
    p = fuse(z, params, dt).p[first:]
    p = p[np.isfinite(p)]
    return math.sqrt(float(p.mean())) if len(p) else math.inf


def held_out(z: Array, dt: Array | None, params: FilterParams, counted: Mask) -> HeldOut | None:
    """Predict every reading of the second half from the rows before it, by all sensors and by each alone.

    Args:
        z: readings, shape (n, sensors).
        dt: steps before the rows; None = 1 each.
        params: the filter.
        counted: the readings that count, which those of a stuck sensor do not, shape (n, sensors).
    """
    every = range(params.sensors)
    squared = [_squared_errors(z, dt, params, sensors) for sensors in (list(every), *([i] for i in every))]
    scored = np.isfinite(sum(squared)) & counted[len(z) - len(squared[0]) :]
    if np.count_nonzero(scored.sum(axis=1)) < 2 * BLOCKS:
        return None
    weights = np.where(scored, params.shares, 0.0)
    fused, *single = (np.where(scored, one, 0.0) for one in squared)
    total = weights.sum()
    means = [float((weights * one).sum() / total) for one in single]
    best = int(np.argmin(means))
    return HeldOut(
        fused=math.sqrt(float((weights * fused).sum() / total)),
        single=np.sqrt(means),
        best=best,
        is_certain=_differ(weights * (single[best] - fused)),
    )


def _squared_errors(z: Array, dt: Array | None, params: FilterParams, sensors: Sequence[int]) -> Array:
    """Squared errors of the second half in the unit of x, shape (rows, all sensors), predicted by these sensors."""
    run = fuse(z[:, sensors], params.only(sensors), dt)
    first = max(len(z) // 2, 1)
    ahead = run.x[first - 1 : -1]
    if run.velocity is not None:
        steps = 1.0 if dt is None else dt[first:]
        ahead = ahead - params.momentum * np.expm1(-steps / params.momentum) * run.velocity[first - 1 : -1]
    return ((z[first:] - params.offset) / params.gain - ahead[:, None]) ** 2


def _differ(weighted: Array) -> bool:
    """Whether the mean of the rows differs from 0 by more than the scatter of its blocks explains."""
    means = np.array([block.sum(axis=1).mean() for block in np.array_split(weighted, BLOCKS)])
    return abs(float(means.mean())) > CERTAIN * float(means.std(ddof=1)) / math.sqrt(BLOCKS)


def pull(params: FilterParams, sensor: int) -> float:
    """How far the fused value goes, in the end, towards a sensor that sticks far away: 0 … 1.

    Without a gate this is its share. A gate rejects it at first, but accepts a reading after a number of
    rejections, to avoid lock-out, and then the others are far from the fused value. That is simulated without
    noise.
    """
    if params.gate is None:
        return float(params.shares[sensor])
    away = FAR * math.sqrt(float(params.scaled_r.max()) + params.q)
    z = np.tile(params.offset, (2 * TRIED, 1))
    z[TRIED:, sensor] += params.gain[sensor] * away
    return float(np.clip(fuse(z, params).x[-TRIED // 2 :].mean() / away, 0.0, 1.0))
