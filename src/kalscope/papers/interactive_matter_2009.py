"""Interactive matter (2009), "Filtering Sensor Data with a Kalman Filter": a LIS302DL, one walk, three questions.

The pictures show a board that is moved by hand. It is re-created here: three axes, ±128 counts, tilted and put
down again, under white noise of σ = 3 counts. The text gives q for three pictures without r; r = 4 is assumed.

The document ends with three questions, answered here with numbers. Can q and r be estimated instead of guessed?
What would several sensors bring? Is there a much easier filter?
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from kalscope.common.charts import Line, Panel, raw_and_filtered
from kalscope.common.numbers import Array
from kalscope.common.progress import OnProgress
from kalscope.estimation.fit import estimate
from kalscope.estimation.fusion import estimate_fusion
from kalscope.filtering.filter import denoise, fuse, kalman_filter
from kalscope.filtering.params import FilterParams
from kalscope.filtering.steady import steady_state
from kalscope.papers.parts import Chapter, Check, Effort, Experiment, Figure, Prose, ResultTable
from kalscope.recording import Recording
from kalscope.sources.samples import open_sample
from kalscope.sources.synthetic import synthesize

PAPER = "Filtering Sensor Data with a Kalman Filter (interactive matter 2009)"
PROSE = Prose(__name__)
ASSUMED_R = 4.0
"""r of the three q pictures, counts²: more than 1, because the text then turns it down to 1."""
WALK = (
    ("q_128", 128.0, ASSUMED_R),
    ("q_4", 4.0, ASSUMED_R),
    ("q_0125", 0.125, ASSUMED_R),
    ("r_1", 0.125, 1.0),
    ("r_4", 0.125, 4.0),
    ("r_32", 0.125, 32.0),
)
"""Name, q and r of the six pictures, in the order of the text."""
NOISE = 3.0
"""Standard deviation of the board's noise, counts."""
P0, X0 = 1023.0, 0.0
"""A start "just high enough", counts², and a first value that does not matter, counts."""
SAMPLES = 600
SAMPLE_PERIOD = 0.01
"""s: the sensor's 100 Hz."""


@dataclass(frozen=True)
class WalkRow:
    """One picture of the walk."""

    name: str
    """Key of the picture."""
    q: float
    """Process noise, counts²."""
    r: float
    """Sensor noise, counts²."""
    gain: float
    """Settled gain K."""
    lag_samples: float
    """Lag on a ramp, (1 − K)/K samples."""
    noise_left: float
    """Standard deviation of white noise, out over in, √(K/(2 − K))."""
    rmse: float
    """Root mean square of x − truth over the three axes after the start, counts; the raw signal has about 3."""


def moved_board() -> Recording:
    """Three axes of a board that is tilted, held and put down; 600 samples at 100 Hz, whole counts ±128."""
    time: Array = np.arange(SAMPLES, dtype=np.float64) * SAMPLE_PERIOD
    tilt = 70.0 * _hold(time, 1.0, 2.2) - 40.0 * _hold(time, 3.4, 4.4)
    roll = 50.0 * _hold(time, 1.6, 3.0) + 25.0 * np.sin(2.0 * np.pi * 1.2 * time) * _hold(time, 4.2, 5.4)
    angle_x, angle_y = np.radians(tilt), np.radians(roll)
    gravity = 55.0  # 18 mg a count
    x = gravity * np.sin(angle_x)
    y = gravity * np.sin(angle_y) * np.cos(angle_x)
    z = gravity * np.cos(angle_x) * np.cos(angle_y)
    truth = np.column_stack([x, y, z])
    noise = NOISE * np.random.default_rng(302).standard_normal(truth.shape)
    return Recording(
        time=time,
        names=("x", "y", "z"),
        units=("counts",) * 3,
        values=np.clip(np.round(truth + noise), -128, 127),
        sample_period=SAMPLE_PERIOD,
        truth=truth,
    )


def walk_params(q: float, r: float) -> FilterParams:
    """One of the three independent filters, as kalman_init(q, r, 1023, 0)."""
    return FilterParams(q=q, r=r, p0=P0, x0=X0)


