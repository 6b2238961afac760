"""State -> TuningMap: how well every pair (q, r) does on the channel on screen. No viser here.

With the automatic start one scan of the recording over λ = q/r gives the log-likelihood of every pair, and the
filtered signal, so also its error against a known truth, depends on λ alone. What a scan gave is kept: moving q, r
or the window costs nothing.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from kalscope.common.array import Array
from kalscope.common.text import count
from kalscope.estimation.estimate import estimate
from kalscope.estimation.likelihood.contour import likelihood_contour
from kalscope.estimation.likelihood.profile import Profile, loglik_map
from kalscope.estimation.momentum.profile import likelihood_profile
from kalscope.estimation.result import Estimate
from kalscope.filtering.filter import denoise
from kalscope.filtering.params import FilterParams
from kalscope.filtering.steady_state import steady_state
from kalscope.tuning.tuning import ChannelTuning
from kalscope_app.engine.cache import Cache
from kalscope_app.session.state import State
from kalscope_app.studies.fleet_layer import FleetLayer, fleet_layer
from kalscope_app.studies.map_geometry import Point, Range

CELLS = 200
"""Cells along each side of the map."""

REACH = {"q": (-6, 2), "r": (-4, 2)}
"""Decades around the starting r of the channel that the map shows at least."""

LOG_RATIOS = np.linspace(-24.0, 24.0, 65)
"""ln λ at which the error against the truth is computed; between them it is as smooth as the filter is."""

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


@dataclass(frozen=True)
class Errors:
    """Error against the truth over λ."""

    rmse: Array
    """Root mean square error of the filtered signal for each ln λ of LOG_RATIOS, unit, shape (65,)."""
    raw: float
    """The same of the measurements themselves."""


@dataclass(frozen=True)
class TuningMap:
    """What is drawn in the middle of the screen."""

    colour: str
    """One of MAP_COLOURS; "" where there is nothing to draw but `note`."""
    q: Range
    """Exponents of q at the left and the right edge."""
    r: Range
    """Exponents of r at the bottom and the top edge."""
    values: Array
    """What is coloured, shape (CELLS, CELLS), row 0 at the lowest r, at the centres of the cells: log-likelihood,
    RMSE in the unit of the signal, or lag in samples."""
    shade: Array
    """The same as a shade, 0 = worst … 1 = best."""
    marks: tuple[tuple[float, float], ...]
    """(shade, value) to write at the colour bar; for the likelihood the value is how far below the best."""
    optimum: Point | None
    """Exponents of the most likely pair, −inf where q or r is 0; None where the record has no information."""
    contour: Array | None
    """Exponents (q, r) around the 95 % region, shape (k, 2)."""
    note: str
    """What the map does not take into account, or why there is none."""
    momentum: float = 0.0
    """Momentum of every filter on it, samples."""
    fleet: FleetLayer | None = None
    """The devices of an open fleet."""


class MapMaker:
    """Computes the map of a state and keeps what it can for the next. One thread at a time."""

    def __init__(self) -> None:
        self._scans, self._errors, self._maps = Cache[Scan](), Cache[Errors](), Cache[TuningMap]()

    def __call__(self, state: State) -> TuningMap:
        """The map of a state; the same object while nothing of it has changed."""
        if not state.is_standard:
            fused = "The tuning map is for one channel: choose one above the tabs."
            other = "The tuning map is that of the Kalman filter alone: another filter runs now."
            return nothing(other if state.fusion is None else fused)
        signal = state.recording, state.channel, state.tuning.momentum
        scan = self._scans.once(lambda: scan_recording(state), *signal)
        colour = state.view.map_colour
        if colour == "RMSE" and state.recording.truth is None:
            colour = "likelihood"
        errors = self._errors.once(lambda: errors_over_ratio(state), *signal) if colour == "RMSE" else None
        q, r = map_ranges(state, scan)
        note = " ".join(filter(None, (limits_of(state), spikes_left_out(scan))))
        fleet = state.fleet

        def draw() -> TuningMap:
            drawn = draw_map(scan, errors, colour, q, r, note)
            return drawn if fleet is None else replace(drawn, fleet=fleet_layer(fleet, q, r))

        return self._maps.once(draw, scan, colour, q, r, note, fleet)


def nothing(why: str) -> TuningMap:
    """A map with only a sentence on it."""
    empty = np.zeros((1, 1))
    return TuningMap("", (-1, 1), (-1, 1), empty, empty, (), None, None, why)


def scan_recording(state: State) -> Scan:
    """One scan of the channel on screen: the best pair, the likelihood over λ, the 95 % region."""
    z, dt, momentum = state.z, state.dt, state.tuning.momentum
    best = estimate(z, "ml", dt=dt, momentum=momentum)
    if best.verdict == "too_many_outliers":
        best = estimate(z, "ml", dt=dt, momentum=momentum, robust=False)
    if best.outliers is not None:
        z = np.where(best.outliers, np.nan, z)  # the map is that of the fit, which did not see them either
    if best.verdict in ("too_few", "constant", "bad_unit"):
        return Scan(best, None, None)
    scan = partial(likelihood_profile, momentum=momentum)
    around = likelihood_contour(z, best, dt, scan=scan)
    line = None if around is None else np.stack([around.log_q, around.log_r], axis=1) / LN10
    return Scan(best, scan(z, dt=dt), line, momentum)


def errors_over_ratio(state: State) -> Errors:
    """Error against the truth for every λ of LOG_RATIOS: one run of the filter each, automatic start."""
    column = state.index
    z, dt = state.recording.values[:, column], state.dt
    truth = np.full(len(z), np.nan) if state.recording.truth is None else state.recording.truth[:, column]
    out = np.empty(len(z))
    rmse: list[float] = []
    for log_ratio in LOG_RATIOS:
        params = FilterParams(q=math.exp(log_ratio), r=1.0, momentum=state.tuning.momentum)
        denoise(z, params, dt, out=out)
        rmse.append(rms(np.subtract(out, truth, out=out)))
    return Errors(np.array(rmse), rms(z - truth))


def rms(error: Array) -> float:
    """Root mean square of what is not missing; NaN if all is."""
    with np.errstate(over="ignore"):
        total = float(np.einsum("i,i->", error, error))
    if 1e-250 < total < 1e300:  # nothing missing, no overflow or underflow: the fast path
        return math.sqrt(total / len(error))
    seen = error[np.isfinite(error)]
    if len(seen) == 0:
        return math.nan
    largest = float(np.abs(seen).max()) or 1.0  # squares of 1e-200 would underflow
    return largest * math.sqrt(float(np.mean((seen / largest) ** 2)))


def map_ranges(state: State, scan: Scan) -> tuple[Range, Range]:
    """Exponents at the edges: around the signal's own noise, wider for the present, best and pinned pairs."""
    centre = round(math.log10(state.start.r)) if state.start.r > 0.0 else 0
    pairs = [(state.tuning.q, state.tuning.r), (float(scan.best.q), float(scan.best.r))]
    pairs += [(v.tuning.q, v.tuning.r) for v in state.variants]
    pairs += () if state.fleet is None else state.fleet.corners

    def reach(name: str, values: list[float]) -> Range:
        low, high = (centre + end for end in REACH[name])
        for exponent in (math.log10(value) for value in values if value > 0.0):
            # A point that was dragged to the edge is rounded there and must not widen the map.
            low, high = min(low, math.floor(exponent + 0.01)), max(high, math.ceil(exponent - 0.01))
        return max(low, -300), min(high, 300)

    q, r = zip(*pairs, strict=True)
    return reach("q", list(q)), reach("r", list(r))


