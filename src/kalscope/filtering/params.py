"""The parameters of a filter as frozen, checked values, and measurements and steps as the loops need them."""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike

from kalscope.common.numbers import Array, in_range
from kalscope.errors import BadSetting

# The model's parameters as one frozen, checked value: one sensor, or several of one quantity.
#
# The model is the local level: x is a random walk of variance q per sample, and sensor i reads offset + gain x +
# noise of variance r. With momentum τ the walk keeps its direction for about τ samples; τ = 0 is the plain one.


MAX_MOMENTUM = 1e5
"""Longest momentum accepted, in sample periods: beyond it the velocity is as good as constant."""
MIN_MOMENTUM = 1e-12
"""Shorter ones, in sample periods, count as none: they change no digit of the filter."""
MAX_VARIANCE = 1e300
"""Largest variance accepted: sums of two of them still fit a double."""
MAX_OFFSET = 1e200
"""Largest offset accepted, and the largest reading of a sensor with offset and gain: x then stays finite."""
MAX_FAST = 1e12
"""Largest factor between the two process noises."""
MIN_GAIN, MAX_GAIN = 1e-100, 1e100
"""Smallest and largest size of a gain."""

_VARIANCE = "a finite variance from 0 to 1e300", 0.0, MAX_VARIANCE
_MUST = {
    "q": _VARIANCE,
    "r": _VARIANCE,
    "p0": _VARIANCE,
    "x0": ("a finite number in the unit of the signal", -sys.float_info.max, sys.float_info.max),
    "gate": ("a finite threshold on v²/s above 0, such as 9", math.ulp(0.0), sys.float_info.max),
    "momentum": ("a number of sample periods from 0 to 1e5", 0.0, MAX_MOMENTUM),
    "fast": ("a factor from 1 to 1e12", 1.0, MAX_FAST),
    "spikes": ("a probability from 0 to 0.5", 0.0, 0.5),
    "offset": ("a number of a size up to 1e200", 0.0, MAX_OFFSET),
    "gain": ("a number of a size from 1e-100 to 1e100", MIN_GAIN, MAX_GAIN),
}
"""What each parameter must be: for messages, and its range or that of its size."""


