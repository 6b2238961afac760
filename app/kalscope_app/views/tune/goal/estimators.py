"""Part of the Check tab: five methods side by side, and which lie within the interval of the first."""

from __future__ import annotations

import threading
from contextlib import AbstractContextManager

import numpy as np
import viser

from kalscope.analysis.estimators import compare_methods, comparison, is_within
from kalscope.common.array import Array
from kalscope.common.text import lag_text, number
from kalscope.estimation.finding import METHOD_NAMES
from kalscope.filtering.steady_state import steady_state
from kalscope_app.engine.frame import Frame
from kalscope_app.engine.jobs import Jobs
from kalscope_app.session.changes.parameters import set_method_comparison
from kalscope_app.session.session import Failed, Session
from kalscope_app.session.state import State
from kalscope_app.views.binding import on_user, put
from kalscope_app.views.slow_job import SlowJobProgress

FIVE_METHODS = (
    "Five methods estimate q and r from the recording, without momentum; the goal *best fit* tries momentum too."
)
"""Why the table may find no noise where the search finds some: shown above the table, too."""


class EstimatorsView:
    """The button "Run five methods" and its table; they run as a job."""

    def __init__(
        self, gui: viser.GuiApi, check_tab: AbstractContextManager[object], session: Session, jobs: Jobs
    ) -> None:
        self._session, self._jobs = session, jobs
        self._stop = threading.Event()
        with check_tab:
            heading = gui.add_markdown("### Compare estimators")
            compare = gui.add_button("Run five methods", hint="Four other methods beside maximum likelihood.")
            self._progress = gui.add_progress_bar(0.0, visible=False)
            self._cancel = gui.add_button("Cancel", visible=False, hint="Stop and compare nothing.")
            self._comparison = gui.add_markdown("")
        self._of_one_channel = heading, compare, self._comparison
        on_user(compare.on_click, lambda _client: self._start())
        on_user(self._cancel.on_click, lambda _client: self._stop.set())

    def _start(self) -> None:
        stop = self._stop = threading.Event()
        self._jobs.run_with_state(self._session, lambda state: self._compare(state, stop), Failed.FIND)

    def _compare(self, state: State, stop: threading.Event) -> None:
        state.require_one_channel()
        z = samples_to_compare(state)
        with SlowJobProgress(self._progress, self._cancel) as shown:
            estimates = compare_methods(z, state.dt, progress=shown.report, cancelled=stop.is_set)
        self._session.request(set_method_comparison(state.recording, state.channel, estimates))

    def show(self, frame: Frame) -> None:
        """Write the table; fused sensors have none."""
        for part in self._of_one_channel:
            put(part, visible=frame.state.fusion is None)
        self._comparison.content = comparison_text(frame.state)


def samples_to_compare(state: State) -> Array:
    """The channel on screen without the spikes that the last search set aside: all methods see the same samples."""
    z, aside = state.recording.channel(state.channel), state.set_aside
    return z if aside is None else np.where(aside, np.nan, z)


def comparison_text(state: State) -> str:
    """The five methods side by side, and which of them lie outside the interval, as markdown."""
    if not state.answers.method_comparison:
        return FIVE_METHODS
    period = state.recording.sample_period
    rows: list[str] = []
    best = state.answers.method_comparison[0]
    for one in state.answers.method_comparison:
        steady = steady_state(one.params) if one.params is not None else None
        lag = "–" if steady is None else lag_text(steady.lag_samples, period)
        inside = {True: "yes", False: "no", None: "–"}[is_within(one, best)]
        q, r, verdict = number(float(one.q)), number(float(one.r)), str(one.verdict).replace("_", " ")
        rows.append(f"| {METHOD_NAMES[one.method]} | {q} | {r} | {lag} | {inside} | {verdict} |")
    said = comparison(state.answers.method_comparison) or "No two of them can be compared."
    head = "| method | q | r | lag | in 95 % | verdict |\n|---|---|---|---|---|---|\n"
    return f"{FIVE_METHODS}\n\n{head}{chr(10).join(rows)}\n\n**{said}**\n\n{best.message}"
