"""The parameters of the channel on screen: a text box with the exact value of each, and a slider beside most."""

from __future__ import annotations

import math

import viser

from kalscope_app.engine.frame import Frame
from kalscope_app.session.changes.parameters import (
    paper_filter,
    reset_parameters,
    set_automatic_start,
    set_exponent,
    set_paper_text,
    set_variant_of_eq3,
    slider_limits,
)
from kalscope_app.session.session import Session, redo, undo
from kalscope_app.views.binding import bind, on_user
from kalscope_app.views.tune.momentum import MomentumControl
from kalscope_app.views.tune.typed_number import SliderWithText, TypedNumber

NAMES = {"q": "process noise q", "r": "measurement noise r", "p0": "initial variance p0"}

HINTS = {
    "q": "How fast the true value moves: the variance it gains per sample, {unit}. Larger follows faster.",
    "r": "How noisy the sensor is: the variance of one reading, {unit}. Larger smooths more.",
    "p0": "How uncertain the initial estimate is: its variance, {unit}. It affects only the start. 0 is allowed.",
}

AUTOMATIC, BY_VALUE = "from first sample", "set manually"


class ParametersView:
    """The controls of the channel on screen. Callbacks only file requests."""

    def __init__(self, gui: viser.GuiApi, session: Session) -> None:
        self._session = session
        with gui.add_folder(None):
            self._paper_boxes = [
                TypedNumber(gui, session, name, label, hint, set_paper_text) for name, label, hint in PAPER_BOXES
            ]
            self._controls = [VarianceControl(gui, session, name) for name in ("q", "r")]
            self._momentum = MomentumControl(gui, session)
            self._start = gui.add_dropdown(
                "initial state",
                (AUTOMATIC, BY_VALUE),
                hint="The first sample as the initial estimate, or your own p0 and x0.",
            )
            self._p0 = VarianceControl(gui, session, "p0")
            self._controls.append(self._p0)
            self._x0 = TypedNumber(
                gui,
                session,
                "x0",
                "initial estimate x0",
                "The estimate before the first sample. 0 is allowed; empty: the first sample.",
            )
            self._gate = TypedNumber(
                gui,
                session,
                "gate",
                "NIS gate",
                "Outlier gate: samples with v²/s above it are not used. 9 is three σ; empty: off.",
            )
            self._filter = gui.add_dropdown("filter", tuple(FILTERS), hint="Khan et al. filter: for comparison.")
            self._steps = gui.add_button_group(
                "",
                ("Undo", "Redo", "Reset"),
                hint="Ctrl+Z; Ctrl+Shift+Z or Ctrl+Y. Reset: r = var(Δz)/2, q = r/100.",
            )
        bind(self._filter, session, lambda name: set_variant_of_eq3(FILTERS[name]))
        bind(self._start, session, lambda choice: set_automatic_start(choice == AUTOMATIC))
        steps = {"Undo": undo, "Redo": redo, "Reset": reset_parameters}
        on_user(self._steps.on_click, lambda _client: session.request(steps[self._steps.value]))
        for command, change in (
            (gui.add_command("Undo", hotkey="Z", modifier="cmd/ctrl"), undo),
            (gui.add_command("Redo", hotkey="Z", modifier="cmd/ctrl+shift"), redo),
            (gui.add_command("Redo (Ctrl+Y)", hotkey="Y", modifier="cmd/ctrl"), redo),
        ):
            on_user(command.on_trigger, lambda _client, change=change: session.request(change))

    def show(self, frame: Frame) -> None:
        """Set every control to the frame's values, except those that have changed since."""
        state, tuning = frame.state, frame.state.tuning
        paper, standard = paper_filter(state), state.filter.is_standard
        self._filter.value = next(
            name for name, value in FILTERS.items() if value == (paper.reading if paper else None)
        )
        for control in (*self._controls, self._momentum):
            control.show(frame)
            control.set_visible(standard and (control is not self._p0 or tuning.p0 is not None))
        self._start.visible = standard
        self._gate.set_visible(standard)
        self._start.value = AUTOMATIC if tuning.p0 is None else BY_VALUE
        self._x0.set_visible(tuning.p0 is not None and standard)
        self._x0.show(frame, tuning.x0, "first")
        self._gate.show(frame, tuning.gate, "off")
        for box, (name, _, _) in zip(self._paper_boxes, PAPER_BOXES, strict=True):
            box.set_visible(paper is not None)
            box.show(frame, None if paper is None else getattr(paper, name), "automatic")


FILTERS: dict[str, str | None] = {
    "Kalman filter": None,
    "Khan et al. filter, eq. (3) as printed": "printed",
    "Khan et al. filter, eq. (3) corrected": "without_slip",
}
"""Filters by their labels, and the variant of equation (3) that each one uses."""

PAPER_BOXES = (
    ("sigma_m", "measured error σM", "The only value that the paper changes from sensor to sensor; above 0."),
    ("sigma_e0", "initial error σE", "Empty: automatic."),
    ("e0", "initial estimate E", "Empty: the first sample."),
)
"""Name, label and hint of the parameters of the Khan et al. filter."""


class VarianceControl(SliderWithText):
    """One variance: the exact value as text, and a slider over its exponent."""

    def __init__(self, gui: viser.GuiApi, session: Session, name: str) -> None:
        typed = TypedNumber(gui, session, name, NAMES[name], HINTS[name])
        slider = gui.add_slider(
            f"log₁₀ {name}",
            min=-6.0,
            max=6.0,
            step=0.01,
            initial_value=0.0,
            hint=f"Drag, or click and use the arrow keys: one step changes {name} by 2.3 %.",
        )
        super().__init__(session, name, typed, slider, lambda exponent: set_exponent(name, exponent))

    def show(self, frame: Frame) -> None:
        """Follow the frame unless the slider has moved since."""
        value = getattr(frame.state.tuning, self._name)
        self.typed.show(frame, value, "automatic")
        low, high = slider_limits(frame.state, self._name)
        if value is None:  # the automatic start has the variance of one reading after its first sample
            value = frame.state.tuning.r
        exponent = min(max(math.log10(value), low), high) if value > 0.0 else float(low)
        self._follow(frame, exponent, float(low), float(high))