def exponents_of(state: State, tuning: ChannelTuning | None = None) -> Point:
    """log₁₀ of the present q and r, or of another pair; −inf for 0."""
    of = tuning or state.tuning
    return tuple(math.log10(value) if value > 0.0 else -math.inf for value in (of.q, of.r))  # pyright: ignore[reportReturnType]


def spikes_left_out(scan: Scan) -> str:
    """That spikes were set aside, in a sentence; "" where none were."""
    aside = scan.best.outliers
    return "" if aside is None or not aside.any() else f"Spikes ({count(int(aside.sum()))}) count as missing."


def limits_of(state: State) -> str:
    """What of the present filter the map does not take into account, in a sentence; "" if all is."""
    tuning = state.tuning
    left_out = [
        words
        for words, there in (
            ("start value", tuning.x0 is not None),
            ("initial variance p0", tuning.p0 is not None),
            ("outlier gate", tuning.gate is not None),
        )
        if there
    ]
    said = [f"Drawn without {' and '.join(left_out)}."] if left_out else []
    elsewhere = [one.name for one in state.variants if one.tuning.momentum != tuning.momentum]
    if elsewhere:
        said.append(f"This map does not apply to {', '.join(elsewhere)}: pinned at another momentum.")
    return " ".join(said)


def cell_exponents(ends: Range) -> Array:
    """Exponents at the centres of the cells along one side, shape (CELLS,)."""
    low, high = ends
    return low + (np.arange(CELLS) + 0.5) * (high - low) / CELLS


