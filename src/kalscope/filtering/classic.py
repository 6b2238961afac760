"""The classic filters (moving average, median, one-euro, …) and chains: settings, response, filter."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kalscope.common.numbers import Array, above_zero, bisect, in_range
from kalscope.errors import BadSetting
from kalscope.filtering import classic_kernels
from kalscope.filtering.filter import Filter, FilterResult, KalmanFilter, denoise
from kalscope.filtering.params import FilterParams, one_record, one_sample, step_of
from kalscope.filtering.steady import SETTLED, SteadyState, at_period, params_of_gain, steady_state

# Checks of the settings of the classic filters.


MAX_WINDOW = 100_000
"""Longest window accepted, samples."""


def odd_window(name: str, value: Any) -> int:
    """A window of a median: an odd number of samples."""
    window = whole(name, value, 1, MAX_WINDOW - 1)
    if window % 2 == 0:
        raise BadSetting(f"{name} must be an odd number of samples, such as {window + 1} (got {window})")
    return window


def whole(name: str, value: Any, least: int, most: int) -> int:
    """`value` as an int from `least` to `most`; 9.0 is one too."""
    must = f"a whole number from {least} to {most}"
    number = in_range(name, value, least, most, must)
    if not number.is_integer():
        raise BadSetting(f"{name} must be {must} (got {value!r})")
    return int(number)


# The classic filters as frozen, checked values: what they are, what they cost, and how a device begins them.
#
# Lag is the lag on a ramp, in samples; noise gain is the variance that is left of white noise, Σh². Both are None
# where no formula gives them, because they depend on the signal.


MIN_ALPHA = 2.0**-30
"""Smallest share of each step accepted: a time constant of a billion samples."""
MIN_CUTOFF, MAX_CUTOFF = 1e-6, 0.499
"""Cut-offs of the Butterworth filter, cycles per sample."""
MIN_NOTCH, MAX_NOTCH = 0.005, 0.495
"""Frequencies of a notch, cycles per sample."""
MIN_WIDTH, MAX_WIDTH = 1e-4, 0.2
"""Widths of a notch, cycles per sample."""
MIN_EURO_CUTOFF, MAX_EURO_CUTOFF = 1e-12, 1e9
"""Cut-offs of the one-euro filter, cycles per sample; it may pass everything."""
MAX_BETA = 1e300
"""Largest growth of a cut-off accepted: the unit of the signal may be anything."""
BEYOND = 1e30
"""Angle beyond which the one-euro filter passes the sample itself: 1/(1 + 1e30) is below any rounding."""


class _Stage:
    """What the filters have in common."""

    name: ClassVar[str]
    _setting: ClassVar[str]

    @property
    def words(self) -> str:
        """Its setting, for the user."""
        return self._setting.format(self)


class _Windowed(_Stage):
    """A filter of the last samples."""

    window: int
    _setting: ClassVar[str] = "window of {0.window}"

    @property
    def start_samples(self) -> int:
        """Samples until the start is forgotten."""
        return self.window


@dataclass(frozen=True)
class MovingAverage(_Windowed):
    """Mean of the last `window` samples, or of fewer at the start."""

    window: int
    """Samples, 1 … 100,000."""
    name: ClassVar[str] = "Moving average"
    constants: ClassVar = (1.0,)
    """What its loop needs to know."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "window", whole("window", self.window, 1, MAX_WINDOW))

    @property
    def memory(self) -> int:
        """Numbers that it remembers: the window, two sums with their levels, the count and the output."""
        return self.window + 6

    @property
    def lag(self) -> float:
        """Lag in samples."""
        return 0.5 * (self.window - 1)

    @property
    def noise_gain(self) -> float:
        """Share of the variance of white noise that is left."""
        return 1.0 / self.window


