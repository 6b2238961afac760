"""A chain as a `Filter`, beside the Kalman filter of q and r: over a record, and sample by sample."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from kalscope.common.array import Array
from kalscope.common.checks import above_zero
from kalscope.errors import BadSetting
from kalscope.filtering.arrays import samples_of, step_of
from kalscope.filtering.classic.chain import Chain
from kalscope.filtering.classic.response import at_period, chain_response
from kalscope.filtering.classic.running import RunningChain, RunningStages
from kalscope.filtering.filter import FilterResult, KalmanFilter, denoise
from kalscope.filtering.params import FilterParams
from kalscope.filtering.steady_state import SteadyState


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
        return self.start().run(z, dt)

    def denoise(self, z: ArrayLike, dt: ArrayLike | None = None) -> Array:
        """The filtered signal only; arguments and errors as `denoise`."""
        return self.run(z, dt).x

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
            tau = self.params.momentum
            before[1:] -= tau * math.expm1(-1.0 / tau) * result.velocity[:-1]
        return before


class ChainStream:
    """The streaming chain: one `update` per sample, equal to `ChainFilter.run` bit for bit."""

    def __init__(self, made_of: ChainFilter) -> None:
        self._stages = RunningStages(made_of.chain.stages)
        self._kalman = KalmanFilter(made_of.params) if made_of.chain.then is None else None
        self._x = math.nan

    @property
    def x(self) -> float:
        """Filtered value, unit."""
        return self._x if self._kalman is None else self._kalman.x

    @property
    def p(self) -> float:
        """Posterior variance, unit²; NaN without a Kalman filter."""
        return math.nan if self._kalman is None else self._kalman.p

    @property
    def k(self) -> float | Array:
        """Gain of the last update, 0 … 1; NaN without a Kalman filter."""
        return math.nan if self._kalman is None else self._kalman.k

    def update(self, z: ArrayLike, dt: float | None = None) -> float:
        """Take one sample and return the filtered value; arguments and errors as `KalmanFilter.update`."""
        elapsed, sample = step_of(dt), samples_of(z)
        if sample.ndim or np.isinf(sample):
            raise BadSetting(f"z must be one finite number, or NaN where missing (got {z})")
        self._x = float(self._stages.take(sample.reshape(1), np.array([elapsed]))[0])
        if self._kalman is None:
            return self._x
        return self._kalman.update(math.nan if np.isnan(sample) else self._x, dt)
