"""The parameters of a fused filter as one frozen, checked value.

The model is that of the scalar filter, x with the process noise q and maybe momentum; sensor i reads
z_i = offset_i + gain_i x + noise of variance r_i.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, cast

import numpy as np

from kalscope.common.array import Array
from kalscope.errors import BadSetting
from kalscope.filtering.params import MAX_VARIANCE, FilterParams

MIN_GAIN, MAX_GAIN, MAX_OFFSET = 1e-100, 1e100, 1e200
"""Sizes of a sensor's gain and offset that are accepted: their squares and quotients are still finite."""

_NONE = cast("Array", None)


@dataclass(frozen=True, eq=False)
class FusionParams:
    """Parameters of the filter of several sensors of one quantity.

    Raises:
        BadSetting: a value is not a number in its range; r, offset and gain have different lengths; more than one r
            is 0 (two exact sensors that differ contradict each other, whatever x is); q is 0 too (the first exact
            reading would decide everything); x0 comes without p0.
    """

    q: float
    """Process-noise variance added per nominal sample period, unit², 0 … 1e300."""
    r: Array
    """Noise variance of each sensor, (unit of its readings)², shape (sensors,), read-only; at most one is 0."""
    offset: Array = _NONE
    """Reading of each sensor where the quantity is 0, shape (sensors,), read-only; None = 0 each."""
    gain: Array = _NONE
    """Rise of each reading when the quantity rises by 1, shape (sensors,), read-only, not 0; None = 1 each."""
    p0: float | None = None
    """Variance of the estimate before the first predict, unit², ≥ 0; None = exact diffuse start."""
    x0: float | None = None
    """Estimate before the first predict, unit; None = what the first finite reading says. Needs p0."""
    gate: float | None = None
    """Outlier gate: a reading whose v²/s exceeds it is not used (9 = three sigma), > 0; None = off."""
    momentum: float = 0.0
    """Momentum τ: how long the quantity keeps its direction, in nominal sample periods, 0 … 1e5; 0 = off."""

    def __post_init__(self) -> None:
        one = FilterParams(self.q, self.r, self.p0, self.x0, self.gate, self.momentum)
        if one.channels is None or not isinstance(one.r, np.ndarray):
            raise BadSetting(f"r must be one variance per sensor, shape (sensors,) (got {self.r!r})")
        checked: dict[str, Any] = {
            "r": one.r,
            "offset": _each("offset", self.offset, 0.0, one.channels),
            "gain": _each("gain", self.gain, 1.0, one.channels),
        }
        for name in ("q", "p0", "x0", "gate", "momentum"):
            checked[name] = getattr(one, name)
            if isinstance(checked[name], np.ndarray):
                raise BadSetting(f"{name} must be one number for all sensors (got {getattr(self, name)})")
        for name, value in checked.items():
            object.__setattr__(self, name, value)
        self._check_gain()
        if np.sum(one.r == 0.0) > 1:
            raise BadSetting(
                f"at most one r may be 0: exact sensors that differ contradict each other (got {self.r})"
            )

    def _check_gain(self) -> None:
        size = np.abs(self.gain)
        if not np.all((size >= MIN_GAIN) & (size <= MAX_GAIN)):
            raise BadSetting(f"gain must not be 0, and its size must be from 1e-100 to 1e100 (got {self.gain})")
        with np.errstate(over="ignore", under="ignore"):
            noise = self.scaled_r
        if np.any((noise > MAX_VARIANCE) | ((noise == 0.0) & (self.r > 0.0))):
            raise BadSetting(f"r/gain² must be a variance up to 1e300 (got r {self.r} with gain {self.gain})")

    @property
    def sensors(self) -> int:
        """Number of sensors."""
        return len(self.r)

    @property
    def scaled_r(self) -> Array:
        """Noise variance of each sensor on the scale of x, r/gain², unit², shape (sensors,)."""
        return self.r / self.gain / self.gain

    @property
    def shares(self) -> Array:
        """What each sensor contributes while all answer, gain²/r as parts of their sum, shape (sensors,)."""
        return self.information / self.information.sum()

    @property
    def information(self) -> Array:
        """Information in a reading of each sensor, gain²/r, 1/unit², shape (sensors,); 1e300 where r is 0."""
        return 1.0 / np.maximum(self.scaled_r, 1.0 / MAX_VARIANCE)

    @property
    def as_single(self) -> FilterParams:
        """The scalar filter of the mean of (z − offset)/gain weighted by `shares`: the fused one while all answer.

        Its r is 1/Σ gain²/r. It has no gate, which rejects single readings; and with p0 but no x0 it starts at the
        mean, not at the first reading.
        """
        noise = self.scaled_r
        r = 0.0 if noise.min() == 0.0 else float(noise.min() / (noise.min() / noise).sum())
        return FilterParams(self.q, r, self.p0, self.x0, momentum=self.momentum)

    def only(self, indices: Sequence[int]) -> FusionParams:
        """The same quantity from the sensors of these indices only, in this order.

        Raises:
            BadSetting: there is no index, or one that no sensor has.
        """
        chosen = list(indices)
        if not chosen or not all(-self.sensors <= one < self.sensors for one in chosen):
            raise BadSetting(f"indices must be those of sensors, 0 to {self.sensors - 1} (got {chosen})")
        return FusionParams(
            self.q,
            self.r[chosen],
            self.offset[chosen],
            self.gain[chosen],
            self.p0,
            self.x0,
            self.gate,
            self.momentum,
        )

    def __eq__(self, other: object) -> bool:
        return self._values() == other._values() if isinstance(other, FusionParams) else NotImplemented

    def __hash__(self) -> int:
        return hash(self._values())

    def _values(self) -> tuple[Any, ...]:
        columns = (tuple(column.tolist()) for column in (self.r, self.offset, self.gain))
        return self.q, *columns, self.p0, self.x0, self.gate, self.momentum


def _each(name: str, value: Any, missing: float, sensors: int) -> Array:
    """`value` as a read-only float64 array of shape (sensors,)."""
    try:
        array = np.array(np.full(sensors, missing) if value is None else value, dtype=np.float64)
    except (TypeError, ValueError):
        raise BadSetting(f"{name} must be one finite number per sensor (got {value!r})") from None
    if array.shape != (sensors,) or not np.all(np.abs(array) <= MAX_OFFSET):
        raise BadSetting(
            f"{name} must be one number per sensor, shape ({sensors},) as r, of a size up to 1e200 (got {value})"
        )
    array.setflags(write=False)
    return array
