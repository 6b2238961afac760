"""A fused filter with its state, which takes rows, one or many at a time. All drivers run this."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from kalscope.common.array import Array
from kalscope.errors import BadSetting
from kalscope.filtering.fusion import kernels
from kalscope.filtering.fusion.params import MAX_OFFSET, FusionParams


@dataclass(frozen=True)
class FusedRows:
    """Arrays to fill: the state after each row, shape (rows,), and each reading, shape (rows, sensors)."""

    states: tuple[Array, ...]
    """x and p; with momentum x, velocity, p, their covariance and the variance of the velocity."""
    readings: kernels.Columns
    """k, innovation and s of each reading, on the scale of x."""

    @classmethod
    def empty(cls, params: FusionParams, rows: int) -> FusedRows:
        """Arrays for this many rows."""
        shape = rows, params.sensors
        states = tuple(np.empty(rows) for _ in range(5 if params.momentum else 2))
        return cls(states, (np.empty(shape), np.empty(shape), np.empty(shape)))


class RunningFusion:
    """The state of a fused filter between rows."""

    velocity = math.nan
    """Filtered velocity, unit per sample period; NaN without momentum."""

    def __init__(self, params: FusionParams) -> None:
        self.params = params
        self.x = math.nan if params.x0 is None else params.x0
        self.p = math.inf if params.p0 is None else params.p0
        self._gate = math.inf if params.gate is None else params.gate
        self._sensors = params.offset, params.gain, params.scaled_r
        self._sums = np.empty(params.sensors)
        if params.momentum:
            self.velocity = 0.0
            self._covariances = 0.0, 0.5 * params.q / params.momentum
        in_a_row, self.rejected, self.scored = (np.zeros(params.sensors, dtype=np.int64) for _ in range(3))
        self._tally: kernels.Tally = in_a_row, self.rejected, self.scored

    def take(self, readings: Array, dt: Array, out: FusedRows) -> float:
        """Take rows of readings into `out`; dt may be empty.

        Args:
            readings: as `checked_readings` gives them, shape (rows, sensors).
            dt: steps before the rows, shape (rows,), or empty.
            out: arrays for as many rows.

        Returns:
            The log-likelihood of the scored readings of these rows, in the unit of x.
        """
        q, tau = self.params.q, self.params.momentum
        if not tau:
            x, p = out.states
            self.x, self.p, loglik = kernels.fuse_rows(
                readings,
                dt,
                q,
                self._sensors,
                self._gate,
                self.x,
                self.p,
                self._tally,
                (x, p),
                out.readings,
                self._sums,
            )
            return loglik
        x, v, p, g, w = out.states
        state = self.x, self.velocity, self.p, *self._covariances
        state, loglik = kernels.fuse_rows_with_momentum(
            readings, dt, q, self._sensors, tau, self._gate, state, self._tally, (x, v, p, g, w), out.readings
        )
        self.x, self.velocity, self.p, *covariances = state
        self._covariances = covariances[0], covariances[1]
        return loglik


def checked_readings(z: Array, params: FusionParams) -> Array:
    """The readings z of shape (rows, sensors), contiguous.

    Raises:
        BadSetting: z has another shape, or a reading that is infinite as a value of x, (z − offset)/gain.
    """
    if z.ndim != 2 or z.shape[1] != params.sensors:
        raise BadSetting(f"z must have a column for each of the {params.sensors} sensors (got shape {z.shape})")
    readings = np.ascontiguousarray(z)
    flat = readings.ravel()
    if max(np.fmax.reduce(flat, initial=0.0), -np.fmin.reduce(flat, initial=0.0)) <= MAX_OFFSET:
        return readings  # the usual case, quick to check: no gain or offset can make these infinite
    with np.errstate(over="ignore"):
        values = (readings - params.offset) / params.gain
    where = np.argwhere(np.isinf(values))
    if len(where):
        row, sensor = where[0]
        raise BadSetting(
            f"z must be finite, or NaN where missing (got {z[row, sensor]} at row {row}, sensor {sensor})"
        )
    return readings
