"""The streaming fused filter: one update per row."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from kalscope.common.array import Array
from kalscope.errors import BadSetting
from kalscope.filtering.arrays import samples_of, step_of
from kalscope.filtering.fusion.params import FusionParams
from kalscope.filtering.fusion.running import FusedRows, RunningFusion, checked_readings


class FusionFilter:
    """The streaming fused filter: one `update` per row of readings, equal to `fuse` bit for bit.

    Before the first finite reading of a diffuse start x is NaN, p inf and k 0.
    """

    def __init__(self, params: FusionParams) -> None:
        self.params = params
        self._running = RunningFusion(params)
        self._row = FusedRows.empty(params, 1)
        self._k = np.zeros(params.sensors)

    @property
    def x(self) -> float:
        """Fused value, unit."""
        return self._running.x

    @property
    def p(self) -> float:
        """Posterior variance, unit²."""
        return self._running.p

    @property
    def k(self) -> Array:
        """By how much the last row moved x for an innovation of 1 of each sensor, shape (sensors,)."""
        return self._k

    @property
    def velocity(self) -> float:
        """Fused velocity, unit per nominal sample period; NaN without momentum."""
        return self._running.velocity

    def update(self, row: ArrayLike, dt: float | None = None) -> float:
        """Take one row of readings and return the fused value.

        Args:
            row: a reading of each sensor, shape (sensors,); NaN where one has none (all NaN: predict only).
            dt: nominal sample periods since the last row, ≥ 0; None = 1.

        Raises:
            BadSetting: a reading is infinite, their number differs from that of the sensors, or dt is negative. The
                state stays.
        """
        step = step_of(dt)
        readings = checked_readings(np.atleast_2d(samples_of(row)), self.params)
        if len(readings) != 1:
            raise BadSetting(f"row must have shape ({self.params.sensors},) (got {np.shape(row)})")
        self._running.take(readings, np.array([step]), self._row)
        self._k = self._row.readings[0][0] / self.params.gain
        return self.x
