"""The exact log-likelihood of several sensors, its derivatives, and the coordinates in which it is searched.

Convention: as `fuse(...).loglik`. All readings but the first, which sets the exact diffuse start, are scored. The
offsets enter linearly, so each place of the search has its most likely ones, from the normal equations.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from kalscope.common.array import Array
from kalscope.estimation.fusion.search import kernels
from kalscope.estimation.momentum.likelihood import step_variance

SEARCHED = 15_000
"""Readings that are enough for a search from several starts; only its end needs all of them."""
_SLOPE = 1e-4
"""Relative step in τ for the derivative of ln(step variance)."""


@dataclass(frozen=True)
class Readings:
    """A record as a list of finite readings, in the order of time and, within a row, of the sensors."""

    value: Array
    """Readings less the centre of their sensor, over `scale`, shape (readings,)."""
    sensor: NDArray[np.int64]
    """Which sensor each comes from, shape (readings,)."""
    gap: Array
    """Nominal sample periods since the reading before, shape (readings,); 0 within a row."""
    centre: Array
    """Median reading of each sensor, unit, shape (sensors,)."""
    scale: float
    """A power of two, unit: dividing by it costs no digit."""

    @property
    def sensors(self) -> int:
        """How many sensors there are."""
        return len(self.centre)

    @property
    def m(self) -> int:
        """Scored readings."""
        return len(self.value) - 1

    @property
    def span(self) -> float:
        """Sample periods from the first reading to the last."""
        return float(self.gap.sum())

    def middle(self) -> Readings:
        """A stretch in the middle that is long enough to search in; the record itself where it is short."""
        first = (len(self.value) - SEARCHED) // 2
        if first <= 0:
            return self
        part = slice(first, first + SEARCHED)
        return replace(self, value=self.value[part], sensor=self.sensor[part], gap=self.gap[part])

    @staticmethod
    def of(z: Array, steps: Array, scale: float | None = None) -> Readings:
        """The finite readings of z, shape (n, sensors), each sensor with one at least; `steps` empty = 1 each."""
        rows, sensor = np.nonzero(np.isfinite(z))
        centre = np.nanmedian(z, axis=0)
        value = z[rows, sensor] - centre[sensor]
        time = np.cumsum(steps) if len(steps) else np.arange(len(z), dtype=np.float64)
        gap = np.diff(time[rows], prepend=time[rows[0]])
        if scale is None:
            size = max(float(np.abs(np.diff(value[sensor == i])).max(initial=0.0)) for i in range(z.shape[1]))
            scale = math.ldexp(1.0, min(math.frexp(size)[1], 1023)) if size > 0.0 else 1.0
        return Readings(value / scale, sensor.astype(np.int64), gap, centre, scale)


@dataclass(frozen=True)
class Place:
    """The parameters of one place of the search, in `scale` of the readings, with its log-likelihood."""

    q: float
    """Variance of the movement a nominal sample period."""
    tau: float
    """Momentum in sample periods; 0 = none."""
    r: Array
    """Variance of the noise of each sensor, shape (sensors,)."""
    c: Array
    """Gain of each sensor, shape (sensors,)."""
    offset: Array
    """Most likely offsets of the centred readings, that of the first sensor 0, shape (sensors,)."""
    spread: Array
    """Their covariance, shape (sensors, sensors)."""
    loglik: float
    """Log-likelihood in the unit of the data."""
    by_q: float
    """Its derivative by q."""
    by_tau: float
    """Its derivative by τ."""
    by_r: Array
    """Its derivatives by r, shape (sensors,)."""
    by_c: Array
    """Its derivatives by c, shape (sensors,)."""


def place_at(data: Readings, q: float, tau: float, r: Array, c: Array) -> Place:
    """The log-likelihood of these parameters with their best offsets; −inf where readings contradict r = 0."""
    sensors, record = data.sensors, (data.value, data.sensor, data.gap)
    offset, spread = np.zeros(sensors), np.zeros((sensors, sensors))
    if sensors > 1:
        matrix, right = np.zeros((sensors, sensors)), np.zeros(sensors)
        kernels.offset_equations(*record, q, tau, r, c, matrix, right)
        try:
            spread[1:, 1:] = np.linalg.inv(matrix[1:, 1:])
        except np.linalg.LinAlgError:  # q = 0 or r = 0 to the last digit: no offset is better than another
            spread[1:, 1:] = np.linalg.pinv(np.nan_to_num(matrix[1:, 1:]), hermitian=True)
        offset[1:] = spread[1:, 1:] @ right[1:]
    kept = np.empty((len(data.value), kernels.KEPT))
    chi2, logdet = kernels.filter_readings(*record, q, tau, r, c, offset, kept)
    loglik = -0.5 * (data.m * (math.log(2.0 * math.pi) + 2.0 * math.log(data.scale)) + logdet + chi2)
    by_r, by_c = np.zeros(sensors), np.zeros(sensors)
    by_q, by_tau = kernels.score_readings(*record, q, tau, r, c, offset, kept, by_r, by_c)
    if not math.isfinite(loglik):
        loglik = -math.inf
    return Place(q, tau, r, c, offset, spread, loglik, by_q, by_tau, by_r, by_c)


@dataclass(frozen=True)
class Coordinates:
    """Which parameters are searched, and how: ln(step variance), ln τ, ln r_i, c_i; all others stay.

    The step variance is that of one step of the signal: with momentum, q itself would run away as τ².
    """

    data: Readings
    """The record."""
    base: Place
    """The parameters that stay."""
    moves: bool
    """Whether q is searched."""
    keeps: bool
    """Whether τ is searched."""
    noisy: NDArray[np.intp]
    """The sensors whose r is searched."""
    gained: NDArray[np.intp]
    """The sensors whose c is searched."""

    @property
    def size(self) -> int:
        """Coordinates."""
        return int(self.moves) + int(self.keeps) + len(self.noisy) + len(self.gained)

    def noise_index(self, sensor: int) -> int:
        """The index of ln r of a sensor among the coordinates."""
        return int(self.moves) + int(self.keeps) + int(np.flatnonzero(self.noisy == sensor)[0])

    def start(self) -> Array:
        """The coordinates of `base`, shape (size,)."""
        head = [math.log(self.base.q * step_of(self.base.tau))] if self.moves else []
        head += [math.log(self.base.tau)] if self.keeps else []
        return np.concatenate([head, np.log(self.base.r[self.noisy]), self.base.c[self.gained]])

    def place(self, at: Array) -> Place:
        """The place of coordinates of shape (size,)."""
        parts = iter(at.tolist())
        log_step = next(parts) if self.moves else None
        tau = math.exp(next(parts)) if self.keeps else self.base.tau
        q = self.base.q * step_of(self.base.tau) if log_step is None else math.exp(log_step)
        r, c = self.base.r.copy(), self.base.c.copy()
        r[self.noisy] = np.exp(np.fromiter(parts, np.float64, len(self.noisy)))
        c[self.gained] = np.fromiter(parts, np.float64, len(self.gained))
        return place_at(self.data, q / step_of(tau), tau, r, c)

    def slope(self, at: Place) -> Array:
        """Derivatives of the log-likelihood by the coordinates, shape (size,)."""
        by_log_q = at.q * at.by_q
        head = [by_log_q] if self.moves else []
        if self.keeps:
            head.append(at.tau * at.by_tau - by_log_q * log_step_slope(at.tau))
        return np.concatenate([head, (at.r * at.by_r)[self.noisy], at.by_c[self.gained]])


def step_of(tau: float) -> float:
    """Variance of one step of the signal for q = 1."""
    return step_variance(tau) if tau > 0.0 else 1.0


def log_step_slope(tau: float) -> float:
    """Derivative of ln(step variance) by ln τ."""
    return (math.log(step_of(tau * (1.0 + _SLOPE))) - math.log(step_of(tau * (1.0 - _SLOPE)))) / (2.0 * _SLOPE)
