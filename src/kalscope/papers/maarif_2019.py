"""Ma'arif et al. (2019), "Kalman Filter for Noise Reducer on Sensor Readings": figures 1–10, Table 1, the advice.

The paper prints neither its data nor its noise. Table 1 fixes the noise: on white noise around a constant, the
mean error mean |z − x| of the settled filter is c σ (1 − K) √(2/(2 − K)), c = √(2/π), and all five printed rows
agree with σ ≈ 72. The appendix's (rand − rand)·100 has σ = 100/√6 = 40.8 and cannot be the table's signal.

Its advice, "ratio 100" and "a mean error of 40 to 55", is tested on three kinds of signal under the table's
noise: one stationary, one that wanders with a true r/q of 100, one that swings fast. Each is filtered with ratios
from 1 to 100,000; its RMSE against the known truth says what a ratio is worth, the paper's mean error against the
raw signal does not.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from functools import cache, partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from kalscope.common.charts import Line, Panel, raw_and_filtered
from kalscope.common.numbers import Array
from kalscope.common.progress import OnProgress
from kalscope.filtering.filter import denoise, kalman_filter
from kalscope.filtering.params import FilterParams
from kalscope.filtering.steady import steady_state
from kalscope.papers.document import Block, Chapter, Check, Experiment, Prose
from kalscope.recording import Recording
from kalscope.sources.samples import open_sample

PROSE = Prose(__name__)
SAMPLES = 100
"""Length of the simulated signals: the appendix's loop."""
SIGMA = 72.0
"""Standard deviation of the white noise that gives Table 1, u."""
TABLE_DRAWS, ADVICE_DRAWS = 4000, 40
"""Signals behind each simulated number of Table 1, and behind each point of the tests of the advice."""

PRINTED = (
    (1.0, 1.0, 26.0677),
    (1.0, 0.1, 44.7392),
    (1.0, 0.01, 53.4466),
    (10.0, 0.1, 53.4541),
    (100.0, 0.1, 56.9959),
)
"""Table 1: R, Q and mean error of figures 4–8."""
SIMULATED_FIGURES = ((3, 1.0, 10.0), (4, 1.0, 1.0), (5, 1.0, 0.1), (6, 1.0, 0.01), (7, 10.0, 0.1), (8, 100.0, 0.1))
"""Figure, R, Q of the MATLAB simulations."""
ROBOT_FIGURES = (
    ("9", "Figure 9", 10.0, 0.1),
    ("10", "Figure 10, caption", 100.0, 0.1),
    ("10_text", "Figure 10, text", 10.0, 0.01),
)
"""Name, title, R, Q on the resting robot; figure 10 by its caption, then by the text."""


def mean_error(z: ArrayLike, x: ArrayLike) -> float:
    """Mean |z − x|, the paper's error (16) with the mean that its name promises; z and x of equal shape."""
    return float(np.mean(np.abs(np.asarray(z, dtype=np.float64) - np.asarray(x, dtype=np.float64))))


def theoretical_mean_error(ratio: float, sigma: float) -> float:
    """Mean |z − x| of the settled filter on Gaussian white noise around a constant, unit.

    z − x = (1 − K)(z − x_before), and x_before has variance σ² K/(2 − K), so z − x is Gaussian of variance
    σ² (1 − K)² · 2/(2 − K).

    Args:
        ratio: λ = q/r, > 0.
        sigma: standard deviation of the noise, unit.

    Source: derived; c = √(2/π) is E|N(0, 1)|.
    """
    gain = float(steady_state(FilterParams(q=ratio, r=1.0)).gain)
    return math.sqrt(2.0 / math.pi) * sigma * (1.0 - gain) * math.sqrt(2.0 / (2.0 - gain))


def theoretical_rmse(ratio: float, sigma: float) -> float:
    """RMSE of the settled filter against a constant truth under white noise, σ √(K/(2 − K)), unit."""
    gain = float(steady_state(FilterParams(q=ratio, r=1.0)).gain)
    return sigma * math.sqrt(gain / (2.0 - gain))


def white_noise(draws: int, samples: int = SAMPLES, seed: int = 2019) -> Array:
    """Gaussian white noise of Table 1 around 0, shape (samples, draws), in u."""
    return SIGMA * np.random.default_rng(seed).standard_normal((samples, draws))


def simulate_table(draws: int) -> list[dict[str, Any]]:
    """Table 1 over `draws` signals of 100 samples of white noise, σ = 72 around 0; the same ones for all rows.

    The mean error is that of the start x = 0, p0 = 0 of the MATLAB appendix, and of p0 = 1 as in section 2.3; `off`
    compares the first with the printed one, in percent.
    """
    z = white_noise(draws)
    rows: list[dict[str, Any]] = []
    for i, (r, q, printed) in enumerate(PRINTED, 1):
        x, started_at_1 = (kalman_filter(z, FilterParams(q=q, r=r, p0=p0, x0=0.0)).x for p0 in (0.0, 1.0))
        row = {"i": i, "r": r, "q": q, "ratio": r / q, "printed": printed, "simulated": mean_error(z, x)}
        row |= {"theoretical": theoretical_mean_error(q / r, SIGMA), "off": 100 * (mean_error(z, x) / printed - 1)}
        row |= {"simulated_p0_1": mean_error(z, started_at_1), "rmse": float(np.sqrt(np.mean(x * x)))}
        rows.append({**row, "rmse_theoretical": theoretical_rmse(q / r, SIGMA)})
    return rows


