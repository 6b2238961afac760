"""Which part of the screen is drawn when: what the user watches at once, the rest as soon as there is time.

If every part were drawn for every step of a slider, the line that the user watches would lag in the browser. So
some parts may lag behind the newest frame, each for a limited time. Pure: no clock and no thread.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum

from kalscope_app.session.state import State


class Part(IntEnum):
    """A part of the screen, in the order in which the parts are drawn."""

    SIGNAL = 0
    """The chart of the signal, with about two points to each pixel."""
    NUMBERS = 1
    """Header, boxes and sliders, the numbers, the goal, the mark in the map; the picture on a phone."""
    CHARTS = 2
    """The charts below that of the signal, and the line above it."""
    OTHER = 3
    """What is in other tabs and in closed folders. viser does not report which tab is open."""
    FULL = 4
    """The chart of the signal with all its points."""


@dataclass(frozen=True)
class Delay:
    """How long a part may lag behind the newest frame, s."""

    pause: float
    """Without a newer frame; a slider that moves brings one every 0.05 s."""
    longest: float
    """While newer frames keep coming."""


DELAYS: Mapping[Part, Delay] = {
    Part.NUMBERS: Delay(0.06, 0.08),
    Part.CHARTS: Delay(0.12, 0.13),
    Part.OTHER: Delay(0.12, 1.0),
    Part.FULL: Delay(0.12, math.inf),
}
"""Of the parts that may wait."""


class Schedule:
    """Which parts are behind the newest frame, and when each must be drawn. Times are in s, of one clock."""

    def __init__(self) -> None:
        self._newest = -math.inf
        self._behind: dict[Part, float] = {}

    def begin(self, now: float, *, whole: bool) -> tuple[Part, ...]:
        """A new frame has arrived: which of its parts to draw now; `whole`: none may wait."""
        self._newest = now
        if whole:
            self._behind.clear()
            return tuple(Part)
        for part in DELAYS:
            self._behind.setdefault(part, now)
        return (Part.SIGNAL,)

    def next_due(self) -> float:
        """When the next part is due if no newer frame comes; inf if none is behind."""
        return min(map(self._due, self._behind), default=math.inf)

    def take_due(self, now: float, *, moving: bool) -> tuple[Part, ...]:
        """The parts of the newest frame to draw now, which then are no longer behind.

        Args:
            now: the time.
            moving: whether a newer frame is due too: it takes precedence over parts that may still wait.
        """
        due = tuple(part for part in sorted(self._behind) if now >= (self._latest if moving else self._due)(part))
        for part in due:
            del self._behind[part]
        return due

    def _due(self, part: Part) -> float:
        return min(self._newest + DELAYS[part].pause, self._latest(part))

    def _latest(self, part: Part) -> float:
        return self._behind[part] + DELAYS[part].longest


def is_move(before: State, after: State) -> bool:
    """Whether only values of the filter have changed, or a live record has grown; no line and no chart is new."""
    return _what_is_drawn(before) == _what_is_drawn(after)


def _what_is_drawn(state: State) -> tuple[object, ...]:
    momentum = state.uses_parameters and state.tuning.momentum > 0.0
    shown = state.record_key, state.measured, state.board, state.variants, state.view
    return *shown, state.is_standard, state.tuning.chain, momentum, state.answers.note
