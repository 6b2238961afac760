"""The goal: what the filter is for, one number, Apply, and what the last search gave."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import viser

from kalscope.common.text import (
    TIME_UNITS,
    decibels,
    gate_text,
    lag_text,
    number,
    percent,
    share_left,
    typed_number,
)
from kalscope.errors import BadSetting
from kalscope.estimation.request import MIN_LAG, Noise, Request, find_parameters, proposed_lag
from kalscope.estimation.settings import SETTINGS, Cost
from kalscope.filtering.steady import steady_state
from kalscope.tuning.tuning import ChannelTuning
from kalscope_app.engine.frame import Frame
from kalscope_app.engine.jobs import Jobs
from kalscope_app.session.changes import apply_found, momentum_words, set_search_method
from kalscope_app.session.session import Failed, Session
from kalscope_app.session.state import Outcome, State
from kalscope_app.views.charts import Chart, dots, line, palette_of, time_scale_for
from kalscope_app.views.widgets import SlowJob, bind, offer, on_user, put, table_of, typed
from kalscope_app.views.window import GOAL, LAG_NUMBER, PRIMARY

# The ways to find q and r that the dashboard offers: what each asks the user for, and the search it requests.


LAG, MORE = "maximum lag", "more …"


@dataclass(frozen=True)
class SearchMethod:
    """One way to find q and r."""

    request: Callable[[State, str], Request]
    """What to look for, from the state and the typed text."""
    label: str = ""
    """Of the box for the number that it needs; "" = it needs none."""
    content: str = ""
    """What is in the box first."""
    hint: str = "A number that this method needs."
    """Of the box."""


def _target(name: str, label: str, content: str, hint: str, factor: float = 1.0) -> SearchMethod:
    def request(state: State, text: str) -> Request:
        return Request(target={name: factor * typed_number(label, text)}, noise=_known_noise(state))

    return SearchMethod(request, label, content, hint)


def _known_noise(state: State) -> Noise:
    """The noise that the last search was given, while its result holds: a new goal does not change the sensor."""
    found = state.searched
    return Noise() if found is None or found.request is None else found.request.noise


def _lag(samples: float, period: float | None) -> SearchMethod:
    """The goal of a lag, first `samples`, in a unit that suits it; in samples where the period (s) is unknown."""
    hint = "The largest lag that you accept: the setting within it that leaves the least noise is used."
    if period is None:
        return _target("lag_samples", "lag (samples)", _short(samples), hint)
    unit, length = next((one for one in reversed(TIME_UNITS) if one[1] <= samples * period), TIME_UNITS[0])
    return _target("lag_s", f"lag ({unit})", _short(samples * period / length), hint, length)


def _short(value: float) -> str:
    return typed(float(f"{value:.2g}"))


def _still(state: State, _text: str) -> Request:
    if state.view.window is None:
        raise BadSetting("the still stretch must be on screen: drag across it in the chart first (got all samples)")
    time, (first, last) = state.recording.time, state.view.window
    at = ((time >= first) & (time <= last)).nonzero()[0]
    if len(at) == 0:
        raise BadSetting("the part on screen must hold samples (got none)")
    return Request(noise=Noise(still=(int(at[0]), int(at[-1]) + 1)))


def _setting(state: State, name: str) -> Request:
    return Request(target={"lag_samples": settings_of(state)[name].lag_samples}, momentum=0.0)


SIGMA = "σ (std)"

SMOOTHING = {f"{name} smoothing": name for name in SETTINGS}
"""The goals where the signal shows hardly any noise, by the settings that they stand for."""

SEARCH_METHODS: dict[str, SearchMethod] = {
    LAG: _lag(10.0, None),
    "cut-off frequency": _target(
        "cutoff_hz", "cut-off (Hz)", "1", "Higher frequencies are attenuated, lower ones pass."
    ),
    "noise reduction": _target(
        "noise_reduction_db",
        "reduction (dB)",
        "12",
        "How much less noise: 20 dB is a tenth of its size, 6 dB half.",
    ),
    "best fit": SearchMethod(lambda _state, _text: Request()),
    "a still stretch, fit q": SearchMethod(_still),
    "data sheet σ, fit q": SearchMethod(
        lambda _state, text: Request(noise=Noise(sigma=typed_number(SIGMA, text))),
        SIGMA,
        hint="The noise of one reading, one standard deviation, in the unit of the signal.",
    ),
    "gain K": _target("gain", "gain K", "0.1", "The weight of each new sample in the estimate, between 0 and 1."),
    "keep r, fit q": SearchMethod(lambda state, _text: Request(noise=Noise(r=state.tuning.r))),
    **{
        goal: SearchMethod(lambda state, _text, name=name: _setting(state, name))
        for goal, name in SMOOTHING.items()
    },
}
"""Ways by the words on screen, the most useful first."""

GOALS = tuple(SEARCH_METHODS)[:4]
"""The ways that the first menu offers; the others are behind MORE."""

MORE_METHODS = tuple(name for name in SEARCH_METHODS if name not in {*GOALS, *SMOOTHING})

HINT = "What the filter is for. Best fit: the q and r that explain the recording best."


def goals_of(state: State) -> tuple[str, ...]:
    """The entries of the first menu."""
    return *(SMOOTHING if settings_of(state) else ()), *GOALS, MORE


def name_of(state: State) -> str:
    """The chosen way; a setting is one only where there are such settings."""
    chosen = state.view.search_method
    return chosen if chosen in (*goals_of(state), *MORE_METHODS) else LAG


def method_of(state: State) -> SearchMethod:
    """The chosen way; a lag is first the one that suits the signal on screen."""
    if (name := name_of(state)) != LAG:
        return SEARCH_METHODS[name]
    samples = max(proposed_lag(costs_of(state), state.start.params), MIN_LAG)
    return _lag(samples if math.isfinite(samples) else 10.0, state.recording.sample_period)


# Where the best fit hardly filters, three settings stand below the goal: the first answer is the medium one.


def costs_of(state: State) -> tuple[Cost, ...]:
    """What each lag costs on the channel on screen; () where that is not known."""
    return state.first.costs


def settings_of(state: State) -> dict[str, Cost]:
    """The three settings by name, where the signal shows hardly any noise; else none."""
    request = state.first.request
    hardly = request is not None and request.setting in SETTINGS and state.tuning.fast is None
    return {one.name: one for one in costs_of(state) if one.name and hardly}


def settings_text(state: State) -> str:
    """What the three settings cost, as markdown; "" where there is noise to remove."""
    if not (settings := settings_of(state)):
        return ""
    period = state.recording.sample_period
    heads = "", "lag", "noise left", "movement lost"
    cells = (
        (name, lag_text(one.lag_samples, period), percent(one.noise_left), percent(one.movement_lost))
        for name, one in settings.items()
    )
    table = table_of([dict(zip(heads, row, strict=True)) for row in cells])
    return f"Hardly any noise to remove without losing movement. Choose a smoothing as the goal:\n\n{table}"


# What the last search gave, in a sentence below Apply: what the filter costs, and what has changed.


MORE_FOLDER = "More settings and numbers"
"""The closed folder below the parameters."""

COSTS_HEIGHT = 170
"""Height of the chart below it, px."""

NBSP = "\u00a0"
"""Keeps a number and its unit on one line."""


def answer_text(state: State) -> str:
    """The last answer as markdown, "" for none; fixed words and numbers, with nothing to escape."""
    outcome = state.searched
    if outcome is None:
        return ""
    if outcome.after is None:
        return f"**Nothing was changed.** {outcome.message}"
    period = state.recording.sample_period
    before, after = steady_state(outcome.before.params), steady_state(outcome.after.params)
    lag, lag_before = (_glued(lag_text(one.lag_samples, period)) for one in (after, before))
    left, left_before = (_glued(share_left(one.noise_reduction_db)) for one in (after, before))
    if outcome.after.fast is not None:
        moving = steady_state(outcome.after.params.moving)
        lag_moving, left_moving = lag_text(moving.lag_samples, period), share_left(moving.noise_reduction_db)
        return (
            f"Two speeds. At rest: lag **{lag}**, leaves **{left} of the noise**. Moving: lag "
            f"**{_glued(lag_moving)}**, leaves **{_glued(left_moving)}**. Before: {lag_before}, {left_before}."
        )
    said = [
        f"{_lead(outcome)} **{lag}** leaves **{left} of the noise** "
        f"({_glued(decibels(-float(after.noise_reduction_db)))}).",
        f"Before: {lag_before}, {left_before}.",
    ]
    if after.overshoot:
        said.append(f"A step overshoots by {percent(float(after.overshoot))}.")
    if changes := changed(outcome.before, outcome.after, period):
        said.append(f"Changed: {changes}.")
    if outcome.estimate is not None:
        said.append(f"More in “{MORE_FOLDER}”.")
    return " ".join(said)


def account_text(state: State) -> str:
    """What an estimate found out about the recording, "" for none: too long for the space above the sliders."""
    outcome = state.outcome
    return "" if outcome is None or outcome.after is None or outcome.estimate is None else outcome.message


def _lead(outcome: Outcome) -> str:
    """What was asked for, unless it is the lag that follows."""
    goal = "" if outcome.request is None else outcome.request.goal
    if goal.startswith("a lag of"):
        return "Lag"
    asked = goal or outcome.how
    return f"{asked[:1].upper()}{asked[1:]}: lag"


def _glued(text: str) -> str:
    return text.replace(" ", NBSP)


def changed(before: ChannelTuning, after: ChannelTuning, period: float | None) -> str:
    """The parameters that differ, with both values: "q 0.61 → 6.97"."""
    rows = (
        ("q", number(before.q), number(after.q)),
        ("r", number(before.r), number(after.r)),
        ("momentum", momentum_words(before.momentum, period), momentum_words(after.momentum, period)),
        ("gate", gate_text(before.gate), gate_text(after.gate)),
    )
    return ", ".join(f"{name}{NBSP}{old}{NBSP}→{NBSP}{new}" for name, old, new in rows if old != new)


# The goal: what the filter is for, one number, Apply, and below it the result.


class GoalView:
    """The upper part of the Tune tab. A search runs as a job; its answer is filed as one undoable change."""

    def __init__(self, gui: viser.GuiApi, session: Session, jobs: Jobs) -> None:
        self._session, self._jobs = session, jobs
        self._shown: tuple[object, ...] = ()
        with gui.add_form(None) as self._form:
            self._goal = gui.add_dropdown("goal", (*GOALS, MORE), hint=HINT)
            hint = "Other ways to find q and r."
            self._method = gui.add_dropdown("method", MORE_METHODS, visible=False, hint=hint)
            self._box = gui.add_text("", "", visible=False, hint="")
            self._apply = gui.add_button("Apply", color=PRIMARY, hint="Sets q and r in one step; Undo reverts it.")
            self._costs = gui.add_markdown("", visible=False)
            self._running = SlowJob(gui, "Stop the search and change nothing.")
            self._answer = gui.add_markdown("", visible=False)
        bind(self._goal, session, lambda goal: set_search_method(_method_for(goal), SEARCH_METHODS))
        bind(self._method, session, lambda method: set_search_method(method, SEARCH_METHODS))
        on_user(self._form.on_submit, lambda _client: self._find_and_apply())
        on_user(self._apply.on_click, lambda _client: self._find_and_apply())
        for goal in GOALS:  # so that the palette finds them by their words
            command = gui.add_command(f"{GOAL}{goal}", description=HINT)
            change = set_search_method(goal, SEARCH_METHODS)
            on_user(command.on_trigger, lambda _client, change=change: session.request(change))

    def _find_and_apply(self) -> None:
        text = self._box.value
        self.search(lambda state: method_of(state).request(state, text))

    def search(self, request: Callable[[State], Request | None]) -> None:
        """Run a search on the state with every earlier request applied; its result is one undoable change."""
        self._jobs.run_with_state(self._session, lambda state: self._search(state, request(state)), Failed.FIND)

    def _search(self, state: State, request: Request | None) -> None:
        if request is None:
            return
        period = state.recording.sample_period
        with self._running as progress:
            found = find_parameters(state.z, request, dt=state.dt, sample_period=period, progress=progress)
        self._session.request(apply_found(state.recording, state.channel, found))

    def show(self, frame: Frame) -> None:
        """Show the boxes of the chosen method, and the last answer; it is for the Kalman filter alone."""
        self._form.visible = frame.state.fusion is None and frame.state.tuning.chain is None
        self._show_method(frame.state)
        table = settings_text(frame.state)
        put(self._costs, content=table, visible=bool(table))
        answer = answer_text(frame.state)
        self._answer.content, self._answer.visible = answer, bool(answer)

    def _show_method(self, state: State) -> None:
        name, method, goals = name_of(state), method_of(state), goals_of(state)
        offer(self._goal, goals, name if name in goals else MORE)
        self._method.visible = name not in goals
        if name not in goals:
            self._method.value = name
        shown = state.record_key, state.channel, bool(costs_of(state)), name, method.label
        if shown != self._shown:
            put(self._box, value=method.content)
        put(self._box, label=method.label, hint=method.hint, visible=bool(method.label))
        self._shown = shown


# What each lag costs, as curves: a click on them takes a lag, as the goal does with Apply.


COSTS = "**What each lag costs{}.** Click to choose a lag."


def _of_what(tuning: ChannelTuning) -> str:
    """The filters of the curves, where that on screen is another one."""
    return " without momentum" if tuning.momentum > 0.0 else "" if tuning.fast is None else " with one speed"


class CostsView:
    """Noise left and movement lost over the lag, and the filter on screen."""

    def __init__(self, gui: viser.GuiApi, goal: GoalView) -> None:
        self._search, self._unit = goal.search, 1.0
        self._text = gui.add_markdown("", visible=False)
        self._chart = Chart(gui, 0.0)
        self._chart.handle.height = COSTS_HEIGHT
        cursor: Any = {"drag": {"x": False, "y": False}, "chooses": True}  # the last for the page script
        self._chart.handle.cursor = cursor
        self._lag = gui.add_number(LAG_NUMBER, 0.0, visible=False, hint="Hidden.")
        on_user(self._lag.on_update, lambda _client: self._choose(float(self._lag.value) / self._unit))

    def _choose(self, samples: float) -> None:
        self._search(lambda state: Request(target={"lag_samples": samples}) if costs_of(state) else None)

    def show(self, frame: Frame) -> None:
        """Draw the curves, where there are any for the filter on screen."""
        state, costs = frame.state, costs_of(frame.state)
        is_shown = bool(costs) and state.is_standard
        put(self._text, content=COSTS.format(_of_what(state.tuning)), visible=is_shown)
        if not is_shown:
            self._chart.hide()
            return
        period, palette = state.recording.sample_period, palette_of(state)
        known, now = np.array([one.lag_samples for one in costs]), float(frame.steady.lag_samples)
        scale = time_scale_for(math.sqrt(known[0] * known[-1]) * (period or 1.0), period)
        self._unit = scale.factor * (period or 1.0)
        lags = np.union1d(known, np.clip(now, known[0], known[-1]))
        left, lost = (
            100.0 * np.interp(np.log(lags), np.log(known), [getattr(one, name) for one in costs])
            for name in ("noise_left", "movement_lost")
        )
        mark = np.where(lags == now, 100.0 * 10.0 ** (-0.05 * float(frame.steady.noise_reduction_db)), np.nan)
        lines = (
            line(left, "noise left", palette.innovation, 2),
            line(lost, "movement lost", palette.truth, 2),
            dots(mark, "this filter", palette.filtered, 10),
        )
        x, label, view = lags * self._unit, scale.label("lag"), state.view.resets
        self._chart.draw(x, lines, label, "%", view=view, y_range=(0.0, 100.0), log="x")


def _method_for(goal: str) -> str:
    """The search method of an entry of the menu; an unknown entry is refused with its name."""
    return MORE_METHODS[0] if goal == MORE else goal
