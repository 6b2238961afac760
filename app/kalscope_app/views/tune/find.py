"""Find q and r from the recording, from a goal for the filter, or from what is known about the sensor."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from contextlib import AbstractContextManager

import numpy as np
import viser

from kalscope.common.array import Array
from kalscope.common.text import lag_text, number, trimmed
from kalscope.estimation.agreement.comparison import compare_methods
from kalscope.estimation.agreement.words import comparison
from kalscope.estimation.finding import METHOD_NAMES, Request, find_parameters
from kalscope.filtering.steady_state import steady_state
from kalscope_app.engine.frame import Frame
from kalscope_app.engine.jobs import Jobs
from kalscope_app.session.changes.parameters import apply_found, set_method_comparison
from kalscope_app.session.changes.view import set_search_method
from kalscope_app.session.session import Failed, Session
from kalscope_app.session.state import State
from kalscope_app.views.binding import bind, on_user
from kalscope_app.views.slow_job import SlowJobProgress
from kalscope_app.views.tune.numbers import rows_of
from kalscope_app.views.tune.search_methods import BOX_HINTS, HINT, SEARCH_METHODS, STILL, clock_of, stretch_texts

FIVE_METHODS = (
    "Five methods estimate q and r from the recording, without momentum; *Find and apply* by maximum likelihood "
    "tries momentum too."
)
"""Why the table may find no noise where the search finds some: stands above it too."""


class FindView:
    """The folder "Find q and r". A search runs as a job; its answer is filed as one undoable change."""

    def __init__(
        self, gui: viser.GuiApi, check_tab: AbstractContextManager[object], session: Session, jobs: Jobs
    ) -> None:
        self._session, self._jobs = session, jobs
        self._shown_method = ""
        self._stretch = ("", "")
        self._stop = threading.Event()
        with gui.add_folder("Find q and r"):
            self._method = gui.add_dropdown("tune for", tuple(SEARCH_METHODS), hint=HINT)
            self._boxes = [gui.add_text("", "", visible=False, hint=BOX_HINTS[""]) for _ in range(2)]
            self._find = gui.add_button("Find and apply", hint="One step; Undo reverts it.")
            self._progress = gui.add_progress_bar(0.0, visible=False)
            self._cancel = gui.add_button("Cancel", visible=False, hint="Stop the search and change nothing.")
            self._answer = gui.add_markdown("", visible=False)
        bind(self._method, session, lambda method: set_search_method(method, SEARCH_METHODS))
        on_user(self._find.on_click, lambda _client: self._find_and_apply())
        on_user(self._cancel.on_click, lambda _client: self._stop.set())
        with check_tab:
            gui.add_markdown("### Compare estimators")
            compare = gui.add_button("Run five methods", hint="Four other methods beside maximum likelihood.")
            self._comparison = gui.add_markdown("")
        on_user(compare.on_click, lambda _client: self._start(self._compare))

    def _find_and_apply(self) -> None:
        texts = [box.value for box in self._boxes]
        self.search(lambda state: SEARCH_METHODS[state.view.search_method].request(state, texts))

    def search(self, request: Callable[[State], Request | None]) -> None:
        """Look for what is asked for, and apply it as one undoable change; None asks for nothing any more."""
        self._start(lambda state, stop: self._search(state, request(state), stop))

    def offer_still(self, state: State, stretch: tuple[int, int] | None) -> None:
        """Fill the still stretch that was found into the boxes of that method, unless a user has typed there."""
        before, self._stretch = self._stretch, ("", "") if stretch is None else stretch_texts(state, *stretch)
        if self._shown_method == STILL:
            for box, old, new in zip(self._boxes, before, self._stretch, strict=True):
                if box.value == old:
                    box.value = new

    def _start(self, work: Callable[[State, threading.Event], None]) -> None:
        """Queue a job on the state that every earlier request has led to; each job has a stop sign of its own."""
        stop = self._stop = threading.Event()
        self._jobs.run_with_state(self._session, lambda state: work(state, stop), Failed.FIND)

    def _search(self, state: State, request: Request | None, stop: threading.Event) -> None:
        if request is None:
            return
        z, period = state.recording.channel(state.channel), state.recording.sample_period
        with SlowJobProgress(self._progress, self._cancel) as shown:
            found = find_parameters(
                z,
                request,
                dt=state.dt,
                sample_period=period,
                progress=shown.report,
                cancelled=stop.is_set,
            )
        self._session.request(apply_found(state.recording, state.channel, found))

    def _compare(self, state: State, stop: threading.Event) -> None:
        z = samples_to_compare(state)
        with SlowJobProgress(self._progress, self._cancel) as shown:
            opinions = compare_methods(z, state.dt, progress=shown.report, cancelled=stop.is_set)
        self._session.request(set_method_comparison(state.recording, state.channel, opinions))

    def show(self, frame: Frame) -> None:
        """Show the boxes of the chosen method, and the last answers."""
        self._show_method(frame.state)
        answer = answer_text(frame.state)
        self._answer.content, self._answer.visible = answer, bool(answer)
        self._comparison.content = comparison_text(frame.state)

    def _show_method(self, state: State) -> None:
        self._method.value = state.view.search_method
        wanted = SEARCH_METHODS[state.view.search_method].boxes
        for i, box in enumerate(self._boxes):
            box.visible = i < len(wanted)
            if i < len(wanted):
                label, content = wanted[i]
                box.label = f"{label} ({clock_of(state).unit})" if label in ("from", "to") else label
                if state.view.search_method != self._shown_method:
                    box.value = self._stretch[i] if state.view.search_method == STILL else content
                box.hint = BOX_HINTS.get(label, BOX_HINTS[""])
        self._shown_method = state.view.search_method


def samples_to_compare(state: State) -> Array:
    """The channel on screen without the spikes that the last search set aside: all methods see the same samples."""
    z, aside = state.recording.channel(state.channel), state.set_aside
    return z if aside is None else np.where(aside, np.nan, z)


def answer_text(state: State) -> str:
    """The last answer with before and after, as markdown; made of our own words and numbers."""
    outcome = state.answers.outcome
    if outcome is None:
        return ""
    if outcome.after is None:
        return f"**{outcome.how}: nothing was changed.** {outcome.message}"
    period = state.recording.sample_period
    before, after = outcome.before, outcome.after

    settled = steady_state(before.params), steady_state(after.params)
    rows = [
        ("q", number(before.q, 4), number(after.q, 4)),
        ("r", number(before.r, 4), number(after.r, 4)),
        *rows_of((before.momentum, after.momentum), settled, period),
    ]
    if before.gate != after.gate:
        rows.append(("gate", gate_words(before.gate), gate_words(after.gate)))
    table = "| | before | now |\n|---|---|---|\n" + "\n".join(f"| {n} | {b} | **{a}** |" for n, b, a in rows)
    return f"{table}\n\n{outcome.message}"


def gate_words(gate: float | None) -> str:
    """A gate on v²/s in standard deviations."""
    return "off" if gate is None else f"{trimmed(math.sqrt(gate))} σ"


def comparison_text(state: State) -> str:
    """The five methods side by side and their disagreement named, as markdown."""
    if not state.answers.method_comparison:
        return FIVE_METHODS
    period = state.recording.sample_period
    rows: list[str] = []
    for one in state.answers.method_comparison:
        steady = steady_state(one.params) if one.params is not None else None
        lag = "–" if steady is None else lag_text(float(steady.lag_samples), period)
        gain = "–" if steady is None else number(float(steady.gain))
        q, r, verdict = number(float(one.q)), number(float(one.r)), str(one.verdict).replace("_", " ")
        rows.append(f"| {METHOD_NAMES[one.method]} | {q} | {r} | {gain} | {lag} | {verdict} |")
    said = comparison(state.answers.method_comparison) or "No two of them can be compared."
    head = "| method | q | r | gain K | lag | verdict |\n|---|---|---|---|---|---|\n"
    message = state.answers.method_comparison[0].message
    return f"{FIVE_METHODS}\n\n{head}{chr(10).join(rows)}\n\n**{said}**\n\n{message}"