def question_the_start(draws: int) -> dict[str, float]:
    """What rows 3 and 4, of one ratio, reveal about the start that the paper does not state, over `draws` signals.

    The difference of their mean errors, as printed and for both starts.
    """
    z, (three, four) = white_noise(draws), PRINTED[2:4]

    def differences(p0: float) -> Array:
        errors = [np.abs(z - kalman_filter(z, FilterParams(q, r, p0=p0, x0=0.0)).x) for r, q, _ in (three, four)]
        return (errors[1] - errors[0]).mean(axis=0)

    one = differences(1.0)
    starts = {"p0_zero": float(np.abs(differences(0.0)).max()), "p0_one": float(one.mean())}
    return {"printed": four[2] - three[2], **starts, "p0_one_spread": float(one.std())}


def robot_recording() -> Recording:
    """The accelerometer of figures 1, 9 and 10, re-created: 2000 samples, counts."""
    return open_sample("balancing_robot")


@cache
def robot_signal() -> Array:
    """Its readings, counts, shape (2000,); shared, so not to be changed."""
    return robot_recording().values[:, 0]


def _simulation(r: float, q: float) -> tuple[Recording, FilterParams]:
    """Noise around the constant truth 0, one channel, one sample per second."""
    z = white_noise(1)
    time = np.arange(len(z), dtype=np.float64)
    recording = Recording(time, ("signal",), ("",), z, 1.0, truth=np.zeros_like(z))
    return recording, FilterParams(q=q, r=r, p0=0.0, x0=0.0)


def _robot(r: float, q: float) -> tuple[Recording, FilterParams]:
    return robot_recording(), FilterParams(q=q, r=r, p0=1.0, x0=0.0)  # Pt_prev = 1, Xt_prev = 0, as on the Arduino


EXPERIMENTS = (
    *(
        Experiment(f"noise_reducer_figure_{i}", f"Figure {i}: R = {r:g}, Q = {q:g}", partial(_simulation, r, q))
        for i, r, q in SIMULATED_FIGURES
    ),
    *(
        Experiment(f"noise_reducer_figure_{i}", f"{title}: R = {r:g}, Q = {q:g}", partial(_robot, r, q))
        for i, title, r, q in ROBOT_FIGURES
    ),
)
"""What opens from this paper."""


ADVISED = 100.0
"""The paper's recommended r/q."""
RULE = (40.0, 55.0)
"""The paper's range of good mean errors, u."""
LENGTH, SETTLING = 2000, 300
"""Length of a signal, and its first part that is left out: the start is not the question."""
RATIOS = np.logspace(0.0, 5.0, 41)
"""r/q that are tried; every eighth is a power of ten."""
SWING, SWING_PERIOD = 300.0, 60
"""Amplitude in u and period in samples of the fast signal."""


def truth_of(kind: str, draws: int, rng: np.random.Generator) -> Array:
    """The noise-free signals of a kind, shape (LENGTH, draws)."""
    if kind == "stationary":
        return np.zeros((LENGTH, draws))
    if kind == "wandering":  # q_true = σ²/100
        return np.cumsum(SIGMA / math.sqrt(ADVISED) * rng.standard_normal((LENGTH, draws)), axis=0)
    swing = SWING * np.sin(2.0 * np.pi * np.arange(LENGTH) / SWING_PERIOD)
    return np.repeat(swing[:, None], draws, axis=1)


def try_advice(kind: str, draws: int) -> dict[str, Any]:
    """A kind of signal, filtered with each of RATIOS; errors in u, averages over draws of noise and walk.

    `loss` is how many times larger the RMSE is at the advised ratio than at the best one.
    """
    rng = np.random.default_rng(100)
    truth = truth_of(kind, draws, rng)
    z = truth + SIGMA * rng.standard_normal(truth.shape)
    filtered = (denoise(z, FilterParams(q=1.0 / ratio, r=1.0)) for ratio in RATIOS)
    rmse = [np.sqrt(np.mean((x - truth)[SETTLING:] ** 2)) for x in filtered]
    best, advised = int(np.argmin(rmse)), float(rmse[np.argmin(np.abs(np.log(RATIOS / ADVISED)))])
    return {
        "kind": kind,
        "best_ratio": float(RATIOS[best]),  # 1e5 means: the largest one tried
        "best_rmse": float(rmse[best]),
        "advised_rmse": advised,
        "loss": advised / float(rmse[best]),
        "raw_rmse": float(np.sqrt(np.mean((z - truth)[SETTLING:] ** 2))),  # no filter at all; its mean error is 0
    }


