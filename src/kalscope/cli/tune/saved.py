"""What a tuning file already holds and keeps when `kalscope tune -o` saves to it."""

from __future__ import annotations

from collections.abc import Set
from pathlib import Path

from kalscope.errors import BadFile
from kalscope.recording import Recording
from kalscope.tuning.tuning import ChannelTuning, Tuning
from kalscope.tuning.tuning_file import load_tuning


def saved_before(recording: Recording, output: Path) -> Tuning | None:
    """The tuning in the file where it is one of this recording, at its sample period."""
    try:
        before = load_tuning(output) if output.is_file() else None
    except BadFile:
        return None  # save_tuning reports what is wrong with it
    if before is None or before.sha256 != recording.sha256 or before.sample_period != recording.sample_period:
        return None
    return before


def kept_channels(recording: Recording, tuned: Set[str], before: Tuning | None) -> list[ChannelTuning]:
    """The other channels that it holds: they were tuned before."""
    channels = () if before is None else before.channels
    return [one for one in channels if one.name in recording.names and one.name not in tuned]


def replaced_chains(tuned: Set[str], before: Tuning | None) -> list[str]:
    """A sentence for each chain of filters that it held for a channel whose q and r were found now."""
    channels = () if before is None else before.channels
    return [
        f"{one.name}: {one.chain.words} is replaced by the Kalman filter of q and r"
        for one in channels
        if one.chain is not None and one.name in tuned
    ]
