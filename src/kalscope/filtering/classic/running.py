"""A classic filter with its state: what a record, a stream and the float32 of a board all run."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kalscope.filtering.arrays import one_record
from kalscope.filtering.classic import kernels
from kalscope.filtering.classic.stages import (
    Butterworth,
    Exponential,
    Median,
    MovingAverage,
    OneEuro,
    PowerOfTwo,
    Stage,
)
from kalscope.filtering.filter import FilterResult, KalmanFilter
from kalscope.filtering.params import FilterParams

Floats = NDArray[Any]
"""float64, or float32 as a board computes."""

LONG_WINDOW = 75
"""A median of more samples is quicker by scipy than by moving each sample to its place."""
MANY_MOVES = 5e7
"""Samples times window from which on that is worth importing scipy."""

_LOOPS: dict[type[Stage], Callable[[Floats, Floats, Floats, Floats, kernels.Counters, Floats], None]] = {
    MovingAverage: kernels.moving_average,
    Exponential: kernels.exponential,
    PowerOfTwo: kernels.exponential,
    Median: kernels.median,
    Butterworth: kernels.butterworth,
    OneEuro: kernels.one_euro,
}


class RunningStage:
    """One classic filter over one channel, from its start on; bit for bit the same in pieces and in one go."""

    def __init__(self, stage: Stage, kind: type[np.float64 | np.float32] = np.float64) -> None:
        """Args: the filter, and the type to compute in: float32 as a board does."""
        self._loop, self._kind = _LOOPS[type(stage)], kind
        self._constants = np.array(stage.constants, dtype=kind)
        self._state = np.zeros(stage.memory, dtype=kind)
        self._state[0] = np.nan
        self._counters = np.zeros(1, dtype=np.int64)
        self._window = stage.window if isinstance(stage, Median) and stage.window > LONG_WINDOW else 0

    @property
    def x(self) -> float:
        """The last output; NaN before the first finite sample."""
        return float(self._state[0])

    def take(self, z: Floats, dt: Floats) -> Floats:
        """Take samples.

        Args:
            z: finite, or NaN where missing: the output is held; shape (n,).
            dt: nominal sample periods before each sample, shape (n,), or empty: 1 each.

        Returns:
            The output after each, shape (n,), of the type to compute in.
        """
        samples, steps = (np.ascontiguousarray(values, dtype=self._kind) for values in (z, dt))
        if self._window * len(samples) > MANY_MOVES and math.isnan(self.x) and _is_plain(samples):
            return self._long_median(samples)
        out = np.empty_like(samples)
        self._loop(samples, steps, self._constants, self._state, self._counters, out)
        return out

    def _long_median(self, z: Floats) -> Floats:
        """As the loop from the start on, by scipy, whose work hardly grows with the window."""
        from scipy.ndimage import median_filter

        window, seen = self._window, np.isfinite(z)
        came = z[seen]
        if not len(came):
            return np.full_like(z, np.nan)
        medians = median_filter(came, size=window, mode="nearest", origin=(window - 1) // 2)
        latest = np.cumsum(seen) - 1
        self._state[0] = medians[-1]
        self._state[1 : window + 1] = np.concatenate([np.full(window, came[0]), came])[-window:]
        self._state[window + 1 :] = np.sort(self._state[1 : window + 1])
        return np.where(latest >= 0, medians[np.maximum(latest, 0)], np.nan)


def _is_plain(z: Floats) -> bool:
    """Whether no sample is -0.0, which scipy may take for 0.0."""
    return not np.signbit(z[z == 0.0]).any()


class RunningStages:
    """Classic filters in a row over one channel; a missing sample is missing for all of them."""

    def __init__(self, stages: tuple[Stage, ...], kind: type[np.float64 | np.float32] = np.float64) -> None:
        self._each = [RunningStage(stage, kind) for stage in stages]

    def take(self, z: Floats, dt: Floats) -> Floats:
        """Arguments and result as `RunningStage.take`."""
        missing, out = np.isnan(z), z
        for number, one in enumerate(self._each):
            out = one.take(np.where(missing, np.nan, out) if number else out, dt)
        return out


class RunningChain:
    """A chain over one channel, from its start on; bit for bit the same in pieces and in one go."""

    def __init__(self, stages: tuple[Stage, ...], kalman: FilterParams | None) -> None:
        """Args: the classic filters; the parameters of the Kalman filter behind them, scalars, or None."""
        self._stages = RunningStages(stages)
        self._kalman = None if kalman is None else KalmanFilter(kalman)
        self._before = math.nan

    def run(self, z: ArrayLike, dt: ArrayLike | None = None) -> FilterResult:
        """Take the samples that follow; arguments, result and errors as `ChainFilter.run` of one channel."""
        samples, steps = one_record(z, dt)
        staged = self._stages.take(samples, steps)
        if self._kalman is not None:
            staged[np.isnan(samples)] = np.nan
            found = self._kalman.run(staged, dt)
            return replace(found, innovation=samples - (staged - found.innovation), loglik=math.nan, m=0)
        unknown = np.full(len(samples), np.nan)
        innovation = samples - np.concatenate([[self._before], staged])[:-1]
        self._before = float(staged[-1]) if len(staged) else self._before
        return FilterResult(staged, unknown, unknown, innovation, unknown, math.nan, 0, 0)
