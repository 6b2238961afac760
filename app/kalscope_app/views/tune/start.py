"""The closed folder "Start and outliers": initial estimate, outlier gate, adding momentum, the gain chart."""

from __future__ import annotations

import viser

from kalscope.common.text import gate_digits
from kalscope.tuning.paper_tuning import PaperTuning
from kalscope_app.engine.frame import Frame
from kalscope_app.session.changes.chain import MEDIANS, median_words, set_median
from kalscope_app.session.changes.momentum import add_momentum
from kalscope_app.session.changes.view import set_gain_shown
from kalscope_app.session.session import Session
from kalscope_app.views.binding import TypedNumber, bind, offer, on_user, put

X0_HINT = "The estimate before the first sample. 0 is allowed; empty: the first sample."

MEDIAN_HINT = "Removes spikes of one sample (3) or two (5) before the filter, and adds one or two samples of lag."

GATE_HINT = "Samples further from their prediction are not used. 4 σ is gate = 16 in a tuning file."


class StartView:
    """What acts at the start, on outliers, or only on request."""

    def __init__(self, gui: viser.GuiApi, session: Session) -> None:
        with gui.add_folder("Start and outliers", expand_by_default=False):
            self._x0 = TypedNumber(gui, session, "x0", "initial estimate x0", X0_HINT)
            self._gate = TypedNumber(gui, session, "gate", "outlier gate (σ)", GATE_HINT, written=gate_digits)
            self._median = gui.add_dropdown("median first", list[str](MEDIANS), hint=MEDIAN_HINT)
            self._add = gui.add_button(
                "Add momentum",
                hint="For signals that keep their direction: less noise at the same lag, but overshoot.",
            )
            self._gain = gui.add_checkbox("show gain chart", False, hint="The gain K of the first samples.")
        on_user(self._add.on_click, lambda _client: session.request(add_momentum))
        bind(self._median, session, set_median)
        bind(self._gain, session, set_gain_shown)

    def show(self, frame: Frame) -> None:
        """Follow the frame."""
        tuning, used = frame.state.tuning, frame.state.uses_parameters
        self._x0.show(frame, tuning.x0, "first")
        self._gate.show(frame, tuning.gate, "off")
        for box in (self._x0, self._gate):
            box.set_visible(used)
        window = 1 if tuning.chain is None else tuning.chain.median
        put(self._median, visible=frame.state.fusion is None and not isinstance(tuning, PaperTuning))
        offer(self._median, dict.fromkeys((*MEDIANS, median_words(window))), median_words(window))
        self._add.visible = used and tuning.momentum == 0.0
        put(self._gain, value=frame.state.view.gain_shown, visible=frame.state.has_gain)
