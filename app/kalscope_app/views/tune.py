"""The parameters of the channel on screen: q, r, p0, momentum, and what they give."""

from __future__ import annotations

import math
from collections.abc import Callable

import viser

from kalscope.common.text import decibels, frequency, gate_digits, lag_in_full, number, percent, plural
from kalscope.filtering.classic import OneEuro
from kalscope_app.engine.frame import Frame
from kalscope_app.session.changes import (
    MAX_POSITION,
    MEDIANS,
    OFF,
    add_momentum,
    median_words,
    momentum_words,
    pin_present,
    reset_parameters,
    set_exponent,
    set_gain_shown,
    set_median,
    set_momentum_position,
    set_momentum_text,
    slider_limits,
    slider_position,
    use_kalman_filter,
)
from kalscope_app.session.session import Session, redo, undo
from kalscope_app.session.state import Change
from kalscope_app.views.goal import account_text
from kalscope_app.views.widgets import TypedNumber, bind, offer, on_user, put

# A parameter with a slider: its exact value as text, and its position on a scale.


class SliderWithText:
    """One parameter: its exact value as text, and a slider for its position on a scale."""

    def __init__(
        self,
        session: Session,
        name: str,
        typed: TypedNumber,
        slider: viser.GuiSliderHandle[float],
        change: Callable[[float], Change],
    ) -> None:
        """Args: the box and the slider of the parameter `name`; the change that a new position asks for."""
        self._session, self._name, self._change = session, name, change
        self.typed, self._slider = typed, slider
        self._serial = 0
        on_user(slider.on_update, lambda _client: self._file())

    def set_visible(self, visible: bool) -> None:
        """Show or hide both."""
        put(self._slider, visible=visible)
        self.typed.set_visible(visible)

    def _file(self) -> None:
        change = self._change(float(self._slider.value))
        self._serial = self._session.request(change, key=f"slider {self._name}")

    def _follow(self, frame: Frame, position: float, low: float, high: float) -> None:
        """Move the slider between its ends as the frame has it, unless it was moved since."""
        if frame.serial < self._serial:
            return
        put(self._slider, min=low, max=high)
        if abs(self._slider.value - position) > 0.005:
            self._slider.value = round(position, 2)


# One variance, q, r or p0: the exact value as text, and a slider over its exponent.


NAMES = {"q": "process noise q", "r": "measurement noise r", "p0": "initial variance p0"}

HINTS = {
    "q": "How fast the true value moves: the variance it gains per sample, {unit}. Larger follows faster.",
    "r": "How noisy the sensor is: the variance of one reading, {unit}. Larger smooths more.",
    "p0": "How uncertain the initial estimate is: its variance, {unit}. automatic: start from the first sample.",
}

AUTOMATIC = "automatic"
"""The text in the box of p0 for a start from the first sample."""


class VarianceControl(SliderWithText):
    """The box and the slider of one variance."""

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
        self.typed.show(frame, value, AUTOMATIC)
        low, high = slider_limits(frame.state, self._name)
        if value is None:  # the automatic start has the variance of one reading after its first sample
            value = frame.state.tuning.r
        exponent = min(max(math.log10(value), low), high) if value > 0.0 else float(low)
        self._follow(frame, exponent, float(low), float(high))


# The momentum τ: how long the signal keeps its direction. A text box, and a slider whose low end is off.


LABEL = "momentum τ, samples"

HINT = "How long the signal keeps its direction, or as 240 ms. More: less noise at the same lag, but overshoot."


MARKS = (
    (0.0, OFF),
    *((slider_position(10.0**power), text) for power, text in enumerate(("10", "100", "1000", "1e4", "1e5"), 1)),
)
"""Values beside the slider, in samples."""


class MomentumControl(SliderWithText):
    """The momentum: the exact value as text, and a slider."""

    def __init__(self, gui: viser.GuiApi, session: Session) -> None:
        typed = TypedNumber(gui, session, "momentum", LABEL, HINT, set_momentum_text)
        slider = gui.add_slider(
            slider_label(0.0, None),
            min=0.0,
            max=MAX_POSITION,
            step=0.01,
            initial_value=0.0,
            marks=MARKS,
            hint="At the left end there is no momentum. Drag, or click and use the arrow keys.",
        )
        super().__init__(session, "momentum", typed, slider, set_momentum_position)

    def show(self, frame: Frame) -> None:
        """Follow the frame unless the slider has moved since; a slider that is dragged to off stays until then."""
        held = 0 < frame.serial <= self._serial
        self.set_visible(frame.state.uses_parameters and (frame.state.tuning.momentum > 0.0 or held))
        momentum = frame.state.tuning.momentum
        self.typed.show(frame, momentum or None, OFF)
        self._slider.label = slider_label(momentum, frame.state.recording.sample_period)
        self._follow(frame, slider_position(momentum), 0.0, MAX_POSITION)


def slider_label(momentum: float, period: float | None) -> str:
    """The label of the slider: the momentum as a time, where the sample period (s) is known."""
    return f"τ = {momentum_words(momentum, period)}" if momentum > 0.0 else "τ off"


# What is shown in place of the goal while a chain of filters runs: what q and r do then, and a way back.


CLASSIC = "This filter has no q and r; those of the Kalman filter are kept."
BEHIND_MEDIAN = (
    "q and r act on what the median leaves. The search for them and the tests are for the Kalman filter alone: "
    "a median makes neighbouring errors correlated."
)


