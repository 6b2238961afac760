"""The filter with momentum in steady state: its gains, and its responses to a step, a ramp and white noise."""

from __future__ import annotations

import cmath
import functools
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from kalscope.common.array import Array
from kalscope.filtering.momentum.gains import Model, Pole

MIN_RATIO, MAX_RATIO = 1e-40, 1e40
"""q/r beyond these is not a useful filter: lags of 1e20 samples, or noise in the twentieth digit."""

_EXACT, _GRID = 2000, 6000
"""The first samples of a step are all evaluated; later ones on a grid with even steps in its logarithm."""
_LEFT = 1e-5
"""Share of a step that is left where the grid ends."""
_FIRST = np.arange(200.0)
"""The first samples, where a fast oscillation has its minimum; that of a slow one is where its slope is 0."""


@dataclass(frozen=True)
class Settled:
    """The settled filter x += K (z - ahead), v += L (z - ahead), and what it does; times in samples."""

    gain: float
    """K, the share of each innovation that is added to the estimate, 0 … 1."""
    velocity_gain: float
    """L, the share that is added to the velocity, per sample."""
    lag: float
    """Lag on a ramp."""
    noise: float
    """White noise, variance out to in, 0 … 1."""
    cutoff: float
    """-3 dB frequency in cycles per sample; NaN where there is none below ½."""
    overshoot: float
    """Overshoot of the step response, as a share of the step."""
    settling: float
    """Time after which no more than the share `left` of a step is missing or too much."""
    time_constant: float
    """Time until 63 % of a step is reached."""


def settle(q: float, r: float, tau: float, left: float) -> Settled:
    """The settled filter of q > 0, r ≥ 0 and τ > 0; `left` is the share of a step at the settling time."""
    model = Model.of(tau)
    if r == 0.0:
        velocity_gain = model.velocity_gain(1.0, model.reach_without_noise())
        return Settled(1.0, velocity_gain, 0.0, 1.0, math.nan, 0.0, 0.0, 0.0)
    step = StepError.of(model, q / r)
    gain, kept, product = step.gain, step.kept, step.product
    u = model.cutoff(gain, kept, product)
    return Settled(
        gain=gain,
        velocity_gain=model.velocity_gain(gain, product / model.forgotten),
        lag=model.forgotten * kept / product,
        noise=model.noise(gain, kept, product),
        cutoff=math.asin(0.5 * math.sqrt(u)) / math.pi if u <= 4.0 else math.nan,
        overshoot=step.overshoot(),
        settling=step.last_above(left),
        time_constant=step.first_below(math.exp(-1.0)),
    )


def overshoot_of(ratio: float, tau: float) -> float:
    """The overshoot of `settle` alone, for q/r = `ratio`."""
    return StepError.of(Model.of(tau), ratio).overshoot()


class StepError:
    """What is missing of a step after n + 1 samples: e(n) = e(0) S(n) - (t e(0) - e(1)) S(n - 1)."""

    def __init__(self, gain: float, kept: float, product: float, poles: tuple[Pole, Pole]) -> None:
        """Args: K and 1 - K, the product of the distances of the poles from 1, and the poles."""
        self.gain, self.kept, self.product, self._poles = gain, kept, product, poles
        total = (poles[0].z + poles[1].z).real
        after_two = kept - (product - gain * (1.0 - total))
        self._weights = kept, total * kept - after_two

    @classmethod
    def of(cls, model: Model, ratio: float) -> StepError:
        """Args: the momentum, and q/r above 0."""
        ratio = min(max(ratio, MIN_RATIO), MAX_RATIO)
        first, second = model.poles(ratio)
        product = (first.d * second.d).real
        reach = product / model.forgotten
        return cls(model.gain(reach), min(1.0, reach * reach / ratio), product, (first, second))

    @functools.cached_property
    def _grid(self) -> tuple[Array, Array]:
        """Times, and the errors at them."""
        decay = -max(pole.log_radius for pole in self._poles)
        end = max(-math.log(_LEFT) / decay, 2.0 * _EXACT)
        grid = np.unique(np.rint(np.geomspace(_EXACT, end, _GRID)))
        samples = np.concatenate([np.arange(float(_EXACT)), grid[1:]])
        return np.concatenate([[0.0], samples + 1.0]), np.concatenate([[1.0], self._after(samples)])

    def _after(self, n: Array) -> Array:
        """Error after n + 1 samples."""
        return self._weights[0] * self._powers(n) - self._weights[1] * self._powers(n - 1.0)

    def _powers(self, n: Array) -> Array:
        """S(n) = (z1^(n+1) - z2^(n+1)) / (z1 - z2), also for poles that are equal."""
        first, second = self._poles
        if first.z.imag:
            angle = abs(cmath.phase(first.z))
            return np.exp(first.log_radius * n) * np.sin((n + 1.0) * angle) / math.sin(angle)
        gap = (second.d - first.d).real
        if gap == 0.0:
            return (n + 1.0) * first.power(n)
        return (first.power(n + 1.0) - second.power(n + 1.0)) / gap

    def overshoot(self) -> float:
        """How far it goes below 0."""
        swings = bool(self._poles[0].z.imag)
        seen = self._after(np.concatenate([_FIRST, self._valley()])) if swings else self._grid[1]
        return max(0.0, -float(seen.min()))

    def _valley(self) -> Array:
        """The whole samples around the first minimum of e(n) between complex poles.

        With z = exp(-s ± ia) the error is exp(-sn) (A sin an + B cos an), up to a factor: its slope is 0 where
        tan an = (aA - sB)/(sA + aB). The first minimum is the lowest one.
        """
        first, _ = self._poles
        s, angle = -first.log_radius, abs(cmath.phase(first.z))
        a, b = (
            self._weights[0] * math.cos(angle) - self._weights[1] * math.exp(s),
            self._weights[0] * math.sin(angle),
        )
        n = math.atan2(angle * a - s * b, s * a + angle * b) % math.pi / angle
        around = [n, n + math.pi / angle]
        return np.array([value for each in around for value in (math.floor(each), math.floor(each) + 1.0)])

    def first_below(self, share: float) -> float:
        """Time until no more than `share` is missing, between samples as on an exponential."""
        at = self._first_whole(int(np.argmax(self._grid[1] <= share)), lambda error: error <= share)
        before, after = self._at(at - 1.0), max(self._at(at), 1e-300)
        if before <= after:  # one sample is negligible in times of 1e16
            return at
        return at - 1.0 + math.log(before / share) / math.log(before / after)

    def last_above(self, share: float) -> float:
        """Time after which the error stays within ± `share`, in whole samples."""
        last = int(np.flatnonzero(np.abs(self._grid[1]) > share)[-1])
        return self._first_whole(last + 1, lambda error: abs(error) <= share)

    def _first_whole(self, at: int, holds: Callable[[float], bool]) -> float:
        """The first whole time at which `holds`, after the one of the grid before `at`, where it does not yet."""
        low, high = float(self._grid[0][at - 1]), float(self._grid[0][at])
        for _ in range(64):
            if high - low <= 1.0:
                break
            middle = math.floor(0.5 * (low + high))
            low, high = (low, middle) if holds(self._at(middle)) else (middle, high)
        return high

    def _at(self, time: float) -> float:
        """The error after `time` samples."""
        return 1.0 if time == 0.0 else float(self._after(np.array([time - 1.0]))[0])