@dataclass(frozen=True)
class Exponential(_Stage):
    """Exponential smoothing, x += α (z − x), begun at the first sample."""

    alpha: float
    """Share of each step that is taken, 2^-30 … 1."""
    name: ClassVar[str] = "Exponential"
    _setting: ClassVar[str] = "α = {0.alpha:.4g}"
    memory: ClassVar[int] = 2
    """Numbers that it remembers: the output, and what rounding left out of it."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "alpha", in_range("alpha", self.alpha, MIN_ALPHA, 1.0))

    @property
    def constants(self) -> tuple[float, ...]:
        """What its loop needs to know."""
        return (self.alpha,)

    @property
    def lag(self) -> float:
        """Lag in samples."""
        return (1.0 - self.alpha) / self.alpha

    @property
    def noise_gain(self) -> float:
        """Share of the variance of white noise that is left."""
        return self.alpha / (2.0 - self.alpha)

    @property
    def start_samples(self) -> int:
        """Samples until 1 % of the start is left."""
        return 1 if self.alpha >= 1.0 else max(1, math.ceil(math.log(SETTLED) / math.log1p(-self.alpha)))


@dataclass(frozen=True)
class Median(_Windowed):
    """Median of the last `window` samples; the window begins filled with the first one."""

    window: int
    """Samples, an odd number, 1 … 99,999."""
    name: ClassVar[str] = "Median"
    lag: ClassVar[None] = None
    noise_gain: ClassVar[None] = None
    constants: ClassVar = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "window", odd_window("window", self.window))

    @property
    def memory(self) -> int:
        """Numbers that it remembers: the window as it came, the same in order of size, and the output."""
        return 2 * self.window + 1


@dataclass(frozen=True)
class Butterworth(_Stage):
    """Second-order low-pass, settled at the first sample."""

    cutoff: float
    """−3 dB frequency in cycles per sample, 1e-6 … 0.499."""
    name: ClassVar[str] = "2nd-order Butterworth"
    _setting: ClassVar[str] = "cut-off {0.cutoff:.3g}"
    memory: ClassVar[int] = 4
    """Numbers that it remembers: output, level, what rounding left out of the level, slope."""

    def __post_init__(self) -> None:
        checked = in_range("cutoff in cycles per sample", self.cutoff, MIN_CUTOFF, MAX_CUTOFF)
        object.__setattr__(self, "cutoff", checked)

    @property
    def constants(self) -> tuple[float, ...]:
        """What its loop needs to know, shares per sample.

        The share of the distance that is added to the slope, and of the slope to the level; the share of the slope
        that is lost; the share of the distance that is added to the level; and 1/2.
        """
        g = self.slope
        whole = 1.0 + g * (g + math.sqrt(2.0))
        return 2.0 * g / whole, 2.0 * g * (g + math.sqrt(2.0)) / whole, 2.0 * g * g / whole, 0.5

    @property
    def slope(self) -> float:
        """Half of the angle Ω that the bilinear transform makes of the cut-off."""
        return math.tan(math.pi * self.cutoff)

    @property
    def lag(self) -> float:
        """Lag in samples: the bilinear transform keeps the delay at frequency 0, √2/Ω."""
        return math.sqrt(0.5) / self.slope

    @property
    def noise_gain(self) -> float:
        """∫|H|² with |H|² = 1/(1 + (tan πf / c)⁴), c = tan πf₀, in closed form."""
        c = self.slope
        return (c**4 + math.sqrt(0.5) * (c - c**3)) / (1.0 + c**4)

    @property
    def start_samples(self) -> int:
        """Samples until 1 % of the start is left: its poles decay by exp(−Ω/√2)."""
        return math.ceil(-math.log(SETTLED) * self.lag) + 1


@dataclass(frozen=True)
class OneEuro(_Stage):
    """Exponential smoothing whose cut-off grows with the speed: smooth when still, quick when moving."""

    cutoff: float
    """Cut-off at speed 0, cycles per sample, 1e-12 … 1e9."""
    beta: float
    """How much it grows for a speed of 1 unit per sample, cycles per unit, 0 … 1e300."""
    speed_cutoff: float
    """Cut-off of the speed itself, cycles per sample, 1e-12 … 1e9."""
    name: ClassVar[str] = "One-euro"
    _setting: ClassVar[str] = "cut-off {0.cutoff:.3g}, β {0.beta:.2g}"
    lag: ClassVar[None] = None
    noise_gain: ClassVar[None] = None
    memory: ClassVar[int] = 4
    """Numbers that it remembers: output, what rounding left out of it, speed, time since the last sample."""

    def __post_init__(self) -> None:
        for name in ("cutoff", "speed_cutoff"):
            checked = in_range(
                f"{name} in cycles per sample", getattr(self, name), MIN_EURO_CUTOFF, MAX_EURO_CUTOFF
            )
            object.__setattr__(self, name, checked)
        object.__setattr__(self, "beta", in_range("beta", self.beta, 0.0, MAX_BETA))

    @property
    def constants(self) -> tuple[float, ...]:
        """Angles a sample: at speed 0, their growth with the speed, that of the speed; and two plain numbers."""
        turn = 2.0 * math.pi
        return turn * self.cutoff, turn * self.beta, turn * self.speed_cutoff, 1.0, BEYOND

    @property
    def start_samples(self) -> int:
        """Samples until 1 % of the start is left, at the speed that doubles the cut-off."""
        return max(1, math.ceil(-math.log(SETTLED) / math.log1p(4.0 * math.pi * self.cutoff)))


@dataclass(frozen=True)
class Notch(_Stage):
    """Second-order filter that takes one frequency out and passes all others, settled at the first sample."""

    frequency: float
    """What is taken out, cycles per sample, 0.005 … 0.495."""
    width: float
    """Between the two frequencies whose power is halved, cycles per sample, 1e-4 … 0.2."""
    name: ClassVar[str] = "Notch"
    _setting: ClassVar[str] = "at {0.frequency:.4g} cycles a sample, width {0.width:.2g}"
    memory: ClassVar[int] = 4
    """Numbers that it remembers: output, level, two sums."""

    def __post_init__(self) -> None:
        for name, least, most in (("frequency", MIN_NOTCH, MAX_NOTCH), ("width", MIN_WIDTH, MAX_WIDTH)):
            checked = in_range(f"{name} of a notch in cycles per sample", getattr(self, name), least, most)
            object.__setattr__(self, name, checked)

    @property
    def constants(self) -> tuple[float, float, float]:
        """What its loop needs to know, those of `scipy.signal.iirnotch`: b = (g, t, g), a = (1, t, 2g − 1)."""
        gain = self.noise_gain
        return gain, -2.0 * gain * math.cos(2.0 * math.pi * self.frequency), 2.0 * gain - 1.0

    @property
    def noise_gain(self) -> float:
        """Share of the variance of white noise that is left: Σh² of (1 + A)/2, A an all-pass that begins 2g − 1."""
        return 1.0 / (1.0 + math.tan(math.pi * self.width))

    @property
    def lag(self) -> float:
        """Lag in samples: the delay at frequency 0."""
        gain = self.noise_gain
        return (1.0 - gain) / (gain * (1.0 - math.cos(2.0 * math.pi * self.frequency)))

    @property
    def start_samples(self) -> int:
        """Samples until 1 % of the start is left: its poles decay by √(2g − 1), or by less where they are real."""
        decay = self.constants[2]
        return math.ceil(2.0 * math.log(SETTLED) / math.log(decay)) if 0.0 < decay < 1.0 else 2


Stage = MovingAverage | Exponential | Median | Butterworth | OneEuro


# A chain: a median, a notch, and what follows them.


@dataclass(frozen=True)
class Chain:
    """A median, a notch, then a classic filter or the channel's own Kalman filter.

    Raises:
        BadSetting: The median is not an odd number of samples; or there is neither a median, a notch nor a classic
            filter: then there is no chain, and the Kalman filter runs alone.
    """

    median: int = 1
    """Window of the median in samples, an odd number; 1 = none."""
    then: Stage | None = None
    """The filter behind them; None = the Kalman filter of the channel's q, r, p0, x0, gate and momentum."""
    notch: Notch | None = None
    """The notch behind the median, which no spike makes ring; None = none."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "median", odd_window("median", self.median))
        if self.then is not None and type(self.then) not in get_args(Stage):
            raise BadSetting(f"then must be a classic filter, or None for the Kalman filter (got {self.then!r})")
        if self.notch is not None and type(self.notch) is not Notch:
            raise BadSetting(f"notch must be a Notch, or None (got {self.notch!r})")
        if self.median == 1 and self.notch is None and self.then is None:
            must = "a chain must have a median of at least 3 samples, a notch, or a filter in place of Kalman's"
            raise BadSetting(f"{must} (got neither)")

    @property
    def first(self) -> tuple[Median | Notch, ...]:
        """What runs before `then`."""
        return (*((Median(self.median),) if self.median > 1 else ()), *((self.notch,) if self.notch else ()))

    @property
    def stages(self) -> tuple[Stage | Notch, ...]:
        """The classic filters, in order; where `then` is None the Kalman filter follows them."""
        return self.first if self.then is None else (*self.first, self.then)

    @property
    def words(self) -> str:
        """The chain for the user, within a sentence: "median of 5, then one-euro (cut-off 0.02, β 0.1)"."""
        last = "Kalman"
        if self.then is not None:
            last = f"{self.then.name[:1].lower()}{self.then.name[1:]} ({self.then.words})"
        first = [f"median of {self.median}"] if self.median > 1 else []
        first += [f"notch ({self.notch.words})"] if self.notch else []
        return ", then ".join((*first, last))


# A classic filter with its state: what a record, a stream and the float32 of a board all run.


Floats = NDArray[Any]
"""float64, or float32 as a board computes."""

LONG_WINDOW = 75
"""A median of more samples is quicker by scipy than by moving each sample to its place."""
MANY_MOVES = 5e7
"""Samples times window from which on that is worth importing scipy."""

_Loop = Callable[[Floats, Floats, Floats, Floats, classic_kernels.Counters, Floats], None]
_LOOPS: dict[type[Stage | Notch], _Loop] = {
    MovingAverage: classic_kernels.moving_average,
    Exponential: classic_kernels.exponential,
    Median: classic_kernels.median,
    Butterworth: classic_kernels.butterworth,
    OneEuro: classic_kernels.one_euro,
    Notch: classic_kernels.notch,
}


class RunningStage:
    """One classic filter over one channel, from its start on; bit for bit the same in pieces and in one go."""

    def __init__(self, stage: Stage | Notch, kind: type[np.float64 | np.float32] = np.float64) -> None:
        """Args: the filter, and the type to compute in: float32 as a board does."""
        self._loop, self._kind = _LOOPS[type(stage)], kind
        self._constants = np.array(stage.constants, dtype=kind)
        self._state = np.zeros(stage.memory, dtype=kind)
        self._state[0] = np.nan
        self._counters = np.zeros(1, dtype=np.int64)
        self._window = stage.window if isinstance(stage, Median) and stage.window > LONG_WINDOW else 0

    def take(self, z: Floats, dt: Floats) -> Floats:
        """Take samples.

        Args:
            z: finite, or NaN where missing: the output is held; shape (n,).
            dt: nominal sample periods before each sample, shape (n,), or empty: 1 each.

        Returns:
            The output after each, shape (n,), of the type to compute in.
        """
        samples, steps = (np.ascontiguousarray(values, dtype=self._kind) for values in (z, dt))
        is_long = self._window * len(samples) > MANY_MOVES and math.isnan(self._state[0])
        if is_long and not np.signbit(samples[samples == 0.0]).any():  # scipy may take -0.0 for 0.0
            return self._long_median(samples)
        out = np.empty_like(samples)
        self._loop(samples, steps, self._constants, self._state, self._counters, out)
        return out

    def _long_median(self, z: Floats) -> Floats:
        """As the loop from the start on, by scipy, whose work hardly grows with the window."""
        from scipy.ndimage import median_filter

        window, seen = self._window, np.isfinite(z)
        came = z[seen]
        if not len(came):
            return np.full_like(z, np.nan)
        medians = median_filter(came, size=window, mode="nearest", origin=(window - 1) // 2)
        latest = np.cumsum(seen) - 1
        self._state[0] = medians[-1]
        self._state[1 : window + 1] = np.concatenate([np.full(window, came[0]), came])[-window:]
        self._state[window + 1 :] = np.sort(self._state[1 : window + 1])
        return np.where(latest >= 0, medians[np.maximum(latest, 0)], np.nan)


class RunningStages:
    """Classic filters in a row over one channel; a missing sample is missing for all of them."""

    def __init__(self, stages: tuple[Stage | Notch, ...], kind: type[np.float64 | np.float32] = np.float64) -> None:
        self._each = [RunningStage(stage, kind) for stage in stages]

    def take(self, z: Floats, dt: Floats) -> Floats:
        """Arguments and result as `RunningStage.take`."""
        missing, out = np.isnan(z), z
        for number, one in enumerate(self._each):
            out = one.take(np.where(missing, np.nan, out) if number else out, dt)
        return out


class RunningChain:
    """A chain over one channel, from its start on; bit for bit the same in pieces, one by one and in one go."""

    def __init__(self, chain: Chain, params: FilterParams) -> None:
        """Args: the filters; the parameters of the Kalman filter that ends a chain without another, scalars."""
        self._stages = RunningStages(chain.stages)
        self._kalman = KalmanFilter(params) if chain.then is None else None
        self._before = math.nan

    def run(self, z: ArrayLike, dt: ArrayLike | None = None) -> FilterResult:
        """Take the samples that follow; arguments, result and errors as `ChainFilter.run` of one channel."""
        samples, steps = one_record(z, dt)
        staged = self._stages.take(samples, steps)
        if self._kalman is not None:
            staged[np.isnan(samples)] = np.nan
            result = self._kalman.run(staged, dt)
            return replace(result, innovation=samples - (staged - result.innovation), loglik=math.nan, m=0)
        unknown = np.full(len(samples), np.nan)
        innovation = samples - np.concatenate([[self._before], staged])[:-1]
        self._before = float(staged[-1]) if len(staged) else self._before
        return FilterResult(staged, unknown, unknown, innovation, unknown, math.nan, 0, 0)

    def update(self, z: ArrayLike, dt: float | None = None) -> float:
        """Take one sample and return the filtered value; arguments and errors as `KalmanFilter.update`."""
        elapsed, sample = step_of(dt), one_sample(z)
        x = self._before = float(self._stages.take(np.array([sample]), np.array([elapsed]))[0])
        return x if self._kalman is None else self._kalman.update(math.nan if math.isnan(sample) else x, dt)


# The bench: the lag and the noise gain, measured, of filters that are not a fixed sum of samples.
#
# The test signals come from the recording: its own noise, shuffled, and its own typical speed. Everything is
# seeded, so the same recording gives the same numbers.


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
        noise = self._shuffled[:size]
        apart = 0.5 * (run(noise + ramp) - run(noise - ramp))
        return float(np.mean(ramp[self.settle :] - apart[self.settle :])) / self.speed

    def noise_gain(self, run: Run) -> float:
        """Variance that `run` leaves of the recording's noise, as a share of it.

        Measured relative to exponential smoothing with the current lag, whose share K/(2 − K) is known: both see
        the same noise, so most of the random error of a finite record cancels.
        """
        output, known = run(self._rest)[self.settle :], self._known
        if np.array_equal(output, self._rest[self.settle :]):
            return 1.0  # measured, it would be 1 apart from that random error
        gain = 1.0 / (1.0 + self.present_lag)
        return float(np.mean(output**2)) / known * gain / (2.0 - gain)

    @cached_property
    def _rest(self) -> Array:
        return self._shuffled[: self.settle + MAX_RAMP]

    @cached_property
    def _known(self) -> float:
        """Variance that exponential smoothing of the present lag leaves of the noise, unit²."""
        known = RunningStage(Exponential(1.0 / (1.0 + self.present_lag)))
        return float(np.mean(known.take(self._rest, np.empty(0))[self.settle :] ** 2))

    @property
    def settle(self) -> int:
        """Samples after which a filter as slow as the current one has settled."""
        return min(int(15.0 * (self.present_lag + 1.0)) + 100, MAX_RAMP // 2)

    @cached_property
    def _shuffled(self) -> Array:
        """Draws of the noise, always the same."""
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


# A chain in steady state: lag, noise reduction, settling; by formula where there is one.


MAX_SAMPLES = 200_000
"""Samples of a record, its last ones, that lag and noise are measured on at most."""

MIN_SLOW, WINDOWS_OF_SLOW = 100.0, 10.0
"""A lag above this many samples, and above this many windows of the median before it, is slow: a median changes the
noise that any slow filter passes by the same factor."""

BUTTERWORTH_SETTLED = 4.6573
"""When its step response, 1 − e^(−τ) (cos τ + sin τ), stays within 1 %, in lags."""


def last_response(then: Stage | None, params: FilterParams) -> SteadyState:
    """The last filter of a chain alone, in samples; NaN where it must be measured.

    Args:
        then: The classic filter; None = the Kalman filter.
        params: Parameters of that, scalars.
    """
    match then:
        case None:
            return steady_state(params, 1.0)
        case Exponential():
            return _smoothing(then.alpha)
        case OneEuro():
            angle = 2.0 * math.pi * then.cutoff
            still = _smoothing(angle / (1.0 + angle))  # while the signal does not change; faster once it does
            return replace(still, lag_samples=math.nan, noise_reduction_db=math.nan, cutoff_hz=math.nan)
        case MovingAverage():
            n = then.window
            return _state(1.0 / n, then, _average_cutoff(n), (1.0 - SETTLED) * n)
        case Butterworth():
            gain = 0.5 * then.constants[2]
            result = _state(gain, then, then.cutoff, BUTTERWORTH_SETTLED * then.lag)
            return replace(result, overshoot=math.exp(-math.pi))
        case Median():
            return _state(math.nan, then, math.nan, 0.5 * (then.window + 1))


def chain_response(chain: Chain, params: FilterParams, record: tuple[Array, Array]) -> SteadyState:
    """A chain, in samples.

    A median passes a step (window − 1)/2 samples later and otherwise unchanged; its lag on a ramp under noise, and
    the noise that it leaves, are measured together with the filter behind it.

    Args:
        chain: The filters.
        params: Parameters of the Kalman filter, scalars.
        record: (z, x): the samples, which give the bench its noise, and a filtered curve of them, which gives its
            speed, shape (n,) each.
    """
    then, late = chain.then, 0.5 * (chain.median - 1) + (chain.notch.lag if chain.notch else 0.0)
    last = last_response(then, params)
    if not chain.first and not isinstance(then, Median | OneEuro):
        return last
    z, x = (values[-MAX_SAMPLES:] for values in record)
    lag, slow = last.lag_samples + late, max(MIN_SLOW, WINDOWS_OF_SLOW * chain.median)
    if last.lag_samples > slow:  # no ramp would be long enough
        probe = Exponential(1.0 / (1.0 + slow))
        gain = bench_of(z, x, slow).noise_gain(_run(replace(chain, then=probe), params))
        noise = last.noise_reduction_db - 10.0 * math.log10(gain / probe.noise_gain)
    else:
        guess = last.settle_samples / -math.log(SETTLED) + late
        guess += 0.5 * then.window if isinstance(then, Median) else 0.0
        bench, run = bench_of(z, x, min(guess, 0.25 * MAX_SAMPLES)), _run(chain, params)
        lag, gain = bench.lag(run), bench.noise_gain(run)
        noise = math.inf if gain == 0.0 else -10.0 * math.log10(gain)
    result = replace(last, lag_samples=lag, noise_reduction_db=noise, cutoff_hz=math.nan)
    return replace(result, settle_samples=last.settle_samples + late)


def _run(chain: Chain, params: FilterParams) -> Run:
    """The chain from z to its output, evenly sampled, from the automatic start and without a gate."""
    plain = FilterParams(params.q, params.r, momentum=params.momentum)

    def run(z: Array) -> Array:
        out = RunningStages(chain.stages).take(z, np.empty(0))
        return denoise(out, plain) if chain.then is None else out

    return run


def _smoothing(alpha: float) -> SteadyState:
    """Exponential smoothing is the Kalman filter of this gain, which has no variance of its own."""
    return replace(steady_state(params_of_gain(alpha), 1.0), p=math.nan)


def _state(gain: float, stage: MovingAverage | Butterworth | Median, cutoff: float, settle: float) -> SteadyState:
    lag = math.nan if stage.lag is None else stage.lag
    noise = math.nan if stage.noise_gain is None else 0.0 - 10.0 * math.log10(stage.noise_gain)  # 0 rather than -0
    return SteadyState(gain, math.nan, lag, lag, noise, cutoff, settle)


def _average_cutoff(window: int) -> float:
    """−3 dB frequency of a moving average, cycles per sample: sin(π f N) = √½ N sin(π f); NaN for a window of 1."""
    if window == 1:
        return math.nan
    peak = math.sqrt(0.5) * window
    return bisect(lambda f: math.sin(math.pi * f * window) > peak * math.sin(math.pi * f), 0.0, 1.0 / window)[0]


# A chain at another sample period: cut-offs stay in hertz, windows and time constants in seconds.


def rescaled_chain(chain: Chain, ratio: float) -> Chain | None:
    """The chain at a sample period `ratio` times as long.

    Windows are rounded to whole samples, those of a median to odd ones. α keeps its time constant,
    1 − (1 − α)^ratio; β is per unit of the signal and stays.

    Returns:
        The chain; None where nothing is left of it but the Kalman filter.

    Raises:
        BadSetting: A window or a cut-off leaves its range.
    """
    median, notch = _odd(chain.median, ratio), chain.notch
    notch = None if notch is None else Notch(notch.frequency * ratio, notch.width * ratio)
    if median == 1 and notch is None and chain.then is None:
        return None
    return Chain(median, None if chain.then is None else _rescaled(chain.then, ratio), notch)


def _rescaled(stage: Stage, ratio: float) -> Stage:
    match stage:
        case MovingAverage():
            return MovingAverage(max(1, round(stage.window / ratio)))
        case Median():
            return Median(_odd(stage.window, ratio))
        case Exponential():
            return Exponential(_share(stage.alpha, ratio))
        case Butterworth():
            return Butterworth(stage.cutoff * ratio)
        case OneEuro():
            return replace(stage, cutoff=stage.cutoff * ratio, speed_cutoff=stage.speed_cutoff * ratio)


def _odd(window: int, ratio: float) -> int:
    """The odd number nearest to window/ratio."""
    return max(1, 2 * round(0.5 * (window / ratio - 1.0)) + 1)


def _share(alpha: float, ratio: float) -> float:
    """The α with the same time constant in seconds; 1 stays 1."""
    return 1.0 if alpha >= 1.0 else -math.expm1(ratio * math.log1p(-alpha))


# A chain as a `Filter`, beside the Kalman filter of q and r: over a record, and sample by sample.


@dataclass(frozen=True)
class ChainFilter(Filter):
    """A chain with the parameters of the channel's Kalman filter, which runs where the chain names no other."""

    chain: Chain
    """The filters."""
    params: FilterParams
    """q, r, … of the channel; without effect where `chain.then` is a classic filter."""

    def run(self, z: ArrayLike, dt: ArrayLike | None = None) -> FilterResult:
        """Filter a record; arguments and errors as `kalman_filter`.

        Returns:
            `x` is the output, held where z is missing; `innovation` is z minus the previous output, or minus what
            the Kalman filter predicted. p, k and s are those of the Kalman filter, NaN where another one is last.
            `loglik` is NaN and `m` 0: the samples behind a median are not independent measurements.
        """
        return self.stream().run(z, dt)

    def stream(self) -> RunningChain:
        """The chain at its start: sample by sample, or over a record that grows."""
        return RunningChain(self.chain, self.params)

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
        predicted, tau = np.append(np.nan, result.x[:-1]), self.params.momentum
        if self.chain.then is None and result.velocity is not None:
            predicted[1:] -= tau * math.expm1(-1.0 / tau) * result.velocity[:-1]
        z = result.innovation + predicted
        return at_period(chain_response(self.chain, self.params, (z, denoise(z, self.params))), period)