@dataclass(frozen=True, eq=False, repr=False)
class FilterParams:
    """Parameters of the scalar Kalman filter.

    Raises:
        BadSetting: a value is not a finite number in its range, r, offset and gain have different lengths, q and r
            are both 0, more than one r is 0 (exact sensors that differ contradict each other), or x0 comes without
            p0.
    """

    q: float
    """Process-noise variance added per nominal sample period, unit², 0 … 1e300."""
    r: float | Array
    """Measurement-noise variance, unit², 0 … 1e300: a number, or one per sensor of the same quantity, in (unit of
    its readings)², shape (sensors,), read-only. At most one is 0, and none with q = 0."""
    p0: float | None = None
    """Variance of the estimate before the first predict, unit², ≥ 0; None = exact diffuse start."""
    x0: float | None = None
    """Estimate before the first predict, unit; None = the first finite reading. Needs p0."""
    gate: float | None = None
    """Outlier gate: a reading whose v²/s exceeds it is not used (9 = three sigma), > 0; None = off."""
    momentum: float = 0.0
    """Momentum τ: how long the signal keeps its direction, in nominal sample periods, 0 … 1e5; 0 = it does not,
    and below 1e-12 is taken as 0."""
    offset: Array = cast("Array", 0.0)  # noqa: RUF009 - one number stands for all sensors
    """Reading of each sensor where the quantity is 0, shape (sensors,), read-only."""
    gain: Array = cast("Array", 1.0)  # noqa: RUF009
    """Rise of each reading when the quantity rises by 1, not 0, shape (sensors,), read-only."""
    fast: float | None = None
    """Two speeds: q grows to fast q while the signal moves, 1 … 1e12; None or 1 = one speed. For one sensor that
    reads x itself, with r > 0, without momentum and gate."""
    spikes: float = 0.0
    """With two speeds, the probability that a reading is a spike, of ten times the noise, 0 … 0.5."""

    def __post_init__(self) -> None:
        checked: dict[str, Any] = {"r": _number("r", self.r) if np.ndim(self.r) == 0 else _each("r", self.r, None)}
        sensors = np.size(checked["r"])
        for name, none in (("offset", _NO_OFFSET), ("gain", _NO_GAIN)):
            value: Any = getattr(self, name)
            is_none = np.ndim(checked["r"]) == 0 and np.array_equal(np.atleast_1d(value), none)
            checked[name] = none if is_none else _each(name, value, sensors)
        for name in ("q", "p0", "x0", "gate", "momentum", "fast", "spikes"):
            value = getattr(self, name)
            is_none = value is None and name not in ("q", "momentum", "spikes")
            checked[name] = None if is_none else _number(name, value)
        if checked["fast"] == 1.0 and not checked["spikes"]:
            checked["fast"] = None
        for name, value in checked.items():
            object.__setattr__(self, name, value)
        if self.x0 is not None and self.p0 is None:
            raise BadSetting(f"x0 needs p0, the variance of that first estimate (got x0 = {self.x0} alone)")
        if self.q == 0.0 and np.any(np.equal(self.r, 0.0)):
            raise BadSetting(
                f"q and r must not both be 0: their ratio decides the filter (got q = 0, r = {self.r})"
            )
        if not self.reads_x:
            self._check_sensors()
        others = self.momentum or self.gate or not self.reads_x or self.r == 0.0
        if (self.fast is not None and others) or (self.fast is None and self.spikes):
            must = "two speeds need one sensor with r > 0, no momentum and no gate; spikes are a part of them"
            raise BadSetting(f"{must} (got {self})")

    def _check_sensors(self) -> None:
        if np.count_nonzero(np.equal(self.r, 0.0)) > 1:
            raise BadSetting(
                f"at most one r may be 0: exact sensors that differ contradict each other (got {self.r})"
            )
        with np.errstate(over="ignore", under="ignore"):
            noise = self.scaled_r
        if np.any((noise > MAX_VARIANCE) | ((noise == 0.0) & (self.sensor_r > 0.0))):
            raise BadSetting(f"r/gain² must be a variance up to 1e300 (got r {self.r} with gain {self.gain})")

    @property
    def sensors(self) -> int:
        """Number of sensors."""
        return len(self.r) if isinstance(self.r, np.ndarray) else 1

    @property
    def fuses(self) -> bool:
        """Whether r is given per sensor: z then has a column for each, and all of them make one x."""
        return isinstance(self.r, np.ndarray)

    @property
    def reads_x(self) -> bool:
        """Whether there is one sensor that reads x itself, without offset and gain."""
        return not self.fuses and self.offset is _NO_OFFSET and self.gain is _NO_GAIN

    @property
    def sensor_r(self) -> Array:
        """Noise variance r of each sensor, shape (sensors,)."""
        return np.atleast_1d(self.r)

    @property
    def scaled_r(self) -> Array:
        """Noise variance of each sensor on the scale of x, r/gain², unit², shape (sensors,)."""
        return self.r / self.gain / self.gain

    @property
    def ratio(self) -> float:
        """λ = q by the r of all sensors together, dimensionless; inf without noise."""
        noise = self.r if self.reads_x else self.as_single.r
        with np.errstate(divide="ignore", over="ignore", under="ignore"):
            return float(np.divide(self.q, noise))

    @property
    def information(self) -> Array:
        """Information in a reading of each sensor, gain²/r, 1/unit², shape (sensors,); 1e300 where r is 0."""
        return 1.0 / np.maximum(self.scaled_r, 1.0 / MAX_VARIANCE)

    @property
    def shares(self) -> Array:
        """What each sensor contributes while all answer, gain²/r as parts of their sum, shape (sensors,)."""
        return self.information / self.information.sum()

    @property
    def moving(self) -> FilterParams:
        """The filter of one speed that two speeds are while the signal surely moves."""
        return replace(self, q=self.q * (self.fast or 1.0), fast=None, spikes=0.0)

    @property
    def as_single(self) -> FilterParams:
        """The filter of the mean of (z − offset)/gain weighted by `shares`: the fused one while all answer.

        Its r is 1/Σ gain²/r. It has no gate, which rejects single readings; and with p0 but no x0 it starts at the
        mean, not at the first reading.
        """
        noise = self.scaled_r
        r = 0.0 if noise.min() == 0.0 else float(noise.min() / (noise.min() / noise).sum())
        return FilterParams(self.q, r, self.p0, self.x0, momentum=self.momentum)

    def only(self, indices: Sequence[int]) -> FilterParams:
        """The same quantity from the sensors of these indices only, in this order."""
        chosen = list(indices)
        return replace(self, r=self.sensor_r[chosen], offset=self.offset[chosen], gain=self.gain[chosen])

    def __repr__(self) -> str:
        given = {f.name: getattr(self, f.name) for f in fields(self)}
        shown = {k: v for k, v in given.items() if k in ("q", "r") or np.any(np.not_equal(v, _USUAL[k]))}
        texts = (f"{k}={v.tolist() if isinstance(v, np.ndarray) else v!r}" for k, v in shown.items())
        return f"FilterParams({', '.join(texts)})"

    def __eq__(self, other: object) -> bool:
        return self._values() == other._values() if isinstance(other, FilterParams) else NotImplemented

    def __hash__(self) -> int:
        return hash(self._values())

    def __reduce__(self) -> tuple[Any, ...]:
        """Arrays are read-only after a copy too."""
        return FilterParams, tuple(getattr(self, f.name) for f in fields(self))

    def _values(self) -> tuple[Any, ...]:
        values = (getattr(self, f.name) for f in fields(self))
        return tuple(tuple(v.tolist()) if isinstance(v, np.ndarray) else v for v in values)


