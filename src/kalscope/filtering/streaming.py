"""The streaming filter: one update per sample."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from kalscope.common.array import Array
from kalscope.errors import BadSetting
from kalscope.filtering.arrays import samples_of, step_of
from kalscope.filtering.channels import ChannelFilter, channel_filters
from kalscope.filtering.params import FilterParams, require_params


class KalmanFilter:
    """The streaming filter: one `update` per sample, equal to `kalman_filter` bit for bit.

    `x`, `p` and `k` are the state after the last update: floats, or arrays of shape (channels,) once the
    samples are arrays. Before the first finite sample of a diffuse start x is NaN, p inf and k 0.
    """

    def __init__(self, params: FilterParams) -> None:
        require_params(params)
        self.params = params
        self._scalar = params.channels is None
        self._states: list[ChannelFilter] = channel_filters(params, params.channels or 1)

    @property
    def x(self) -> float | Array:
        """Filtered value, unit."""
        return self._gather([state.x for state in self._states])

    @property
    def p(self) -> float | Array:
        """Posterior variance, unit²."""
        return self._gather([state.p for state in self._states])

    @property
    def k(self) -> float | Array:
        """Gain of the last update, 0 … 1."""
        return self._gather([state.k for state in self._states])

    @property
    def velocity(self) -> float | Array:
        """Filtered velocity, unit per nominal sample period; NaN without momentum."""
        return self._gather([state.velocity for state in self._states])

    def update(self, z: ArrayLike, dt: float | None = None) -> float | Array:
        """Take one sample and return the filtered value.

        Args:
            z: the sample, a number or shape (channels,); NaN is a missing sample (predict only).
            dt: nominal sample periods since the last sample, ≥ 0; None = 1.

        Raises:
            BadSetting: z is infinite or has another number of channels; dt is negative. The state stays.
        """
        step = step_of(dt)
        if self._scalar and isinstance(z, float) and not math.isinf(z):  # the usual case, without arrays
            state = self._states[0]
            state.take(z, step)
            return state.x
        samples = np.atleast_1d(samples_of(z))
        if np.ndim(z) == 1 and self._scalar:
            self._spread(len(samples))
        if samples.shape != (len(self._states),):
            raise BadSetting(f"z must hold {len(self._states)} channels (got shape {samples.shape})")
        if np.isinf(samples).any():
            raise BadSetting(f"z must be finite, or NaN where missing (got {z})")
        for state, sample in zip(self._states, samples, strict=True):
            state.take(float(sample), step)
        return self.x

    def _spread(self, channels: int) -> None:
        """Scalar parameters meet an array of channels: one filter each, if none has started."""
        if self._states[0].started:
            raise BadSetting(f"z must stay a single number (got {channels} channels)")
        self._scalar = False
        self._states = channel_filters(self.params, channels)

    def _gather(self, values: list[float]) -> float | Array:
        return values[0] if self._scalar else np.array(values)
