"""The bench: the lag and the noise gain, measured, of filters that are not a fixed sum of samples.

The test signals come from the recording: its own noise, shuffled, and its own typical speed. Everything is
seeded, so the same recording gives the same numbers.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from kalscope.common.array import Array
from kalscope.filtering.classic.running import RunningStage
from kalscope.filtering.classic.stages import Exponential

Run = Callable[[Array], Array]

MAX_NOISE = 20_000
"""Samples of noise to draw from."""

MAX_RAMP = 200_000
"""Samples of the longest ramp."""


@dataclass(frozen=True)
class Bench:
    """A recording's noise, speed and length."""

    noise: Array
    """Deviations to draw from, unit, mean 0, shape (m,)."""
    speed: float
    """Typical change from sample to sample, unit, > 0."""
    samples: int
    """Length of the stretch: no window may be longer than half of it."""
    present_lag: float
    """Lag of the current filter in samples; it sets how long the ramps must be."""

    @property
    def longest_window(self) -> int:
        """The longest odd window that fits twice into the stretch."""
        half = max(self.samples // 2, 1)
        return half if half % 2 else half - 1

    def lag(self, run: Run) -> float:
        """Samples by which `run` trails a ramp of the typical speed under the recording's noise.

        Two ramps, up and down, carry the same noise, so the response to the noise cancels in their difference.
        """
        size = self.settle + min(self.settle + 2000, MAX_RAMP // 2)
        ramp = self.speed * np.arange(size)
        noise = self.drawn(size)
        apart = 0.5 * (run(noise + ramp) - run(noise - ramp))
        return float(np.mean(ramp[self.settle :] - apart[self.settle :])) / self.speed

    def noise_gain(self, run: Run) -> float:
        """Variance that `run` leaves of the recording's noise, as a share of it.

        Measured relative to exponential smoothing with the current lag, whose share K/(2 − K) is known: both see
        the same noise, so most of the random error of a finite record cancels.
        """
        left, known = run(self._rest)[self.settle :], self._known
        if np.array_equal(left, self._rest[self.settle :]):
            return 1.0  # measured, it would be 1 apart from that random error
        gain = 1.0 / (1.0 + self.present_lag)
        return float(np.mean(left**2)) / known * gain / (2.0 - gain)

    @cached_property
    def _rest(self) -> Array:
        return self.drawn(self.settle + MAX_RAMP)

    @cached_property
    def _known(self) -> float:
        """Variance that exponential smoothing of the present lag leaves of the noise, unit²."""
        known = RunningStage(Exponential(1.0 / (1.0 + self.present_lag)))
        return float(np.mean(known.take(self._rest, np.empty(0))[self.settle :] ** 2))

    @property
    def settle(self) -> int:
        """Samples after which a filter as slow as the current one has settled."""
        return min(int(15.0 * (self.present_lag + 1.0)) + 100, MAX_RAMP // 2)

    def drawn(self, size: int) -> Array:
        """`size` draws of the noise, always the same."""
        return np.resize(self._shuffled, size)

    @cached_property
    def _shuffled(self) -> Array:
        return np.random.default_rng(1).choice(self.noise, 2 * MAX_RAMP)


def step_overshoot(run: Run, size: int) -> float:
    """Overshoot of a linear filter's step response, as a share of the step; it peaks within `size` samples."""
    size = min(size, MAX_RAMP)
    step = np.repeat([0.0, 1.0], (size, 2 * size))
    return max(0.0, float(np.nanmax(run(step))) - 1.0)


def bench_of(z: Array, curve: Array, lag: float) -> Bench:
    """The bench of the samples z, shape (n,), NaN where missing, and a filtered curve of them.

    The noise is z less the mean of its two neighbours, times √(2/3), which leaves white noise its variance and
    removes slow movement; the speed is the RMS step of the curve.
    """
    rough = math.sqrt(2.0 / 3.0) * (z[1:-1] - 0.5 * (z[:-2] + z[2:]))
    rough = rough[np.isfinite(rough)]
    noise = rough[:: max(1, len(rough) // MAX_NOISE)]
    noise = noise - noise.mean() if len(noise) else noise
    if len(noise) < 8 or not noise.any():
        noise = np.random.default_rng(2).normal(size=1000)  # no noise: any scale will do
    steps = np.diff(curve)
    steps = steps[np.isfinite(steps)]
    speed = float(np.sqrt(np.mean(steps**2))) if len(steps) else 0.0
    return Bench(noise, speed or float(noise.std()), len(z), lag)
