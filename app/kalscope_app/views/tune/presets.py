"""Presets: select one, read what it does, then apply it."""

from __future__ import annotations

import viser

from kalscope.common.text import number
from kalscope.filtering.steady_state import SteadyState, steady_state
from kalscope_app.engine.frame import Frame
from kalscope_app.session.changes.presets import PRESETS, choose_preset, take_preset
from kalscope_app.session.session import Session
from kalscope_app.session.state import State
from kalscope_app.views.binding import bind, on_user
from kalscope_app.views.tune.numbers import rows_of

FOR_ONE_CHANNEL = "A preset is for one channel: choose one above the tabs."


class PresetsView:
    """The folder "Presets". Choosing shows; only the button changes the filter."""

    def __init__(self, gui: viser.GuiApi, session: Session) -> None:
        with gui.add_folder("Presets", expand_by_default=False) as self._folder:
            self._which = gui.add_dropdown("preset", tuple(PRESETS), hint="Select one to see what it would do.")
            self._text = gui.add_markdown("")
            self._take = gui.add_button("Apply preset", hint="Sets q, r and momentum; Undo reverts it.")
        bind(self._which, session, choose_preset)
        on_user(self._take.on_click, lambda _client: session.request(take_preset(self._which.value)))

    def show(self, frame: Frame) -> None:
        """Show what the selected preset would do."""
        title = frame.state.view.preset or next(iter(PRESETS))
        self._which.value = title
        fused = frame.state.fusion is not None
        self._folder.visible = frame.state.tuning.chain is None
        self._text.content = FOR_ONE_CHANNEL if fused else preset_text(frame.state, title, frame.steady)
        self._take.visible = self._which.visible = not fused


def preset_text(state: State, title: str, now: SteadyState) -> str:
    """Its purpose, then its q, r, lag and noise beside the current ones, and the momentum if any; markdown."""
    preset = PRESETS[title]
    params, period = preset.params(state), state.recording.sample_period
    rows = [
        ("q", number(state.tuning.q), number(params.q)),
        ("r", number(state.tuning.r), number(float(params.r))),
        *rows_of((state.tuning.momentum, params.momentum), (now, steady_state(params)), period),
    ]
    table = "| | current | preset |\n|---|---|---|\n" + "\n".join(f"| {n} | {a} | **{b}** |" for n, a, b in rows)
    return f"{preset.why}\n\n{table}"
