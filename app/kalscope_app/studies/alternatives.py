"""State -> simpler filters, spectrum and Allan deviation of the channel on screen: studies. Pure."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from kalscope.analysis.alternatives.comparison import Alternative, Comparison, compare_alternatives, stretch_of
from kalscope.common.array import Array
from kalscope_app.engine.frame import Shown, choose_shown

if TYPE_CHECKING:
    import numpy as np

    from kalscope.recording import Recording
    from kalscope_app.session.state import State


@dataclass(frozen=True)
class Compared:
    """The present filter beside simpler ones, and which samples of them are drawn."""

    state: State
    """The choices that were compared."""
    found: Comparison
    """All of them, over their stretch."""
    shown: Shown
    """The samples that the signal chart draws; those outside the stretch are left out."""

    @property
    def inside(self) -> np.ndarray:
        """Which of the drawn samples lie in the stretch, bool, shape (m,)."""
        at = self.shown.indices
        return (at >= self.found.first) & (at < self.found.last)

    def curve(self, one: Alternative) -> Array:
        """A curve at the drawn samples inside the stretch."""
        return one.curve[self.shown.indices[self.inside] - self.found.first]

    @property
    def rivals(self) -> tuple[Alternative, ...]:
        """What is drawn beside the present filter: the chosen one, or all."""
        chosen = tuple(one for one in self.found.others if one.name == self.state.view.drawn_alternative)
        return chosen or self.found.others


class AlternativesStudy:
    """Compares at rest, and keeps the last comparison while only the view changes."""

    def __init__(self) -> None:
        self._recording: Recording | None = None
        self._key: tuple[object, ...] = ()
        self._found: Comparison | None = None

    def compute(self, state: State) -> Compared | None:
        """Compare; None where the filter on screen has no q and r."""
        if state.paper_filter is not None:
            return None
        recording = state.recording
        shown = choose_shown(recording, state.channel, state.view.window)
        window = (shown.first, shown.last)
        key = (state.channel, state.params, state.view.match_by, *stretch_of(len(recording), window))
        if self._found is None or self._recording is not recording or self._key != key:
            column = recording.index(state.channel)
            self._found = compare_alternatives(
                recording.values[:, column],
                state.params,
                match=state.view.match_by,
                dt=state.dt,
                truth=None if recording.truth is None else recording.truth[:, column],
                window=window,
            )
            self._recording, self._key = recording, key
        return Compared(state, self._found, shown)