def try_walk(r_of_q_pictures: float = ASSUMED_R) -> tuple[WalkRow, ...]:
    """The six pictures in numbers, with another r for the first three if given."""
    board = moved_board()
    rows: list[WalkRow] = []
    for name, q, r in WALK:
        used = r_of_q_pictures if name.startswith("q_") else r
        params = walk_params(q, used)
        settled = steady_state(params)
        gain = float(settled.gain)
        error = (denoise(board.values, params) - truth_of(board))[20:]
        rows.append(
            WalkRow(
                name=name,
                q=q,
                r=used,
                gain=gain,
                lag_samples=float(settled.lag_samples),
                noise_left=(gain / (2.0 - gain)) ** 0.5,
                rmse=float(np.sqrt(np.mean(error * error))),
            )
        )
    return tuple(rows)


def truth_of(recording: Recording) -> Array:
    """The noise-free signal of a simulated recording, shape (n, channels)."""
    return recording.values if recording.truth is None else recording.truth


def _hold(time: Array, start: float, stop: float) -> Array:
    """0, a quick rise to 1 at `start`, and back at `stop`; each takes about 0.2 s."""
    return 0.5 * (np.tanh((time - start) / 0.1) - np.tanh((time - stop) / 0.1))


def _picture(key: str, q: float, r: float) -> Experiment:
    assumed = " (r assumed)" if key.startswith("q_") else ""
    title = f"LIS302DL: q = {q:g}, r = {r:g}{assumed}"
    gain = float(steady_state(walk_params(q, r)).gain)
    summary = f"Three independent filters on a board moved by hand; settled gain {gain:.3g}."
    figure = f"Picture of {'q' if key.startswith('q_') else 'r'} = {q if key.startswith('q_') else r:g}"
    return Experiment(f"lis302dl_{key}", title, PAPER, figure, summary, lambda: (moved_board(), walk_params(q, r)))


EXPERIMENTS = tuple(_picture(*row) for row in WALK)
"""What opens from this document."""


def c_listing(measurements: ArrayLike, q: float, r: float, p: float, initial_value: float) -> tuple[Array, Array]:
    """kalman_init and kalman_update of the interactive-matter listing (2009).

    Args:
        measurements: shape (n,).
        q: process noise, unit².
        r: sensor noise, unit².
        p: first estimated error, unit².
        initial_value: first value, unit.

    Returns:
        x and p after each update, shape (n,) each.
    """
    x = initial_value
    states: list[tuple[float, float]] = []
    for measurement in np.asarray(measurements, dtype=np.float64).tolist():
        p = p + q
        k = p / (p + r)
        x = x + k * (measurement - x)
        p = (1 - k) * p
        states.append((x, p))
    pairs = np.array(states).reshape(-1, 2)
    return pairs[:, 0], pairs[:, 1]


TRUE_Q, TRUE_R = 0.125, 9.0
"""The document's q and the noise of the re-created board, counts²: what the estimates should find."""
RECORD, START = 2000, 100
"""Samples per recording, 20 s, and those left out of the errors."""
SENSOR_R = (9.0, 25.0)
"""Noise variances of the two sensors of one quantity, counts²."""


@dataclass(frozen=True)
class EstimateAnswer:
    """How close maximum likelihood comes, over many recordings of 2000 samples."""

    q_median: float
    """Median estimate of q, counts²; true is 0.125."""
    q_low: float
    """5 % of the estimates lie below."""
    q_high: float
    """5 % lie above."""
    r_median: float
    """Median estimate of r, counts²; true is 9."""
    r_low: float
    """5 % of the estimates lie below."""
    r_high: float
    """5 % lie above."""
    loss: float
    """RMSE of the filter with the estimated pair over that with the true pair, mean over recordings."""
    found: float
    """Share of the recordings in which a pair was found."""
    board_rmse: float
    """RMSE on the moved board, three axes, each with its own estimated pair, counts."""
    by_eye_rmse: float
    """The same with q = 0.125, r = 4, found by eye."""
    resting_verdicts: tuple[str, ...]
    """What is answered for the three axes of the stationary board, where there is no q to find."""


@dataclass(frozen=True)
class FusionAnswer:
    """Two noisy sensors of one quantity, both fed to one filter; errors in counts."""

    first: float
    """RMSE with the better sensor alone."""
    second: float
    """RMSE with the other one alone."""
    fused: float
    """RMSE with one predict and two updates a sample."""
    fused_theory: float
    """√(K r) with 1/r = 1/r₁ + 1/r₂: what the model promises."""
    difference: float
    """Largest distance to the filter of the weighted mean of both readings: the same filter."""


