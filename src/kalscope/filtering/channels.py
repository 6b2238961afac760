"""The filter of one channel with its state: the five lines, or with momentum. All drivers run these."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from kalscope.errors import BadSetting
from kalscope.filtering import kernels
from kalscope.filtering.momentum import kernels as momentum_kernels
from kalscope.filtering.momentum import smoothing_kernels as momentum_smoothing
from kalscope.filtering.params import require_params

if TYPE_CHECKING:
    from kalscope.common.array import Array
    from kalscope.filtering.params import FilterParams, Parameter

Rows = Sequence["Array"]
"""Arrays of one length to write into."""

Sums = tuple[float, int, int]
"""Log-likelihood over the m scored innovations, m, and the samples that the gate rejected."""


class FiveLines:
    """The scalar filter: a signal that moves at random."""

    rows = 5
    """Arrays that `filter` writes: x, p, k, innovation and s."""
    smoothed_rows = 2
    """Arrays that `smooth` writes: x and p."""
    velocity = math.nan
    """The model has none."""

    def __init__(self, q: float, r: float, gate: float, x: float, p: float) -> None:
        """Args: the parameters of one channel; x = NaN and p = inf stand for the automatic start."""
        self.q, self.r, self.gate, self.x, self.p = q, r, gate, x, p
        self.k = 0.0
        self.started = False
        self._in_a_row = 0

    def take(self, z: float, dt: float) -> None:
        """Take one sample."""
        self.started = True
        self.x, self.p, self.k, _, _, done = kernels.step(
            z, dt, self.q, self.r, self.gate, self.x, self.p, self._in_a_row
        )
        if done == kernels.REJECTED:
            self._in_a_row += 1
        elif done != kernels.MISSING:
            self._in_a_row = 0

    def filter(self, z: Array, dt: Array, out: Rows) -> Sums:
        """Take the samples z into the rows of `out`; dt may be empty."""
        x, p, k, v, s = out
        loglik, m, refused, self._in_a_row = kernels.filter_channel(
            z, dt, self.q, self.r, self.gate, self.x, self.p, self._in_a_row, (x, p, k, v, s)
        )
        if len(z):
            self.started = True
            self.x, self.p, self.k = float(x[-1]), float(p[-1]), float(k[-1])
        return loglik, m, refused

    def denoise(self, z: Array, dt: Array, out: Array) -> int:
        """X only, from the start; -1, or the index of the first infinite sample."""
        return kernels.denoise_channel(z, dt, self.q, self.r, self.gate, self.x, self.p, out)

    def smooth(self, z: Array, dt: Array, out: Rows) -> None:
        """Smooth z, from the start, into the rows of `out`."""
        kernels.smooth_channel(z, dt, self.q, self.r, self.gate, self.x, self.p, out[0], out[1])


class WithMomentum:
    """The filter of a signal that keeps its direction for a while: its second state is the velocity."""

    rows = 7
    """Arrays that `filter` writes: those of the five lines, the velocity and its variance."""
    smoothed_rows = 4
    """Arrays that `smooth` writes: x, p, the velocity and its variance."""

    def __init__(self, q: float, r: float, momentum: float, gate: float, x: float, p: float) -> None:
        """Args: as `FiveLines`, and the momentum τ in sample periods, above 0."""
        self.q, self.r, self.momentum, self.gate = q, r, momentum, gate
        self._state: momentum_kernels.State = (x, 0.0, p, 0.0, 0.5 * q / momentum)
        self.k = 0.0
        self.started = False
        self._in_a_row = 0
        self._dt, self._over = 1.0, momentum_kernels.transition(1.0, q, momentum)

    @property
    def x(self) -> float:
        """Filtered value."""
        return self._state[0]

    @property
    def p(self) -> float:
        """Its variance."""
        return self._state[2]

    @property
    def velocity(self) -> float:
        """Filtered velocity, unit per sample period."""
        return self._state[1]

    def take(self, z: float, dt: float) -> None:
        """Take one sample."""
        self.started = True
        if dt != self._dt:
            self._dt, self._over = dt, momentum_kernels.transition(dt, self.q, self.momentum)
        self._state, self.k, _, _, done = momentum_kernels.step(
            z, self._over, self.r, self.gate, self._state, self._in_a_row
        )
        if done == kernels.REJECTED:
            self._in_a_row += 1
        elif done != kernels.MISSING:
            self._in_a_row = 0

    def filter(self, z: Array, dt: Array, out: Rows) -> Sums:
        """Take the samples z into the rows of `out`; dt may be empty."""
        x, p, k, innovation, s, v, w = out
        self._state, loglik, m, refused, self._in_a_row = momentum_kernels.filter_channel(
            z,
            dt,
            self.q,
            self.r,
            self.momentum,
            self.gate,
            self._state,
            self._in_a_row,
            (x, p, k, innovation, s, v, w),
        )
        if len(z):
            self.started = True
            self.k = float(k[-1])
        return loglik, m, refused

    def denoise(self, z: Array, dt: Array, out: Array) -> int:
        """X only, from the start; -1, or the index of the first infinite sample."""
        return momentum_kernels.denoise_channel(z, dt, self.q, self.r, self.momentum, self.gate, self._state, out)

    def smooth(self, z: Array, dt: Array, out: Rows) -> None:
        """Smooth z, from the start, into the rows of `out`."""
        x, p, v, w = out
        momentum_smoothing.smooth_channel(
            z, dt, self.q, self.r, self.momentum, self.gate, self._state, (x, p, v, w)
        )


ChannelFilter = FiveLines | WithMomentum


def channel_filters(params: FilterParams, channels: int) -> list[ChannelFilter]:
    """The filter of each channel, at its start.

    Raises:
        BadSetting: params hold another number of channels, or there are none.
    """
    require_params(params)
    if params.channels not in (None, channels):
        raise BadSetting(f"params must fit z: they hold {params.channels} channels (got z with {channels})")

    def spread(value: Parameter | None, missing: float) -> list[float]:
        return np.broadcast_to(missing if value is None else value, channels).astype(float).tolist()

    rows = zip(
        spread(params.q, 0.0),
        spread(params.r, 0.0),
        spread(params.momentum, 0.0),
        spread(params.gate, math.inf),
        spread(params.x0, math.nan),
        spread(params.p0, math.inf),
        strict=True,
    )
    return [
        WithMomentum(q, r, momentum, gate, x, p) if momentum > 0.0 else FiveLines(q, r, gate, x, p)
        for q, r, momentum, gate, x, p in rows
    ]
