"""The charts of the signal and of its innovation, and the part of the recording that they show."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import viser
from numpy.typing import NDArray

from kalscope.common.numbers import Array
from kalscope.common.text import count, number
from kalscope.filtering.steady import steady_state
from kalscope.sources.reading.account import warnings
from kalscope_app.engine.filter_runs import Cache, DrawnSamples, choose_indices
from kalscope_app.engine.frame import Frame
from kalscope_app.session import changes
from kalscope_app.session.session import Session
from kalscope_app.session.state import Live
from kalscope_app.views import charts
from kalscope_app.views.charts import Chart, ChartLine, Palette, Scale, palette_of, short, time_axis
from kalscope_app.views.widgets import bind, escape_markdown, on_user, put
from kalscope_app.views.window import HEADING, ONE_BUTTON, ZOOM_SLIDER, height_of

# Which part of the recording is on screen: a range, its end or all of it; a live one can be followed.


WINDOW = (0.0, 1.0)
"""The present window in shares of itself. A double click asks for more: it means the whole recording."""


class WindowView:
    """The range control above the charts."""

    def __init__(self, gui: viser.GuiApi, session: Session) -> None:
        self._session = session
        hint = "The part of the recording that is plotted. Drag in a chart to zoom in; double-click to zoom out."
        self._range = gui.add_multi_slider(
            "view", min=0.0, max=1.0, step=0.001, initial_value=(0.0, 1.0), marks=(), visible=False, hint=hint
        )
        # Only the page script changes it: shares of the window that a drag over a chart begins and ends at.
        self._zoom = gui.add_multi_slider(
            ZOOM_SLIDER, min=-1.0, max=2.0, step=1e-6, initial_value=WINDOW, marks=(), visible=False, hint="Hidden."
        )
        self._drawn = (0.0, 1.0)
        gui.add_html(ONE_BUTTON)
        self._buttons = gui.add_button_group("", ("Reset view",), visible=False, hint="Show all of the recording.")
        hint = "Follow the newest sample, or freeze the charts."
        self._live = gui.add_button_group("live", ("Live", "Pause"), hint=hint, visible=False)
        hint = "Length of the live window."
        span = gui.add_dropdown(
            "shows the last", tuple(changes.SPANS), initial_value="10 s", hint=hint, visible=False
        )
        self._span = bind(span, session, changes.set_span)
        self._serial = 0
        self._moved_at = -math.inf
        self._scale = Scale(1.0, "s")
        steps = {"Reset view": changes.reset_view, "Live": changes.follow, "Pause": changes.pause}
        on_user(self._range.on_update, lambda _client: self._file())
        on_user(self._zoom.on_update, lambda _client: self._file_zoom())
        for buttons in (self._buttons, self._live):
            on_user(buttons.on_click, lambda _client, pressed=buttons: session.request(steps[pressed.value]))

    def _file(self) -> None:
        first, last = (float(end) / self._scale.factor for end in self._range.value)
        self._serial = self._session.request(changes.set_window(first, last), key="view")

    def _file_zoom(self) -> None:
        ends, (first, last) = self._zoom.value, self._drawn
        self._zoom.value = WINDOW  # the same shares must count again
        low, high = (first + share * (last - first) for share in ends)
        zoomed = 0.0 <= ends[0] < ends[1] <= 1.0
        change = changes.set_window(low, high) if zoomed else changes.reset_view
        self._serial = self._session.request(change, key="view")

    def _show_live(self, live: Live | None, *, zoomed: bool) -> None:
        self._live.visible = self._span.visible = live is not None
        put(self._range, visible=zoomed or live is not None)
        put(self._buttons, visible=zoomed and live is None)
        if live is not None:
            self._span.value = next(words for words, span in changes.SPANS.items() if span == live.span)
            self._live.label = "live, paused" if live.paused else "live" if live.following else "looking back"

    def show(self, frame: Frame) -> None:
        """Follow the frame unless the range has moved since."""
        live, axis = frame.state.live, time_axis(frame.drawn.time, frame.state)
        self._show_live(live, zoomed=frame.state.view.window is not None)
        self._drawn = axis.origin + axis.first, axis.origin + axis.last
        if live is not None and live.following and time.monotonic() - self._moved_at < 1.0:
            return  # a slider that moves is hard to grab
        self._moved_at = time.monotonic()
        begin, end = frame.drawn.time_range
        self._scale = charts.time_scale_for(end - begin, frame.state.recording.sample_period)
        low, high = begin * self._scale.factor, end * self._scale.factor
        high = high if high > low else low + 1.0
        if frame.serial < self._serial:
            return
        window = changes.live_window(frame.state) or (begin, end)
        value = tuple(min(max(end * self._scale.factor, low), high) for end in window)
        self._range.min, self._range.max, self._range.step = low, high, (high - low) / 1000.0
        self._range.value = value


# The charts: raw and filtered signal with its band, innovation with its band, and the gain or the velocity.


LIVE_HEIGHT, ZOOMED_HEIGHT, QUESTION_HEIGHT = 104, 58, 30
"""Heights in px that the controls of a live record with its second line of heading, the controls of a zoom, and a
question about the file take from the chart below."""

SHARES: dict[int, tuple[float, ...]] = {3: (0.57, 0.235, 0.195), 2: (0.7, 0.3)}
"""Shares of the height by the number of charts: signal, innovation, and gain or velocity where one is drawn."""

MAX_LABEL_LETTERS = 14
"""Characters that fit beside the innovation at 720 px of height."""


class SignalView:
    """Three charts, one below the other; those over time share their zoom."""

    def __init__(self, gui: viser.GuiApi, asks: Callable[[Frame], bool]) -> None:
        """Args: the panel; whether a question stands above the charts of this frame."""
        self._asks = asks
        self._heading = gui.add_markdown("")
        self.signal, self.innovation = (Chart(gui, share, sync="kalscope-time", window=True) for share in SHARES[2])
        self.gain = Chart(gui, SHARES[3][2])
        self.velocity = Chart(gui, SHARES[3][2], sync="kalscope-time", window=True)
        self.gain.hide()
        self.velocity.hide()
        self._kept = Cache[NDArray[np.intp]]()

    def show(self, frame: Frame, *, thinned: bool = False) -> None:
        """Draw the signal; `thinned`: with fewer points, while a control moves."""
        state = frame.state
        third = frame.velocity is not None or frame.moving is not None or (state.view.gain_shown and state.has_gain)
        self._share_height(3 if third else 2, self._height_above(frame))
        scale = charts.scale_for(frame.drawn.raw, state.tuning.unit)
        label, axis, lines = scale.label(short(state.tuning.name, 30)), axis_of(frame, 30), signal_lines(frame)
        if thinned and (places := places_to_keep(frame, self._kept)) is not None:
            axis["x"], lines = axis["x"][places], [replace(one, y=one.y[places]) for one in lines]
        self.signal.draw(**axis, lines=lines, y_label=label, factor=scale.factor)

    def show_below(self, frame: Frame) -> None:
        """Draw the charts below the signal, and write the line above it."""
        state, palette, axis = frame.state, palette_of(frame.state), axis_of(frame)
        put(self._heading, content=(HEADING if state.live is not None else "") + heading_of(frame))
        name, lines = innovation_lines(frame)
        scale = charts.scale_for(np.concatenate([one.y for one in lines]), state.tuning.unit)
        label = scale.label(name)
        if len(label) > MAX_LABEL_LETTERS:  # the legend has the name, too; nothing else has the power of ten
            label = name if scale.factor == 1.0 else scale.unit[:MAX_LABEL_LETTERS]
        self.innovation.draw(**axis, lines=lines, y_label=label, factor=scale.factor)
        if frame.velocity is not None and frame.velocity_spread is not None:
            per = " per sample" if state.recording.sample_period is None else "/s"
            scale = charts.scale_for(frame.velocity, f"{state.tuning.unit or 'unit'}{per}")
            edges = charts.band(frame.velocity, frame.velocity_spread, "2σ", palette.gain + palette.band)
            name = scale.label("velocity")  # the unit is in the legend
            middle = charts.line(frame.velocity, name, palette.gain, 2)
            lines = [*edges, middle]
            self.velocity.draw(**axis, lines=lines, y_label="velocity", factor=scale.factor)
        elif frame.moving is not None:
            lines = [charts.line(frame.moving, "probability of moving", palette.gain, 2)]
            self.velocity.draw(**axis, lines=lines, y_label="moving", y_range=(0.0, 1.0))
        else:
            self.velocity.hide()
        if frame.velocity is None and frame.moving is None and state.view.gain_shown and state.has_gain:
            top = float(frame.gain.max(initial=0.0))
            ends = 0.0, next((level for level in GAIN_LEVELS if top <= level), 1.0)
            lines = [charts.line(frame.gain, "gain K", palette.gain, 2)]
            self.gain.draw(frame.gain_samples, lines, "samples since start", "gain K", y_range=ends)
        else:
            self.gain.hide()

    def _height_above(self, frame: Frame) -> int:
        if frame.state.live is not None:
            return LIVE_HEIGHT
        if frame.state.view.window is not None:
            return ZOOMED_HEIGHT
        return QUESTION_HEIGHT if self._asks(frame) else 0

    def _share_height(self, charts: int, above: int) -> None:
        """Set the heights of the charts below what takes `above` px; two take that of the third as well."""
        for chart, share in zip((self.signal, self.innovation), SHARES[charts], strict=False):
            chart.set_height(share, height_of(share, charts) - (above if chart is self.signal else 0))


def axis_of(frame: Frame, space: int = 15) -> dict[str, Any]:
    """What draws a chart over the time of a frame; with a wider `space` (px) a low chart has no number but 0."""
    axis, view = time_axis(frame.drawn.time, frame.state), frame.state.view.resets
    return {"x": axis.x, "x_label": axis.label, "view": view, "reach": axis.reach, "space": space}


def signal_lines(frame: Frame) -> list[ChartLine]:
    """All that is drawn over the measurements, these first.

    Only the measurements and the truth set the y range: a large start-up transient may leave the chart.
    """
    shown, state, palette = frame.drawn, frame.state, palette_of(frame.state)
    lines = [*(sensor_lines(frame, palette, raw=True) or raw_lines(shown, palette))]
    if state.tuning.chain is None:  # the error of a chain is not known
        lines += charts.band(frame.filtered, frame.spread, "2√p", palette.filtered + palette.band)
    for variant, curve in zip(state.variants, frame.variants, strict=False):
        lines.append(charts.line(curve, variant.name, variant.css(dark=state.view.dark), 1.5, scaled=False))
    name = "fused" if frame.sensors else "filtered"
    lines.append(charts.line(frame.filtered, name, palette.filtered, 2.5, scaled=False))
    if shown.truth is not None:
        lines.append(charts.line(shown.truth, "truth", palette.truth, 1.5, dash=(6, 4)))
    if frame.smoothed is not None:
        lines.append(charts.line(frame.smoothed, "smoother", palette.smoothed, 1.5))
    if frame.board is not None:
        lines.append(charts.line(frame.board, "board's filter", palette.board, 1.5, dash=(3, 3)))
    if frame.set_aside is not None and state.set_aside is not None:
        name = f"set aside ({count(int(state.set_aside.sum()))})"
        lines.append(charts.rings(frame.set_aside, name, palette.innovation, 9))
    if frame.refused is not None:  # a count here would rebuild the chart
        lines.append(charts.rings(frame.refused, "rejected by the gate", palette.filtered, 13))
    return [*lines, *lag_line(frame, palette)]


def innovation_lines(frame: Frame) -> tuple[str, list[ChartLine]]:
    """Name and lines of the chart below the signal.

    How far the sensors are from the fused value, or raw from filtered behind a chain: these have no innovation.
    """
    palette = palette_of(frame.state)
    if frame.sensors:
        return "sensor − fused", sensor_lines(frame, palette, raw=False)
    if frame.state.tuning.chain is not None:
        name = "raw − filtered"
        return name, [*charts.gappy(name, frame.drawn.raw - frame.filtered, palette.innovation)]
    v, spread = without_start(frame)
    edges = charts.band(0.0, spread, "2√s", palette.innovation + palette.band, scaled=True)
    return "innovation", [*edges, *charts.gappy("innovation", v, palette.innovation, quiet=1)]


def raw_lines(shown: DrawnSamples, palette: Palette) -> tuple[ChartLine, ...]:
    """The measurements: a line, points where some are missing, or the edges of a band where they are dense."""
    if shown.band is None:
        return charts.gappy("raw", shown.raw, palette.raw)
    low, high = shown.band
    top = charts.line(high, "raw max", palette.raw, 0.5, fill=f"{palette.raw}57")
    return charts.line(low, "raw min", palette.raw, 0.5), top


def sensor_lines(frame: Frame, palette: Palette, *, raw: bool) -> list[ChartLine]:
    """A line for each of the sensors that are fused, in its colour: readings, or their differences."""
    lines: list[ChartLine] = []
    for one in frame.sensors:
        y, colour = one.raw if raw else one.difference, palette.sensors[one.colour % len(palette.sensors)]
        lines += charts.gappy(short(one.name, 20), y, colour)
    return lines


def lag_line(frame: Frame, palette: Palette) -> tuple[ChartLine, ...]:
    """A level line as long as the lag, up to the filtered signal at its steepest rise; none if it is too short."""
    time, x, axis = frame.drawn.time, frame.filtered, time_axis(frame.drawn.time, frame.state)
    steady = frame.steady if frame.state.tuning.fast is None else steady_state(frame.state.params.moving)
    lag, length = steady.lag_samples * (frame.state.recording.sample_period or 1.0), axis.last - axis.first
    if len(x) < 2 or steady.lag_samples < 1.0 or not 0.005 * length < lag < 0.5 * length:
        return ()  # by no sample's time: of a live record they vary, and another line rebuilds the chart
    y, begin = np.full(len(x), np.nan), np.searchsorted(time, time - lag)
    end = int(np.argmax(np.nan_to_num(np.where(time - lag < time[0], np.nan, x - x[begin]), nan=-math.inf)))
    y[begin[end] : end + 1] = x[end]
    return (charts.line(y, "lag", palette.ink, 3, scaled=False, gaps=True),)


GAIN_LEVELS = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0)
"""Ranges of the gain chart: few, so that it rarely changes while q does."""


def heading_of(frame: Frame) -> str:
    """Size, what is not drawn, and the status of the board; one line of markdown."""
    record, shown = frame.state.recording, frame.drawn
    waits = frame.state.live is not None and frame.state.live.waits
    axis = time_axis(frame.drawn.time, frame.state)
    parts = [] if frame.state.live is not None else [f"{charts.range_text(*axis.reach)} {axis.scale.unit}"]
    inside = "" if frame.state.view.window is None else f"{count(shown.last - shown.first)} of "
    parts.append(changes.WAITING if waits else f"{inside}{count(len(record))} samples")
    if shown.missing and not waits:
        parts.append(f"{count(shown.missing)} missing")
    if frame.state.live is None and warnings(record):
        parts.append("**part of the file could not be read: see Source**")
    if shown.decimated:
        plotted, all_samples = count(len(shown.indices)), count(shown.last - shown.first)
        parts.append(f"plotting {plotted} of {all_samples} samples; statistics use all")
    if math.isfinite(frame.board_difference):
        parts.append(f"the board's filter differs by up to {number(frame.board_difference)}")
    if frame.status is not None:
        parts.append(f"**{escape_markdown(frame.status.word, 120)}**")
        parts += [escape_markdown(frame.status.hint, 160)] if frame.status.hint else []
        recorder = frame.status.recording
        if recorder is not None:
            name = escape_markdown(recorder.paths[-1].name)
            parts.append(f"recording to **{name}**: {count(recorder.counts.written)} lines")
            parts += [f"**{escape_markdown(recorder.error, 160)}**"] if recorder.error else []
    return " · ".join(parts)


def without_start(frame: Frame) -> tuple[Array, Array]:
    """Innovation and its 2√s, clipped to the range after the start-up, which the start would dwarf."""
    later = (frame.drawn.indices > frame.start_up) & np.isfinite(frame.innovation)
    limit = math.inf  # nothing comes after the start-up
    if later.any():
        limit = 1.05 * float(max(np.abs(frame.innovation[later]).max(), frame.innovation_spread[later].max()))
    return np.clip(frame.innovation, -limit, limit), np.minimum(frame.innovation_spread, limit)


# Fewer points for a chart that is drawn at every step of a control that moves.
#
# They are some of those that are drawn once it has stopped, the first and the last among them: neither the axes nor
# the raw signal move when the others follow.


MAX_MOVING_POINTS = 2000
"""Points of a line while a control moves, at most: about two to each pixel of a wide chart."""


def places_to_keep(frame: Frame, kept: Cache[NDArray[np.intp]]) -> NDArray[np.intp] | None:
    """Indices of the points to draw among those of the frame; None: all, where single samples are visible.

    Ascending: the first, last, highest and lowest, and those that keep the shape of raw signal and truth; `kept`
    has those of the last frame, which are chosen once for each view of the recording.
    """
    drawn = frame.drawn
    if drawn.band is None or frame.set_aside is not None or len(drawn.indices) <= MAX_MOVING_POINTS:
        return None

    def choose() -> NDArray[np.intp]:
        chosen = choose_indices(drawn.raw, drawn.truth, MAX_MOVING_POINTS - 2)
        return np.union1d(chosen, (drawn.raw.argmin(), drawn.raw.argmax())).astype(np.intp)

    return kept.once(choose, drawn)
