"""The header above the tabs: what is open, its channel and rate, and what the filter costs and gives."""

from __future__ import annotations

import viser

from kalscope.common.text import decibels, duration, lag_text
from kalscope.recording import Recording
from kalscope.sources.times.mean_rate import MIN_SPREAD, MeanRate, mean_rate
from kalscope_app.engine.frame import Frame
from kalscope_app.engine.step_spread import spread_of_span
from kalscope_app.session.changes.channels import select_channel
from kalscope_app.session.session import Session
from kalscope_app.views.binding import bind, offer
from kalscope_app.views.text import escape_markdown
from kalscope_app.views.window.css import HEADER

WORTH_SAYING = 0.05
"""Share of a lag by which nine of ten must differ to be shown: fewer digits hide the rest."""


class HeaderView:
    """Two lines of text, and between them the channel where there are several."""

    def __init__(self, gui: viser.GuiApi, session: Session) -> None:
        gui.add_html(HEADER)
        self._record = gui.add_markdown("")
        self._channel = gui.add_dropdown("channel", list[str](["–"]), hint="Each channel has its own filter.")
        self._numbers = gui.add_markdown("")
        self._rated: tuple[Recording | None, MeanRate | None] = None, None
        bind(self._channel, session, select_channel)

    def show(self, frame: Frame) -> None:
        """Write both lines."""
        state = frame.state
        rate = self._rate_of(state.recording)
        self._record.content = record_line(state.recording.title, rate)
        offer(self._channel, state.recording.names, state.channel)
        self._channel.visible = len(state.recording.names) > 1
        self._numbers.content = numbers_line(frame, rate)

    def _rate_of(self, recording: Recording) -> MeanRate | None:
        if recording is not self._rated[0]:  # every stamp is read: once a recording, not once a frame
            self._rated = recording, mean_rate(recording)
        return self._rated[1]


def record_line(title: str, rate: MeanRate | None) -> str:
    """Name and rate, with how far the steps vary; markdown, escaped."""
    return f"**{escape_markdown(title, 40)}** · {'sample rate unknown' if rate is None else rate.words}"


def numbers_line(frame: Frame, rate: MeanRate | None) -> str:
    """The lag at the mean rate and what is left of the noise; where steps vary, nine of ten lags lie in a range."""
    lag, period = float(frame.steady.lag_samples), None if rate is None else rate.period
    said = f"lag **{lag_text(lag, period)}**"
    if rate is not None and rate.spread >= MIN_SPREAD:
        factors = spread_of_span(frame.state.recording.time, lag)
        low, high = (duration(factor * lag * rate.period) for factor in factors)
        said += f" ({low} to {high}: the steps vary)" if factors[1] - factors[0] > WORTH_SAYING else ""
    return f"{said} · noise **{decibels(-float(frame.steady.noise_reduction_db))}**"
