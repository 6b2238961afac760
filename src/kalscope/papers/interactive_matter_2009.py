"""Interactive matter (2009), "Filtering Sensor Data with a Kalman Filter": a LIS302DL, one walk, two questions.

The pictures show a board that is moved by hand. It is re-created here: three axes, ±128 counts, tilted and put
down again, under white noise of σ = 3 counts. The text gives q for three pictures without r; r = 4 is assumed.

Two of the questions at its end are answered here with numbers. Can q and r be estimated instead of guessed? Is
there a much easier filter? The third, what several sensors would bring, is a chapter of the guide.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from kalscope.common.charts import Panel, raw_and_filtered
from kalscope.common.numbers import Array
from kalscope.common.progress import OnProgress
from kalscope.estimation.fit import estimate
from kalscope.filtering.filter import denoise
from kalscope.filtering.params import FilterParams
from kalscope.filtering.steady import steady_state
from kalscope.papers.document import Block, Chapter, Check, Experiment, Prose
from kalscope.recording import Recording
from kalscope.sources.samples import open_sample

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


def try_walk() -> list[dict[str, Any]]:
    """The six pictures in numbers, with the gains that another r would give the first three.

    `percent` is what is left of white noise, √(K/(2 − K)); `rmse` that of x − truth over the three axes after the
    start, counts, of which the raw signal has about 3.
    """
    board = moved_board()
    rows: list[dict[str, Any]] = []
    for name, q, r in WALK:
        settled = steady_state(walk_params(q, r))
        error = (denoise(board.values, walk_params(q, r)) - truth_of(board))[20:]
        row: dict[str, Any] = {"q": q, "r": r, "gain": settled.gain, "lag_samples": settled.lag_samples}
        row |= {"percent": 100 * (settled.gain / (2.0 - settled.gain)) ** 0.5}
        for other in (1.0, 32.0):
            gain = f"{steady_state(walk_params(q, other)).gain:.3f}" if name.startswith("q_") else ""
            row[f"gain_if_{other:g}"] = gain
        rows.append({**row, "rmse": float(np.sqrt(np.mean(error * error)))})
    return rows


def truth_of(recording: Recording) -> Array:
    """The noise-free signal of a simulated recording, shape (n, channels)."""
    return recording.values if recording.truth is None else recording.truth


def _hold(time: Array, start: float, stop: float) -> Array:
    """0, a quick rise to 1 at `start`, and back at `stop`; each takes about 0.2 s."""
    return 0.5 * (np.tanh((time - start) / 0.1) - np.tanh((time - stop) / 0.1))


def _picture(key: str, q: float, r: float) -> Experiment:
    title = f"LIS302DL: q = {q:g}, r = {r:g}{' (r assumed)' if key.startswith('q_') else ''}"
    return Experiment(f"lis302dl_{key}", title, lambda: (moved_board(), walk_params(q, r)))


EXPERIMENTS = tuple(_picture(*row) for row in WALK)
"""What opens from this document."""


TRUE_Q, TRUE_R = 0.125, 9.0
"""The document's q and the noise of the re-created board, counts²: what the estimates should find."""
RECORD, START = 2000, 100
"""Samples per recording, 20 s, and those left out of the errors."""
DRAWS = 60
"""Recordings whose q and r are estimated."""


