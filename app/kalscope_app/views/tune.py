"""The parameters of the channel on screen: q, r, p0 and momentum in a row each; what is set rarely; the result."""

from __future__ import annotations

import math

import viser

from kalscope.common.text import frequency, gate_digits, lag_in_full, noise_left, number, percent, plural
from kalscope.filtering.classic import OneEuro
from kalscope.filtering.params import MAX_FAST
from kalscope.filtering.steady import steady_state
from kalscope_app.engine.frame import Frame
from kalscope_app.session import changes
from kalscope_app.session.changes import OFF
from kalscope_app.session.session import Session, redo, undo
from kalscope_app.session.state import Change, State
from kalscope_app.views.goal import account_text
from kalscope_app.views.widgets import Ends, NumberWithSlider, TypedNumber, add_button, bind, offer, on_user, put
from kalscope_app.views.window import STEP_BUTTONS

# The parameters, a row each: the exact value as text, and a slider over its exponent.


AUTOMATIC = "automatic"
"""The text in the box of p0 for a start from the first sample."""

ROWS = {
    "q": (
        "process noise q",
        "How fast the true value moves: the variance it gains per sample, {unit}. Larger follows faster.",
    ),
    "r": (
        "measurement noise r",
        "How noisy the sensor is: the variance of one reading, {unit}. Larger smooths more.",
    ),
    "p0": (
        "initial variance p0",
        "How uncertain the initial estimate is: its variance, {unit}. automatic: start from the first sample.",
    ),
    "momentum": (
        "momentum τ",
        "How long the signal keeps its direction, in samples or as 240 ms. More: less noise, but overshoot.",
    ),
    "fast": ("fast factor", "Two speeds: q is this many times larger while the signal moves. off: one speed."),
}
"""Label and hint of each box by its parameter."""


def on_decades(value: float | None, low: int, high: int, beyond: str = "") -> tuple[float, Ends]:
    """Position and ends of a slider over 10^low … 10^high; `beyond` names one more step at its right, for None."""
    ends = (float(low), f"1e{low}"), (float(high), f"1e{high}")
    if beyond:
        ends = (float(low), ""), (high + 1.0, beyond)  # there is no room for both words
    if value is None:
        return ends[1][0], ends
    return min(max(math.log10(value), low), high) if value > 0.0 else float(low), ends


def place(state: State, name: str) -> tuple[float, Ends]:
    """Position and ends of the slider of a parameter."""
    if name == "momentum":
        return changes.slider_position(state.tuning.momentum), ((0.0, OFF), (changes.MAX_POSITION, "1e5"))
    if name == "fast":
        return math.log10(state.tuning.fast or 1.0), ((0.0, OFF), (math.log10(MAX_FAST), "1e12"))
    low, high = changes.slider_limits(state, name)
    return on_decades(getattr(state.tuning, name), low, high, beyond=AUTOMATIC if name == "p0" else "")


class ParametersView:
    """A row for each of some parameters. Callbacks only file requests."""

    def __init__(self, gui: viser.GuiApi, session: Session, *names: str) -> None:
        with gui.add_form(None):  # the page lays its boxes and sliders out side by side
            self._rows = {name: self._row(gui, session, name) for name in names}

    def _row(self, gui: viser.GuiApi, session: Session, name: str) -> NumberWithSlider:
        box = TypedNumber(gui, session, name, *ROWS[name])
        label = "τ, 0 to 5" if name == "momentum" else f"log₁₀ {name}"
        return NumberWithSlider(gui, session, label, box, lambda at: self._moved(name, at))

    def _moved(self, name: str, position: float) -> Change:
        if name == "p0" and position > self._rows[name].slider.max - 0.5:
            return changes.set_text(name, AUTOMATIC)
        return changes.set_slider(name, position)

    def show(self, frame: Frame) -> None:
        """Set every row to the frame's values, except those that have changed since."""
        state = frame.state
        for name, row in self._rows.items():
            value, missing = getattr(state.tuning, name), AUTOMATIC
            if name in ("momentum", "fast"):
                value, missing = value or None, OFF
            visible = state.uses_parameters and self._is_needed(name, frame)
            row.show(frame, value, missing, *place(state, name), visible=visible)

    def _is_needed(self, name: str, frame: Frame) -> bool:
        if name in ("momentum", "fast"):  # a slider that is dragged to off stays until then
            return bool(getattr(frame.state.tuning, name)) or self._rows[name].is_held(frame)
        return name != "r" or frame.state.fusion is None  # each of several fused sensors has its own


STEPS = {"Pin": changes.pin_present, "Undo": undo, "Redo": redo}
"""The row of small buttons; the last two are there once there is something to undo."""


class StepsView:
    """The row of small buttons below the parameters, and its keys."""

    def __init__(self, gui: viser.GuiApi, session: Session) -> None:
        self._session = session
        gui.add_html(STEP_BUTTONS)
        hint = "Pin: keep this setting as A, B, C … in the Compare tab."
        self._steps = gui.add_button_group("", tuple(STEPS), hint=hint)
        on_user(self._steps.on_click, lambda _client: session.request(STEPS[self._steps.value]))
        for command, change in (
            (gui.add_command("Undo", hotkey="Z", modifier="cmd/ctrl"), undo),
            (gui.add_command("Redo", hotkey="Z", modifier="cmd/ctrl+shift"), redo),
            (gui.add_command("Redo (Ctrl+Y)", hotkey="Y", modifier="cmd/ctrl"), redo),
        ):
            on_user(command.on_trigger, lambda _client, change=change: session.request(change))

    def show(self, _frame: Frame) -> None:
        """Offer to undo and redo where there is something to undo or redo."""
        past, future = self._session.steps
        put(self._steps, options=tuple(STEPS)[: 3 if future else 2 if past else 1])


