"""What an export starts from: one checked value that every target reads."""

from __future__ import annotations

from dataclasses import asdict, dataclass

from kalscope.errors import BadSetting
from kalscope.export.names import identifiers
from kalscope.filtering.momentum.constants import step_constants
from kalscope.filtering.steady_state import SteadyState, steady_state
from kalscope.tuning.tuning import ChannelTuning, Tuning


@dataclass(frozen=True)
class ExportJob:
    """The filters to be exported and where they come from.

    Raises:
        BadSetting: No channel.
    """

    channels: tuple[ChannelTuning, ...]
    """The filters, at least one, names distinct (as in the tuning)."""
    sample_period: float | None = None
    """Sample period that q belongs to, s; None where unknown."""
    source_name: str = ""
    """Name of the recording it was tuned on, for display; from outside: only through `comment_text`."""
    sha256: str = ""
    """SHA-256 of that recording, "" where unknown; from outside as well."""
    tool: str = ""
    """Program and version that made the tuning; from outside as well."""
    date: str = ""
    """When the tuning was made, UTC, ISO 8601; from outside as well."""

    def __post_init__(self) -> None:
        if not self.channels:
            raise BadSetting("an export must hold at least one channel (got none)")

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
        """Whether any filter has momentum: its code then has the second state, also for those without."""
        return any(channel.momentum > 0.0 for channel in self.channels)

    def steady(self, channel: ChannelTuning) -> SteadyState:
        """Gain, lag and cut-off of the settled filter of one of the channels."""
        return steady_state(channel.params, self.sample_period)


def step_of(channel: ChannelTuning) -> dict[str, float]:
    """The constants of a channel with momentum by the names of `StepConstants`; {} without momentum."""
    return asdict(step_constants(channel.q, channel.momentum)) if channel.momentum > 0.0 else {}


def job_of(tuning: Tuning) -> ExportJob:
    """The job of a whole tuning."""
    return ExportJob(
        channels=tuning.channels,
        sample_period=tuning.sample_period,
        source_name=tuning.source_name,
        sha256=tuning.sha256,
        tool=tuning.tool,
        date=tuning.date,
    )
