"""The filter on screen beside simpler ones: an idle-time computation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kalscope.analysis.alternatives import Alternative, Comparison, compare_alternatives, stretch_of
from kalscope.common.array import Array
from kalscope.tuning.paper_tuning import PaperTuning
from kalscope_app.engine.cache import Cache
from kalscope_app.engine.decimation import DrawnSamples, choose_samples
from kalscope_app.session.state import State


@dataclass(frozen=True)
class Compared:
    """The present filter beside simpler ones, and which samples of them are drawn."""

    state: State
    """The choices that were compared."""
    found: Comparison
    """All of them, over their stretch."""
    drawn: DrawnSamples
    """The samples that the signal chart draws; those outside the stretch are left out."""

    @property
    def inside(self) -> np.ndarray:
        """Which of the drawn samples lie in the stretch, bool, shape (m,)."""
        at = self.drawn.indices
        return (at >= self.found.first) & (at < self.found.last)

    def curve(self, one: Alternative) -> Array:
        """A curve at the drawn samples inside the stretch."""
        return one.curve[self.drawn.indices[self.inside] - self.found.first]

    @property
    def to_export(self) -> Alternative | None:
        """The one chosen filter that a device can run, if one is chosen."""
        drawn = self.alternatives
        return drawn[0] if len(drawn) == 1 and drawn[0].chain is not None else None

    @property
    def alternatives(self) -> tuple[Alternative, ...]:
        """What is drawn beside the present filter: the chosen one, or all."""
        chosen = tuple(one for one in self.found.others if one.name == self.state.view.drawn_alternative)
        return chosen or self.found.others


class AlternativesStudy:
    """Compares while idle, and keeps the last comparison while only the view changes."""

    def __init__(self) -> None:
        self._found = Cache[Comparison]()

    def compute(self, state: State) -> Compared | None:
        """Compare the Kalman filter of the q and r on screen; None where there is none of one channel."""
        if state.fusion is not None or isinstance(state.tuning, PaperTuning):
            return None
        drawn = choose_samples(state.recording, state.channel, state.view.window)
        window = (drawn.first, drawn.last)
        stretch = stretch_of(len(state.recording), window)
        self._found.begin(state.recording, state.channel, state.view.match_by, stretch)
        return Compared(state, self._found.get(state.params, lambda: _compare(state, window)), drawn)


def _compare(state: State, window: tuple[int, int]) -> Comparison:
    truth = state.recording.truth
    return compare_alternatives(
        state.recording.values[:, state.index],
        state.params,
        match=state.view.match_by,
        dt=state.dt,
        truth=None if truth is None else truth[:, state.index],
        window=window,
    )
