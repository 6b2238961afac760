"""State -> Overview: every channel raw and filtered, each on a lane of its own; computed at rest."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from kalscope.common.array import Array
from kalscope.filtering.batch import denoise
from kalscope.filtering.params import FilterParams
from kalscope.papers.experiments import run_filter
from kalscope_app.engine.decimation import choose_indices

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from kalscope.papers.parts import Settings
    from kalscope.recording import Recording
    from kalscope_app.session.state import State

LIMIT = 16
"""Channels that are drawn: more lanes than that are too low to read."""

POINTS = 3000
"""Most points of all lanes together, before what they share is drawn once."""

HALF_LANE = 0.46
"""Half the height of a lane, which is 1: a little air stays between two."""


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
    """Moments drawn, s, ascending, shape (m,)."""
    lanes: tuple[Lane, ...]
    """At most 16 of the channels; none where the recording has only one."""


class Overviews:
    """Computes overviews; what a change does not touch is kept."""

    def __init__(self) -> None:
        self._of: tuple[Recording, object] | None = None
        self._at: NDArray[np.intp] = np.zeros(0, dtype=np.intp)
        self._known: dict[tuple[str, Settings], Array] = {}

    def compute(self, state: State) -> Overview:
        """The overview of a state."""
        recording = state.recording
        clock = np.maximum.accumulate(recording.time)
        if len(recording.names) < 2:
            return Overview(state, clock[:0], ())
        self._look_at(state, clock)
        known, self._known = self._known, {}
        lanes = []
        for i, name in enumerate(recording.names[:LIMIT]):
            settings = (
                state.settings.paper_filters[i] if state.settings.paper_filters else None
            ) or state.settings.tunings[i].params
            key = name, settings
            if key not in known:
                known[key] = _filtered(recording.values[:, i], settings, state.dt)[self._at]
            self._known[key] = known[key]
            lanes.append(_lane(name, recording.values[:, i], self._at, known[key]))
        return Overview(state, clock[self._at], tuple(lanes))

    def _look_at(self, state: State, clock: Array) -> None:
        """Choose the samples to draw, anew where recording or window changed."""
        if self._of is not None and self._of[0] is state.recording and self._of[1] == state.view.window:
            return
        self._of, self._known = (state.recording, state.view.window), {}
        first, last = 0, len(clock)
        if state.view.window is not None:
            first = int(np.searchsorted(clock, state.view.window[0], side="left"))
            last = max(int(np.searchsorted(clock, state.view.window[1], side="right")), first + 1)
        values = state.recording.values[first:last, :LIMIT]
        share = max(2, POINTS // values.shape[1])
        chosen = [choose_indices(np.ascontiguousarray(column), None, share) for column in values.T]
        self._at = first + np.unique(np.concatenate(chosen))


def _filtered(z: Array, settings: Settings, dt: Array | None) -> Array:
    return denoise(z, settings, dt) if isinstance(settings, FilterParams) else run_filter(z, settings, dt).x


def _lane(name: str, z: Array, at: NDArray[np.intp], filtered: Array) -> Lane:
    raw = z[at]
    seen = raw[np.isfinite(raw)]
    low, high = (float(seen.min()), float(seen.max())) if len(seen) else (float("nan"), float("nan"))
    middle, half = (0.5 * low + 0.5 * high, 0.5 * high - 0.5 * low) if len(seen) else (0.0, 1.0)
    half = half if half > 0.0 else 1.0
    missing = int(np.isnan(z).sum())
    return Lane(name, low, high, missing, (raw - middle) / half, np.clip((filtered - middle) / half, -1.0, 1.0))