def swinging_rmse(ratio: float) -> float:
    """RMSE of the settled filter on the swinging signal, u, from its frequency response.

    With a = 1 − K the share of a sine that is lost is |a (1 − e^−iω)/(1 − a e^−iω)|; noise adds K/(2 − K).
    """
    gain = float(steady_state(FilterParams(q=1.0 / ratio, r=1.0)).gain)
    turn = cmath.exp(-2j * math.pi / SWING_PERIOD)
    lost = abs((1.0 - gain) * (1.0 - turn) / (1.0 - (1.0 - gain) * turn))
    return math.hypot(SWING * lost / math.sqrt(2.0), theoretical_rmse(1.0 / ratio, SIGMA))


def _figure_1() -> Block:
    z = robot_signal()
    panel = Panel("Resting robot, raw", (Line(np.arange(600), z[:600], "raw", "raw"),), "sample", "counts")
    return PROSE.figure("figure_1", [panel], low=z.min(), high=z.max(), mean=z.mean(), spread=z.std())


def _figures_3_to_8() -> Block:
    z = white_noise(1)[:, 0]
    panels: list[Panel] = []
    for figure, r, q in SIMULATED_FIGURES:
        lines = raw_and_filtered(np.arange(len(z)), z, denoise(z, FilterParams(q=q, r=r, p0=0.0, x0=0.0)))
        title = f"Figure {figure}: R = {r:g}, Q = {q:g} (ratio {r / q:g})"
        panels.append(Panel(title, lines, "sample", "value", (-220.0, 220.0)))
    return PROSE.figure("figures_3_to_8", panels, sigma=SIGMA)


def _figures_9_and_10() -> Block:
    z = robot_signal()
    panels: list[Panel] = []
    words: list[str] = []
    for _, title, r, q in ROBOT_FIGURES:
        x = denoise(z, _robot(r, q)[1])
        for start, stop, limits in ((0, 500, (0.0, 400.0)), (1000, 1500, (290.0, 390.0))):
            lines = raw_and_filtered(np.arange(start, stop), z[start:stop], x[start:stop])
            panels.append(Panel(f"{title}: R = {r:g}, Q = {q:g}", lines, "sample", "counts", limits))
        late = int(np.flatnonzero(np.abs(x - z.mean()) > 0.05 * z.mean())[-1]) + 1
        less = z[1000:].std() / x[1000:].std()
        words.append(f"{title}: {late} samples until within 5 %, then {less:.1f} times less noise")
    return PROSE.figure("figures_9_and_10", panels, numbers="; ".join(words))


def chapter(report: OnProgress) -> Chapter:
    """Everything of this paper, drawn and checked."""
    report(0.0, "Table 1")
    table, start = simulate_table(TABLE_DRAWS), question_the_start(TABLE_DRAWS)
    report(0.4, "the advice on three kinds of signal")
    advice = [try_advice(kind, ADVICE_DRAWS) for kind in ("stationary", "wandering", "swinging")]
    report(0.8, "figures 1 to 10")
    worst, row_2 = max(abs(row["off"]) for row in table), theoretical_mean_error(0.1, SIGMA)
    best = ["≥ 100,000" if test["best_ratio"] >= RATIOS[-1] else f"{test['best_ratio']:.3g}" for test in advice]
    return PROSE.chapter(
        blocks=(
            _figure_1(),
            PROSE.figure("figure_2"),
            _figures_3_to_8(),
            PROSE.table("table_1", table, sigma=SIGMA, samples=SAMPLES, draws=TABLE_DRAWS, worst=worst),
            PROSE.table("start", [start]),
            PROSE.table("advice", ({**test, "best": text} for test, text in zip(advice, best, strict=True))),
            _figures_9_and_10(),
        ),
        checks=_checks(table, start, advice, row_2),
    )


def _checks(
    table: Sequence[dict[str, Any]], start: dict[str, float], advice: Sequence[dict[str, Any]], row_2: float
) -> tuple[Check, ...]:
    still, wander, swing = advice
    swing_theory, still_theory = swinging_rmse(ADVISED), theoretical_rmse(1.0 / ADVISED, SIGMA)
    middle, half = 0.5 * sum(RULE), 0.5 * (RULE[1] - RULE[0])
    rows = [
        Check(
            f"Table 1, row {row['i']} (R = {row['r']:g}, Q = {row['q']:g}): mean error, {word}",
            row[key],
            row["printed"],
            0.02,
            relative=True,
        )
        for row in table
        for word, key in (("simulated", "simulated"), ("theory", "theoretical"))
    ]
    return (
        *rows,
        Check("Rows 3 and 4 from p0 = 0: difference", start["p0_zero"], 0.0, 1e-9),
        Check("Rows 3 and 4 from p0 = 1, 100 samples: difference", start["p0_one"], 0.45, 0.03),
        Check("Stationary signal: best ratio is the largest tried", still["best_ratio"], 1e5, 0.0),
        Check("Signal that wanders with r/q = 100: RMSE at 100 over the best", wander["loss"], 1.0, 0.01),
        Check("Signal that swings: RMSE at ratio 100", swing["advised_rmse"], swing_theory, 0.02, relative=True),
        Check("Stationary signal: RMSE at ratio 100", still["advised_rmse"], still_theory, 0.03, relative=True),
        Check("Rule 40 to 55 admits ratio 10: its mean error", row_2, middle, half),
    )
