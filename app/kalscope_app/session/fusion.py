"""The fused filter of a State: several sensors of one quantity, some of which may be dropped."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

from kalscope.errors import BadSetting
from kalscope.filtering.params import MAX_VARIANCE, FilterParams
from kalscope.recording import Recording
from kalscope.tuning.tuning import ChannelTuning

if TYPE_CHECKING:
    from kalscope.estimation.fusion.result import FusionEstimate

MIN_SENSORS = 2
"""One sensor needs no fusion."""

MAX_SENSORS = 8
"""Sensors that the dashboard fuses, at most; the command line takes more."""


@dataclass(frozen=True)
class Fusion:
    """The filter that was found for several sensors, and which of them take part."""

    tuning: ChannelTuning
    """Of all sensors."""
    start: ChannelTuning
    """What it was when the sensors were fused; Reset goes back there."""
    dropped: frozenset[str] = frozenset()
    """Sensors that take no part."""
    estimate: FusionEstimate | None = None
    """What the search found about them; None where the filter comes from a file."""

    @cached_property
    def used(self) -> ChannelTuning:
        """The filter of the sensors that take part."""
        return self._of_used(self.tuning)

    @cached_property
    def params(self) -> FilterParams:
        """Its parameters."""
        return self.used.params

    @cached_property
    def as_channel(self) -> ChannelTuning:
        """The filter of one channel that it equals while all sensors in use answer."""
        return self.used.as_channel

    @cached_property
    def start_as_channel(self) -> ChannelTuning:
        """The same of its starting values."""
        return self._of_used(self.start).as_channel

    @property
    def reset(self) -> Fusion:
        """As it was when the sensors were fused; all of them take part."""
        return replace(self, tuning=self.start, dropped=frozenset())

    @cached_property
    def shares(self) -> Mapping[str, float]:
        """What each sensor contributes to the fused value while all answer; 0 for a dropped one."""
        shares = dict.fromkeys(self.tuning.sensors, 0.0)
        return {**shares, **dict(zip(self.used.sensors, self.params.shares.tolist(), strict=True))}

    def columns(self, recording: Recording) -> list[int]:
        """The columns of a recording with the readings of the sensors that take part."""
        return [recording.index(name) for name in self.used.sensors]

    def fits(self, recording: Recording) -> bool:
        """Whether a recording has all its sensors."""
        return set(self.tuning.sensors) <= set(recording.names)

    def with_values(self, **values: Any) -> Fusion:
        """With other values of the fused filter, as of a channel: another r scales the noise of every sensor."""
        r = values.pop("r", None)
        if r is not None and r != self.as_channel.r:
            factor = r / self.as_channel.r if self.as_channel.r > 0.0 else 1.0
            values["r"] = tuple(min(one * factor, MAX_VARIANCE) for one in self.tuning.r)
        return replace(self, tuning=replace(self.tuning, **values))

    def with_sensor(self, sensor: str, **values: float) -> Fusion:
        """With another r or offset of one sensor."""
        at = self.tuning.sensors.index(sensor)
        changed = {
            name: tuple(value if i == at else old for i, old in enumerate(getattr(self.tuning, name)))
            for name, value in values.items()
        }
        return replace(self, tuning=replace(self.tuning, **changed, how="by hand"))

    def with_taking_part(self, sensor: str, takes_part: bool) -> Fusion:
        """With a sensor dropped, or taking part again.

        Raises:
            BadSetting: it is the last one.
        """
        dropped = self.dropped - {sensor} if takes_part else self.dropped | {sensor}
        if len(dropped) == len(self.tuning.sensors):
            raise BadSetting(f"at least one sensor must take part (got {sensor[:40]!r}, the last one, dropped out)")
        return replace(self, dropped=dropped)

    def _of_used(self, tuning: ChannelTuning) -> ChannelTuning:
        return tuning.of_sensors(name for name in tuning.sensors if name not in self.dropped)
