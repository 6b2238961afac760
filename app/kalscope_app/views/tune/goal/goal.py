"""The goal: what the filter is for, one number, Apply, and below it the result."""

from __future__ import annotations

import threading
from collections.abc import Callable

import viser

from kalscope.estimation.finding import Request, find_parameters
from kalscope_app.engine.frame import Frame
from kalscope_app.engine.jobs import Jobs
from kalscope_app.session.changes.parameters import apply_found
from kalscope_app.session.changes.view import set_search_method
from kalscope_app.session.session import Failed, Session
from kalscope_app.session.state import State
from kalscope_app.views.binding import bind, on_user
from kalscope_app.views.slow_job import SlowJobProgress
from kalscope_app.views.tune.goal.answer import answer_text
from kalscope_app.views.tune.goal.search_methods import (
    GOALS,
    HINT,
    MORE,
    MORE_METHODS,
    SEARCH_METHODS,
    STILL,
    clock_of,
    hint_of,
    method_of,
    stretch_texts,
)
from kalscope_app.views.window.css import PRIMARY


class GoalView:
    """The upper part of the Tune tab. A search runs as a job; its answer is filed as one undoable change."""

    def __init__(self, gui: viser.GuiApi, session: Session, jobs: Jobs) -> None:
        self._session, self._jobs = session, jobs
        self._shown: tuple[str, ...] = ()
        self._stretch = ("", "")
        self._stop = threading.Event()
        with gui.add_form(None) as self._form:
            self._goal = gui.add_dropdown("goal", (*GOALS, MORE), hint=HINT)
            self._method = gui.add_dropdown(
                "method", MORE_METHODS, visible=False, hint="Other ways to find q and r."
            )
            self._boxes = [gui.add_text("", "", visible=False, hint=hint_of("")) for _ in range(2)]
            self._apply = gui.add_button("Apply", color=PRIMARY, hint="Sets q and r in one step; Undo reverts it.")
            self._progress = gui.add_progress_bar(0.0, visible=False)
            self._cancel = gui.add_button("Cancel", visible=False, hint="Stop the search and change nothing.")
            self._answer = gui.add_markdown("", visible=False)
        bind(self._goal, session, lambda goal: set_search_method(_method_for(goal), SEARCH_METHODS))
        bind(self._method, session, lambda method: set_search_method(method, SEARCH_METHODS))
        on_user(self._form.on_submit, lambda _client: self._find_and_apply())
        on_user(self._apply.on_click, lambda _client: self._find_and_apply())
        on_user(self._cancel.on_click, lambda _client: self._stop.set())

    def _find_and_apply(self) -> None:
        texts = [box.value for box in self._boxes]

        def request(state: State) -> Request:
            method = method_of(state)
            return method.request(state, texts[: len(method.boxes)])

        self.search(request)

    def search(self, request: Callable[[State], Request | None]) -> None:
        """Run the search that is asked for, and apply its result as one undoable change; None: no search."""
        self._start(lambda state, stop: self._search(state, request(state), stop))

    def offer_still(self, found: tuple[State, tuple[int, int] | None]) -> None:
        """Fill the still stretch that was found into the boxes of that method, unless a user has typed there."""
        state, stretch = found
        before, self._stretch = self._stretch, ("", "") if stretch is None else stretch_texts(state, *stretch)
        if self._shown[:1] == (STILL,):
            for box, old, new in zip(self._boxes, before, self._stretch, strict=True):
                if box.value == old:
                    box.value = new

    def _start(self, work: Callable[[State, threading.Event], None]) -> None:
        """Queue a job on the state with every earlier request applied; each job has its own stop event."""
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

    def show(self, frame: Frame) -> None:
        """Show the boxes of the chosen method, and the last answer; it is for the Kalman filter alone."""
        self._form.visible = frame.state.fusion is None and frame.state.tuning.chain is None
        self._show_method(frame.state)
        answer = answer_text(frame.state)
        self._answer.content, self._answer.visible = answer, bool(answer)

    def _show_method(self, state: State) -> None:
        name, wanted = state.view.search_method, method_of(state).boxes
        self._goal.value = name if name in GOALS else MORE
        self._method.visible = name not in GOALS
        if name not in GOALS:
            self._method.value = name
        labels = tuple(
            f"{label} ({clock_of(state).unit})" if label in ("from", "to") else label for label, _ in wanted
        )
        for i, box in enumerate(self._boxes):
            box.visible = i < len(wanted)
            if i < len(wanted):
                if (name, *labels)[: i + 2] != self._shown[: i + 2]:
                    box.value = self._stretch[i] if name == STILL else wanted[i][1]
                box.label, box.hint = labels[i], hint_of(wanted[i][0])
        self._shown = name, *labels


def _method_for(goal: str) -> str:
    """The search method of an entry of the menu; an unknown entry is refused with its name."""
    return MORE_METHODS[0] if goal == MORE else goal
