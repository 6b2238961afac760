"""The header above the tabs: what is open, its channel and rate, and what the filter costs and gives."""

from __future__ import annotations

import viser

from kalscope.common.text import decibels, duration, lag_text
from kalscope.recording import Recording
from kalscope.sources.times.jitter import MIN_JITTER, jitter_of, rate_words
from kalscope_app.engine.frame import Frame
from kalscope_app.engine.step_spread import spread_of_span
from kalscope_app.session.changes.channels import select_channel
from kalscope_app.session.session import Session
from kalscope_app.views.binding import bind, offer
from kalscope_app.views.markdown import capitalised, escape_markdown
from kalscope_app.views.window.css import HEADER

WORTH_SAYING = 0.05
"""Share of a lag by which nine of ten must differ to be shown: less is lost in the digits shown."""


class HeaderView:
    """Two lines of text, and between them the channel where there are several."""

    def __init__(self, gui: viser.GuiApi, session: Session) -> None:
        gui.add_html(HEADER)
        self._record = gui.add_markdown("")
        self._channel = gui.add_dropdown("channel", list[str](["–"]), hint="Each channel has its own filter.")
        self._numbers = gui.add_markdown("")
        self._jitter: tuple[Recording | None, float] = None, 0.0
        bind(self._channel, session, select_channel)

    def show(self, frame: Frame) -> None:
        """Write both lines."""
        record, jitter = frame.state.recording, self._jitter_of(frame.state.recording)
        self._record.content = record_line(record, jitter)
        fusion = frame.state.settings.fusion
        names = record.names if fusion is None else (*record.names, fusion.tuning.name)
        offer(self._channel, names, frame.state.channel if frame.state.fusion is None else names[-1])
        self._channel.visible = len(record.names) > 1
        self._numbers.content = numbers_line(frame, jitter)

    def _jitter_of(self, recording: Recording) -> float:
        if recording is not self._jitter[0]:  # every stamp is read: once a recording, not once a frame
            self._jitter = recording, jitter_of(recording)
        return self._jitter[1]


def record_line(recording: Recording, jitter: float) -> str:
    """Name and rate, with how far the steps vary; markdown, escaped."""
    return f"**{escape_markdown(recording.title, 40)}** · {rate_words(recording.sample_period, jitter)}"


def numbers_line(frame: Frame, jitter: float) -> str:
    """The lag and what is left of the noise; where steps vary, the range in which nine of ten lags lie.

    First the filter, where it is not the Kalman filter alone.
    """
    lag, record, chain = frame.steady.lag_samples, frame.state.recording, frame.state.tuning.chain
    said = f"lag **{lag_text(lag, record.sample_period)}**"
    ends = spread_of_span(record.time, lag) if jitter >= MIN_JITTER else None
    if ends is not None and ends[1] - ends[0] > WORTH_SAYING * lag * (record.sample_period or 1.0):
        said += f" ({duration(ends[0])} to {duration(ends[1])}: the steps vary)"
    name = "" if chain is None else f"**{capitalised(chain.words)}**  \n"
    return f"{name}{said} · noise **{decibels(-frame.steady.noise_reduction_db)}**"
