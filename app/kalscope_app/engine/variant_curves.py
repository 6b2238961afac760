"""Curves of the pinned settings at the drawn samples, kept until the view changes: no slider moves them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from kalscope.common.array import Array
from kalscope.filtering.batch import denoise

if TYPE_CHECKING:
    from kalscope.filtering.params import FilterParams
    from kalscope_app.engine.frame import Shown
    from kalscope_app.session.state import State


class Curves:
    """What the variants look like; filters the whole recording once a variant and view."""

    def __init__(self) -> None:
        self._shown: Shown | None = None
        self._of: tuple[object, str] = (None, "")
        self._known: dict[FilterParams, Array] = {}

    def of(self, state: State, shown: Shown) -> tuple[Array, ...]:
        """One curve a variant of the channel on screen, in their order, unit, shape (m,)."""
        same = shown is self._shown and self._of[0] is state.recording and self._of[1] == state.channel
        known = self._known if same else {}
        wanted = [variant.tuning.params for variant in state.variants]
        z = state.recording.channel(state.channel)
        self._known = {
            params: known[params] if params in known else denoise(z, params, state.dt)[shown.indices]
            for params in wanted
        }
        self._shown, self._of = shown, (state.recording, state.channel)
        return tuple(self._known[params] for params in wanted)
