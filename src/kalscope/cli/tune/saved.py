"""What a tuning file already holds and keeps when `kalscope tune -o` saves to it."""

from __future__ import annotations

from collections.abc import Sequence, Set
from pathlib import Path

from kalscope.errors import BadFile
from kalscope.recording import Recording
from kalscope.tuning.tuning import ChannelTuning, Tuning
from kalscope.tuning.tuning_file import load_tuning, save_tuning


def _saved_before(recording: Recording, output: Path) -> Tuning | None:
    """The tuning in the file where it is one of this recording, at its sample period."""
    try:
        before = load_tuning(output) if output.is_file() else None
    except BadFile:
        return None  # save_tuning reports what is wrong with it
    if before is None or before.sha256 != recording.sha256 or before.sample_period != recording.sample_period:
        return None
    return before


def _kept_channels(recording: Recording, tuned: Set[str], before: Tuning | None) -> list[ChannelTuning]:
    """The other channels that it holds: they were tuned before."""
    channels = () if before is None else before.channels
    return [one for one in channels if one.name in recording.names and one.name not in tuned]


def _replaced_chains(tuned: Set[str], before: Tuning | None) -> list[str]:
    """A sentence for each chain of filters that it held for a channel whose q and r were found now."""
    channels = () if before is None else before.channels
    return [
        f"{one.name}: {one.chain.words} is replaced by the Kalman filter of q and r"
        for one in channels
        if one.chain is not None and one.name in tuned
    ]


def save(
    recording: Recording,
    found: Sequence[ChannelTuning],
    tuned: Set[str],
    output: Path,
    fusion: ChannelTuning | None = None,
) -> list[str]:
    """Save filters beside those that the file keeps; returns notes about it for the user.

    Args:
        recording: where the channels are.
        found: the filters, at least one.
        tuned: all channels that were tuned, those without a filter too.
        output: the file.
        fusion: the filter that fuses them; None = the one that the file has.
    """
    before = _saved_before(recording, output)
    kept = _kept_channels(recording, tuned, before)
    notes = _replaced_chains({one.name for one in found}, before) if fusion is None else []
    if kept:
        notes.append(f"kept as they were in the tuning: {', '.join(one.name for one in kept)}")
    channels = sorted([*kept, *found], key=lambda one: recording.names.index(one.name))
    fusion = fusion or (None if before is None else before.fusion)
    save_tuning(Tuning.of(recording, channels, selected=found[0].name, fusion=fusion), output)
    return notes