def draw_map(scan: Scan, errors: Errors | None, colour: str, q: Range, r: Range, note: str) -> TuningMap:
    """Fill the cells; what the colours show is `colour`, one of MAP_COLOURS."""
    if scan.profile is None:
        return nothing(str(scan.best.message))
    log_q, log_r = LN10 * cell_exponents(q), LN10 * cell_exponents(r)
    log_ratio = log_q[None, :] - log_r[:, None]
    best_q, best_r = float(scan.best.q), float(scan.best.r)
    optimum = tuple(math.log10(value) if value > 0.0 else -math.inf for value in (best_q, best_r))
    if colour == "RMSE" and errors is not None and np.isfinite(errors.rmse).all():
        values = between(errors.rmse, log_ratio)
        shade, marks = shade_of_excess(values, float(errors.rmse.min()))
        note = f"{note} The error against the truth depends on q/r alone.".strip()
    elif colour == "lag":
        values = lags(log_ratio, scan.momentum)
        shade, marks = shade_of_lag(values)
    else:
        colour = "likelihood"
        values = loglik_map(scan.profile, log_q, log_r)
        shade, marks = shade_of_loglik(values, float(scan.best.loglik))
    best = (optimum[0], optimum[1])
    return TuningMap(colour, q, r, values, shade, marks, best, scan.contour, note, scan.momentum)


def lags(log_ratio: Array, momentum: float) -> Array:
    """Lag on a ramp, samples, of each ln λ; with momentum interpolated in a table, accurate to 0.1 %."""
    over = np.exp(np.minimum(-log_ratio, 700.0))  # r/q, kept finite at the far ends
    if momentum == 0.0:
        return 2.0 * over / (1.0 + np.sqrt(1.0 + 4.0 * over))  # (1 − K)/K = K/λ
    table = np.linspace(-60.0, 60.0, 241)
    settled = [steady_state(FilterParams(q, 1.0, momentum=momentum)) for q in np.exp(table).tolist()]
    log_lags = np.log(np.maximum([one.lag_samples for one in settled], 1e-30))
    return np.exp(np.interp(log_ratio, table, log_lags))


def between(rmse: Array, log_ratio: Array) -> Array:
    """The error at any ln λ from that at LOG_RATIOS, accurate to 0.2 %; beyond them, that at the end."""
    from scipy.interpolate import CubicSpline

    within = np.clip(log_ratio, LOG_RATIOS[0], LOG_RATIOS[-1])
    floor = max(1e-9 * float(rmse.max()), 1e-300)  # a filter that follows a signal without noise has no error
    return np.exp(CubicSpline(LOG_RATIOS, np.log(np.maximum(rmse, floor)))(within))


def shade_of_loglik(values: Array, best: float) -> tuple[Array, tuple[tuple[float, float], ...]]:
    """Shades by the logarithm of the distance from the best, so that near and far both have structure."""
    short = np.maximum(best - np.nan_to_num(values, nan=-math.inf), 0.0)
    reach = float(np.quantile(short[np.isfinite(short)], 0.9)) if np.isfinite(short).any() else 1.0
    depth = math.log1p(max(reach, 30.0) / 3.0)
    marks = [(1.0 - math.log1p(drop / 3.0) / depth, drop) for drop in (0.0, *(3.0 * 10.0**k for k in range(12)))]
    return 1.0 - np.clip(np.log1p(short / 3.0) / depth, 0.0, 1.0), tuple(m for m in marks if m[0] >= 0.0)


def shade_of_excess(values: Array, smallest: float) -> tuple[Array, tuple[tuple[float, float], ...]]:
    """Shades by the logarithm of the error over the smallest one."""
    floor = max(smallest, float(values.max()) * 1e-6, 1e-300)
    excess = np.log(np.maximum(values, floor) / floor)
    depth = max(float(excess.max()), 1e-3)
    marks = tuple((1.0 - part, floor * math.exp(depth * part)) for part in (0.0, 0.33, 0.67, 1.0))
    return 1.0 - excess / depth, marks


def shade_of_lag(values: Array) -> tuple[Array, tuple[tuple[float, float], ...]]:
    """Shades by the logarithm of the lag, from a tenth of a sample on; short lags are bright."""
    exponent = np.log10(np.maximum(values, 0.1))
    top = max(1, math.ceil(float(exponent.max())))
    marks = tuple((1.0 - (e + 1) / (top + 1), 10.0**e) for e in range(-1, top + 1))
    return 1.0 - (exponent + 1.0) / (top + 1.0), marks
