"""Reads the channels to fit from a file."""

from __future__ import annotations

from dataclasses import dataclass

from kalscope.analysis.channel_kinds import default_channel
from kalscope.common.array import Array
from kalscope.errors import BadFile
from kalscope.recording import Recording
from kalscope.sources.readers.recording_file import read_recording
from kalscope.tuning.fleet.recordings.unit import Unit
from kalscope.tuning.fleet.work.asked import Asked


@dataclass(frozen=True)
class Series:
    """One channel of one recording."""

    id: str
    """Name of the recording."""
    recording: Recording
    """Where the channel is."""
    channel: str
    """Its name."""

    @property
    def z(self) -> Array:
        """The samples, shape (n,)."""
        return self.recording.channel(self.channel)

    @property
    def dt(self) -> Array | None:
        """Nominal sample periods before each sample; None = 1 each."""
        return self.recording.steps() if self.recording.gaps == "dt" else None


def read_file(unit: Unit, asked: Asked) -> list[Series]:
    """The channels of a file.

    Raises:
        BadFile: it cannot be read.
        BadSetting: an option does not suit it, or it has no such channel.
    """
    if unit.reason:
        raise BadFile(unit.reason)
    recording = read_recording(unit.pieces[0].path, asked.reading, sample_period=asked.sample_period)
    return channels_of(recording, unit.id, unit.channel, asked)


def channels_of(recording: Recording, name: str, channel: str | None, asked: Asked) -> list[Series]:
    """The channels of a recording that are asked for.

    Args:
        recording: What was read.
        name: Its name in the table.
        channel: The channel that a list names, or None.
        asked: The options.
    """
    chosen = channel or asked.channel
    if chosen is not None:
        recording.index(chosen)
    names = (chosen,) if chosen else recording.names if asked.every else (default_channel(recording),)
    return [Series(name, recording, one) for one in names]
