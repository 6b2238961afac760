"""State -> TuningMap: how well every pair (q, r) does on the channel on screen, and where things lie on the map."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from kalscope.common.numbers import Array, Indices
from kalscope.common.text import count
from kalscope.estimation.fit import estimate
from kalscope.estimation.likelihood import Profile, likelihood_contour, loglik_map
from kalscope.estimation.momentum import likelihood_profile
from kalscope.estimation.result import Estimate
from kalscope.filtering.steady import ratio_for
from kalscope_app.engine.filter_runs import Cache
from kalscope_app.session.changes import exponents_around
from kalscope_app.session.state import OpenFleet, State

if TYPE_CHECKING:
    from kalscope.fleet.results import Fleet


# Where things lie on the tuning map: the sizes of its picture, pixels ⇄ (q, r), lines of equal lag. Pure.
#
# Pixels are counted from the top left of the picture. Exponents are log₁₀ of q and r in unit².


Point = tuple[float, float]
Range = tuple[int, int]

NO_FILTERING = 0.7
"""Samples of lag under which lines of equal lag are not drawn: there is nothing left to choose."""


MAX_DECADES = 12
"""Decades of lag up to which each has lines of its own."""


@dataclass(frozen=True)
class MapFrame:
    """The rectangle of the map inside its picture, pixels, and what its edges mean."""

    q: Range
    """Exponents of q at the left and the right edge."""
    r: Range
    """Exponents of r at the bottom and the top edge."""
    momentum: float = 0.0
    """Momentum of every filter on the map, samples."""

    width, height = 400.0, 800.0
    """Of the picture, px. Each browser fits it into the space between its panels."""
    left, top, right, bottom = 62.0, 56.0, 346.0, 482.0
    """Edges of the map; names and numbers are around it, the legend below."""

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


def lag_lines(frame: MapFrame, sample: float) -> list[tuple[float, Point]]:
    """Lags in samples of 1, 3, 10, 30 … units whose line q/r crosses the map, and the exponents where it leaves.

    A map of very many decades has fewer of them: 1, 1000, 1e6 … `sample` is a sample's length in units.
    """
    lowest = math.floor(math.log10(NO_FILTERING * sample))
    highest = math.ceil(0.5 * (frame.r[1] - frame.q[0]) + math.log10(sample))
    step = max(1, math.ceil((highest - lowest) / MAX_DECADES))
    lines: list[tuple[float, Point]] = []
    for decade in range(lowest, highest + 1, step):
        for lead in (1.0, 3.0) if step == 1 else (1.0,):
            lag = lead * 10.0**decade / sample
            ratio = ratio_for(lag_samples=lag, momentum=frame.momentum) if lag >= NO_FILTERING else 0.0
            shift = math.log10(ratio) if ratio > 0.0 else math.inf  # log q − log r
            end = min(frame.q[1], frame.r[1] + shift)
            if max(frame.q[0], frame.r[0] + shift) < end:
                lines.append((lag, (end, end - shift)))
    return lines


def decades(low: int, high: int, most: int = 9) -> list[int]:
    """Exponents to write along an axis, at most `most` of them."""
    step = max(1, math.ceil((high - low + 1) / most))
    return [e for e in range(low, high + 1) if e % step == 0]


# The devices of a fleet on the tuning map, and the filter for all. Pure: numpy.
#
# Exponents are log₁₀ of q and r in unit².


LOSSES = (0.1, 0.3)
"""Growth of the prediction error at which the colour of a device changes."""
LOSS_WORDS = ("loses less than 10 %", "10 to 30 %", "above 30 %", "too short to tell")
"""What the colours mean."""
REACH = 8.0
"""Pixels of the picture from which a click takes the nearest point."""


@dataclass(frozen=True, eq=False)
class FleetLayer:
    """What is drawn of a fleet."""

    fleet: Fleet
    """Whose devices they are."""
    devices: Indices
    """The rows of those with q and r, shape (k,); the most remarkable one last."""
    points: Array
    """Their exponents (q, r), clamped to the map, shape (k, 2)."""
    classes: Indices
    """Which of `words` each belongs to, shape (k,)."""
    words: tuple[str, ...]
    """What the classes are, each with how many devices are in it; "" for one without any."""
    shared: Point | None
    """The filter for all; None where there is none."""
    ratio_ends: tuple[float, float] | None
    """log₁₀ of the q/r that the fleet allows, 95 %; None where it is not known."""

    def nearest(self, frame: MapFrame, pixel: Point) -> int | None:
        """The row whose point is nearest to a pixel of the picture; None where no point is near."""
        if not len(self.points):
            return None
        across = (frame.right - frame.left) / (frame.q[1] - frame.q[0])
        up = (frame.bottom - frame.top) / (frame.r[1] - frame.r[0])
        away = np.hypot(*((self.points - frame.point(pixel)) * (across, up)).T)[::-1]  # first those on top
        at = int(np.argmin(away))
        return int(self.devices[::-1][at]) if away[at] <= REACH else None


def fleet_layer(open_fleet: OpenFleet, q: Range, r: Range) -> FleetLayer:
    """The layer of a fleet.

    Args:
        open_fleet: The fleet and how it is coloured.
        q: Exponents of q at the left and the right edge of the map.
        r: Exponents of r at its bottom and its top.
    """
    fleet = open_fleet.fleet
    usable = np.flatnonzero(fleet.devices.usable)
    usable = usable[np.argsort(np.nan_to_num(fleet.distance[usable], posinf=1e9), kind="stable")]
    logs = np.stack([np.log10(values[usable]) for values in (fleet.devices.q, fleet.devices.r)], axis=1)
    growth = fleet.growth[usable]
    classes = np.where(np.isnan(growth), len(LOSSES) + 1, np.searchsorted(LOSSES, growth, side="left"))
    sizes = np.bincount(classes, minlength=len(LOSS_WORDS)).tolist()
    shared = fleet.shared
    low, high = (0.0, 0.0) if shared is None else shared.ratio_interval
    return FleetLayer(
        fleet=fleet,
        devices=usable,
        points=np.clip(logs, (q[0], r[0]), (q[1], r[1])),
        classes=classes,
        words=tuple(f"{word}: {count(size)}" if size else "" for word, size in zip(LOSS_WORDS, sizes, strict=True)),
        shared=None if shared is None else exponents_of(shared.params.q, float(shared.params.r)),
        ratio_ends=(math.log10(low), math.log10(high)) if 0.0 < low <= high < math.inf else None,
    )


# State -> TuningMap: how well every pair (q, r) does on the channel on screen. No viser here.
#
# With the automatic start one scan of the recording over λ = q/r gives the log-likelihood of every pair, and the
# filtered signal, so also its error against a known truth, depends on λ alone. What a scan gave is kept: moving q,
# r or the window costs nothing.


TUNING_MAP_CELLS = 200
"""Cells along each side of the map."""

TUNING_MAP_REACH = (-6, 2), (-4, 2)
"""Decades of q and of r around the starting r of the channel that the map shows at least."""


LN10 = math.log(10.0)


@dataclass(frozen=True)
class Scan:
    """What a recording says about every pair (q, r) at one momentum, whatever the map's colours and range."""

    best: Estimate
    """Maximum likelihood."""
    profile: Profile | None
    """The likelihood over λ; None where there is none to draw."""
    contour: Array | None
    """Exponents (q, r) around the 95 % region, shape (k, 2)."""
    momentum: float = 0.0
    """Momentum of every pair, samples."""


