"""A chain as a `Filter`, beside the Kalman filter of q and r: over a record, and sample by sample."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from kalscope.common.array import Array
from kalscope.common.checks import above_zero
from kalscope.errors import BadSetting
from kalscope.filtering.arrays import (
    columns_of,
    refuse_infinite,
    samples_of,
    scalar,
    shaped_like,
    step_of,
    steps_of,
)
from kalscope.filtering.batch import FilterResult, denoise, kalman_filter
from kalscope.filtering.classic.chain import Chain
from kalscope.filtering.classic.response import at_period, chain_response
from kalscope.filtering.classic.running import RunningChain, RunningStages
from kalscope.filtering.params import FilterParams
from kalscope.filtering.steady_state import SteadyState
from kalscope.filtering.streaming import KalmanFilter


@dataclass(frozen=True)
class ChainFilter:
    """A chain with the parameters of the channel's Kalman filter, which runs where the chain names no other."""

    chain: Chain
    """The filters."""
    params: FilterParams
    """q, r, … of the channel; without effect where `chain.then` is a classic filter."""

    @property
    def is_standard(self) -> bool:
        """False: q and r alone do not describe it."""
        return False

    def run(self, z: ArrayLike, dt: ArrayLike | None = None) -> FilterResult:
        """Filter a record; arguments and errors as `kalman_filter`.

        Returns:
            `x` is the output, held where z is missing; `innovation` is z minus the previous output, or minus what
            the Kalman filter predicted. p, k and s are those of the Kalman filter, NaN where another one is last.
            `loglik` is NaN and `m` 0: the samples behind a median are not independent measurements.
        """
        staged = self._staged(z, dt)
        if self.chain.then is None:
            found = kalman_filter(staged, self.params, dt)
            innovation = samples_of(z) - (staged - found.innovation)
            return replace(found, innovation=innovation, loglik=found.loglik * math.nan, m=found.m * 0)
        before, unknown = np.full(staged.shape, np.nan), np.full(staged.shape, np.nan)
        before[1:] = staged[:-1]
        innovation = samples_of(z) - before
        rest = (math.nan, 0, 0)
        if staged.ndim == 2:
            none = np.zeros(staged.shape[1], dtype=np.int64)
            rest = (np.full(staged.shape[1], math.nan), none, none)
        return FilterResult(staged, unknown, unknown, innovation, unknown, *rest)

    def denoise(self, z: ArrayLike, dt: ArrayLike | None = None) -> Array:
        """The filtered signal only; arguments and errors as `denoise`."""
        staged = self._staged(z, dt)
        return denoise(staged, self.params, dt) if self.chain.then is None else staged

    def start(self) -> RunningChain:
        """The chain at its start, over a record that grows."""
        return RunningChain(self.chain.stages, self.params if self.chain.then is None else None)

    def stream(self) -> ChainStream:
        """A `ChainStream`."""
        return ChainStream(self)

    def settled(self, result: FilterResult, sample_period: float | None = None) -> SteadyState:
        """Lag, noise reduction and settling once the start is forgotten.

        By formula for a linear filter alone. Lag and noise of a chain with a median or a one-euro filter are
        measured with the noise of this run, and with the speed of the output of the Kalman filter of `params`,
        whatever the chain; a one-euro filter settles as it does at speed 0. The gain and the overshoot are those of
        the last filter; NaN marks what a filter does not have: a gain, a cut-off, a variance.

        Args:
            result: a run of this chain over one channel.
            sample_period: nominal sample period in s, > 0.

        Raises:
            BadSetting: the sample period is not a positive finite number.
        """
        period = None if sample_period is None else above_zero("sample_period", sample_period)
        z = result.innovation + self._predicted(result)
        return at_period(chain_response(self.chain, self.params, (z, denoise(z, self.params))), period)

    def _predicted(self, result: FilterResult) -> Array:
        """The predictions behind the innovations of a run, shape (n,); NaN at its first sample."""
        before = np.full(result.x.shape, np.nan)
        before[1:] = result.x[:-1]
        if self.chain.then is None and result.velocity is not None:
            tau = scalar(self.params.momentum)
            before[1:] -= tau * math.expm1(-1.0 / tau) * result.velocity[:-1]
        return before

    def _staged(self, z: ArrayLike, dt: ArrayLike | None) -> Array:
        """The output of the classic filters, shape of z; NaN where z is missing if the Kalman filter follows."""
        columns, shape = columns_of(z)
        steps = steps_of(dt, columns.shape[1])
        refuse_infinite(columns)
        out = np.empty_like(columns)
        for row, column in zip(out, columns, strict=True):
            row[:] = RunningStages(self.chain.stages).take(column, steps)
        if self.chain.then is None:
            out[np.isnan(columns)] = np.nan
        return shaped_like(out, shape)


class ChainStream:
    """The streaming chain: one `update` per sample, equal to `ChainFilter.run` bit for bit.

    `x`, `p` and `k` are as `run` gives them: floats, or arrays of shape (channels,) once the samples are arrays.
    """

    def __init__(self, made_of: ChainFilter) -> None:
        self._stages = made_of.chain.stages
        self._kalman = KalmanFilter(made_of.params) if made_of.chain.then is None else None
        self._channels: list[RunningStages] = []
        self._x: float | Array = math.nan

    @property
    def x(self) -> float | Array:
        """Filtered value, unit."""
        return self._x if self._kalman is None else self._kalman.x

    @property
    def p(self) -> float | Array:
        """Posterior variance, unit²; NaN without a Kalman filter."""
        return self._x * math.nan if self._kalman is None else self._kalman.p

    @property
    def k(self) -> float | Array:
        """Gain of the last update, 0 … 1; NaN without a Kalman filter."""
        return self._x * math.nan if self._kalman is None else self._kalman.k

    def update(self, z: ArrayLike, dt: float | None = None) -> float | Array:
        """Take one sample and return the filtered value; arguments and errors as `KalmanFilter.update`."""
        step = step_of(dt)
        samples = samples_of(z)
        if samples.ndim > 1 or samples.size == 0:
            raise BadSetting(f"z must be a number or hold one value per channel (got shape {samples.shape})")
        each = np.atleast_1d(samples)
        if np.isinf(each).any():
            raise BadSetting(f"z must be finite, or NaN where missing (got {z})")
        if self._channels and (len(each) != len(self._channels) or samples.ndim != np.ndim(self._x)):
            raise BadSetting(f"z must hold {len(self._channels)} channels (got shape {samples.shape})")
        self._channels = self._channels or [RunningStages(self._stages) for _ in each]
        steps = np.array([step])
        pairs = zip(self._channels, each, strict=True)
        staged = np.array([one.take(np.array([sample]), steps)[0] for one, sample in pairs])
        self._x = staged if samples.ndim else float(staged[0])
        if self._kalman is None:
            return self._x
        missing = np.where(np.isnan(each), np.nan, staged)
        return self._kalman.update(missing if samples.ndim else float(missing[0]), dt)
