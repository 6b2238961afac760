"""Synthetic sensors: a known signal, a known noise and the usual faults, for learning and for tests."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from typing import Any
from urllib.parse import urlencode

import numpy as np

from kalscope.common.numbers import Array
from kalscope.errors import BadSetting
from kalscope.recording import Recording

SHAPES = ("constant", "step", "ramp", "sine", "triangle", "random_walk", "chirp")
"""Noise-free signals. "triangle" sweeps up and down; "chirp" is a sine whose frequency rises tenfold."""
NOISES = ("gaussian", "uniform", "triangular", "none")
"""Laws of the noise. "triangular" is rand − rand, as in the MATLAB appendix of the noise-reducer paper."""
MAX_CHANNELS = 16
MAX_SAMPLES = 50_000_000
"""Samples over all channels: 400 MB per copy."""


@dataclass(frozen=True)
class SignalSettings:
    """All settings of a synthetic recording; equal settings make equal recordings, bit for bit."""

    shape: str = "sine"
    """Noise-free signal, one of SHAPES."""
    n: int = 2000
    """Samples, >= 1."""
    sample_period: float = 0.01
    """Time between samples in s, > 0."""
    channels: int = 1
    """Channels, 1…16, each with its own noise; see `synthesize` for their signals."""
    amplitude: float = 1.0
    """Height in u: peak of a sine, size of a step, half a sweep, std of a walk after one period."""
    level: float = 0.0
    """Value in u around which a sine, triangle and chirp swing, and at which the other shapes begin."""
    period: float = 5.0
    """Time scale of the shape in s, > 0: one cycle, the rise time of the ramp, the time of the step."""
    noise: str = "gaussian"
    """Law of the noise, one of NOISES."""
    sigma: float = 0.1
    """Standard deviation of the noise in u, >= 0, whatever its law; r of the filter is its square."""
    outliers: float = 0.0
    """Fraction of samples hit by a spike, 0…1."""
    outlier_size: float = 1.0
    """Size of a spike in u, >= 0; its sign is drawn."""
    quantum: float = 0.0
    """Step of the converter in u, >= 0; 0 is none."""
    drop_outs: float = 0.0
    """Fraction of samples that are missing (NaN), 0…1."""
    limits: tuple[float, float] | None = None
    """Range of the converter (lowest, highest) in u, where it clips; None is none."""
    seed: int = 0
    """Seed of the random numbers, >= 0."""
    sigmas: tuple[float, ...] | None = None
    """Several sensors of one signal: the standard deviation of each in u, in place of `channels` and `sigma`;
    None = each channel has a signal of its own."""
    offsets: tuple[float, ...] | None = None
    """With `sigmas`: how much too high each sensor reads, in u; None = not at all."""
    every: tuple[float, ...] | None = None
    """With `sigmas`: each sensor has a reading once in so many rows, whole numbers; None = in all of them."""

    def __post_init__(self) -> None:
        for name, choices in (("shape", SHAPES), ("noise", NOISES)):
            if getattr(self, name) not in choices:
                raise BadSetting(f"{name} must be one of {', '.join(choices)} (got {getattr(self, name)!r})")
        for low, high, names in _RANGES:
            for name in names:
                _check(name, getattr(self, name), low, high)
        if self.limits is not None and not (len(self.limits) == 2 and self.limits[0] < self.limits[1]):
            raise BadSetting(f"limits must be two numbers, lowest and highest (got {self.limits!r})")
        if not 1 <= self.columns <= MAX_CHANNELS:
            raise BadSetting(f"sigmas must be 1 to {MAX_CHANNELS} numbers, one per sensor (got {self.sigmas!r})")
        if self.sigmas is not None and self.channels != 1:
            raise BadSetting(f"channels must be left out where sigmas gives a channel each (got {self.channels})")
        for name, given in (("offsets", self.offsets), ("every", self.every)):
            if given is not None and len(given) != len(self.sigmas or ()):
                raise BadSetting(f"{name} must have a number for each of sigmas, {self.sigmas} (got {given!r})")
        if self.n * self.columns > MAX_SAMPLES:
            raise BadSetting(f"n * channels must be at most {MAX_SAMPLES} (got {self.n * self.columns})")

    @property
    def columns(self) -> int:
        """Channels of the recording."""
        return self.channels if self.sigmas is None else len(self.sigmas)

    @property
    def spec(self) -> str:
        """What reopens it: `synthetic:SHAPE?…` with the settings that differ from their defaults."""
        given = {item.name: getattr(self, item.name) for item in fields(self) if item.name != "shape"}
        given = {name: value for name, value in given.items() if value != getattr(SignalSettings, name)}
        changed = {name: ",".join(map(repr, v)) if name in _SEVERAL else v for name, v in given.items()}
        return f"synthetic:{self.shape}" + ("?" + urlencode(changed, safe=",") if changed else "")


MAX_SETTING = 1e50
"""Bound of all settings in u and s, and 1/MAX_SETTING of all times: products of a few of them stay finite."""

# (lowest, highest, settings); whole numbers are bounded by whole numbers
_RANGES = (
    (1, MAX_SAMPLES, ("n", "every")),
    (1, MAX_CHANNELS, ("channels",)),
    (0, 2**63 - 1, ("seed",)),
    (1 / MAX_SETTING, MAX_SETTING, ("sample_period", "period")),
    (-MAX_SETTING, MAX_SETTING, ("amplitude", "level", "limits", "offsets")),
    (0.0, MAX_SETTING, ("sigma", "sigmas", "outlier_size", "quantum")),
    (0.0, 1.0, ("outliers", "drop_outs")),
)
_SEVERAL = frozenset(("limits", "sigmas", "offsets", "every"))
"""Settings of several numbers; None = not given."""


def synthesize(shape: str | SignalSettings, **settings: Any) -> Recording:
    """Make a recording whose true signal is known.

    The order is that of a real sensor: signal, noise, spikes, converter (limits, then steps), lost samples.
    Channel j of a periodic shape lags channel 0 by j/channels of a period; a constant is j/2 amplitudes higher;
    others are 1 + j/2 times as high; walks are independent. With `sigmas` all of them, named a, b, c …, measure one
    signal.

    Args:
        shape: One of SHAPES, or all settings as one SignalSettings.
        **settings: Fields of SignalSettings by name, where `shape` is a name.

    Returns:
        A Recording with `values` and `truth` of shape (n, channels), `source` that reopens it.

    Raises:
        BadSetting: an unknown setting, or one out of its range.
    """
    known = {item.name for item in fields(SignalSettings)} - {"shape"}
    unknown = set(settings) - (known if isinstance(shape, str) else set())
    if unknown:
        raise BadSetting(f"setting must be one of {', '.join(sorted(known))} (got {', '.join(sorted(unknown))})")
    chosen = SignalSettings(shape, **settings) if isinstance(shape, str) else shape
    rng = np.random.default_rng(chosen.seed)
    time = np.arange(chosen.n, dtype=np.float64) * float(chosen.sample_period)
    signals = np.column_stack([_signal(chosen, time, j, rng) for j in range(chosen.channels)])
    truth = np.broadcast_to(signals, (chosen.n, chosen.columns)).copy()
    measured, units = _measure(truth, chosen, rng), ("",) * chosen.columns
    given = Recording(time, _names(chosen), units, measured, float(chosen.sample_period), truth=truth)
    return replace(given, source=chosen.spec, title=f"Synthetic {chosen.shape.replace('_', ' ')}")


def _names(settings: SignalSettings) -> tuple[str, ...]:
    if settings.sigmas is not None:
        return tuple("abcdefghijklmnop"[: settings.columns])
    one = settings.channels == 1
    return (settings.shape,) if one else tuple(f"{settings.shape} {j + 1}" for j in range(settings.channels))


def _signal(settings: SignalSettings, time: Array, channel: int, rng: np.random.Generator) -> Array:
    """Noise-free channel, shape (n,)."""
    shape, height, cycles = settings.shape, settings.amplitude, time / settings.period
    if shape in _PERIODIC:
        return settings.level + height * _PERIODIC[shape](cycles, channel / settings.channels)
    if shape == "constant":
        return settings.level + height * np.full(len(time), channel / 2)
    if shape == "random_walk":
        # Starts at the level; after one period the walk has the standard deviation `height`.
        steps = rng.standard_normal(len(time)) * math.sqrt(settings.sample_period / settings.period)
        steps[0] = 0.0
        cycles = np.cumsum(steps)
    elif shape == "step":
        cycles = np.where(cycles >= 1, 1.0, 0.0)
    return settings.level + height * (1 + channel / 2) * cycles


def _sine(cycles: Array, lag: float) -> Array:
    return np.sin(2 * np.pi * (np.mod(cycles, 1.0) - lag))


_PERIODIC: dict[str, Callable[[Array, float], Array]] = {
    "sine": _sine,
    "triangle": lambda cycles, lag: 1.0 - 4.0 * np.abs(np.mod(cycles - lag, 1.0) - 0.5),
    # Its frequency rises linearly from 1/period to 10/period over the record; the phase is the integral.
    "chirp": lambda cycles, lag: _sine(cycles + 4.5 * cycles * (cycles / (cycles[-1] or 1.0)), lag),
}


def _measure(truth: Array, settings: SignalSettings, rng: np.random.Generator) -> Array:
    """What the sensor measures of the truth, shape (n, channels)."""
    sigma = settings.sigma if settings.sigmas is None else np.array(settings.sigmas)
    values = truth + sigma * _LAWS[settings.noise](rng, truth.shape)
    if settings.offsets is not None:
        values = values + np.array(settings.offsets)
    if settings.outliers:
        hit = rng.random(truth.shape) < settings.outliers
        values = values + hit * rng.choice((-1.0, 1.0), truth.shape) * settings.outlier_size
    if settings.limits is not None:
        values = np.clip(values, *settings.limits)
    if settings.quantum:
        # A quotient may overflow where the step is tiny: such a step changes nothing.
        with np.errstate(over="ignore"):
            steps = np.round(values / settings.quantum)
        values = np.where(np.isfinite(steps), steps * settings.quantum, values)
    if settings.drop_outs:
        values = np.where(rng.random(truth.shape) < settings.drop_outs, np.nan, values)
    if settings.every is not None:
        values = np.where(np.arange(settings.n)[:, None] % np.array(settings.every) == 0, values, np.nan)
    return values


# Noise of mean 0 and standard deviation 1.
_LAWS: dict[str, Callable[[np.random.Generator, tuple[int, ...]], Array]] = {
    "gaussian": lambda rng, shape: rng.standard_normal(shape),
    "uniform": lambda rng, shape: math.sqrt(12) * (rng.random(shape) - 0.5),  # width 2√3 has variance 1
    "triangular": lambda rng, shape: math.sqrt(6) * (rng.random(shape) - rng.random(shape)),  # rand − rand: 1/6
    "none": lambda _, shape: np.zeros(shape),
}


def _check(name: str, value: Any, low: float, high: float) -> None:
    """Refuse a setting out of its range, and each number of one of several."""
    several, is_whole = name in _SEVERAL, isinstance(low, int)
    if several and type(value) not in (tuple, type(None)):
        raise BadSetting(f"{name} must be several numbers (got {value!r})")
    # A source gives the numbers of `every` as 2.0.
    kinds: Any = (int, np.integer) if is_whole and not several else (int, float, np.integer, np.floating)
    for one in (value or ()) if several else (value,):
        fits = isinstance(one, kinds) and not isinstance(one, bool) and low <= one <= high  # false for NaN
        if not fits or (is_whole and one != int(one)):
            what = f"whole number from {low} to {high}" if is_whole else f"number from {low:g} to {high:g}"
            raise BadSetting(f"{name} must be a {what} (got {one!r})")
