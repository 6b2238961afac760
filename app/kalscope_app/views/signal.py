"""The charts of the signal and of its innovation, and the part of the recording that they show."""

from __future__ import annotations

import math
import time
from collections.abc import Callable

import numpy as np
import viser
from numpy.typing import NDArray

from kalscope.common.numbers import Array
from kalscope.common.text import count, number
from kalscope.sources.reading.account import warnings
from kalscope_app.engine.frame import Frame, SensorCurve
from kalscope_app.session.changes import reset_view, set_window
from kalscope_app.session.live_changes import SPANS, WAITING, follow, live_window, set_paused, set_span
from kalscope_app.session.session import Session
from kalscope_app.session.state import Live
from kalscope_app.views.charts import (
    DARK,
    LIGHT,
    SENSORS,
    Chart,
    ChartLayout,
    ChartLine,
    Palette,
    Scale,
    Thinning,
    axes,
    follows,
    gappy,
    lag_line,
    line,
    range_text,
    raw_lines,
    rings,
    scale_for,
    short,
    time_axis,
    time_label,
    time_points,
    time_scale_for,
)
from kalscope_app.views.widgets import bind, escape_markdown, on_user, put
from kalscope_app.views.window import HEADING, ONE_BUTTON, ZOOM_SLIDER, height_of

