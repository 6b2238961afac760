"""Several sensors of one quantity fused over a whole record; the streaming filter agrees bit for bit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kalscope.common.array import Array
from kalscope.filtering.arrays import samples_of, steps_of
from kalscope.filtering.fusion.params import FusionParams
from kalscope.filtering.fusion.running import FusedRows, RunningFusion, checked_readings


@dataclass(frozen=True)
class FusionResult:
    """What `fuse` computed: (n,) arrays of the state after each row, (n, sensors) arrays of each reading."""

    x: Array
    """Fused value (posterior mean), unit; NaN before the first finite reading of an automatic start."""
    p: Array
    """Posterior variance, unit²; inf before the first finite reading of a diffuse start."""
    k: Array
    """Kalman gain: by how much x moves for an innovation of 1; 0 where a reading was missing or rejected."""
    innovation: Array
    """z minus offset + gain x as it was before, unit of the sensor; NaN where z is missing or sets the start."""
    s: Array
    """Innovation variance, gain² p + r; inf where a diffuse start is set."""
    loglik: float
    """Log-likelihood: sum over the m scored innovations of −½(ln 2π + ln s + v²/s)."""
    m: int
    """Scored readings: neither missing, nor rejected, nor the one that sets the start."""
    rejected: NDArray[np.int64]
    """Readings of each sensor that the outlier gate rejected, shape (sensors,)."""
    information: Array
    """Information in a reading of each sensor, gain²/r, 1/unit², shape (sensors,)."""
    velocity: Array | None = None
    """Velocity, unit per nominal sample period; None without momentum."""
    velocity_p: Array | None = None
    """Its posterior variance."""

    @property
    def weights(self) -> Array:
        """Shares of the sensors in each row by `information`; they sum to 1, or are 0 where no reading was used."""
        used = np.where(self.k != 0.0, self.information, 0.0)
        total = used.sum(axis=1, keepdims=True)
        return used / np.where(total > 0.0, total, 1.0)


def fuse(z: ArrayLike, params: FusionParams, dt: ArrayLike | None = None) -> FusionResult:
    """Fuse the readings of several sensors of one quantity.

    A row predicts once, then the sensors that have a reading update one after the other, in column order. The first
    finite reading of a diffuse start sets x = (z − offset)/gain with the variance r/gain², and is not scored; other
    readings of its row are updates. One sensor without offset and gain is `kalman_filter`, bit for bit.

    Args:
        z: readings, shape (n, sensors); NaN where a sensor has none: that covers gaps and different rates.
        params: the model.
        dt: nominal sample periods that elapse before each row, shape (n,), ≥ 0; None = 1 each. dt[0] = 0 puts the
            prior at the first row.

    Raises:
        BadSetting: z holds inf or has another shape; dt does not fit z.

    Source: Durbin & Koopman (2012), section 6.4, the univariate treatment of multivariate series.
    """
    readings = checked_readings(samples_of(z), params)
    steps = steps_of(dt, len(readings))
    running, rows = RunningFusion(params), FusedRows.empty(params, len(readings))
    loglik = running.take(readings, steps, rows)
    k, innovation, s = rows.readings
    if np.any(params.gain != 1.0):  # back on the scale of each sensor
        k /= params.gain
        innovation *= params.gain
        s *= params.gain * params.gain
        loglik -= float(running.scored @ np.log(np.abs(params.gain)))
    m = int(running.scored.sum())
    if not params.momentum:
        x, p = rows.states
        return FusionResult(x, p, k, innovation, s, loglik, m, running.rejected, params.information)
    x, v, p, _, w = rows.states
    return FusionResult(x, p, k, innovation, s, loglik, m, running.rejected, params.information, v, w)
