"""The model's parameters as one frozen, checked value.

The model is the local level: x is a random walk of variance q per sample, z = x + noise of variance r. With
momentum τ the walk keeps its direction for about τ samples; τ = 0 is the plain one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from kalscope.common.array import Array
from kalscope.errors import BadSetting

MAX_MOMENTUM = 1e5
"""Longest momentum accepted, in sample periods: beyond it the velocity is as good as constant."""
MIN_MOMENTUM = 1e-12
"""Shorter ones, in sample periods, count as none: they change no digit of the filter."""
MAX_VARIANCE = 1e300
"""Largest variance accepted: sums of two of them still fit a double."""
NO_GATE = 1e300
"""A gate that rejects nothing: for channels without one beside others with one."""

Parameter = float | Array
"""One number for every channel, or an array of shape (channels,)."""

_VARIANCE = "a finite variance from 0 to 1e300"
_MUST = {
    "q": _VARIANCE,
    "r": _VARIANCE,
    "p0": _VARIANCE,
    "x0": "a finite number in the unit of the signal",
    "gate": "a finite threshold on v²/s above 0, such as 9",
    "momentum": "a number of sample periods from 0 to 1e5",
}
"""What each parameter must be."""


@dataclass(frozen=True, eq=False)
class FilterParams:
    """Parameters of the scalar Kalman filter: scalars, or arrays of shape (channels,).

    Raises:
        BadSetting: a value is not a finite number in its range, q and r are both 0, x0 comes without p0, or
            the arrays have different lengths.
    """

    q: Parameter
    """Process-noise variance added per nominal sample period, unit², 0 … 1e300."""
    r: Parameter
    """Measurement-noise variance, unit², 0 … 1e300; q and r are not both 0."""
    p0: Parameter | None = None
    """Variance of the estimate before the first predict, unit², ≥ 0; None = exact diffuse start."""
    x0: Parameter | None = None
    """Estimate before the first predict, unit; None = the first finite sample. Needs p0."""
    gate: Parameter | None = None
    """Outlier gate: a sample whose v²/s exceeds it is not used (9 = three sigma), > 0; None = off."""
    momentum: Parameter = 0.0
    """Momentum τ: how long the signal keeps its direction, in nominal sample periods, 0 … 1e5; 0 = it does not,
    and below 1e-12 is taken as 0."""

    def __post_init__(self) -> None:
        given = {name: getattr(self, name) for name in _MUST}
        checked = {
            name: None if value is None and name not in ("q", "r", "momentum") else _checked(name, value)
            for name, value in given.items()
        }
        if self.x0 is not None and self.p0 is None:
            raise BadSetting(f"x0 needs p0, the variance of that first estimate (got x0 = {self.x0} alone)")
        lengths = {len(v) for v in checked.values() if isinstance(v, np.ndarray)}
        if len(lengths) > 1:
            raise BadSetting(f"parameters must have one value per channel (got {sorted(lengths)} values)")
        if np.any((np.asarray(checked["q"]) == 0.0) & (np.asarray(checked["r"]) == 0.0)):
            raise BadSetting("q and r must not both be 0: their ratio decides the filter (got q = 0, r = 0)")
        for name, value in checked.items():
            object.__setattr__(self, name, value)

    @property
    def channels(self) -> int | None:
        """Number of channels of the arrays; None where all values are scalars."""
        return next((len(v) for v in self._values() if isinstance(v, np.ndarray)), None)

    @property
    def ratio(self) -> Parameter:
        """λ = q / r, dimensionless; inf for r = 0."""
        with np.errstate(divide="ignore", over="ignore", under="ignore"):
            value = np.divide(self.q, self.r)
        return float(value) if np.ndim(value) == 0 else value

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, FilterParams):
            return NotImplemented
        return all(map(_same, self._values(), other._values()))

    def __hash__(self) -> int:
        return hash(tuple(v.tobytes() if isinstance(v, np.ndarray) else v for v in self._values()))

    def _values(self) -> tuple[Parameter | None, ...]:
        return self.q, self.r, self.p0, self.x0, self.gate, self.momentum


def require_params(params: object) -> None:
    """Refuse what is no parameters, above all the None of an estimate that found no usable q and r.

    Raises:
        BadSetting: It is not `FilterParams`.
    """
    if not isinstance(params, FilterParams):
        raise BadSetting(
            f"params must be FilterParams (got {params!r:.60}): where estimate finds no usable q and r, its "
            "message says why; choose them, as in FilterParams(q=0.01, r=1)"
        )


def _checked(name: str, value: Any) -> Parameter:
    """`value` as a float or a read-only array of shape (channels,), in the range that _MUST states."""
    wrong = f"{name} must be {_MUST[name]}"
    if isinstance(value, float):  # as an array it would take ten times as long
        if not (math.isfinite(value) and _in_range(name, value)):
            raise BadSetting(f"{wrong} (got {value})")
        return 0.0 if name == "momentum" and value < MIN_MOMENTUM else float(value)
    try:
        array = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise BadSetting(f"{wrong} (got {value!r})") from None
    if array.ndim > 1 or array.size == 0 or not np.all(np.isfinite(array) & _in_range(name, array)):
        raise BadSetting(f"{wrong} (got {value})")
    if name == "momentum":
        array = np.where(array < MIN_MOMENTUM, 0.0, array)
    if array.ndim == 0:
        return float(array)
    array.setflags(write=False)
    return array


def _in_range(name: str, value: Any) -> Any:
    if name == "x0":
        return True
    if name == "gate":
        return value > 0.0
    return (value >= 0.0) & (value <= (MAX_MOMENTUM if name == "momentum" else MAX_VARIANCE))


def _same(a: Parameter | None, b: Parameter | None) -> bool:
    if a is None or b is None:
        return a is b
    return math.prod(np.shape(a)) == math.prod(np.shape(b)) and np.array_equal(a, b)
