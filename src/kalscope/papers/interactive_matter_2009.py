"""Interactive matter (2009), "Filtering Sensor Data with a Kalman Filter": a LIS302DL, one walk, three questions.

The pictures show a board that is moved by hand. It is re-created here: three axes, ±128 counts, tilted and put
down again, under white noise of σ = 3 counts. The text gives q for three pictures without r; r = 4 is assumed.

The document ends with three questions, answered here with numbers. Can q and r be estimated instead of guessed?
What would several sensors bring? Is there a much easier filter?
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Literal

import numpy as np

from kalscope.common.charts import Line, Panel, raw_and_filtered
from kalscope.common.numbers import Array
from kalscope.common.progress import OnProgress
from kalscope.estimation.fit import estimate
from kalscope.estimation.fusion import estimate_fusion
from kalscope.filtering.filter import denoise, fuse
from kalscope.filtering.params import FilterParams
from kalscope.filtering.steady import steady_state
from kalscope.papers.parts import Chapter, Check, Effort, Experiment, Figure, Prose
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


def try_walk(r_of_q_pictures: float = ASSUMED_R) -> list[dict[str, Any]]:
    """The six pictures in numbers, with another r for the first three if given.

    `noise_left` is the standard deviation of white noise, out over in, √(K/(2 − K)); `rmse` that of x − truth over
    the three axes after the start, counts, of which the raw signal has about 3.
    """
    board = moved_board()
    rows: list[dict[str, Any]] = []
    for name, q, r in WALK:
        used = r_of_q_pictures if name.startswith("q_") else r
        params = walk_params(q, used)
        settled = steady_state(params)
        error = (denoise(board.values, params) - truth_of(board))[20:]
        row = {"name": name, "q": q, "r": used, "gain": settled.gain, "lag_samples": settled.lag_samples}
        row |= {"noise_left": (settled.gain / (2.0 - settled.gain)) ** 0.5}
        rows.append({**row, "rmse": float(np.sqrt(np.mean(error * error)))})
    return rows


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


TRUE_Q, TRUE_R = 0.125, 9.0
"""The document's q and the noise of the re-created board, counts²: what the estimates should find."""
RECORD, START = 2000, 100
"""Samples per recording, 20 s, and those left out of the errors."""


def answer_estimation(draws: int) -> dict[str, Any]:
    """Estimate q and r of `draws` random walks in noise, and filter with what was found.

    Median, 5 % and 95 % quantile of q and r; `loss` is the mean RMSE of the estimated pair over that of the true
    one; then the RMSE on the moved board, and the verdicts of the stationary one, where there is no q to find.
    """
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
    quantiles = np.quantile(np.array(pairs), (0.05, 0.5, 0.95), axis=0).T.ravel().tolist()
    names = ("q_low", "q_median", "q_high", "r_low", "r_median", "r_high")
    shares = {"loss": float(np.mean(losses)), "found": len(pairs) / draws}
    return dict(zip(names, quantiles, strict=True)) | shares | _on_the_board()


def _on_the_board() -> dict[str, Any]:
    board = moved_board()
    truth = truth_of(board)
    each = np.column_stack([_filtered_alone(z, momentum=0.0) for z in board.values.T])
    resting = open_sample("lis302dl").values
    verdicts = tuple(str(estimate(z, momentum=0.0).verdict) for z in resting.T)
    by_eye = _rmse(denoise(board.values, walk_params(0.125, 4.0)), truth)
    return {"board_rmse": _rmse(each, truth), "by_eye_rmse": by_eye, "resting_verdicts": verdicts}


def exponential(z: Array, gain: float, x0: float) -> Array:
    """The much easier filter: x ← x + K (z − x) with a constant K; z and the result have shape (n,)."""
    x, out = x0, np.empty(len(z))
    for i, value in enumerate(z.tolist()):
        x = x + gain * (value - x)
        out[i] = x
    return out


