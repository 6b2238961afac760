"""Drawing and writing with Pillow in pixels of the page, whatever the resolution of the picture. Pure."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

from PIL import Image, ImageDraw, ImageFont

from kalscope_app.studies.map_geometry import Point

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
