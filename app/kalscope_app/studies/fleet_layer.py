"""The devices of a fleet on the tuning map: a density, the outliers as points, the filter for all. Pure: numpy.

Exponents are log₁₀ of q and r in unit².
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from kalscope.common.array import Array, Indices, Mask
from kalscope.common.text import count, one_line, trimmed
from kalscope_app.session.fleet import OpenFleet, loss_text
from kalscope_app.studies.map_geometry import MapFrame, Point, Range

if TYPE_CHECKING:
    from kalscope.fleet.results import Fleet

MAX_POINTS = 1000
"""Devices drawn as points, at most; of a larger fleet the outliers are, and all of it is a density."""
CELLS = (142, 213)
"""Cells of the density along q and r, each about two pixels of the page wide."""
LOSSES = (0.1, 0.3)
"""Growth of the prediction error at which the colour of a device changes."""
LOSS_WORDS = ("loses less than 10 %", "10 to 30 %", "above 30 %", "not judged")
"""What the colours mean."""
MAX_VERDICTS = 3
"""Verdicts with a colour of their own."""
MAX_NAME = 36
"""Characters of the name of a device that was clicked."""
REACH = 8.0
"""Pixels of the picture from which a click takes the nearest point."""


@dataclass(frozen=True)
class Picked:
    """A device that was clicked."""

    device: int
    """Its row."""
    point: Point
    """Its exponents (q, r), clamped to the map."""
    words: tuple[str, ...]
    """The text about it, line by line."""


@dataclass(frozen=True, eq=False)
class FleetLayer:
    """What is drawn of a fleet."""

    fleet: Fleet
    """Whose devices they are."""
    density: Array | None
    """Share of colour in each cell, 0 = no device … 1, shape (rows, columns), row 0 at the lowest r; None where
    every device is a point."""
    devices: Indices
    """The rows of the points, shape (k,); the most remarkable one last."""
    points: Array
    """Their exponents (q, r), clamped to the map, shape (k, 2)."""
    classes: Indices
    """Which of `words` each belongs to, shape (k,)."""
    words: tuple[str, ...]
    """What the classes are, each with how many devices of the fleet are in it; "" for one without any."""
    shared: Point | None
    """The filter for all; None where there is none."""
    ratio_ends: tuple[float, float] | None
    """log₁₀ of the q/r that the fleet allows, 95 %; None where it is not known."""
    picked: Picked | None = None
    """The device that was clicked."""

    @property
    def unit(self) -> str:
        """The unit of most devices."""
        return self.fleet.devices.unit

    def nearest(self, frame: MapFrame, pixel: Point) -> int | None:
        """The row whose point is nearest to a pixel of the picture; None where no point is near."""
        if not len(self.points):
            return None
        across = (self.points[:, 0] - frame.q[0]) / (frame.q[1] - frame.q[0])
        up = (self.points[:, 1] - frame.r[0]) / (frame.r[1] - frame.r[0])
        x, y = frame.left + across * (frame.right - frame.left), frame.bottom - up * (frame.bottom - frame.top)
        away = np.hypot(x - pixel[0], y - pixel[1])[::-1]  # of two at the same place, the one on top
        at = int(np.argmin(away))
        return int(self.devices[len(away) - 1 - at]) if away[at] <= REACH else None


def fleet_layer(open_fleet: OpenFleet, q: Range, r: Range) -> FleetLayer:
    """The layer of a fleet.

    Args:
        open_fleet: The fleet and how it is coloured.
        q: Exponents of q at the left and the right edge of the map.
        r: Exponents of r at its bottom and its top.
    """
    fleet = open_fleet.fleet
    usable = np.flatnonzero(fleet.devices.usable)
    logs = np.stack([np.log10(values[usable]) for values in (fleet.devices.q, fleet.devices.r)], axis=1)
    logs = np.clip(logs, (q[0], r[0]), (q[1], r[1]))
    classes, words = _by_loss(fleet, usable) if open_fleet.colour == "loss" else _by_verdict(fleet, usable)
    chosen = _points(fleet, usable)
    few = len(chosen) == len(usable)
    shared = fleet.shared
    ends = None if shared is None else shared.ratio_interval
    known = ends is not None and 0.0 < ends[0] <= ends[1] < math.inf
    return FleetLayer(
        fleet=fleet,
        density=None if few else _density(logs, q, r),
        devices=usable[chosen],
        points=logs[chosen],
        classes=classes[chosen],
        words=words,
        shared=None if shared is None else (_exponent(shared.params.q), _exponent(shared.params.r)),
        ratio_ends=(math.log10(ends[0]), math.log10(ends[1])) if known and ends is not None else None,
        picked=_picked(fleet, open_fleet.picked, q, r),
    )


def _picked(fleet: Fleet, device: int | None, q: Range, r: Range) -> Picked | None:
    """The device that was clicked, and the text about it."""
    devices = fleet.devices
    if device is None or not devices.usable[device]:
        return None
    pair, growth = (float(devices.q[device]), float(devices.r[device])), float(fleet.growth[device])
    loss = "" if math.isnan(growth) else f", loss {loss_text(growth)}"
    name = one_line(devices.name(device))
    words = (
        name if len(name) <= MAX_NAME else f"…{name[1 - MAX_NAME :]}",
        f"q {trimmed(pair[0])}, r {trimmed(pair[1])}{loss}",
        "click it again to open it",
    )
    x, y = (math.log10(value) for value in pair)
    return Picked(device, (min(max(x, q[0]), q[1]), min(max(y, r[0]), r[1])), words)


def _exponent(value: object) -> float:
    return math.log10(float(value))  # pyright: ignore[reportArgumentType]


def _points(fleet: Fleet, usable: Indices) -> Indices:
    """Which of the devices with q and r are points, the most remarkable last."""
    distance, growth = (np.nan_to_num(one[usable], posinf=1e9) for one in (fleet.distance, fleet.growth))
    by_distance = np.argsort(distance, kind="stable")
    if len(usable) <= MAX_POINTS:
        return by_distance
    odd: Mask = fleet.outlier[usable] | (growth > LOSSES[0])
    half = MAX_POINTS // 2
    wanted = np.zeros(len(usable), dtype=bool)
    for order in (by_distance, np.argsort(growth, kind="stable")):
        wanted[order[odd[order]][-half:]] = True
    return by_distance[wanted[by_distance]]


def _by_loss(fleet: Fleet, usable: Indices) -> tuple[Indices, tuple[str, ...]]:
    growth = fleet.growth[usable]
    classes = np.where(np.isnan(growth), len(LOSSES) + 1, np.searchsorted(LOSSES, growth, side="left"))
    return classes, _counted(LOSS_WORDS, classes)


def _by_verdict(fleet: Fleet, usable: Indices) -> tuple[Indices, tuple[str, ...]]:
    rows: list[int] = usable.tolist()
    verdicts = [fleet.verdicts[i] for i in rows]
    common = [verdict for verdict, _ in Counter(verdicts).most_common(MAX_VERDICTS)]
    places = {verdict: place for place, verdict in enumerate(common)}
    classes = np.array([places.get(verdict, MAX_VERDICTS) for verdict in verdicts], dtype=np.intp)
    words = [verdict.replace("_", " ")[:20] for verdict in common]
    return classes, _counted((*words, *("",) * (MAX_VERDICTS - len(words)), "others"), classes)


def _counted(words: tuple[str, ...], classes: Indices) -> tuple[str, ...]:
    sizes = np.bincount(classes, minlength=len(words)).tolist()
    return tuple(f"{word}: {count(size)}" if size else "" for word, size in zip(words, sizes, strict=True))


def _density(logs: Array, q: Range, r: Range) -> Array:
    """Devices in each cell, by their logarithm, as shares of the fullest one."""
    columns, rows = CELLS
    across = np.clip(((logs[:, 0] - q[0]) / (q[1] - q[0]) * columns).astype(int), 0, columns - 1)
    up = np.clip(((logs[:, 1] - r[0]) / (r[1] - r[0]) * rows).astype(int), 0, rows - 1)
    devices = np.bincount(up * columns + across, minlength=rows * columns).reshape(rows, columns)
    return np.log1p(devices) / np.log1p(devices.max())
