"""Facts about all samples of a record, kept between frames: of a live record only the new samples are read."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kalscope.recording import Recording
from kalscope_app.session.state import State


@dataclass(frozen=True)
class Facts:
    """What holds for a whole recording and one of its channels."""

    ascends: bool = True
    """Whether its time never steps back."""
    missing: int = 0
    """Missing samples of the channel."""

    def clock(self, recording: Recording) -> NDArray[np.float64]:
        """Times to draw at, s, never descending, shape (n,): where time steps back, the last value is held."""
        return recording.time if self.ascends else np.maximum.accumulate(recording.time)


def facts_of(recording: Recording, channel: str, known: Facts | None = None, seen: int = 0) -> Facts:
    """The facts of a recording whose first `seen` samples are `known`."""
    known = known or Facts()
    time = recording.time[max(seen - 1, 0) :]
    gaps = np.isnan(recording.channel(channel)[seen:])
    return Facts(known.ascends and not np.any(time[1:] < time[:-1]), known.missing + int(np.count_nonzero(gaps)))


class RecordFacts:
    """The facts of the record on screen."""

    def __init__(self) -> None:
        self._state: State | None = None  # held so that the ids in its key stay valid
        self._facts = Facts()

    def of(self, state: State) -> Facts:
        """The facts of what a State shows; of a record that has grown only the new samples are read."""
        recording, before = state.recording, self._state
        grown = before is not None and _key(before) == _key(state) and len(before.recording) <= len(recording)
        known, seen = (self._facts, len(before.recording)) if grown and before is not None else (None, 0)
        self._facts, self._state = facts_of(recording, state.channel, known, seen), state
        return self._facts


def _key(state: State) -> tuple[object, ...]:
    snapshot = state.live.snapshot if state.live else None
    return state.record_key, state.channel, 0 if snapshot is None else snapshot.first
