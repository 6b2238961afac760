"""Which part of the recording is on screen: a range, its end or all of it; a live one can be followed."""

from __future__ import annotations

import math
import time

import viser

from kalscope_app.engine.frame import Frame
from kalscope_app.session.changes.live import SPANS, follow, live_window, set_paused, set_span
from kalscope_app.session.changes.view import reset_view, set_window
from kalscope_app.session.live_state import Live
from kalscope_app.session.session import Session
from kalscope_app.views.binding import bind, on_user
from kalscope_app.views.charts.time_axis import time_points
from kalscope_app.views.scales import Scale, time_scale_for
from kalscope_app.views.window.css import ONE_BUTTON
from kalscope_app.views.window.page.page_script import ZOOM_SLIDER

WINDOW = (0.0, 1.0)
"""The present window in shares of itself. A double click asks for more: it means the whole recording."""


class WindowView:
    """The range control above the charts."""

    def __init__(self, gui: viser.GuiApi, session: Session) -> None:
        self._session = session
        self._range = gui.add_multi_slider(
            "view",
            min=0.0,
            max=1.0,
            step=0.001,
            initial_value=(0.0, 1.0),
            marks=(),
            hint="The part of the recording that is plotted. Drag in a chart to zoom in; double-click to zoom out.",
        )
        # Only the page script changes it: shares of the window that a drag over a chart begins and ends at.
        self._zoom = gui.add_multi_slider(
            ZOOM_SLIDER, min=-1.0, max=2.0, step=1e-6, initial_value=WINDOW, marks=(), visible=False, hint="Hidden."
        )
        self._drawn = (0.0, 1.0)
        gui.add_html(ONE_BUTTON)
        self._buttons = gui.add_button_group("", ("Reset view",), hint="Show all of the recording.")
        self._live = gui.add_button_group(
            "live",
            ("Live", "Pause"),
            hint="Follow the newest sample, or freeze the charts.",
            visible=False,
        )
        self._span = gui.add_dropdown(
            "shows the last", tuple(SPANS), initial_value="10 s", hint="Length of the live window.", visible=False
        )
        self._serial = 0
        self._moved_at = -math.inf
        self._scale = Scale(1.0, "s")
        changes = {"Reset view": reset_view, "Live": follow, "Pause": set_paused(True)}
        on_user(self._range.on_update, lambda _client: self._file())
        on_user(self._zoom.on_update, lambda _client: self._file_zoom())
        for buttons in (self._buttons, self._live):
            on_user(buttons.on_click, lambda _client, pressed=buttons: session.request(changes[pressed.value]))
        bind(self._span, session, set_span)

    def _file(self) -> None:
        first, last = (float(end) / self._scale.factor for end in self._range.value)
        self._serial = self._session.request(set_window(first, last), key="view")

    def _file_zoom(self) -> None:
        ends, (first, last) = self._zoom.value, self._drawn
        self._zoom.value = WINDOW  # the same shares must count again
        low, high = (first + share * (last - first) for share in ends)
        zoomed = 0.0 <= ends[0] < ends[1] <= 1.0
        self._serial = self._session.request(set_window(low, high) if zoomed else reset_view, key="view")

    def _show_live(self, live: Live | None) -> None:
        self._live.visible = self._span.visible = live is not None
        self._buttons.visible = live is None
        if live is not None:
            self._span.value = next(words for words, span in SPANS.items() if span == live.span)
            self._live.label = "live, paused" if live.paused else "live" if live.following else "looking back"

    def show(self, frame: Frame) -> None:
        """Follow the frame unless the range has moved since."""
        self._show_live(frame.state.live)
        self._drawn = drawn_window(frame)
        recording = frame.state.recording
        if moves_too_often(frame, time.monotonic() - self._moved_at):
            return
        self._moved_at = time.monotonic()
        begin, end = frame.drawn.time_range
        self._scale = time_scale_for(end - begin, recording.sample_period)
        low, high = begin * self._scale.factor, end * self._scale.factor
        high = high if high > low else low + 1.0
        if frame.serial < self._serial:
            return
        window = live_window(frame.state) or (begin, end)
        value = tuple(min(max(end * self._scale.factor, low), high) for end in window)
        self._range.min, self._range.max, self._range.step = low, high, (high - low) / 1000.0
        self._range.value = value


def drawn_window(frame: Frame) -> tuple[float, float]:
    """First and last time of the time axis, s, on the clock of the recording."""
    time, reach = time_points(frame)
    if reach is None:
        return (float(time[0]), float(time[-1])) if len(time) else (0.0, 1.0)
    newest = float(frame.state.recording.time[-1])
    return newest + reach[0], newest + reach[1]


def moves_too_often(frame: Frame, seconds: float) -> bool:
    """Whether the range of a live record moved less than a second ago: a slider that moves is hard to grab."""
    return frame.state.live is not None and frame.state.live.following and seconds < 1.0