@dataclass(frozen=True)
class ExponentialAnswer:
    """x ← x + K (z − x) with the settled K, against the filter, on the moved board's z axis.

    That axis rests at 55 counts, far from the start at 0.
    """

    gain: float
    """K."""
    at_start: float
    """Largest difference in the first 10 samples, counts."""
    samples_to_agree: int
    """Samples after which the difference stays below 0.01 counts."""
    at_end: float
    """Largest difference over the last half of the record, counts."""


def answer_estimation(draws: int) -> EstimateAnswer:
    """Estimate q and r of `draws` random walks in noise, and filter with what was found."""
    rng = np.random.default_rng(1960)
    pairs: list[tuple[float, float]] = []
    losses: list[float] = []
    true = FilterParams(q=TRUE_Q, r=TRUE_R)
    for _ in range(draws):
        truth = np.cumsum(math.sqrt(TRUE_Q) * rng.standard_normal(RECORD))
        z = truth + math.sqrt(TRUE_R) * rng.standard_normal(RECORD)
        found = estimate(z, momentum=0.0)
        if found.params is None:
            continue
        pairs.append((float(found.q), float(found.r)))
        losses.append(_rmse(denoise(z, found.params), truth) / _rmse(denoise(z, true), truth))
    q, r = np.array(pairs).T
    low, middle, high = np.quantile(q, (0.05, 0.5, 0.95)).tolist()
    r_low, r_middle, r_high = np.quantile(r, (0.05, 0.5, 0.95)).tolist()
    return EstimateAnswer(
        middle, low, high, r_middle, r_low, r_high, float(np.mean(losses)), len(pairs) / draws, *_on_the_board()
    )


def _on_the_board() -> tuple[float, float, tuple[str, ...]]:
    """RMSE of estimated pairs and of the pair by eye on the moved board; the verdicts on the resting one."""
    board = moved_board()
    truth = truth_of(board)
    columns: list[Array] = []
    for axis in range(3):
        z = board.values[:, axis]
        found = estimate(z, momentum=0.0).params
        columns.append(z if found is None else denoise(z, found))
    by_eye = denoise(board.values, walk_params(0.125, 4.0))
    resting = open_sample("lis302dl").values
    verdicts = tuple(str(estimate(resting[:, axis], momentum=0.0).verdict) for axis in range(3))
    return _rmse(np.column_stack(columns), truth), _rmse(by_eye, truth), verdicts


def answer_fusion() -> FusionAnswer:
    """Two sensors of σ = 3 and 5 counts on one random walk of 20,000 samples."""
    rng = np.random.default_rng(2)
    n = 10 * RECORD
    truth = np.cumsum(math.sqrt(TRUE_Q) * rng.standard_normal(n))
    z = truth[:, None] + np.sqrt(SENSOR_R) * rng.standard_normal((n, 2))
    both = FilterParams(TRUE_Q, np.array(SENSOR_R))
    fused, one = fuse(z, both).x, both.as_single
    mean = (z * both.shares).sum(axis=1)
    alone = [_rmse(denoise(z[:, i], FilterParams(q=TRUE_Q, r=SENSOR_R[i])), truth) for i in range(2)]
    return FusionAnswer(
        first=alone[0],
        second=alone[1],
        fused=_rmse(fused, truth),
        fused_theory=math.sqrt(float(steady_state(one).p)),
        difference=float(np.abs(fused - denoise(mean, one)).max()),
    )


def exponential(z: Array, gain: float, x0: float) -> Array:
    """The much easier filter: x ← x + K (z − x) with a constant K; z and the result have shape (n,)."""
    x, out = x0, np.empty(len(z))
    for i, value in enumerate(z.tolist()):
        x = x + gain * (value - x)
        out[i] = x
    return out


