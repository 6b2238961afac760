"""The likelihood over the momentum: a button in the Check tab, a chart of it, and what it says."""

from __future__ import annotations

import threading

import numpy as np
import viser

from kalscope.common.array import Array
from kalscope.common.text import number
from kalscope_app.engine.frame import Frame
from kalscope_app.engine.jobs import Jobs
from kalscope_app.session.changes.momentum import momentum_words
from kalscope_app.session.session import Session
from kalscope_app.session.state import State
from kalscope_app.studies.momentum_profile import MomentumProfile, momentum_profile
from kalscope_app.views.binding import on_user, put
from kalscope_app.views.charts.chart import Chart, ChartLayout
from kalscope_app.views.charts.spectra import log_axes
from kalscope_app.views.charts.style import DARK, LIGHT, dots, line
from kalscope_app.views.scales import log_scale_for, log_time_scale
from kalscope_app.views.slow_job import SlowJobProgress

LEAD = "How well each momentum explains the recording, with the best q and r of each: its log-likelihood."


class MomentumProfileView:
    """Part of the Check tab; the profile is computed as a job."""

    def __init__(self, gui: viser.GuiApi, session: Session, jobs: Jobs) -> None:
        self._session, self._jobs = session, jobs
        self._profile: MomentumProfile | None = None
        self._shown: object = None
        self._stop = threading.Event()
        heading = gui.add_markdown("### Momentum")
        draw = gui.add_button("Draw the momentum profile", hint="Searches q and r at 25 values of the momentum.")
        self._progress = gui.add_progress_bar(0.0, visible=False)
        self._cancel = gui.add_button("Cancel", visible=False, hint="Stop and draw nothing.")
        self._said = gui.add_markdown(LEAD)
        self._of_one_channel = heading, draw, self._said
        self._chart = Chart(gui, 0.3)
        self._chart.hide()
        on_user(draw.on_click, lambda _client: self._start())
        on_user(self._cancel.on_click, lambda _client: self._stop.set())

    def _start(self) -> None:
        stop = self._stop = threading.Event()

        def work(state: State) -> None:
            state.require_one_channel()
            with SlowJobProgress(self._progress, self._cancel) as shown:
                self._profile = momentum_profile(state, shown.report, stop.is_set)
            self._session.request(lambda state: state)  # the frame of it draws the profile

        self._jobs.run_with_state(self._session, work)

    def show(self, frame: Frame) -> None:
        """Draw the profile and mark the present momentum; hide the profile of another channel."""
        state, profile = frame.state, self._profile
        for part in self._of_one_channel:
            put(part, visible=state.fusion is None)
        present = profile, state.tuning.momentum, state.view.dark, state.record_key, state.measured
        if present == self._shown:
            return
        if profile is None or state.fusion is not None or not profile.belongs_to(state):
            self._said.content = LEAD
            self._chart.hide()
        else:
            self._said.content = words_of(profile)
            self._chart.show(*lines_of(profile, state))
        self._shown = present


def words_of(profile: MomentumProfile) -> str:
    """What the profile says, in one or two sentences."""
    at = int(np.argmax(profile.loglik))
    gain = float(profile.loglik[at]) - profile.plain
    if gain < 1.0:
        return f"{LEAD} No momentum explains it better than none."
    words = momentum_words(float(profile.momentum[at]), profile.state.recording.sample_period)
    return (
        f"{LEAD} The best is near **{words}**: its log-likelihood lies {number(gain)} above that without momentum. "
        "The goal *best fit* takes momentum only if it also predicts unseen samples better."
    )


def lines_of(profile: MomentumProfile, state: State) -> tuple[Array, list[Array], ChartLayout]:
    """Log-likelihood below the best over the momentum, that without momentum, and a dot at the present one."""
    palette = DARK if state.view.dark else LIGHT
    period = profile.state.recording.sample_period
    times = profile.momentum * (period or 1.0)
    clock = log_scale_for(times, "samples") if period is None else log_time_scale(times)
    best = max(float(profile.loglik.max()), profile.plain)
    below, plain = profile.loglik - best, np.full(len(times), profile.plain - best)
    present = np.full(len(times), np.nan)
    if state.tuning.momentum > 0.0:
        nearest = int(np.argmin(np.abs(np.log(profile.momentum) - np.log(state.tuning.momentum))))
        present[nearest] = below[nearest]
    x = times * clock.factor
    layout = ChartLayout(
        (
            {"label": clock.label("momentum")},
            {**line("without momentum", palette.truth, 1.5), "dash": (6, 4)},
            line("with momentum", palette.filtered, 2),
            dots("near the present one", palette.filtered, 12),
        ),
        log_axes(x, None, "below the best"),
        gaps=frozenset({2}),
        log_x=True,
    )
    return x, [plain, below, present], layout
