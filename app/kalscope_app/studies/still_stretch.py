"""The still stretch of the channel on screen, found once for each recording."""

from __future__ import annotations

from kalscope.estimation.methods.still_stretch import find_still_stretch
from kalscope_app.engine.cache import Cache
from kalscope_app.session.state import State

Stretch = tuple[int, int] | None
"""First sample and one past the last; None = there is none."""


class StillStretches:
    """Finds the stretch and keeps it. One thread at a time."""

    def __init__(self) -> None:
        self._kept = Cache[Stretch]()

    def of(self, state: State) -> Stretch:
        """The stretch of the channel on screen; none of a live record, which changes all the time."""
        if state.live is not None:
            return None
        return self._kept.once(
            lambda: find_still_stretch(state.z, state.dt), state.recording, state.channel, state.recording.gaps
        )

    def study(self, state: State) -> tuple[State, Stretch]:
        """The stretch with the state that it belongs to, for the view that offers it."""
        return state, self.of(state)
