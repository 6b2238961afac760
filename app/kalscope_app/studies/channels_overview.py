"""State -> Overview: every channel raw and filtered, each on its own lane; an idle-time computation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kalscope.common.array import Array
from kalscope.recording import Recording
from kalscope_app.engine.cache import Cache
from kalscope_app.engine.decimation import choose_indices
from kalscope_app.session.state import State

MAX_LANES = 16
"""Channels that are drawn, at most: with more, the lanes are too low to read."""

MAX_POINTS = 3000
"""Points of all lanes together, at most, before what they share is drawn once."""

HALF_LANE = 0.46
"""Half the height of a lane, which is 1: a small gap stays between two."""


@dataclass(frozen=True)
class Lane:
    """One channel."""

    name: str
    """Name of the channel."""
    low: float
    """Its smallest value on screen, unit; NaN where it has none."""
    high: float
    """Its largest, unit."""
    missing: int
    """Missing samples of the whole recording."""
    raw: Array
    """Measurements, −1 … 1 between low and high, shape (m,); NaN where missing."""
    filtered: Array
    """Filtered, on the same scale."""


@dataclass(frozen=True)
class Overview:
    """The channels of a recording side by side."""

    state: State
    """The choices that it belongs to."""
    time: Array
    """Times drawn, s, ascending, shape (m,)."""
    lanes: tuple[Lane, ...]
    """At most 16 of the channels; none where the recording has only one."""


class Overviews:
    """Computes overviews; what a change does not touch is kept."""

    def __init__(self) -> None:
        self._drawn = Cache[NDArray[np.intp]]()
        self._filtered = Cache[Array]()

    def compute(self, state: State) -> Overview:
        """The overview of a state."""
        recording, window = state.recording, state.view.window
        if len(recording.names) < 2:
            return Overview(state, np.empty(0), ())
        clock = np.maximum.accumulate(recording.time)
        at = self._drawn.once(lambda: _drawn_samples(recording, clock, window), recording, window)
        self._filtered.begin(recording, window)
        lanes: list[Lane] = []
        for i, name in enumerate(recording.names[:MAX_LANES]):
            z, used = recording.values[:, i], state.settings.tunings[i].filter
            filtered = self._filtered.get((i, used), lambda z=z, used=used: used.denoise(z, state.dt)[at])
            lanes.append(_lane(name, z, at, filtered))
        return Overview(state, clock[at], tuple(lanes))


def _drawn_samples(recording: Recording, clock: Array, window: tuple[float, float] | None) -> NDArray[np.intp]:
    """Indices of the samples that show every channel in the window, ascending."""
    first, last = 0, len(clock)
    if window is not None:
        first = int(np.searchsorted(clock, window[0], side="left"))
        last = max(int(np.searchsorted(clock, window[1], side="right")), first + 1)
    values = recording.values[first:last, :MAX_LANES]
    share = max(2, MAX_POINTS // values.shape[1])
    chosen = [choose_indices(np.ascontiguousarray(column), None, share) for column in values.T]
    return first + np.unique(np.concatenate(chosen))


def _lane(name: str, z: Array, at: NDArray[np.intp], filtered: Array) -> Lane:
    raw = z[at]
    seen = raw[np.isfinite(raw)]
    low, high = (float(seen.min()), float(seen.max())) if len(seen) else (float("nan"), float("nan"))
    middle, half = (0.5 * low + 0.5 * high, 0.5 * high - 0.5 * low) if len(seen) else (0.0, 1.0)
    half = half if half > 0.0 else 1.0
    missing = int(np.isnan(z).sum())
    return Lane(name, low, high, missing, (raw - middle) / half, np.clip((filtered - middle) / half, -1.0, 1.0))
