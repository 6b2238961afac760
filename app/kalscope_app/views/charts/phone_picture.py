"""The signal as a picture behind the sheet of a phone, where viser shows no chart beside the controls."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING

import numpy as np
import viser
from numpy.typing import NDArray
from PIL import Image

from kalscope.common.array import Array
from kalscope.common.text import decibels, lag_text, number, percent
from kalscope_app.engine.frame import Frame
from kalscope_app.views.charts.chart import drawable
from kalscope_app.views.charts.pen import Pen
from kalscope_app.views.charts.style import DARK, LIGHT, SENSORS, Palette
from kalscope_app.views.charts.time_axis import time_axis
from kalscope_app.views.scales import range_text, scale_for
from kalscope_app.views.window.layout import shape_of
from kalscope_app.views.window.page.page_script import PHONE_CHECKBOX

if TYPE_CHECKING:
    from PIL import ImageDraw

WIDTH = 780
"""Width of the picture, px: sharp on the screens of phones."""

VISIBLE = 0.39
"""Share of the height that viser's sheet leaves free."""

MARGIN = 0.04
"""Space around the curves, share of the width."""


class PhonePictures:
    """Draws every frame into the canvas of each phone. A hidden checkbox reports which browsers are on phones."""

    def __init__(self, server: viser.ViserServer) -> None:
        self._server = server
        self._lock = threading.RLock()  # reports, cameras and disconnects arrive in several threads, in any order
        self._shapes: dict[viser.ClientHandle, float | None] = {}
        self._frame: Frame | None = None

    def attach(self, client: viser.ClientHandle) -> None:
        """Ask a new browser whether it is on a phone."""
        is_phone = client.gui.add_checkbox(PHONE_CHECKBOX, False, visible=False)
        is_phone.on_update(lambda _event: self._on_report(client, is_phone))
        self._on_report(client, is_phone)  # a quick page may have answered before the callback was there
        client.camera.on_update(lambda _camera: self._follow_shape(client))

    def detach(self, client: viser.ClientHandle) -> None:
        """Forget a browser that has disconnected."""
        with self._lock:
            self._shapes.pop(client, None)

    def show(self, frame: Frame) -> None:
        """Draw the frame."""
        self._frame = frame
        with self._lock:
            for client, shape in self._shapes.items():
                self._draw(client, shape)

    def on_emptied(self) -> None:
        """Take the pictures away."""
        self._frame = None
        with self._lock:
            for client in self._shapes:
                client.scene.set_background_image(None)

    def _on_report(self, client: viser.ClientHandle, checkbox: viser.GuiCheckboxHandle) -> None:
        with self._lock:
            if client.client_id not in self._server.get_clients():
                return
            is_phone = checkbox.value  # read here: the last thread to enter must act on the last report
            if is_phone:
                self._shapes[client] = None
                self._follow_shape(client)
            elif client in self._shapes:
                self.detach(client)

    def _follow_shape(self, client: viser.ClientHandle) -> None:
        """Draw again once the canvas has another shape, as when the phone is turned."""
        with self._lock:
            shape, known = shape_of(client), self._shapes.get(client, 0.0)  # 0: not on a phone
            if shape is not None and (known is None or abs(shape - known) > 0.01 * known > 0.0):
                self._shapes[client] = shape
                self._draw(client, shape)

    def _draw(self, client: viser.ClientHandle, shape: float | None) -> None:
        if self._frame is not None and shape is not None:
            client.scene.set_background_image(draw_picture(self._frame, shape), format="jpeg", jpeg_quality=90)