# Which part of the recording is on screen: a range, its end or all of it; a live one can be followed.


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
            visible=False,
            hint="The part of the recording that is plotted. Drag in a chart to zoom in; double-click to zoom out.",
        )
        # Only the page script changes it: shares of the window that a drag over a chart begins and ends at.
        self._zoom = gui.add_multi_slider(
            ZOOM_SLIDER, min=-1.0, max=2.0, step=1e-6, initial_value=WINDOW, marks=(), visible=False, hint="Hidden."
        )
        self._drawn = (0.0, 1.0)
        gui.add_html(ONE_BUTTON)
        self._buttons = gui.add_button_group("", ("Reset view",), visible=False, hint="Show all of the recording.")
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

    def _show_live(self, live: Live | None, *, zoomed: bool) -> None:
        self._live.visible = self._span.visible = live is not None
        put(self._range, visible=zoomed or live is not None)
        put(self._buttons, visible=zoomed and live is None)
        if live is not None:
            self._span.value = next(words for words, span in SPANS.items() if span == live.span)
            self._live.label = "live, paused" if live.paused else "live" if live.following else "looking back"

    def show(self, frame: Frame) -> None:
        """Follow the frame unless the range has moved since."""
        self._show_live(frame.state.live, zoomed=frame.state.view.window is not None)
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
        self._thinning = Thinning()

    def show(self, frame: Frame, *, thinned: bool = False) -> None:
        """Draw the signal; `thinned`: with fewer points, while a control moves."""
        with_gain = frame.state.view.gain_shown and frame.state.has_gain
        self._share_height(3 if frame.velocity is not None or with_gain else 2, self._height_above(frame))
        palette = DARK if frame.state.view.dark else LIGHT
        self._show_signal(frame, palette, time_axis(frame), self._thinning.of(frame) if thinned else None)

    def show_below(self, frame: Frame) -> None:
        """Draw the charts below the signal, and write the line above it."""
        palette, clock = DARK if frame.state.view.dark else LIGHT, time_axis(frame)
        put(self._heading, content=(HEADING if frame.state.live is not None else "") + heading_of(frame))
        self._show_innovation(frame, palette, clock)
        if frame.velocity is not None and frame.velocity_spread is not None:
            self._show_velocity(frame, palette, clock, frame.velocity, frame.velocity_spread)
        else:
            self.velocity.hide()
        if frame.state.view.gain_shown and frame.velocity is None and frame.state.has_gain:
            self._show_gain(frame, palette)
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

    def _show_signal(self, frame: Frame, palette: Palette, clock: Scale, places: NDArray[np.intp] | None) -> None:
        shown, state = frame.drawn, frame.state
        scale = scale_for(shown.raw, state.tuning.unit)
        raw = self._sensor_lines(frame, lambda one: one.raw) if frame.sensors else raw_lines(shown, palette)
        # Only the measurements and the truth set the y range: a large start-up transient may leave the chart.
        lines: list[ChartLine] = [
            *raw,
            ChartLine(frame.filtered - frame.spread, line("−2√p", scaled=False)),
            ChartLine(frame.filtered + frame.spread, line("+2√p", scaled=False)),
        ]
        bands = ({"series": (2, 1), "fill": palette.raw_band},) if shown.band is not None else ()
        bands = (*bands, {"series": (len(raw) + 2, len(raw) + 1), "fill": palette.band})
        if state.tuning.chain is not None:  # its error is not known
            lines, bands = [*raw], bands[:-1]
        for variant, curve in zip(state.variants, frame.variants, strict=False):
            colour = variant.css(dark=state.view.dark)
            lines.append(ChartLine(curve, line(variant.name, colour, 1.5, scaled=False)))
        filtered = "fused" if frame.sensors else "filtered"
        lines.append(ChartLine(frame.filtered, line(filtered, palette.filtered, 2.5, scaled=False)))
        if shown.truth is not None:
            lines.append(ChartLine(shown.truth, {**line("truth", palette.truth, 1.5), "dash": (6, 4)}))
        if frame.smoothed is not None:
            lines.append(ChartLine(frame.smoothed, line("smoother", palette.smoothed, 1.5)))
        if frame.board is not None:
            lines.append(ChartLine(frame.board, {**line("board's filter", palette.board, 1.5), "dash": (3, 3)}))
        if frame.set_aside is not None and state.set_aside is not None:
            name = f"set aside ({count(int(state.set_aside.sum()))})"
            lines.append(ChartLine(frame.set_aside, rings(name, palette.innovation, 9), gaps=True))
        if frame.refused is not None:
            ring = rings("rejected by the gate", palette.filtered, 13)  # a count here would rebuild the chart
            lines.append(ChartLine(frame.refused, ring, gaps=True))
        lines.append(lag_line(frame, palette))
        label = scale.label(short(state.tuning.name, 30))
        self._draw(self.signal, frame, clock, scale, lines, label, *bands, places=places)

    def _sensor_lines(self, frame: Frame, of: Callable[[SensorCurve], Array]) -> tuple[ChartLine, ...]:
        """A line for each of the sensors that are fused, in its colour."""
        colours = SENSORS[frame.state.view.dark]
        drawn = (gappy(short(one.name, 20), of(one), colours[one.colour % len(colours)]) for one in frame.sensors)
        return tuple(line for lines in drawn for line in lines)

    def _show_differences(self, frame: Frame, palette: Palette, clock: Scale) -> None:
        """How far the sensors are from the fused value, or raw from filtered behind a chain: no innovation."""
        name = "sensor − fused" if frame.sensors else "raw − filtered"
        lines = self._sensor_lines(frame, lambda one: one.difference)
        lines = lines or gappy(name, frame.drawn.raw - frame.filtered, palette.innovation)
        scale = scale_for(np.concatenate([one.y for one in lines]), frame.state.tuning.unit)
        label = label_beside(scale, name)
        self._draw(self.innovation, frame, clock, scale, [*lines], label)

    def _show_innovation(self, frame: Frame, palette: Palette, clock: Scale) -> None:
        if frame.sensors or frame.state.tuning.chain is not None:
            self._show_differences(frame, palette, clock)
            return
        v, spread = without_start(frame)
        scale = scale_for(v, frame.state.tuning.unit)
        lines = [
            ChartLine(-spread, line("−2√s")),
            ChartLine(spread, line("+2√s")),
            *gappy("innovation", v, palette.innovation, quiet=1),
        ]
        band = {"series": (2, 1), "fill": palette.innovation_band}
        label = label_beside(scale, "innovation")
        self._draw(self.innovation, frame, clock, scale, lines, label, band)

    def _show_velocity(self, frame: Frame, palette: Palette, clock: Scale, velocity: Array, spread: Array) -> None:
        scale = scale_for(velocity, velocity_unit(frame))
        lines = [
            ChartLine(velocity - spread, line("−2σ", scaled=False)),
            ChartLine(velocity + spread, line("+2σ", scaled=False)),
            ChartLine(velocity, line(scale.label("velocity"), palette.gain, 2)),
        ]
        band = {"series": (2, 1), "fill": palette.velocity_band}
        self._draw(self.velocity, frame, clock, scale, lines, "velocity", band)  # its unit is in the legend

    def _draw(
        self,
        chart: Chart,
        frame: Frame,
        clock: Scale,
        scale: Scale,
        lines: list[ChartLine],
        label: str,
        *bands: object,
        places: NDArray[np.intp] | None = None,
    ) -> None:
        series = ({"label": time_label(clock, before_now=follows(frame))}, *(one.style for one in lines))
        gaps = frozenset(i for i, one in enumerate(lines) if one.gaps)
        space = 30 if chart is self.signal else 15  # with fewer ticks a low chart has a 0 and no other number
        layout = ChartLayout(series, axes(label, space), bands, gaps)
        x, reach = time_points(frame)
        kept = slice(None) if places is None else places
        ys = [one.y[kept] * scale.factor for one in lines]
        ends = None if reach is None else (reach[0] * clock.factor, reach[1] * clock.factor)
        chart.show(x[kept] * clock.factor, ys, layout, frame.state.view.resets, ends)

    def _show_gain(self, frame: Frame, palette: Palette) -> None:
        top = float(frame.gain.max(initial=0.0))
        ceiling = next((level for level in GAIN_LEVELS if top <= level), 1.0)
        layout = ChartLayout(
            ({"label": "samples since start"}, line("gain K", palette.gain, 2)),
            axes("gain K"),
            y_range=(0.0, ceiling),
        )
        self.gain.show(frame.gain_samples, [frame.gain], layout)


