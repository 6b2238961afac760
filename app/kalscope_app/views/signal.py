"""The charts: raw and filtered signal with its band, the innovation with its band, the gain at the start."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import viser

from kalscope_app.charts import Array, Chart, Layout, Scale, scale_for, time_scale_for
from kalscope_app.frame import Frame
from kalscope_app.views.words import count, duration, frequency, plain


@dataclass(frozen=True)
class Palette:
    """Colours of one theme; hues from the colour-blind-safe set of the Arduino plotter."""

    raw: str
    filtered: str
    truth: str
    innovation: str
    gain: str
    smoothed: str
    band: str
    innovation_band: str


LIGHT = Palette(
    raw="#a9b4be",
    filtered="#D55E00",
    truth="#0072B2",
    innovation="#009E73",
    gain="#CC79A7",
    smoothed="#1b9e8a",
    band="rgba(213, 94, 0, 0.14)",
    innovation_band="rgba(0, 158, 115, 0.14)",
)
DARK = Palette(
    raw="#6f7f8d",
    filtered="#ff8a3d",
    truth="#56B4E9",
    innovation="#2fc99b",
    gain="#e39ac6",
    smoothed="#3fd6bd",
    band="rgba(255, 138, 61, 0.20)",
    innovation_band="rgba(47, 201, 155, 0.18)",
)


class SignalView:
    """Three charts, one below the other; the first two share their zoom."""

    def __init__(self, gui: viser.GuiApi) -> None:
        self._heading = gui.add_markdown("")
        self.signal = Chart(gui, 430, sync="kalscope-time")
        self.innovation = Chart(gui, 200, sync="kalscope-time")
        self.gain = Chart(gui, 150)

    def set_heights(self, signal: int, innovation: int, gain: int) -> None:
        """Heights of the three charts in px."""
        for chart, height in ((self.signal, signal), (self.innovation, innovation), (self.gain, gain)):
            chart.handle.height = height

    def show(self, frame: Frame) -> None:
        """Draw the frame."""
        palette = DARK if frame.state.dark else LIGHT
        heading = heading_of(frame)
        if self._heading.content != heading:
            self._heading.content = heading
        clock = time_axis(frame)
        self._show_signal(frame, palette, clock)
        self._show_innovation(frame, palette, clock)
        self._show_gain(frame, palette)

    def _show_signal(self, frame: Frame, palette: Palette, clock: Scale) -> None:
        shown, state = frame.shown, frame.state
        scale = scale_for(shown.raw, state.tuning.unit)
        low, high = frame.filtered - frame.spread, frame.filtered + frame.spread
        ys = [shown.raw, low, high, frame.filtered]
        # Only the measurements and the truth decide the y range: a wild start may leave the picture.
        series = [
            {"label": time_label(clock)},
            _raw_series(palette, points=bool(np.isnan(shown.raw).any())),
            {**line("−2√p"), "auto": False},
            {**line("+2√p"), "auto": False},
            {**line("filtered", palette.filtered, 2.5), "auto": False},
        ]
        if shown.truth is not None:
            ys.append(shown.truth)
            series.append({**line("truth", palette.truth, 1.5), "dash": (6, 4)})
        if frame.smoothed is not None:
            ys.append(frame.smoothed)
            series.append(line("best offline", palette.smoothed, 1.5))
        layout = Layout(
            tuple(series),
            axes(scale.label(state.channel)),
            ({"series": (3, 2), "fill": palette.band},),
        )
        self.signal.show(shown.time * clock.factor, [y * scale.factor for y in ys], layout, state.resets)

    def _show_innovation(self, frame: Frame, palette: Palette, clock: Scale) -> None:
        v, spread = without_start(frame)
        scale = scale_for(v, frame.state.tuning.unit)
        layout = Layout(
            (
                {"label": time_label(clock)},
                line("−2√s"),
                line("+2√s"),
                line("innovation", palette.innovation),
            ),
            axes(scale.unit or "innovation"),
            ({"series": (2, 1), "fill": palette.innovation_band},),
        )
        ys = [-spread, spread, v]
        time = frame.shown.time * clock.factor
        self.innovation.show(time, [y * scale.factor for y in ys], layout, frame.state.resets)

    def _show_gain(self, frame: Frame, palette: Palette) -> None:
        layout = Layout(
            (
                {"label": "samples since the start"},
                line("gain K", palette.gain, 2),
            ),
            axes("gain K"),
        )
        self.gain.show(frame.gain_samples, [frame.gain], layout)


def heading_of(frame: Frame) -> str:
    """Name, size, rate and what is not drawn; one line of markdown."""
    recording, shown = frame.state.recording, frame.shown
    parts = [f"**{plain(recording.title)}**"]
    if len(recording.names) > 1:
        parts.append(plain(frame.state.channel))
    parts.append(f"{count(len(recording))} samples")
    if recording.sample_period:
        period = recording.sample_period
        parts.append(frequency(1.0 / period) if period < 10.0 else f"one every {duration(period)}")
    if shown.missing:
        parts.append(f"{count(shown.missing)} missing")
    if shown.decimated:
        parts.append(
            f"drawn: {count(len(shown.indices))} of {count(shown.last - shown.first)} points; numbers use all"
        )
    if starts_wild(frame):
        parts.append("the innovation is cut off during the start")
    return " · ".join(parts)


def time_axis(frame: Frame) -> Scale:
    """Unit of the shared time axis, by the length of what is shown."""
    time = frame.shown.time
    span = float(time[-1] - time[0]) if len(time) > 1 else 1.0
    return time_scale_for(span, frame.state.recording.sample_period)


def time_label(clock: Scale) -> str:
    """Name of the time axis, with its unit."""
    return "sample" if clock.unit == "samples" else f"time ({clock.unit})"


def without_start(frame: Frame) -> tuple[Array, Array]:
    """Innovation and its 2√s, held within what occurs after the start-up, so that the start does not dwarf it."""
    limit = largest_after_start(frame)
    return np.clip(frame.innovation, -limit, limit), np.minimum(frame.innovation_spread, limit)


def starts_wild(frame: Frame) -> bool:
    """Whether the innovation of the start-up is larger than any later one, and so is cut off in the chart."""
    finite = frame.innovation[np.isfinite(frame.innovation)]
    return bool(np.abs(finite).max(initial=0.0) > largest_after_start(frame))


def largest_after_start(frame: Frame) -> float:
    """Largest |innovation| or 2√s drawn after the start-up, with a little room; inf if nothing comes after it."""
    later = (frame.shown.indices > frame.start_up) & np.isfinite(frame.innovation)
    if not later.any():
        return math.inf
    return 1.05 * float(max(np.abs(frame.innovation[later]).max(), frame.innovation_spread[later].max()))


def _raw_series(palette: Palette, *, points: bool) -> dict[str, object]:
    if points:  # uPlot would draw a line across every gap
        marks = {"show": True, "size": 3, "space": 0, "fill": palette.raw, "stroke": palette.raw}
        return {"label": "raw", "stroke": palette.raw, "width": 0, "points": marks}
    return line("raw", palette.raw)


def line(label: str, colour: str = "transparent", width: float = 1) -> dict[str, object]:
    """A line without marks; without a colour it is the edge of a band."""
    return {"label": label, "stroke": colour, "width": width, "points": {"show": False}}


def axes(y: str) -> tuple[dict[str, object], ...]:
    """Small type; the x axis has its name in the legend, which saves a line."""
    small = {
        "font": "12px sans-serif",
        "labelFont": "12px sans-serif",
        "labelSize": 20,
        "labelGap": 2,
        "gap": 3,
    }
    return ({**small, "size": 34}, {**small, "label": y, "size": 60, "space": 22})
