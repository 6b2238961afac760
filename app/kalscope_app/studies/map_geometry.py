"""Where things lie on the tuning map: the sizes of its picture, pixels ⇄ (q, r), lines of equal lag. Pure.

Pixels are counted from the top left of the picture. Exponents are log₁₀ of q and r in unit².
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from kalscope.filtering.params import FilterParams
from kalscope.filtering.steady_state import ratio_for, steady_state

Point = tuple[float, float]
Range = tuple[int, int]

NO_FILTERING = 0.7
"""Samples of lag under which lines of equal lag are not drawn: there is nothing left to choose."""


MAX_DECADES = 12
"""Decades of lag up to which each has lines of its own."""


@dataclass(frozen=True)
class MapFrame:
    """The rectangle of the map inside its picture, pixels, and what its edges mean."""

    width: float
    """Width of the picture."""
    height: float
    """Height of the picture."""
    left: float
    top: float
    right: float
    bottom: float
    q: Range
    """Exponents of q at the left and the right edge."""
    r: Range
    """Exponents of r at the bottom and the top edge."""
    momentum: float = 0.0
    """Momentum of every filter on the map, samples."""

    def pixel(self, point: Point) -> Point:
        """Where a pair of exponents (q, r) lies, also outside the rectangle; infinite ones far outside."""
        across, up = ((min(max(e, -999.0), 999.0) - a) / (b - a) for e, (a, b) in zip(point, (self.q, self.r)))  # noqa: B905
        return self.left + across * (self.right - self.left), self.bottom - up * (self.bottom - self.top)

    def point(self, pixel: Point) -> Point:
        """Exponents (q, r) at a pixel."""
        across = (pixel[0] - self.left) / (self.right - self.left)
        up = (self.bottom - pixel[1]) / (self.bottom - self.top)
        return self.q[0] + across * (self.q[1] - self.q[0]), self.r[0] + up * (self.r[1] - self.r[0])

    def held(self, point: Point) -> Point:
        """The nearest exponents inside the rectangle."""
        q, r = point
        return min(max(q, self.q[0]), self.q[1]), min(max(r, self.r[0]), self.r[1])

    def inside(self, pixel: Point) -> bool:
        """Whether a pixel lies in the rectangle or on its edge."""
        return self.left <= pixel[0] <= self.right and self.top <= pixel[1] <= self.bottom


def frame_for(width: float, height: float, q: Range, r: Range, momentum: float = 0.0) -> MapFrame:
    """The map in a picture: space for names and numbers around it and for the legend below."""
    left, right, top = 62.0, width - 54.0, 88.0
    bottom = min(height - LEGEND_HEIGHT, top + 1.5 * (right - left))
    return MapFrame(width, height, left, top, max(right, left + 50.0), max(bottom, top + 50.0), q, r, momentum)


LEGEND_HEIGHT = 258.0
"""Pixels under the map: numbers, name of the axis, colour bar, legend, a sentence."""


@dataclass(frozen=True)
class Diagonal:
    """A line q/r = const across the map."""

    start: Point
    """Pixel where it enters, at the left or the bottom edge."""
    end: Point
    """Pixel where it leaves, at the top or the right edge."""
    lag: float
    """Lag on a ramp, samples."""


def diagonal(frame: MapFrame, ratio: float) -> Diagonal | None:
    """The line q/r = `ratio` > 0 inside the rectangle; None if it misses it."""
    shift = math.log10(ratio)  # log q − log r
    first, last = max(frame.q[0], frame.r[0] + shift), min(frame.q[1], frame.r[1] + shift)
    if first >= last:
        return None
    start, end = (frame.pixel((q, q - shift)) for q in (first, last))
    params = FilterParams(q=ratio, r=1.0, momentum=frame.momentum)
    return Diagonal(start, end, steady_state(params).lag_samples)


def lag_lines(frame: MapFrame, sample: float) -> list[Diagonal]:
    """Lines of equal lag at 1, 3, 10, 30 … units, those that cross the map; `sample`: units in one sample.

    A map of very many decades has fewer of them: 1, 1000, 1e6 …
    """
    lowest = math.floor(math.log10(NO_FILTERING * sample))
    highest = math.ceil(0.5 * (frame.r[1] - frame.q[0]) + math.log10(sample))
    step = max(1, math.ceil((highest - lowest) / MAX_DECADES))
    lines: list[Diagonal] = []
    for decade in range(lowest, highest + 1, step):
        for lead in (1.0, 3.0) if step == 1 else (1.0,):
            lag = lead * 10.0**decade / sample
            ratio = ratio_for(lag_samples=lag, momentum=frame.momentum) if lag >= NO_FILTERING else 0.0
            line = diagonal(frame, ratio) if ratio > 0.0 else None
            if line is not None:
                lines.append(line)
    return lines


def decades(low: int, high: int, most: int = 9) -> list[int]:
    """Exponents to write along an axis, at most `most` of them."""
    step = max(1, math.ceil((high - low + 1) / most))
    return [e for e in range(low, high + 1) if e % step == 0]