_NO_OFFSET, _NO_GAIN = np.zeros(1), np.ones(1)
_NO_OFFSET.setflags(write=False)
_NO_GAIN.setflags(write=False)
_USUAL: dict[str, Any] = {
    "p0": None,
    "x0": None,
    "gate": None,
    "momentum": 0.0,
    "offset": 0.0,
    "gain": 1.0,
    "fast": None,
    "spikes": 0.0,
}


def require_params(params: object) -> FilterParams:
    """Refuse what is no parameters, above all the None of an estimate that found no usable q and r.

    Raises:
        BadSetting: It is not `FilterParams`.
    """
    if not isinstance(params, FilterParams):
        raise BadSetting(
            f"params must be FilterParams (got {params!r:.60}): where estimate finds no usable q and r, its "
            "message says why; choose them, as in FilterParams(q=0.01, r=1)"
        )
    return params


def _number(name: str, value: Any) -> float:
    """`value` as a float in the range that _MUST states."""
    must, least, most = _MUST[name]
    number = in_range(name, value, -most if name == "offset" else least, most, must)
    return 0.0 if name == "momentum" and number < MIN_MOMENTUM else number


def _each(name: str, value: Any, sensors: int | None) -> Array:
    """`value` as a read-only array of shape (sensors,), one number for all; `sensors` None = of any number."""
    try:
        array = np.array(value, dtype=np.float64)
        array = np.full(sensors, array) if sensors and array.ndim == 0 else array
    except (TypeError, ValueError):
        raise BadSetting(f"{name} must be {_MUST[name][0]} (got {value!r})") from None
    if array.ndim != 1 or array.size == 0 or (sensors is not None and array.shape != (sensors,)):
        raise BadSetting(f"{name} must have one value per sensor, as r (got {value})")
    for one in array.tolist():
        _number(name, abs(one) if name == "gain" and one < 0.0 else one)
    array.setflags(write=False)
    return array


# Measurements, steps and parameters as the kernels need them, checked once for all drivers.


def scalar(value: float | None) -> float:
    """The value; NaN for None."""
    return math.nan if value is None else value


def samples_of(z: ArrayLike, name: str = "z") -> Array:
    """The samples z, which messages call `name`, as float64, a view where possible; masked ones become NaN."""
    if isinstance(z, np.ndarray) and np.iscomplexobj(cast("Array", z)):  # asarray would drop the imaginary part
        raise BadSetting(f"{name} must be an array of real numbers (got complex ones)")
    try:
        array = np.asarray(z, dtype=np.float64)
    except (TypeError, ValueError):
        raise BadSetting(f"{name} must be an array of numbers (got something else)") from None
    if isinstance(z, np.ma.MaskedArray):
        return np.where(np.ma.getmaskarray(cast("Array", z)), np.nan, array)
    return array


