"""What an export starts from: one checked value that every target reads."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields
from typing import Any

from kalscope.errors import BadSetting
from kalscope.export.board.chain import runs_kalman
from kalscope.export.names import identifiers
from kalscope.filtering.momentum.constants import step_constants
from kalscope.filtering.steady_state import SteadyState, steady_state
from kalscope.tuning.fusion import FusionTuning
from kalscope.tuning.tuning import ChannelTuning, Tuning


@dataclass(frozen=True, kw_only=True)
class Origin:
    """Where an export comes from; the texts are from outside: use them only through `comment_text`."""

    sample_period: float | None = None
    """Sample period that q belongs to, s; None where unknown."""
    source_name: str = ""
    """Name of the recording it was tuned on, for display."""
    sha256: str = ""
    """SHA-256 of that recording, "" where unknown."""
    tool: str = ""
    """Program and version that made the tuning."""
    date: str = ""
    """When the tuning was made, UTC, ISO 8601."""

    @property
    def title(self) -> str:
        """What is exported, for its first line."""
        raise NotImplementedError

    @property
    def has_momentum(self) -> bool:
        """Whether any filter has momentum: its code then has the second state, also for those without."""
        raise NotImplementedError

    @property
    def for_one_period(self) -> bool:
        """Whether the user cannot convert the export to another sample period."""
        return self.has_momentum

    @property
    def marks(self) -> frozenset[str]:
        """Marks of the lines of a template that this export needs."""
        return frozenset({"momentum" if self.has_momentum else "plain"})


@dataclass(frozen=True)
class ExportJob(Origin):
    """The filters to be exported and where they come from.

    Raises:
        BadSetting: No channel.
    """

    channels: tuple[ChannelTuning, ...]
    """The filters, at least one, names distinct (as in the tuning)."""

    def __post_init__(self) -> None:
        if not self.channels:
            raise BadSetting("an export must hold at least one channel (got none)")

    @property
    def title(self) -> str:
        """As in `Origin`."""
        return "Noise filters" if self.has_chain else "Scalar Kalman noise filter"

    @property
    def identifiers(self) -> tuple[str, ...]:
        """A distinct identifier [a-z][a-z0-9_]* for each channel, in their order."""
        return identifiers(channel.name for channel in self.channels)

    @property
    def named_channels(self) -> tuple[tuple[str, ChannelTuning], ...]:
        """Each channel with its identifier, in their order."""
        return tuple(zip(self.identifiers, self.channels, strict=True))

    @property
    def has_momentum(self) -> bool:
        """As in `Origin`."""
        return any(channel.momentum > 0.0 and runs_kalman(channel) for channel in self.channels)

    @property
    def has_chain(self) -> bool:
        """Whether any filter is a chain: each channel then says which filter it has."""
        return any(channel.chain is not None for channel in self.channels)

    @property
    def for_one_period(self) -> bool:
        """As in `Origin`."""
        return self.has_momentum or self.has_chain

    @property
    def has_median(self) -> bool:
        """Whether the median of samples goes into any filter."""
        return any(channel.chain is not None and channel.chain.median > 1 for channel in self.channels)

    @property
    def has_kalman(self) -> bool:
        """Whether any channel has a Kalman filter, after a median or alone."""
        return any(map(runs_kalman, self.channels))

    @property
    def marks(self) -> frozenset[str]:
        """As in `Origin`; of a chain and a median; and whether any filter is Kalman's, or none."""
        has = {"chain": self.has_chain, "median": self.has_median, "kalman": self.has_kalman}
        has["classic"] = not self.has_kalman
        return super().marks.union(name for name, it_has in has.items() if it_has)

    def steady(self, channel: ChannelTuning) -> SteadyState:
        """Gain, lag and cut-off of the settled filter of one of the channels."""
        return steady_state(channel.params, self.sample_period)


@dataclass(frozen=True)
class FusionJob(Origin):
    """The filter that fuses several sensors, and where it comes from."""

    fusion: FusionTuning
    """The filter."""

    @property
    def title(self) -> str:
        """As in `Origin`."""
        return "Kalman filter that fuses several sensors of one quantity"

    @property
    def identifier(self) -> str:
        """The fused value as an identifier [a-z][a-z0-9_]*, other than those of the sensors."""
        return identifiers((*self.fusion.sensors, self.fusion.name))[-1]

    @property
    def sensor_identifiers(self) -> tuple[str, ...]:
        """A distinct identifier for each sensor, in their order."""
        return identifiers(self.fusion.sensors)

    @property
    def has_momentum(self) -> bool:
        """As in `Origin`."""
        return self.fusion.momentum > 0.0

    @property
    def has_gains(self) -> bool:
        """Whether a reading must be divided by a gain."""
        return any(gain != 1.0 for gain in self.fusion.gain)

    @property
    def marks(self) -> frozenset[str]:
        """As in `Origin`, and of the gains."""
        return super().marks.union(["gains"] if self.has_gains else [])

    @property
    def noise(self) -> tuple[float, ...]:
        """Measurement-noise variance of each sensor on the scale of the fused value, r / gain²."""
        return tuple(self.fusion.params.scaled_r.tolist())

    @property
    def arguments(self) -> tuple[dict[str, float], dict[str, tuple[float, ...]]]:
        """What makes the filter: single numbers, without those that are automatic, and those of each sensor."""
        start = {name: getattr(self.fusion, name) for name in ("q", "p0", "x0", "gate")}
        single = {name: value for name, value in start.items() if value is not None} | step_of(self.fusion)
        return single, {"r": self.noise, "offset": self.fusion.offset, "gain": self.fusion.gain}

    @property
    def as_single(self) -> ExportJob:
        """The filter of one reading that equals it while all sensors answer, of their weighted mean."""
        fusion, one = self.fusion, self.fusion.params.as_single
        name, unit, r = fusion.name, fusion.unit, float(one.r)
        channel = ChannelTuning(name, unit, fusion.q, r, fusion.p0, fusion.x0, momentum=fusion.momentum)
        return ExportJob((channel,), sample_period=self.sample_period)

    @property
    def steady(self) -> SteadyState:
        """Gain, lag and cut-off of the settled filter while all sensors answer."""
        return self.as_single.steady(self.as_single.channels[0])


def step_of(channel: ChannelTuning | FusionTuning) -> dict[str, float]:
    """The constants of a filter with momentum by the names of `StepConstants`; {} without momentum."""
    return asdict(step_constants(channel.q, channel.momentum)) if channel.momentum > 0.0 else {}


def job_of(tuning: Tuning) -> ExportJob:
    """The job of all channels of a tuning."""
    return ExportJob(tuning.channels, **_origin(tuning))


def fusion_job_of(tuning: Tuning) -> FusionJob | None:
    """The job of the fusion of a tuning; None where it has none."""
    return None if tuning.fusion is None else FusionJob(tuning.fusion, **_origin(tuning))


def _origin(tuning: Tuning) -> dict[str, Any]:
    return {field.name: getattr(tuning, field.name) for field in fields(Origin)}
