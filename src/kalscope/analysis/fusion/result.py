"""FusionVerdict: the verdict on fused sensors, in numbers and sentences."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from kalscope.common.array import Array
from kalscope.estimation.fusion.shared import Shared

Fault = Literal["drift", "noise", "spikes", "stuck", "silent"]
"""What can be wrong with a sensor: its difference from the others moves; the size of its noise changes; single
readings far off; it repeats one value; it is silent for a long time."""


@dataclass(frozen=True, eq=False)
class SensorVerdict:
    """One of the fused sensors. No number is ever NaN."""

    name: str
    """Its name."""
    share: float
    """Its share of the fused value while all sensors answer, 0 … 1."""
    answered: float
    """Share of the rows in which it has a reading."""
    error: float
    """Error of the quantity with this sensor alone, one standard deviation, unit, predicted by the model."""
    error_without: float
    """Error where this sensor drops out and the others continue, unit; inf where it is the only one."""
    shares_without: Array
    """Shares of all sensors then, shape (sensors,): its own is 0."""
    pull: float
    """How far the fused value in the end goes towards this sensor where it sticks at one value, 0 … 1: its share,
    or as tried out with an outlier gate."""
    drift: float
    """By how much its difference from the others moves within the record, unit; 0 where not more than by chance."""
    noise_ratio: float
    """Largest over smallest variance of its noise within the record; 1 where not more than by chance."""
    spikes: int
    """Readings far off that no other sensor confirms."""
    stuck: tuple[int, int]
    """First row and one past the last of its longest stretch of equal readings; (0, 0) where none is odd."""
    silent: tuple[int, int]
    """The same of its longest stretch without a reading."""
    faults: tuple[Fault, ...]
    """What is wrong with it; () where nothing is."""
    sentences: tuple[str, ...]
    """Each fault in one sentence; then what happens when it drops out, and when it sticks."""


@dataclass(frozen=True, eq=False)
class HeldOut:
    """How the readings of the second half are predicted one row ahead. There is no truth to compare with."""

    fused: float
    """Root mean square error of the prediction, the noise of the predicted readings included, unit."""
    single: Array
    """The same of predictions by each sensor alone, shape (sensors,)."""
    best: int
    """The sensor that predicts best."""
    is_certain: bool
    """Whether fused and best single sensor differ by more than chance."""


@dataclass(frozen=True, eq=False)
class FusionVerdict:
    """What fusing brings, and what each sensor does in it."""

    error: float
    """Error of the fused value, 1 σ, unit, predicted by the model for the rows in which every sensor has begun."""
    best: int
    """The sensor with the smallest error alone."""
    held_out: HeldOut | None
    """How well the second half is predicted; None where there are too few rows."""
    sensors: tuple[SensorVerdict, ...]
    """One a sensor, in the order of the columns."""
    headline: str
    """What fusing brings, in one sentence."""
    sentences: tuple[str, ...]
    """The headline, the held-out stretch, shares, and faults; what follows if one fails is with the sensors."""
    shared: Shared | None = None
    """The sensors whose noises are correlated; None where none shows."""