def draw_picture(frame: Frame, shape: float) -> NDArray[np.uint8]:
    """Raw and filtered signal with its band, for a canvas of `shape` = width : height; (height, width, 3)."""
    palette = DARK if frame.state.view.dark else LIGHT
    background, ink = ("#1e2024", "#c9ced6") if frame.state.view.dark else ("#ffffff", "#495057")
    image = Image.new("RGB", (WIDTH, round(WIDTH / shape)), background)
    margin = round(MARGIN * WIDTH)
    top, bottom = margin + 36, round(VISIBLE * image.height) - 44
    pen = Pen(image, 1)
    low, high = _draw_curves(pen.draw, frame, palette, (margin, top, WIDTH - margin, bottom))
    scale, clock = scale_for(frame.drawn.raw, frame.state.tuning.unit), time_axis(frame)
    first, last = (frame.drawn.time[i] * clock.factor if len(frame.drawn.time) else 0.0 for i in (0, -1))
    reach = f"{number(low * scale.factor)} to {number(high * scale.factor)} {scale.unit}"
    pen.text((margin, margin), f"{frame.state.tuning.name[:24]}: {reach}", ink, 24, "la")
    span = range_text(first, last)
    pen.text((margin, bottom + 10), f"{span} {clock.unit}", ink, 24, "la")
    for x, name, colour in (
        (WIDTH - margin - 170, "raw", palette.raw),
        (WIDTH - margin, "fused" if frame.sensors else "filtered", palette.filtered),
    ):
        pen.text((x, bottom + 10), name, ink, 24, "ra")
        start = x - pen.width(name, 24) - 12
        pen.line([(start - 28, bottom + 24), (start, bottom + 24)], colour, 5)
    _write_numbers(pen, frame, ink, (margin, round(VISIBLE * image.height) + 2 * margin))
    return np.asarray(image)


def _write_numbers(pen: Pen, frame: Frame, ink: str, corner: tuple[int, int]) -> None:
    """The numbers that matter, in the strip that viser's sheet leaves free at the left."""
    steady, period = frame.steady, frame.state.recording.sample_period
    rows = [
        ("lag", lag_text(steady.lag_samples, period)),
        ("noise", decibels(-steady.noise_reduction_db)),
    ]
    if frame.state.has_gain:
        rows.append(("gain K", number(steady.gain)))
    if frame.state.uses_parameters and frame.state.tuning.momentum:
        rows.append(("overshoot", percent(steady.overshoot)))
    for i, (name, value) in enumerate(rows):
        x, y = corner[0], corner[1] + 130 * i
        pen.text((x, y), name, ink, 24, "la")
        pen.text((x, y + 34), value, ink, 36, "la")


def _draw_curves(
    pen: ImageDraw.ImageDraw, frame: Frame, palette: Palette, box: tuple[int, int, int, int]
) -> tuple[float, float]:
    """Draw into a box (left, top, right, bottom); the range of y follows the signal, as in the chart."""
    shown = frame.drawn
    colours = SENSORS[frame.state.view.dark]
    raws = [(one.raw, colours[one.colour % len(colours)]) for one in frame.sensors] or [(shown.raw, palette.raw)]
    x, filtered, spread, *lines = drawable(shown.time, [frame.filtered, frame.spread, *(raw for raw, _ in raws)])
    low, high = min(float(raw.min()) for raw in lines), max(float(raw.max()) for raw in lines)
    if high <= low:
        low, high = low - 1.0, high + 1.0
    left, top, right, bottom = box

    def points(y: Array) -> list[tuple[float, float]]:
        across = left + (right - left) * (x - x[0]) / (x[-1] - x[0] or 1.0)
        up = np.clip((y - low) / (high - low), -0.1, 1.1)
        return list(zip(across.tolist(), (bottom - (bottom - top) * up).tolist(), strict=True))

    if frame.state.tuning.chain is None:
        band = tuple(int(part) for part in palette.band[5:-1].split(",")[:3])
        pen.polygon([*points(filtered - spread), *points(filtered + spread)[::-1]], fill=(*band, 45))
    for line, (raw, colour) in zip(lines, raws, strict=True):
        seen = np.isfinite(raw) if len(raw) == len(x) else np.ones(len(x), dtype=bool)
        drawn = points(line)
        for start, end in zip(range(len(x) - 1), range(1, len(x)), strict=True):
            if seen[start] and seen[end]:
                pen.line([drawn[start], drawn[end]], fill=colour, width=1)
    for extra, colour in ((shown.truth, palette.truth), (frame.smoothed, palette.smoothed)):
        if extra is not None:
            pen.line(points(drawable(shown.time, [extra])[1]), fill=colour, width=2)
    pen.line(points(filtered), fill=palette.filtered, width=5, joint="curve")
    return low, high
