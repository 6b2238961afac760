"""Pictures by matplotlib in pixels of the page; the signal as a picture behind the sheet of a phone."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING, Any

import numpy as np
import viser
from numpy.typing import NDArray

from kalscope.common.charts import drawing
from kalscope.common.text import lag_text, noise_left, number, percent
from kalscope_app.engine.frame import Frame
from kalscope_app.views.charts import palette_of, scale_for, short, time_axis
from kalscope_app.views.window import PHONE_CHECKBOX, shape_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# pyright: reportUnknownMemberType=false
# matplotlib leaves the types of keyword arguments open. It is imported where it draws, because that takes long.


def page_figure(width: float, height: float, paper: str, sharpness: int = 1) -> Figure:
    """A figure in pixels of the page: a point of matplotlib is one. Within `drawing`."""
    from matplotlib.figure import Figure

    size = (width + 1e-6) / 72.0, (height + 1e-6) / 72.0  # sizes are rounded down
    return Figure(size, dpi=72.0 * sharpness, facecolor=paper)


def pixels_of(figure: Figure) -> NDArray[np.uint8]:
    """The figure, shape (rows, columns, 3)."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3].copy()


# The signal as a picture behind the sheet of a phone, where viser shows no chart beside the controls.


WIDTH = 780
"""Width of the picture, px: sharp on the screens of phones."""

VISIBLE = 0.39
"""Share of the height that viser's sheet leaves free."""

LEFT = 0.13
"""Space for the numbers beside the curves, share of the width."""


class PhonePictures:
    """Draws every frame into the canvas of each phone. A hidden checkbox reports which browsers are on phones."""

    def __init__(self) -> None:
        self._lock = threading.Lock()  # reports and cameras arrive in several threads
        self._boxes: dict[viser.ClientHandle, viser.GuiCheckboxHandle] = {}
        self._shapes: dict[viser.ClientHandle, float] = {}
        self._frame: Frame | None = None

    def attach(self, client: viser.ClientHandle) -> None:
        """Ask a new browser whether it is on a phone."""
        box = self._boxes[client] = client.gui.add_checkbox(PHONE_CHECKBOX, False, visible=False)
        box.on_update(lambda _event: self._draw(client))
        client.camera.on_update(lambda _camera: self._draw(client, turned=True))
        self._draw(client)  # a quick page may have answered before the callback was there

    def detach(self, client: viser.ClientHandle) -> None:
        """Forget a browser that has disconnected."""
        self._boxes.pop(client, None)
        self._shapes.pop(client, None)

    def show(self, frame: Frame) -> None:
        """Draw the frame."""
        self._frame = frame
        for client in [*self._boxes]:
            self._draw(client)

    def on_emptied(self) -> None:
        """Take the pictures away."""
        self._frame = None
        for client in [*self._boxes]:
            client.scene.set_background_image(None)

    def _draw(self, client: viser.ClientHandle, *, turned: bool = False) -> None:
        """Draw the newest frame for a phone; `turned`: only if its canvas has another shape than last time."""
        with self._lock:
            box, frame, shape = self._boxes.get(client), self._frame, shape_of(client)
            if box is None or not box.value or frame is None or shape is None:
                return
            if turned and abs(shape - self._shapes.get(client, 0.0)) < 0.01 * shape:
                return
            self._shapes[client] = shape
            client.scene.set_background_image(draw_picture(frame, shape), format="jpeg", jpeg_quality=90)


def draw_picture(frame: Frame, shape: float) -> NDArray[np.uint8]:
    """Raw and filtered signal with its band, for a canvas of `shape` = width : height; (height, width, 3)."""
    palette = palette_of(frame.state)
    height, scale = round(WIDTH / shape), scale_for(frame.drawn.raw, frame.state.tuning.unit)
    with drawing():
        figure = page_figure(WIDTH, height, palette.paper)
        axes = figure.add_axes((LEFT, 1.0 - VISIBLE + 110.0 / height, 0.97 - LEFT, VISIBLE - 170.0 / height))
        _draw_curves(axes, frame, scale.factor)
        style: dict[str, Any] = {"color": palette.ink, "fontsize": 24}
        axes.set_title(scale.label(short(frame.state.tuning.name, 24)), fontweight="normal", **style)
        axes.set_xlabel(time_axis(frame.drawn.time, frame.state).label, **style)
        axes.tick_params(labelsize=20, labelcolor=palette.ink)
        axes.locator_params(nbins=4)
        axes.grid(color=palette.quiet, alpha=0.3)
        axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3, fontsize=22, labelcolor=palette.ink)
        for i, (name, value) in enumerate(_numbers(frame)):
            y = 1.0 - VISIBLE - (70.0 + 130.0 * i) / height
            figure.text(0.04, y, name, **style)
            figure.text(0.04, y - 14.0 / height, value, color=palette.ink, fontsize=32, va="top")
        return pixels_of(figure)


def _numbers(frame: Frame) -> list[tuple[str, str]]:
    """The numbers that matter, for the strip that viser's sheet leaves free at the left."""
    steady, state = frame.steady, frame.state
    rows = [("lag", lag_text(steady.lag_samples, state.recording.sample_period))]
    rows.append(("noise left", noise_left(steady.noise_reduction_db).replace(" (", "\n(")))
    if state.uses_parameters and state.tuning.momentum:
        rows.append(("overshoot", percent(steady.overshoot)))
    elif state.has_gain:
        rows.append(("gain K", number(steady.gain)))
    return rows


def _draw_curves(axes: Axes, frame: Frame, factor: float) -> None:
    """Points where the readings have gaps, else lines; the range of y follows the signal, as in the chart."""
    shown, palette = frame.drawn, palette_of(frame.state)
    x, colours = time_axis(shown.time, frame.state).x, palette.sensors
    raws = [(one.name, one.raw, colours[one.colour % len(colours)]) for one in frame.sensors]
    raws = raws or [("raw", shown.raw, palette.raw)]
    for name, raw, colour in raws:
        marks: dict[str, Any] = {"marker": ".", "linestyle": ""} if np.isnan(raw).any() else {}
        axes.plot(x, factor * raw, color=colour, linewidth=1.5, label=short(name, 12), **marks)
    low, high = axes.get_ylim()
    filtered, spread = factor * frame.filtered, factor * np.where(np.isfinite(frame.spread), frame.spread, np.nan)
    if frame.state.tuning.chain is None:
        axes.fill_between(x, filtered - spread, filtered + spread, color=palette.filtered, alpha=0.2, linewidth=0)
    for extra, colour in ((shown.truth, palette.truth), (frame.smoothed, palette.smoothed)):
        if extra is not None:
            axes.plot(x, factor * extra, color=colour, linewidth=2)
    axes.plot(x, filtered, color=palette.filtered, linewidth=5, label="fused" if frame.sensors else "filtered")
    axes.set_ylim(low, high)