class ChainView:
    """The upper part of the Tune tab while a chain runs."""

    def __init__(self, gui: viser.GuiApi, session: Session) -> None:
        with gui.add_folder(None, visible=False) as self._folder:
            self._said = gui.add_markdown("")
            back = gui.add_button("Back to the Kalman filter", hint="At the q and r that it had; Undo reverts it.")
        on_user(back.on_click, lambda _client: session.request(use_kalman_filter))

    def show(self, frame: Frame) -> None:
        """Follow the frame."""
        chain, has_gain = frame.state.tuning.chain, frame.state.has_gain
        self._folder.visible = chain is not None or frame.state.tuning.paper is not None
        self._said.content = BEHIND_MEDIAN if chain is not None and has_gain else CLASSIC


# q, r and p0 of the channel on screen, its momentum where it has one, and the row Pin, Undo, Redo, Reset.


STEPS = {"Pin": pin_present, "Undo": undo, "Redo": redo, "Reset": reset_parameters}
"""The row of small buttons."""


class ParametersView:
    """A text box and a slider for each parameter. Callbacks only file requests."""

    def __init__(self, gui: viser.GuiApi, session: Session) -> None:
        with gui.add_folder(None):  # indented as the goal above
            self._controls = [VarianceControl(gui, session, name) for name in ("q", "r", "p0")]
            _, self._r, _ = self._controls  # each sensor has its own where several are fused
            self._momentum = MomentumControl(gui, session)
            self._steps = gui.add_button_group(
                "",
                tuple(STEPS),
                hint="Pin: keep this setting as A, B, C … in the Compare tab. Reset: the filter that the "
                "recording opened with; for fused sensors, the values found.",
            )
        on_user(self._steps.on_click, lambda _client: session.request(STEPS[self._steps.value]))
        for command, change in (
            (gui.add_command("Undo", hotkey="Z", modifier="cmd/ctrl"), undo),
            (gui.add_command("Redo", hotkey="Z", modifier="cmd/ctrl+shift"), redo),
            (gui.add_command("Redo (Ctrl+Y)", hotkey="Y", modifier="cmd/ctrl"), redo),
        ):
            on_user(command.on_trigger, lambda _client, change=change: session.request(change))

    def show(self, frame: Frame) -> None:
        """Set every control to the frame's values, except those that have changed since."""
        used = frame.state.uses_parameters
        for control in self._controls:
            control.show(frame)
            control.set_visible(used and (control is not self._r or frame.state.fusion is None))
        self._momentum.show(frame)


# The closed folder "Start and outliers": initial estimate, outlier gate, adding momentum, the gain chart.


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
        put(self._median, visible=frame.state.fusion is None and tuning.paper is None)
        offer(self._median, dict.fromkeys((*MEDIANS, median_words(window))), median_words(window))
        self._add.visible = used and tuning.momentum == 0.0
        put(self._gain, value=frame.state.view.gain_shown, visible=frame.state.has_gain)


# What q, r and momentum give: lag, noise reduction, cut-off, gain, settling time, overshoot.


class NumbersView:
    """A table of derived numbers below the sliders, and below it what the current estimate found."""

    def __init__(self, gui: viser.GuiApi) -> None:
        with gui.add_folder("Resulting filter", expand_by_default=False):
            self._table = gui.add_markdown("")
            self._account = gui.add_markdown("", visible=False)

    def show(self, frame: Frame) -> None:
        """Write the table and the account."""
        self._table.content = table(frame)
        account = account_text(frame.state)
        self._account.content, self._account.visible = account, bool(account)


def table(frame: Frame) -> str:
    """One markdown row for each number, with its unit."""
    steady, params = frame.steady, frame.state.params
    lag, settle = steady.lag_samples, steady.settle_samples
    period = frame.state.recording.sample_period
    rows = [
        ("lag (delay)", _time_in_bold(lag_in_full(lag, period))),
        ("noise reduction", f"**{decibels(steady.noise_reduction_db)}**"),
    ]
    if frame.state.tuning.momentum > 0.0 and frame.state.uses_parameters:
        rows += [
            ("overshoot (step)", f"**{percent(steady.overshoot)}**"),
            ("keeps direction", _time_in_bold(lag_in_full(frame.state.tuning.momentum, period))),
        ]
    if steady.cutoff_hz is not None and (frame.state.filter.is_standard or math.isfinite(steady.cutoff_hz)):
        rows.append(("cut-off (−3 dB)", f"**{frequency(float(steady.cutoff_hz))}**"))
    if frame.state.has_gain:
        rows.append(("gain K", f"**{number(steady.gain)}**"))
    if frame.state.uses_parameters:
        rows.append(("q / r", f"**{number(params.ratio)}**"))
    chain = frame.state.tuning.chain
    if chain is None or not isinstance(chain.then, OneEuro):  # it settles faster, the larger a step is
        rows.append(("settling (to 1\u00a0%)", _time_in_bold(lag_in_full(settle, period))))
    if params.gate is not None and frame.state.uses_parameters:
        rows.append(("rejected by the gate", f"**{plural(frame.rejected, 'sample')}**"))
    return "| | |\n|---|---|\n" + "\n".join(f"| {name} | {value} |" for name, value in rows)


def _time_in_bold(text: str) -> str:
    time, bracket, samples = text.partition(" (")
    return f"**{time}**{bracket}{samples}"