def answer_exponential(q: float, r: float) -> dict[str, Any]:
    """The filter against its own settled gain on the board's z axis, which rests far from the start x = 0 of both.

    The largest difference in the first 10 samples and over the last half, counts, and the samples until it stays
    below 0.01 counts.
    """
    z = moved_board().values[:, 2]
    params = walk_params(q, r)
    gain = steady_state(params).gain
    difference = np.abs(denoise(z, params) - exponential(z, gain, X0))
    far = np.flatnonzero(difference > 0.01)
    return {
        "gain": gain,
        "at_start": float(difference[:10].max()),
        "samples_to_agree": int(far[-1]) + 1 if len(far) else 0,
        "at_end": float(difference[len(z) // 2 :].max()),
    }


def _rmse(x: Array, truth: Array) -> float:
    """Root mean square error after the start."""
    return float(np.sqrt(np.mean((x - truth)[START:] ** 2)))


TILT_SENSORS = ("accelerometer", "tilt sensor")
TILT_NOISE, TILT_OFFSET = (3.0, 0.8), 2.5
"""Standard deviations of both sensors, and what the tilt sensor reads too high, degrees."""
EVERY = 10
"""How many rows apart the readings of the tilt sensor are."""


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


def answer_tilt() -> dict[str, Any]:
    """Estimate two unknown sensors, fuse them, and drop one: r in degrees², the rest in degrees.

    The offset with its 95 % interval; the `share` of the tilt sensor in a row in which both answer; the RMSE of
    each alone, with what is estimated from it and without the offset, which it cannot know; of the fused value,
    and the errors that the filter predicts for itself with both and without the tilt sensor.
    """
    board = tilted_board()
    z, truth = board.values, truth_of(board)[:, 0]
    found = estimate_fusion(z, names=TILT_SENSORS, reference=TILT_SENSORS[0])
    if found.params is None:
        raise ArithmeticError(found.message)
    fused, first = fuse(z, found.params), fuse(z[:, :1], found.params.only([0]))
    low, high = found.offset_interval[1].tolist()
    return {
        "r_first": float(found.r[0]),
        "r_second": float(found.r[1]),
        "offset": float(found.offset[1]),
        "offset_low": low,
        "offset_high": high,
        "share": float(found.params.shares[1]),
        "first": _rmse(_filtered_alone(z[:, 0]), truth),
        "second": _rmse(_filtered_alone(z[:, 1] - TILT_OFFSET), truth),
        "fused": _rmse(fused.x, truth),
        "predicted": _predicted(fused.p),
        "without_second": _predicted(first.p),
    }


def _filtered_alone(z: Array, momentum: float | Literal["auto"] = "auto") -> Array:
    found = estimate(z, momentum=momentum)
    return z if found.params is None else denoise(z, found.params)


def _predicted(p: Array) -> float:
    return math.sqrt(float(np.mean(p[START:])))


def chapter(effort: Effort, report: OnProgress) -> Chapter:
    """Everything of this document, drawn and checked."""
    report(0.0, "the walk through q and r")
    walk = try_walk()
    report(0.1, "estimating q and r")
    estimated = answer_estimation(effort.estimate_draws)
    report(0.8, "two sensors, the figures")
    tilt = answer_tilt()
    simple = [answer_exponential(q, r) for _, q, r in WALK]
    verdicts = ", ".join(sorted(set(estimated["resting_verdicts"]))).replace("_", " ")
    return PROSE.chapter(
        blocks=(
            _walk_figure(),
            _walk_table(walk),
            _axes_figure(),
            PROSE.table("estimate", draws=effort.estimate_draws, verdicts=verdicts, **estimated),
            PROSE.table("tilt", gain=100 * (1 - tilt["fused"] / min(tilt["first"], tilt["second"])), **tilt),
            _exponential_table(simple),
            _exponential_figure(),
        ),
        checks=(
            Check("q = 128: noise left, as a share", walk[0]["noise_left"], 1.0, 0.05),
            Check("q estimated, median", estimated["q_median"], TRUE_Q, 0.1, relative=True),
            Check("r estimated, median", estimated["r_median"], TRUE_R, 0.03, relative=True),
            Check("RMSE with the estimated pair over the true one", estimated["loss"], 1.0, 0.02),
            Check("Accelerometer and tilt: offset found", tilt["offset"], TILT_OFFSET, 0.1, relative=True),
            Check("Accelerometer and tilt: predicted error", tilt["predicted"], tilt["fused"], 0.15, relative=True),
            Check("Exponential filter, worst of the walk, last half", max(a["at_end"] for a in simple), 0.0, 1e-6),
        ),
        results={
            "walk": walk,
            "walk_q_pictures_if_r": {str(r): try_walk(r)[:3] for r in (1.0, 32.0)},
            "assumed_r": ASSUMED_R,
            "estimation": estimated,
            "tilt": tilt,
            "exponential": simple,
        },
    )


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


def _walk_table(walk: Sequence[dict[str, Any]]) -> Figure:
    other = {f"gain_if_{r:g}": try_walk(r) for r in (1.0, 32.0)}
    rows: list[dict[str, Any]] = []
    for i, row in enumerate(walk):
        gains = {key: f"{other[key][i]['gain']:.3f}" if row["name"].startswith("q_") else "" for key in other}
        rows.append({**row, "percent": 100 * row["noise_left"], **gains})
    best = min(walk, key=lambda row: row["rmse"])
    return PROSE.table("walk", rows, best_q=best["q"], best_r=best["r"])


def _axes_figure() -> Figure:
    board = moved_board()
    x = denoise(board.values, walk_params(0.125, 4.0))
    panels: list[Panel] = []
    for i, name in enumerate(board.names):
        raw, filtered = raw_and_filtered(board.time, board.values[:, i], x[:, i])
        lines = (raw, Line(board.time, truth_of(board)[:, i], "truth", "truth"), filtered)
        panels.append(Panel(f"{name} axis", lines, "time / s", "counts", (-60.0, 70.0)))
    return PROSE.figure("axes", panels)


def _exponential_table(answers: Sequence[dict[str, Any]]) -> Figure:
    rows = ({**answer, "q": q, "r": r} for (_, q, r), answer in zip(WALK, answers, strict=True))
    return PROSE.table("exponential", rows, samples=max(a["samples_to_agree"] for a in answers))


def _exponential_figure() -> Figure:
    board = moved_board()
    z, q, r = board.values[:, 2], 0.125, 32.0
    params = walk_params(q, r)
    x = denoise(z, params)
    simple = exponential(z, answer_exponential(q, r)["gain"], X0)
    shown = slice(0, 120)
    lines = (
        *raw_and_filtered(board.time[shown], z[shown], x[shown], "Kalman filter"),
        Line(board.time[shown], simple[shown], "exponential smoothing", "s1"),
    )
    panel = Panel("z axis, q = 0.125, r = 32, both started at 0", lines, "time / s", "counts")
    return PROSE.figure("start", [panel])
