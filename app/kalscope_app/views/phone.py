"""The signal as a picture behind the sheet of a phone, drawn with Pillow in pixels of the page."""

from __future__ import annotations

import math
import threading
from functools import lru_cache
from typing import Any

import numpy as np
import viser
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from kalscope.common.numbers import Array
from kalscope.common.text import decibels, lag_text, number, percent
from kalscope_app.engine.frame import Frame
from kalscope_app.studies.tuning_map import Point
from kalscope_app.views.charts import DARK, LIGHT, SENSORS, Palette, drawable, range_text, scale_for, time_axis
from kalscope_app.views.window import PHONE_CHECKBOX, shape_of

# Drawing and writing with Pillow in pixels of the page, whatever the resolution of the picture. Pure.


RAISED = 0.68
"""Size of a superscript relative to the text it belongs to."""

MISSING = {"−": "-", "∞": "inf", "…": "...", "µ": "u", "μ": "u", "Δ": "delta", "°": "deg ", "Ω": "Ohm", "·": "*"}
"""Substitutes for letters that the built-in font lacks."""

Colour = Any


@lru_cache(maxsize=64)
def font(size: int) -> Any:
    """The built-in font at a size in picture pixels."""
    return ImageFont.load_default(size=size)


@lru_cache(maxsize=1024)
def known(letter: str) -> bool:
    """Whether the built-in font has this letter; it draws a box for all that it lacks."""
    face = font(24)
    return letter == " " or bytes(face.getmask(letter)) != bytes(face.getmask("\u0fff"))


def printable(text: str) -> str:
    """Text in the letters of the built-in font; ² stays, because it is drawn as a superscript 2."""
    text = "".join(MISSING.get(letter, letter) for letter in text.replace("\u202f", " "))
    return "".join(letter if letter == "²" or known(letter) else "?" for letter in text)


def luminance(colour: str) -> float:
    """Relative luminance of a colour, #rrggbb: 0 = black, 1 = white (WCAG 2.2)."""
    parts = (int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5))
    linear = (part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts)
    return sum(weight * part for weight, part in zip((0.2126, 0.7152, 0.0722), linear, strict=True))


def ink_on(colour: str) -> str:
    """Black or white, whichever is legible on a colour: with a contrast of 4.5 : 1 or more."""
    return "#000000" if luminance(colour) > 0.18 else "#ffffff"