# What is shown in place of the goal while a chain of filters runs: what q and r do then, and a way back.


CLASSIC = "This filter has no q and r; those of the Kalman filter are kept."
BEHIND_MEDIAN = (
    "q and r act on what the filter before them passes. The tests are for the Kalman filter alone: behind another "
    "one neighbouring errors are correlated."
)


class ChainView:
    """The upper part of the Tune tab while a chain runs."""

    def __init__(self, gui: viser.GuiApi, session: Session) -> None:
        self._text = gui.add_markdown("", visible=False)
        hint = "At the q and r that it had; Undo reverts it."
        self._back = gui.add_button("Back to the Kalman filter", visible=False, hint=hint)
        on_user(self._back.on_click, lambda _client: session.request(State.with_standard_filter))

    def show(self, frame: Frame) -> None:
        """Follow the frame."""
        chain, has_gain = frame.state.tuning.chain, frame.state.has_gain
        self._text.visible = self._back.visible = chain is not None or frame.state.tuning.paper is not None
        self._text.content = BEHIND_MEDIAN if chain is not None and has_gain else CLASSIC


# The closed folder below them: what acts at the start, on outliers, or only on request; and what q, r and momentum
# give.


X0_HINT = "The estimate before the first sample. 0 is allowed; empty: the first sample."

GATE_HINT = "Samples further from their prediction are not used. 4 σ is gate = 16 in a tuning file."

MEDIAN_HINT = "Removes spikes of one sample (3) or two (5) before the filter, and adds one or two samples of lag."


class MoreView:
    """The controls that are needed rarely, and a table of derived numbers with what the last estimate found."""

    def __init__(self, gui: viser.GuiApi, session: Session) -> None:
        self._x0 = TypedNumber(gui, session, "x0", "initial estimate x0", X0_HINT)
        self._gate = TypedNumber(gui, session, "gate", "outlier gate (σ)", GATE_HINT, written=gate_digits)
        self._momentum = ParametersView(gui, session, "momentum", "fast")
        median = gui.add_dropdown("median first", list[str](changes.MEDIANS), hint=MEDIAN_HINT)
        self._median = bind(median, session, changes.set_median)
        hint = "For signals that keep their direction: less noise at the same lag, but overshoot."
        self._add = add_button(gui, "Add momentum", hint, lambda _: session.request(changes.add_momentum))
        hint = "Back to how the recording opened, or the sensors were fused."
        add_button(gui, "Reset", hint, lambda _: session.request(changes.reset_parameters))
        gain = gui.add_checkbox("show gain chart", False, hint="The gain K of the first samples.")
        self._gain = bind(gain, session, changes.set_gain_shown)
        self._table = gui.add_markdown("")
        self._account = gui.add_markdown("", visible=False)

    def show(self, frame: Frame) -> None:
        """Follow the frame."""
        state, tuning, used = frame.state, frame.state.tuning, frame.state.uses_parameters
        self._momentum.show(frame)
        self._x0.show(frame, tuning.x0, "first", visible=used)
        self._gate.show(frame, tuning.gate, OFF, visible=used and tuning.fast is None)
        window = 1 if tuning.chain is None else tuning.chain.median
        put(self._median, visible=state.fusion is None and tuning.paper is None)
        words = changes.median_words(window)
        offer(self._median, dict.fromkeys((*changes.MEDIANS, words)), words)
        self._add.visible = used and tuning.momentum == 0.0 and tuning.fast is None
        put(self._gain, value=state.view.gain_shown, visible=state.has_gain)
        account = account_text(state)
        put(self._table, content=table(frame))
        put(self._account, content=account, visible=bool(account))


def table(frame: Frame) -> str:
    """What the parameters give, one markdown row for each number with its unit."""
    steady, params, state = frame.steady, frame.state.params, frame.state
    period, used = state.recording.sample_period, state.uses_parameters
    rows = {
        "lag (delay)": _time_in_bold(steady.lag_samples, period),
        "noise left": f"**{noise_left(steady.noise_reduction_db)}**",
    }
    if used and state.tuning.fast is not None:
        moving = steady_state(params.moving, period)
        rows = {f"{name}, at rest": value for name, value in rows.items()}
        rows["lag (delay), moving"] = _time_in_bold(moving.lag_samples, period)
        rows["noise left, moving"] = f"**{noise_left(moving.noise_reduction_db)}**"
        rows["spikes"] = f"**{percent(state.tuning.spikes)}**"
    if state.tuning.momentum > 0.0 and used:
        rows["overshoot (step)"] = f"**{percent(steady.overshoot)}**"
        rows["keeps direction"] = _time_in_bold(state.tuning.momentum, period)
    if steady.cutoff_hz is not None and (state.filter.is_standard or math.isfinite(steady.cutoff_hz)):
        rows["cut-off (−3 dB)"] = f"**{frequency(float(steady.cutoff_hz))}**"
    if state.has_gain:
        rows["gain K"] = f"**{number(steady.gain)}**"
    if used:
        rows["q / r"] = f"**{number(params.ratio)}**"
    chain = state.tuning.chain
    if chain is None or not isinstance(chain.then, OneEuro):  # it settles faster, the larger a step is
        rows["settling (to 1\u00a0%)"] = _time_in_bold(steady.settle_samples, period)
    if params.gate is not None and used:
        rows["rejected by the gate"] = f"**{plural(frame.rejected, 'sample')}**"
    return "| | |\n|---|---|\n" + "\n".join(f"| {name} | {value} |" for name, value in rows.items())


def _time_in_bold(samples: float, period: float | None) -> str:
    time, bracket, rest = lag_in_full(samples, period).partition(" (")
    return f"**{time}**{bracket}{rest}"