GAIN_LEVELS = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0)
"""Ranges of the gain chart: few, so that it rarely changes while q does."""


def label_beside(scale: Scale, name: str) -> str:
    """What fits beside a low chart: its name, with the unit where there is room."""
    label = scale.label(name)
    return label if len(label) <= MAX_LABEL_LETTERS else name


def velocity_unit(frame: Frame) -> str:
    """The unit of the velocity: that of the signal per s, or per sample where the sample period is not known."""
    unit = frame.state.tuning.unit or "unit"
    return f"{unit}/s" if frame.state.recording.sample_period is not None else f"{unit} per sample"


def heading_of(frame: Frame) -> str:
    """Size, what is not drawn, and the status of the board; one line of markdown."""
    record, shown = frame.state.recording, frame.drawn
    waits = frame.state.live is not None and frame.state.live.waits
    parts = [] if frame.state.live is not None else [window_text(frame)]
    parts.append(WAITING if waits else f"{count(len(record))} samples")
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


def window_text(frame: Frame) -> str:
    """From when to when the charts show the recording: 0 to 36 s."""
    clock, (time, _) = time_axis(frame), time_points(frame)
    ends = (float(time[0]) * clock.factor, float(time[-1]) * clock.factor) if len(time) else (0.0, 0.0)
    return f"{range_text(*ends)} {clock.unit}"


def without_start(frame: Frame) -> tuple[Array, Array]:
    """Innovation and its 2√s, clipped to the range after the start-up, which the start would dwarf."""
    limit = largest_after_start(frame)
    return np.clip(frame.innovation, -limit, limit), np.minimum(frame.innovation_spread, limit)


def largest_after_start(frame: Frame) -> float:
    """Largest |innovation| or 2√s drawn after the start-up, with a small margin; inf if nothing comes after it."""
    later = (frame.drawn.indices > frame.start_up) & np.isfinite(frame.innovation)
    if not later.any():
        return math.inf
    return 1.05 * float(max(np.abs(frame.innovation[later]).max(), frame.innovation_spread[later].max()))