@dataclass(frozen=True, eq=False)
class TuningMap:
    """What is drawn in the middle of the screen; compared by identity."""

    frame: MapFrame
    """Where it lies in its picture, and what its edges mean."""
    values: Array
    """Log-likelihood at the centres of the cells, shape (CELLS, CELLS), row 0 at the lowest r."""
    shade: Array
    """The same as a shade, 0 = worst … 1 = best."""
    marks: tuple[tuple[float, float], ...]
    """(shade, how far below the best) to write at the colour bar; none where only `note` is drawn."""
    optimum: Point | None
    """Exponents of the most likely pair, −inf where q or r is 0; None where the record has no information."""
    contour: Array | None
    """Exponents (q, r) around the 95 % region, shape (k, 2)."""
    note: str
    """What the map does not take into account, or why there is none."""
    fleet: FleetLayer | None = None
    """The devices of an open fleet."""


def compute_map(state: State, kept: Cache[Any]) -> TuningMap:
    """The map of a state; `kept` has the last one, and all that a move of q, r or the window does not change."""
    if not state.has_one_speed:
        fused = "The tuning map is for one channel: choose one above the tabs."
        other = "The tuning map is that of one Kalman filter alone: another filter runs now."
        return nothing(other if state.fusion is None else fused)
    kept.begin(state.recording, state.channel, state.tuning.momentum)
    scan = kept.get(None, lambda: scan_recording(state))
    frame, note, fleet = frame_of(state, scan), note_of(state, scan), state.fleet

    def draw() -> TuningMap:
        drawn = draw_map(scan, frame, note)
        return drawn if fleet is None else replace(drawn, fleet=fleet_layer(fleet, frame.q, frame.r))

    return kept.get((frame, note, fleet), draw)