def answer_estimation(draws: int) -> dict[str, Any]:
    """Estimate q and r of `draws` random walks in noise, and filter with what was found.

    Median, 5 % and 95 % quantile of q and r; `loss` is the mean RMSE of the estimated pair over that of the true
    one; then the RMSE on the moved board, and the verdicts of the stationary one, where there is no q to find.
    """
    rng = np.random.default_rng(1960)
    rows: list[tuple[float, float, float]] = []
    for _ in range(draws):
        truth = np.cumsum(math.sqrt(TRUE_Q) * rng.standard_normal(RECORD))
        z = truth + math.sqrt(TRUE_R) * rng.standard_normal(RECORD)
        estimated = estimate(z, momentum=0.0)
        if estimated.params is not None:
            best = _rmse(denoise(z, FilterParams(q=TRUE_Q, r=TRUE_R)), truth)
            rows.append((float(estimated.q), float(estimated.r), _rmse(denoise(z, estimated.params), truth) / best))
    q, r, losses = np.array(rows).T
    names = [f"{name}_{place}" for name in "qr" for place in ("low", "median", "high")]
    quantiles = np.quantile((q, r), (0.05, 0.5, 0.95), axis=1).T.ravel().tolist()
    board, resting = moved_board(), open_sample("lis302dl").values
    fits = [(z, estimate(z, momentum=0.0).params) for z in board.values.T]
    each = np.column_stack([z if params is None else denoise(z, params) for z, params in fits])
    verdicts = {str(estimate(z, momentum=0.0).verdict) for z in resting.T}
    return {
        "draws": draws,
        **dict(zip(names, quantiles, strict=True)),
        "loss": float(losses.mean()),
        "found": len(rows) / draws,
        "board_rmse": _rmse(each, truth_of(board)),
        "by_eye_rmse": _rmse(denoise(board.values, walk_params(0.125, 4.0)), truth_of(board)),
        "verdicts": ", ".join(sorted(verdicts)).replace("_", " "),
    }


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
    z, params = moved_board().values[:, 2], walk_params(q, r)
    gain = steady_state(params).gain
    difference = np.abs(denoise(z, params) - exponential(z, gain, X0))
    at_start, at_end = float(difference[:10].max()), float(difference[len(z) // 2 :].max())
    agree = int(np.max(np.flatnonzero(difference > 0.01), initial=-1)) + 1
    return {"q": q, "r": r, "gain": gain, "at_start": at_start, "samples_to_agree": agree, "at_end": at_end}


def _rmse(x: Array, truth: Array) -> float:
    """Root mean square error after the start."""
    return float(np.sqrt(np.mean((x - truth)[START:] ** 2)))


def chapter(report: OnProgress) -> Chapter:
    """Everything of this document, drawn and checked."""
    report(0.0, "the walk through q and r")
    walk = try_walk()
    best = min(walk, key=lambda row: row["rmse"])
    report(0.1, "estimating q and r")
    estimated = answer_estimation(DRAWS)
    report(0.8, "the much easier filter, the figures")
    simple = [answer_exponential(q, r) for _, q, r in WALK]
    return PROSE.chapter(
        blocks=(
            _walk_figure(),
            PROSE.table("walk", walk, best_q=best["q"], best_r=best["r"]),
            PROSE.table("estimate", **estimated),
            PROSE.table("exponential", simple, samples=max(row["samples_to_agree"] for row in simple)),
        ),
        checks=(
            Check("q = 128: noise left, percent", walk[0]["percent"], 100.0, 5.0),
            Check("q estimated, median", estimated["q_median"], TRUE_Q, 0.1, relative=True),
            Check("r estimated, median", estimated["r_median"], TRUE_R, 0.03, relative=True),
            Check("RMSE with the estimated pair over the true one", estimated["loss"], 1.0, 0.02),
            Check("Exponential filter, worst of the walk, last half", max(a["at_end"] for a in simple), 0.0, 1e-6),
        ),
    )


def _walk_figure() -> Block:
    board = moved_board()
    z, shown = board.values[:, 0], slice(60, 330)
    panels: list[Panel] = []
    for name, q, r in WALK:
        lines = raw_and_filtered(board.time[shown], z[shown], denoise(z, walk_params(q, r))[shown])
        title = f"q = {q:g}, r = {r:g}{' (assumed)' if name.startswith('q_') else ''}"
        panels.append(Panel(title, lines, "time / s", "x / counts", (-15.0, 68.0)))
    return PROSE.figure("walk_figure", panels)
