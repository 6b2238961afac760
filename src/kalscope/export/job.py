"""What an export starts from: one checked value that every target reads."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields, replace

from kalscope.errors import BadSetting
from kalscope.export.board.chain import runs_kalman
from kalscope.export.names import identifiers
from kalscope.filtering.momentum.constants import step_constants
from kalscope.filtering.steady_state import SteadyState, steady_state
from kalscope.tuning.tuning import ChannelTuning, Tuning


@dataclass(frozen=True)
class ExportJob:
    """The filters to be exported and where they come from.

    The texts are from outside: use them only through `comment_text`.

    Raises:
        BadSetting: No channel.
    """

    channels: tuple[ChannelTuning, ...]
    """The filters, at least one, names distinct (as in the tuning); or one alone that fuses sensors."""
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

    def __post_init__(self) -> None:
        if not self.channels:
            raise BadSetting("an export must hold at least one channel (got none)")

    @property
    def fusion(self) -> ChannelTuning:
        """The filter of an export that fuses."""
        return self.channels[0]

    @property
    def fuses(self) -> bool:
        """Whether the filter is one that fuses sensors."""
        return bool(self.fusion.sensors)

    @property
    def title(self) -> str:
        """What is exported, for its first line."""
        if self.fuses:
            return "Kalman filter that fuses several sensors of one quantity"
        return "Noise filters" if self.has_chain else "Scalar Kalman noise filter"

    @property
    def identifiers(self) -> tuple[str, ...]:
        """A distinct identifier [a-z][a-z0-9_]* for each channel in order, or each sensor and the fused value."""
        return identifiers(name for one in self.channels for name in (*one.sensors, one.name))

    @property
    def named_channels(self) -> tuple[tuple[str, ChannelTuning], ...]:
        """Each channel with its identifier, in their order."""
        return tuple(zip(self.identifiers, self.channels, strict=True))

    @property
    def sensor_identifiers(self) -> tuple[str, ...]:
        """A distinct identifier for each sensor, in their order."""
        return self.identifiers[:-1]

    @property
    def has_momentum(self) -> bool:
        """Whether any filter has momentum: its code then has the second state, also for those without."""
        return any(channel.momentum > 0.0 and runs_kalman(channel) for channel in self.channels)

    @property
    def has_chain(self) -> bool:
        """Whether any filter is a chain: each channel then says which filter it has."""
        return any(channel.chain is not None for channel in self.channels)

    @property
    def for_one_period(self) -> bool:
        """Whether the user cannot convert the export to another sample period."""
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
        """Marks of the lines of a template that this export needs."""
        has = {
            "momentum": self.has_momentum,
            "plain": not self.has_momentum,
            "chain": self.has_chain,
            "median": self.has_median,
            "kalman": self.has_kalman,
            "classic": not self.has_kalman,
            "gains": self.fusion.has_gains,
        }
        return frozenset(name for name, it_has in has.items() if it_has)

    @property
    def noise(self) -> tuple[float, ...]:
        """Measurement-noise variance of each sensor on the scale of the fused value, r / gain²."""
        return tuple(self.fusion.params.scaled_r.tolist())

    @property
    def arguments(self) -> tuple[dict[str, float], dict[str, tuple[float, ...]]]:
        """What makes a filter that fuses: numbers, without the automatic ones, and those of each sensor."""
        start = {name: getattr(self.fusion, name) for name in ("q", "p0", "x0", "gate")}
        single = {name: value for name, value in start.items() if value is not None} | step_of(self.fusion)
        return single, {"r": self.noise, "offset": self.fusion.offset, "gain": self.fusion.gain}

    @property
    def as_single(self) -> ExportJob:
        """The filter of one reading that equals it while all sensors answer, of their weighted mean."""
        return replace(self, channels=(self.fusion.as_channel,))

    def steady(self, channel: ChannelTuning) -> SteadyState:
        """Gain, lag and cut-off of the settled filter of one of the channels; while all of its sensors answer."""
        return steady_state(channel.params, self.sample_period)


def step_of(channel: ChannelTuning) -> dict[str, float]:
    """The constants of a filter with momentum by the names of `StepConstants`; {} without momentum."""
    return asdict(step_constants(channel.q, channel.momentum)) if channel.momentum > 0.0 else {}


def job_of(tuning: Tuning) -> ExportJob:
    """The job of the fusion of a tuning, or of all channels where it has none."""
    origin = {one.name: getattr(tuning, one.name) for one in fields(ExportJob) if one.name != "channels"}
    return ExportJob(tuning.channels if tuning.fusion is None else (tuning.fusion,), **origin)