def nothing(why: str) -> TuningMap:
    """A map with only a sentence on it."""
    empty = np.zeros((1, 1))
    return TuningMap(MapFrame((-1, 1), (-1, 1)), empty, empty, (), None, None, why)


def scan_recording(state: State) -> Scan:
    """One scan of the channel on screen: the best pair, the likelihood over λ, the 95 % region."""
    z, dt, momentum = state.z, state.dt, state.tuning.momentum
    best = estimate(z, dt=dt, momentum=momentum)
    if best.verdict == "too_many_outliers":
        best = estimate(z, dt=dt, momentum=momentum, robust=False)
    if best.outliers is not None:
        z = np.where(best.outliers, np.nan, z)  # the map is that of the fit, which did not see them either
    if best.verdict in ("too_few", "constant", "bad_unit"):
        return Scan(best, None, None)
    scan = partial(likelihood_profile, momentum=momentum)
    around = likelihood_contour(z, best, scan, dt)
    line = None if around is None else np.stack([around.log_q, around.log_r], axis=1) / LN10
    return Scan(best, scan(z, dt=dt), line, momentum)


def frame_of(state: State, scan: Scan) -> MapFrame:
    """Exponents at the edges: around the signal's own noise, wider for the present, best and pinned pairs."""
    pairs = [(state.tuning.q, state.tuning.r), (float(scan.best.q), float(scan.best.r))]
    pairs += [(v.tuning.q, v.tuning.r) for v in state.variants]
    pairs += () if state.fleet is None else state.fleet.corners
    # A point that was dragged to the edge is rounded there and must not widen the map.
    each = zip(TUNING_MAP_REACH, zip(*pairs, strict=True), strict=True)
    q, r = (exponents_around(state.start.r, ends, values, slack=0.01) for ends, values in each)
    return MapFrame(q, r, scan.momentum)


def exponents_of(q: float, r: float) -> Point:
    """log₁₀ of a pair; −inf for 0."""
    return math.log10(q) if q > 0.0 else -math.inf, math.log10(r) if r > 0.0 else -math.inf


def note_of(state: State, scan: Scan) -> str:
    """What the map does not take into account, in sentences; "" if nothing."""
    tuning, aside = state.tuning, scan.best.outliers
    values = {"start value": tuning.x0, "initial variance p0": tuning.p0, "outlier gate": tuning.gate}
    left_out = [words for words, value in values.items() if value is not None]
    elsewhere = [one.name for one in state.variants if one.tuning.momentum != tuning.momentum]
    notes = (
        left_out and f"Drawn without {' and '.join(left_out)}.",
        elsewhere and f"This map does not apply to {', '.join(elsewhere)}: pinned at another momentum.",
        aside is not None and aside.any() and f"Spikes ({count(int(aside.sum()))}) count as missing.",
    )
    return " ".join(note for note in notes if isinstance(note, str))


def cell_exponents(ends: Range) -> Array:
    """Exponents at the centres of the cells along one side, shape (CELLS,)."""
    low, high = ends
    return low + (np.arange(TUNING_MAP_CELLS) + 0.5) * (high - low) / TUNING_MAP_CELLS


def draw_map(scan: Scan, frame: MapFrame, note: str) -> TuningMap:
    """Fill the cells."""
    if scan.profile is None:
        return nothing(str(scan.best.message))
    values = loglik_map(scan.profile, LN10 * cell_exponents(frame.q), LN10 * cell_exponents(frame.r))
    shade, marks = shade_of_loglik(values, float(scan.best.loglik))
    best = exponents_of(float(scan.best.q), float(scan.best.r))
    return TuningMap(frame, values, shade, marks, best, scan.contour, note)


def shade_of_loglik(values: Array, best: float) -> tuple[Array, tuple[tuple[float, float], ...]]:
    """Shades by the logarithm of the distance from the best, so that near and far both have structure."""
    short = np.maximum(best - np.nan_to_num(values, nan=-math.inf), 0.0)
    reach = float(np.quantile(short[np.isfinite(short)], 0.9)) if np.isfinite(short).any() else 1.0
    depth = math.log1p(max(reach, 30.0) / 3.0)
    marks = [(1.0 - math.log1p(drop / 3.0) / depth, drop) for drop in (0.0, *(3.0 * 10.0**k for k in range(12)))]
    return 1.0 - np.clip(np.log1p(short / 3.0) / depth, 0.0, 1.0), tuple(m for m in marks if m[0] >= 0.0)