class Pen:
    """Draws on one picture."""

    def __init__(self, image: Image.Image, scale: int) -> None:
        """Args: the picture; its pixels for each pixel of the page."""
        self._image, self._scale = image, scale
        self.draw = ImageDraw.Draw(image, "RGBA")

    def _at(self, point: Point) -> Point:
        return self._scale * point[0], self._scale * point[1]

    def line(self, points: list[Point], colour: Colour, width: float) -> None:
        """A line through points."""
        self.draw.line([self._at(p) for p in points], fill=colour, width=round(self._scale * width), joint="curve")

    def dashes(self, start: Point, end: Point, colour: Colour, width: float) -> None:
        """A dashed line."""
        length = math.dist(start, end)
        for i in range(math.ceil(length / 10.0)):
            a, b = (min(step / length, 1.0) for step in (10.0 * i, 10.0 * i + 6.0))
            ends = [(start[0] + t * (end[0] - start[0]), start[1] + t * (end[1] - start[1])) for t in (a, b)]
            self.line(ends, colour, width)

    def ring(self, at: Point, radius: float, colour: Colour, edge: Colour) -> None:
        """A ring with a dot."""
        for width, paint in ((5, edge), (3, colour)):
            reach = radius + 0.5 * width
            self.oval((at[0] - reach, at[1] - reach, at[0] + reach, at[1] + reach), paint, width)
        self.draw.ellipse([self._scale * v for v in (at[0] - 2, at[1] - 2, at[0] + 2, at[1] + 2)], fill=colour)

    def oval(self, box: tuple[float, float, float, float], colour: Colour, width: float = 2) -> None:
        """The outline of an ellipse."""
        self.draw.ellipse([self._scale * v for v in box], outline=colour, width=round(self._scale * width))

    def cross(self, at: Point, colour: Colour, edge: Colour) -> None:
        """An upright cross."""
        x, y = at
        for width, reach, paint in ((5, 8, edge), (2.5, 7, colour)):
            self.line([(x - reach, y), (x + reach, y)], paint, width)
            self.line([(x, y - reach), (x, y + reach)], paint, width)

    def badge(self, at: Point, name: str, colour: Colour, edge: Colour) -> None:
        """A filled disc with a letter."""
        box = [self._scale * v for v in (at[0] - 8, at[1] - 8, at[0] + 8, at[1] + 8)]
        self.draw.ellipse(box, fill=colour, outline=edge, width=round(1.5 * self._scale))
        self.text(at, name[:1], ink_on(colour), 11, "mm")

    def disc(self, at: Point, radius: float, fill: Colour, edge: Colour) -> None:
        """A filled disc."""
        box = [self._scale * v for v in (at[0] - radius, at[1] - radius, at[0] + radius, at[1] + radius)]
        self.draw.ellipse(box, fill=fill, outline=edge, width=self._scale)

    def polygon(self, corners: list[Point], fill: Colour) -> None:
        """A filled polygon."""
        self.draw.polygon([self._at(corner) for corner in corners], fill=fill)

    def box(self, box: tuple[float, float, float, float], fill: Colour, edge: Colour) -> None:
        """A rounded box."""
        self.draw.rounded_rectangle(
            [self._scale * v for v in box], radius=5 * self._scale, fill=fill, outline=edge, width=self._scale
        )

    def outline(self, box: tuple[float, float, float, float], colour: Colour) -> None:
        """A plain box around something."""
        self.draw.rectangle([self._scale * v for v in box], outline=colour, width=self._scale)

    def paste(self, image: Image.Image, at: Point) -> None:
        """Another picture, of the same resolution."""
        x, y = self._at(at)
        self._image.paste(image, (round(x), round(y)))

    def width(self, text: str, size: float) -> float:
        """How wide a text will be, pixels of the page."""
        plain = printable(text)
        parts = plain.split("²")
        raised = (len(parts) - 1) * font(round(RAISED * size * self._scale)).getlength("2")
        return (sum(font(round(size * self._scale)).getlength(part) for part in parts) + raised) / self._scale

    def text(self, at: Point, text: str, colour: Colour, size: float, anchor: str = "lm") -> None:
        """A line of text; the anchor as Pillow has it, l m r and a m s."""
        face, small = font(round(size * self._scale)), font(round(RAISED * size * self._scale))
        x, y = self._at(at)
        x -= {"l": 0.0, "m": 0.5, "r": 1.0}[anchor[0]] * self._scale * self.width(text, size)
        for i, part in enumerate(printable(text).split("²")):
            if i:
                up = 0.38 * size * self._scale
                self.draw.text((x, y - up), "2", fill=colour, font=small, anchor="l" + anchor[1])
                x += small.getlength("2")
            self.draw.text((x, y), part, fill=colour, font=face, anchor="l" + anchor[1])
            x += face.getlength(part)

    def upright(self, at: Point, text: str, colour: Colour, size: float) -> None:
        """Text that reads upwards, its middle at a point."""
        wide, high = round(self._scale * self.width(text, size)) + 4, round(self._scale * size * 1.8)
        layer = Image.new("RGBA", (wide, high), (0, 0, 0, 0))
        Pen(layer, self._scale).text((0.5 * wide / self._scale, 0.5 * high / self._scale), text, colour, size, "mm")
        turned = layer.transpose(Image.Transpose.ROTATE_90)
        x, y = self._at(at)
        self._image.paste(turned, (round(x - 0.5 * turned.width), round(y - 0.5 * turned.height)), turned)

    def paragraph(self, at: Point, text: str, colour: Colour, size: float, width: float) -> float:
        """Text in lines not wider than `width`; returns where it ends."""
        line, y = "", at[1]
        for word in (*text.split(), ""):
            longer = f"{line} {word}".strip()
            if not word or self.width(longer, size) > width:
                self.text((at[0], y), line, colour, size, "lm")
                line, y = word, y + 1.45 * size
            else:
                line = longer
        return y


# The signal as a picture behind the sheet of a phone, where viser shows no chart beside the controls.


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