def one_channel(z: ArrayLike, params: FilterParams | None = None) -> Array:
    """The samples z as float64, shape (n,), for functions of one signal, of one sensor where `params` is given."""
    if params is not None and not require_params(params).reads_x:
        raise BadSetting(f"params must be those of one sensor without offset and gain (got {params})")
    samples = samples_of(z)
    if samples.ndim != 1:
        raise BadSetting(f"z must be one channel, shape (n,) (got shape {samples.shape})")
    return samples


def one_sample(z: ArrayLike) -> float:
    """The sample z, finite or NaN where missing."""
    sample = samples_of(z)
    if sample.ndim or np.isinf(sample):
        raise BadSetting(f"z must be one finite number, or NaN where missing (got {z})")
    return float(sample)


def checked_readings(z: Array, params: FilterParams, first: int = 0) -> Array:
    """The readings z as rows of shape (n, sensors), contiguous, a view where possible.

    Args:
        z: readings, shape (n,), or with an r per sensor (n, sensors).
        params: the model.
        first: the number of the first row, for the message.

    Raises:
        BadSetting: z has another shape, or a reading that is infinite, or beyond 1e200 with an offset or gain.
    """
    if z.ndim != 1 + params.fuses or (params.fuses and z.shape[1] != params.sensors):
        must = f"have a column for each of the {params.sensors} sensors" if params.fuses else "have shape (n,)"
        raise BadSetting(f"z must {must} (got shape {z.shape})")
    rows = np.ascontiguousarray(z).reshape(-1, params.sensors)
    if params.reads_x:
        refuse_infinite(rows[:, 0], first)
    elif max(np.fmax.reduce(rows.ravel(), initial=0.0), -np.fmin.reduce(rows.ravel(), initial=0.0)) > MAX_OFFSET:
        row, sensor = np.argwhere(np.abs(rows) > MAX_OFFSET)[0]
        got = f"{rows[row, sensor]} at row {first + row}, sensor {sensor}"
        raise BadSetting(f"z must be of a size up to {MAX_OFFSET:g}, or NaN where missing (got {got})")
    return rows


def one_record(z: ArrayLike, dt: ArrayLike | None) -> tuple[Array, Array]:
    """The samples z of one channel, shape (n,), and the steps dt, checked and contiguous."""
    samples = one_channel(z)
    refuse_infinite(samples)
    return np.ascontiguousarray(samples), steps_of(dt, len(samples))


def steps_of(dt: ArrayLike | None, n: int) -> Array:
    """The steps dt as the kernels need it: empty for regular sampling."""
    if dt is None:
        return np.empty(0)
    steps = np.ascontiguousarray(samples_of(dt, "dt"))
    if steps.shape != (n,):
        raise BadSetting(f"dt must have one value per sample, shape ({n},) (got {steps.shape})")
    if n and not (np.all(np.isfinite(steps)) and steps.min() >= 0.0):
        raise BadSetting(f"dt must be finite and not negative (got {steps.min()} to {steps.max()})")
    return steps


def step_of(dt: float | None) -> float:
    """One step dt as the kernels need it: 1 where it is None."""
    return 1.0 if dt is None else in_range("dt", dt, 0.0, sys.float_info.max, "finite and not negative")


def refuse_infinite(column: Array, first: int = 0) -> None:
    """BadSetting where z holds inf; NaN is a missing sample."""
    with np.errstate(over="ignore", invalid="ignore"):
        if math.isfinite(column.sum()):
            return
    where = np.flatnonzero(np.isinf(column))
    if len(where):
        raise infinite(float(column[where[0]]), first + int(where[0]))


def infinite(value: float, index: int) -> BadSetting:
    """The error that names an infinite sample."""
    return BadSetting(f"z must be finite, or NaN where missing (got {value} at sample {index})")