def answer_exponential(q: float, r: float) -> ExponentialAnswer:
    """The filter against its own settled gain, both from the document's start x = 0."""
    z = moved_board().values[:, 2]
    params = walk_params(q, r)
    gain = float(steady_state(params).gain)
    difference = np.abs(denoise(z, FilterParams(q=q, r=r, p0=P0, x0=X0)) - exponential(z, gain, X0))
    far = np.flatnonzero(difference > 0.01)
    return ExponentialAnswer(
        gain=gain,
        at_start=float(difference[:10].max()),
        samples_to_agree=int(far[-1]) + 1 if len(far) else 0,
        at_end=float(difference[len(z) // 2 :].max()),
    )


def _rmse(x: Array, truth: Array) -> float:
    """Root mean square error after the start."""
    return float(np.sqrt(np.mean((x - truth)[START:] ** 2)))


TILT_SENSORS = ("accelerometer", "tilt sensor")
TILT_NOISE, TILT_OFFSET = (3.0, 0.8), 2.5
"""Standard deviations of both sensors, and what the tilt sensor reads too high, degrees."""
EVERY = 10
"""How many rows apart the readings of the tilt sensor are."""


@dataclass(frozen=True)
class TiltAnswer:
    """What is found about two unknown sensors; r in degrees², the rest in degrees."""

    r_first: float
    """r of the accelerometer; true is 9."""
    r_second: float
    """r of the tilt sensor; true is 0.64."""
    offset: float
    """How much higher the tilt sensor reads; true is 2.5."""
    offset_low: float
    """Lower end of its 95 % interval."""
    offset_high: float
    """Upper end."""
    share: float
    """Share of the tilt sensor in a row in which both answer."""
    first: float
    """RMSE of the accelerometer, filtered alone with what is estimated from it."""
    second: float
    """The same of the tilt sensor; its offset, which it cannot know, is subtracted."""
    fused: float
    """RMSE of the fused value."""
    predicted: float
    """The error that the fused filter predicts for itself."""
    without_second: float
    """The error that it predicts without the tilt sensor."""


def tilted_board() -> Recording:
    """40 s of a board that swings by ±20° once in 4 s, seen by both sensors."""
    return synthesize(
        "sine",
        n=4000,
        sample_period=SAMPLE_PERIOD,
        amplitude=20.0,
        period=4.0,
        sigmas=TILT_NOISE,
        offsets=(0.0, TILT_OFFSET),
        every=(1, EVERY),
    )


def answer_tilt() -> TiltAnswer:
    """Estimate, fuse, and drop one out."""
    board = tilted_board()
    z, truth = board.values, (board.values if board.truth is None else board.truth)[:, 0]
    found = estimate_fusion(z, names=TILT_SENSORS, reference=TILT_SENSORS[0])
    if found.params is None:
        raise ArithmeticError(found.message)
    fused, first = fuse(z, found.params), fuse(z[:, :1], found.params.only([0]))
    alone = [_filtered_alone(z[:, 0]), _filtered_alone(z[:, 1] - TILT_OFFSET)]
    low, high = found.offset_interval[1].tolist()
    return TiltAnswer(
        r_first=float(found.r[0]),
        r_second=float(found.r[1]),
        offset=float(found.offset[1]),
        offset_low=low,
        offset_high=high,
        share=float(found.params.shares[1]),
        first=_rmse(alone[0], truth),
        second=_rmse(alone[1], truth),
        fused=_rmse(fused.x, truth),
        predicted=_predicted(fused.p),
        without_second=_predicted(first.p),
    )


def _filtered_alone(z: Array) -> Array:
    found = estimate(z)
    return z if found.params is None else denoise(z, found.params)


def _predicted(p: Array) -> float:
    return math.sqrt(float(np.mean(p[START:])))


def chapter(effort: Effort, report: OnProgress) -> Chapter:
    """Everything of this document, drawn and checked."""
    report(0.0, "the walk through q and r")
    walk = try_walk()
    report(0.1, "estimating q and r")
    estimated = answer_estimation(effort.estimate_draws)
    report(0.8, "two sensors, the listing, the figures")
    fused, board = answer_fusion(), answer_tilt()
    simple = tuple(answer_exponential(q, r) for _, q, r in WALK)
    listing = listing_difference()
    verdicts = ", ".join(sorted(set(estimated.resting_verdicts))).replace("_", " ")
    return PROSE.chapter(
        blocks=(
            _walk_figure(),
            _walk_table(walk),
            _axes_figure(),
            PROSE.table("estimate", draws=effort.estimate_draws, verdicts=verdicts, **asdict(estimated)),
            PROSE.table("fusion", gain=100 * (1 - fused.fused / fused.first), **asdict(fused)),
            PROSE.table("tilt", gain=100 * (1 - board.fused / min(board.first, board.second)), **asdict(board)),
            _exponential_table(simple),
            _exponential_figure(),
        ),
        checks=(
            Check("C listing, three axes, six settings: largest difference", listing, 0.0, 1e-10),
            Check("q = 128: noise left, as a share", walk[0].noise_left, 1.0, 0.05),
            Check("q estimated, median", estimated.q_median, TRUE_Q, 0.1, relative=True),
            Check("r estimated, median", estimated.r_median, TRUE_R, 0.03, relative=True),
            Check("RMSE with the estimated pair over the true one", estimated.loss, 1.0, 0.02),
            Check("Two sensors fused: RMSE", fused.fused, fused.fused_theory, 0.05, relative=True),
            Check("Fused, against the filter of the weighted mean", fused.difference, 0.0, 1e-9),
            Check("Accelerometer and tilt: offset found", board.offset, TILT_OFFSET, 0.1, relative=True),
            Check("Accelerometer and tilt: predicted error", board.predicted, board.fused, 0.15, relative=True),
            Check("Exponential filter, worst of the walk, last half", max(a.at_end for a in simple), 0.0, 1e-6),
        ),
        results={
            "walk": [asdict(row) for row in walk],
            "walk_q_pictures_if_r": {str(r): [asdict(row) for row in try_walk(r)[:3]] for r in (1.0, 32.0)},
            "assumed_r": ASSUMED_R,
            "c_listing_difference": listing,
            "estimation": asdict(estimated),
            "fusion": asdict(fused),
            "tilt": asdict(board),
            "exponential": [asdict(answer) for answer in simple],
        },
    )


def listing_difference() -> float:
    """Largest difference of x, counts, or of p, counts², between the C listing and kalman_filter: rounding."""
    board, largest = moved_board(), 0.0
    for _, q, r in WALK:
        result = kalman_filter(board.values, walk_params(q, r))
        for axis in range(3):
            x, p = c_listing(board.values[:, axis], q, r, P0, X0)
            apart = np.abs(x - result.x[:, axis]).max(), np.abs(p - result.p[:, axis]).max()
            largest = max(largest, *map(float, apart))
    return largest


def _walk_figure() -> Figure:
    board = moved_board()
    z, shown = board.values[:, 0], slice(60, 330)
    panels: list[Panel] = []
    for name, q, r in WALK:
        x = denoise(z, walk_params(q, r))
        assumed = " (assumed)" if name.startswith("q_") else ""
        lines = raw_and_filtered(board.time[shown], z[shown], x[shown])
        panels.append(Panel(f"q = {q:g}, r = {r:g}{assumed}", lines, "time / s", "x / counts", (-15.0, 68.0)))
    return PROSE.figure("walk_figure", panels)


def _walk_table(walk: Sequence[WalkRow]) -> ResultTable:
    other = {f"gain_if_{r:g}": try_walk(r) for r in (1.0, 32.0)}
    rows: list[dict[str, Any]] = []
    for i, row in enumerate(walk):
        gains = {key: f"{other[key][i].gain:.3f}" if row.name.startswith("q_") else "" for key in other}
        rows.append({**asdict(row), "percent": 100 * row.noise_left, **gains})
    best = min(walk, key=lambda row: row.rmse)
    return PROSE.table("walk", rows, best_q=best.q, best_r=best.r)


def _axes_figure() -> Figure:
    board = moved_board()
    x = denoise(board.values, walk_params(0.125, 4.0))
    panels: list[Panel] = []
    for i, name in enumerate(board.names):
        raw, filtered = raw_and_filtered(board.time, board.values[:, i], x[:, i])
        lines = (raw, Line(board.time, truth_of(board)[:, i], "truth", "truth"), filtered)
        panels.append(Panel(f"{name} axis", lines, "time / s", "counts", (-60.0, 70.0)))
    return PROSE.figure("axes", panels)


def _exponential_table(answers: Sequence[ExponentialAnswer]) -> ResultTable:
    rows = ({**asdict(answer), "q": q, "r": r} for (_, q, r), answer in zip(WALK, answers, strict=True))
    return PROSE.table("exponential", rows, samples=max(a.samples_to_agree for a in answers))


def _exponential_figure() -> Figure:
    board = moved_board()
    z, q, r = board.values[:, 2], 0.125, 32.0
    params = walk_params(q, r)
    x = denoise(z, params)
    simple = exponential(z, answer_exponential(q, r).gain, X0)
    shown = slice(0, 120)
    lines = (
        *raw_and_filtered(board.time[shown], z[shown], x[shown], "Kalman filter"),
        Line(board.time[shown], simple[shown], "exponential smoothing", "s1"),
    )
    panel = Panel("z axis, q = 0.125, r = 32, both started at 0", lines, "time / s", "counts")
    return PROSE.figure("start", [panel])
