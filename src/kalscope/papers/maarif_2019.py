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
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from kalscope.common.charts import Line, Panel, raw_and_filtered
from kalscope.common.numbers import Array, bisect
from kalscope.common.progress import OnProgress
from kalscope.filtering.filter import denoise, kalman_filter
from kalscope.filtering.params import FilterParams
from kalscope.filtering.steady import steady_state
from kalscope.papers.parts import Chapter, Check, Effort, Experiment, Figure, Prose
from kalscope.recording import Recording
from kalscope.sources.samples import open_sample

PAPER = "Kalman Filter for Noise Reducer on Sensor Readings (Ma'arif et al. 2019)"
PROSE = Prose(__name__)
SAMPLES = 100
"""Length of the simulated signals: the appendix's loop."""
SIGMA = 72.0
"""Standard deviation of the white noise that gives Table 1, u."""
SEED = 2019

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
ROBOT_FIGURES = (("9", 10.0, 0.1), ("10", 100.0, 0.1), ("10_text", 10.0, 0.01))
"""Figure, R, Q on the resting robot; figure 10 by its caption, then by the text."""


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


def white_noise(draws: int, samples: int = SAMPLES, sigma: float = SIGMA, seed: int = SEED) -> Array:
    """Gaussian white noise around 0, shape (samples, draws), in u."""
    return sigma * np.random.default_rng(seed).standard_normal((samples, draws))


def appendix_signal(samples: int = SAMPLES, seed: int = SEED) -> Array:
    """The MATLAB appendix's zk = (rand − rand)·100, shape (samples,), σ = 100/√6."""
    rng = np.random.default_rng(seed)
    return (rng.random(samples) - rng.random(samples)) * 100.0


def simulate_table(draws: int) -> list[dict[str, float]]:
    """Table 1 over `draws` signals of 100 samples of white noise, σ = 72 around 0; the same ones for all rows.

    The mean error is that of the start x = 0, p0 = 0 of the MATLAB appendix, and of p0 = 1 as in section 2.3.
    """
    z = white_noise(draws)
    rows: list[dict[str, float]] = []
    for r, q, printed in PRINTED:
        x = kalman_filter(z, FilterParams(q=q, r=r, p0=0.0, x0=0.0)).x
        started_at_1 = kalman_filter(z, FilterParams(q=q, r=r, p0=1.0, x0=0.0)).x
        row = {"r": r, "q": q, "printed": printed}
        row |= {"simulated": mean_error(z, x), "theoretical": theoretical_mean_error(q / r, SIGMA)}
        row |= {"simulated_p0_1": mean_error(z, started_at_1), "rmse": float(np.sqrt(np.mean(x * x)))}
        rows.append({**row, "rmse_theoretical": theoretical_rmse(q / r, SIGMA)})
    return rows


def question_the_start(draws: int) -> dict[str, Any]:
    """What rows 3 and 4, of one ratio, reveal about the start that the paper does not state, over `draws` signals.

    The difference row 4 − row 3 as printed, and for both starts; p0 = 1 comes as close to 0 as printed in a `share`
    of the draws, and `p0_needed`, or p0 = 1 and `samples_needed`, give the printed one on average.
    """
    z = white_noise(draws)
    printed = PRINTED[3][2] - PRINTED[2][2]
    zero, one = _row_difference(z, 0.0), _row_difference(z, 1.0)
    some = z[:, :400]
    low, high = bisect(lambda p0: bool(_row_difference(some, p0).mean() < printed), 0.0, 1.0, 16)  # grows with p0
    # What the start adds to the sum of |z − x| is spent after a few time constants; the mean dilutes it as 1/n.
    longer = white_noise(max(draws // 10, 20), samples=1000, seed=SEED + 1)
    errors = np.abs(z - kalman_filter(z, FilterParams(q=0.01, r=1.0, p0=0.0, x0=0.0)).x).mean(axis=0)
    return {
        "printed": printed,
        "p0_zero": float(np.abs(zero).max()),  # nothing but rounding
        "p0_one": float(one.mean()),
        "p0_one_spread": float(one.std()),
        "share": float(np.mean(np.abs(one) <= printed)),
        "own_signals_spread": math.sqrt(2.0) * float(errors.std()),  # if each row had a signal of its own
        "p0_needed": 0.5 * (low + high),
        "samples_needed": 1000.0 * float(_row_difference(longer, 1.0).mean()) / printed,
    }


def _row_difference(z: Array, p0: float) -> Array:
    """Mean error of row 4 − row 3 for each signal, shape (draws,)."""
    errors = [
        np.abs(z - kalman_filter(z, FilterParams(q=q, r=r, p0=p0, x0=0.0)).x).mean(axis=0)
        for r, q, _ in PRINTED[2:4]
    ]
    return errors[1] - errors[0]


def constant_in_noise(values: Array) -> Recording:
    """Noise around the constant truth 0, one channel, one sample per second."""
    time, z = np.arange(len(values), dtype=np.float64), values[:, None]
    return Recording(time, ("signal",), ("",), z, 1.0, truth=np.zeros_like(z))


def robot_recording() -> Recording:
    """The accelerometer of figures 1, 9 and 10, re-created: 2000 samples, counts."""
    return open_sample("balancing_robot")


@cache
def robot_signal() -> Array:
    """Its readings, counts, shape (2000,); shared, so not to be changed."""
    return robot_recording().values[:, 0]


def _simulation(figure: int, r: float, q: float) -> Experiment:
    name, title = f"noise_reducer_figure_{figure}", f"Figure {figure}: R = {r:g}, Q = {q:g}"
    says = {3: "hardly filtered", 4: "filtered a little", 5: "still jumpy", 6: "the paper's choice", 8: "too much"}
    summary = f"White noise of standard deviation 72; ratio {r / q:g}: {says.get(figure, 'like figure 6')}."
    params = FilterParams(q=q, r=r, p0=0.0, x0=0.0)
    where = f"Figure {figure}"
    return Experiment(name, title, PAPER, where, summary, lambda: (constant_in_noise(white_noise(1)[:, 0]), params))


def _robot(label: str, r: float, q: float) -> Experiment:
    figure = label.removesuffix("_text")
    source = {"10": ", as captioned", "10_text": ", as in the text"}.get(label, "")
    name, title = f"noise_reducer_figure_{label}", f"Figure {figure}: resting robot, R = {r:g}, Q = {q:g}{source}"
    summary = f"10-bit accelerometer on a stationary robot, ratio {r / q:g}, started at 0 as on the Arduino."
    params = FilterParams(q=q, r=r, p0=1.0, x0=0.0)
    return Experiment(name, title, PAPER, f"Figure {figure}", summary, lambda: (robot_recording(), params))


EXPERIMENTS = (
    *(_simulation(*row) for row in SIMULATED_FIGURES),
    *(_robot(*row) for row in ROBOT_FIGURES),
    Experiment(
        "noise_reducer_appendix",
        "Appendix: R = 100, Q = 1, (rand − rand)·100",
        PAPER,
        "Appendix a",
        "The MATLAB program with its own noise, of standard deviation 40.8.",
        lambda: (constant_in_noise(appendix_signal()), FilterParams(q=1.0, r=100.0, p0=0.0, x0=0.0)),
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
    """A kind of signal, filtered with each of RATIOS; errors in u, averages over draws of noise and walk."""
    rng = np.random.default_rng(100)
    truth = truth_of(kind, draws, rng)
    z = truth + SIGMA * rng.standard_normal(truth.shape)
    rmse, mean_error = np.empty(len(RATIOS)), np.empty(len(RATIOS))
    for i, ratio in enumerate(RATIOS):
        x = denoise(z, FilterParams(q=1.0 / ratio, r=1.0))
        rmse[i] = np.sqrt(np.mean((x - truth)[SETTLING:] ** 2))
        mean_error[i] = np.mean(np.abs(x - z)[SETTLING:])
    best = int(np.argmin(rmse))
    return {
        "kind": kind,
        "best_ratio": float(RATIOS[best]),  # 1e5 means: the largest one tried
        "best_rmse": float(rmse[best]),
        "advised_rmse": float(rmse[np.argmin(np.abs(np.log(RATIOS / ADVISED)))]),
        "raw_rmse": float(np.sqrt(np.mean((z - truth)[SETTLING:] ** 2))),  # no filter at all; its mean error is 0
        "ratios": RATIOS.tolist(),
        "rmse": rmse.tolist(),
        "mean_error": mean_error.tolist(),
    }


def loss(test: dict[str, Any]) -> float:
    """How many times larger the RMSE is at the advised ratio than at the best one."""
    return test["advised_rmse"] / test["best_rmse"]


def swinging_rmse(ratio: float) -> float:
    """RMSE of the settled filter on the swinging signal, u, from its frequency response.

    With a = 1 − K the share of a sine that is lost is |a (1 − e^−iω)/(1 − a e^−iω)|; noise adds K/(2 − K).
    """
    gain = float(steady_state(FilterParams(q=1.0 / ratio, r=1.0)).gain)
    turn = cmath.exp(-2j * math.pi / SWING_PERIOD)
    lost = abs((1.0 - gain) * (1.0 - turn) / (1.0 - (1.0 - gain) * turn))
    return math.sqrt((SWING * lost) ** 2 / 2.0 + SIGMA**2 * gain / (2.0 - gain))


def judge_rule() -> dict[str, Any]:
    """Which settled filters the rule of thumb admits on white noise around a constant.

    The lowest and the highest r/q at σ = 72; the mean error of Table 1's row 2, which the text calls too
    aggressive; the σ below which no filter reaches 40, and the one at which ratio 100 exceeds the rule.
    """
    low, high = RULE
    return {
        "ratios": (_ratio_of(low, SIGMA), _ratio_of(high, SIGMA)),
        "row_2": theoretical_mean_error(0.1, SIGMA),
        "sigma_too_small": low / math.sqrt(2.0 / math.pi),  # K → 0: the mean error is c σ at most
        "sigma_too_large": high / theoretical_mean_error(1.0 / ADVISED, 1.0),
    }


def _ratio_of(mean_error: float, sigma: float) -> float:
    """The r/q whose settled filter has this mean error on white noise; it grows with the ratio."""
    low, high = bisect(lambda place: theoretical_mean_error(10.0**-place, sigma) < mean_error, -6.0, 12.0)
    return 10.0 ** (0.5 * (low + high))


def figure_1() -> Figure:
    """Figure 1: the raw resting robot."""
    z = robot_signal()
    lines = (Line(np.arange(600), z[:600], "raw", "raw"),)
    panel = Panel("Resting robot, raw", lines, "sample", "ADC reading / counts")
    numbers = {"low": z.min(), "high": z.max(), "mean": z.mean(), "spread": z.std()}
    return PROSE.figure("figure_1", [panel], **numbers)


def figures_3_to_8() -> Figure:
    """Figures 3–8: six pairs (R, Q) on one draw of the noise."""
    z = white_noise(1)[:, 0]
    panels: list[Panel] = []
    for figure, r, q in SIMULATED_FIGURES:
        x = denoise(z, FilterParams(q=q, r=r, p0=0.0, x0=0.0))
        title = f"Figure {figure}: R = {r:g}, Q = {q:g} (ratio {r / q:g})"
        lines = raw_and_filtered(np.arange(len(z)), z, x)
        panels.append(Panel(title, lines, "sample", "value", (-220.0, 220.0)))
    return PROSE.figure("figures_3_to_8", panels, sigma=SIGMA)


def figures_9_and_10() -> Figure:
    """Figures 9 and 10, the latter by its caption and by the text: start and settled filter."""
    z = robot_signal()
    panels: list[Panel] = []
    words: list[str] = []
    for label, r, q in ROBOT_FIGURES:
        x = denoise(z, FilterParams(q=q, r=r, p0=1.0, x0=0.0))  # Pt_prev = 1 and Xt_prev = 0, as on the Arduino
        source = {"9": "Figure 9", "10": "Figure 10, caption", "10_text": "Figure 10, text"}[label]
        title = f"{source}: R = {r:g}, Q = {q:g}"
        for start, stop, limits in ((0, 500, (0.0, 400.0)), (1000, 1500, (290.0, 390.0))):
            at = np.arange(start, stop)
            panels.append(Panel(title, raw_and_filtered(at, z[at], x[at]), "sample", "counts", limits))
        late = int(np.flatnonzero(np.abs(x - z.mean()) > 0.05 * z.mean())[-1]) + 1
        less = z[1000:].std() / x[1000:].std()
        words.append(f"{source}: {late} samples until within 5 %, then {less:.1f} times less noise")
    return PROSE.figure("figures_9_and_10", panels, numbers="; ".join(words))


def advice_figure(tests: Sequence[dict[str, Any]]) -> Figure:
    """RMSE and mean error over the ratio for the three kinds of signal."""
    panels: list[Panel] = []
    for test, title in zip(tests, ("stationary", "wandering, true r/q = 100", "swinging, 60 samples"), strict=True):
        lines = (
            Line(RATIOS, test["rmse"], "RMSE against the truth", "s1"),
            Line(RATIOS, test["mean_error"], "mean error against the raw signal", "s2"),
            Line((ADVISED, ADVISED), (0.0, 160.0), "advised: R/Q 100, mean error 40 to 55", "truth"),
            *(
                Line((RATIOS[0], RATIOS[-1]), (at, at), "advised: R/Q 100, mean error 40 to 55", "truth")
                for at in RULE
            ),
        )
        panels.append(Panel(title, lines, "R/Q", "error", (0.0, 160.0), log_x=True))
    return PROSE.figure("advice_figure", panels, sigma=SIGMA)


TABLE_TOLERANCE = 0.02
"""Simulated against printed, and against theory, as a share."""


def chapter(effort: Effort, report: OnProgress) -> Chapter:
    """Everything of this paper, drawn and checked."""
    report(0.0, "Table 1")
    table = simulate_table(effort.table_draws)
    report(0.2, "rows 3 and 4 of Table 1")
    clue = question_the_start(effort.table_draws)
    report(0.5, "the advice on three kinds of signal")
    advice = [try_advice(kind, effort.limit_draws) for kind in ("stationary", "wandering", "swinging")]
    rule = judge_rule()
    report(0.9, "figures 1 to 10")
    return PROSE.chapter(
        blocks=(
            figure_1(),
            PROSE.figure("figure_2"),
            figures_3_to_8(),
            table_1(table, effort.table_draws),
            PROSE.table("start", percent=100 * clue["share"], about=round(clue["samples_needed"], -2), **clue),
            advice_figure(advice),
            _advice_table(advice),
            PROSE.table("rule", **rule),
            figures_9_and_10(),
        ),
        checks=checks(table, clue, advice, rule),
        results={
            "sigma": SIGMA,
            "table_1": table,
            "rows_3_and_4": clue,
            "ratio_100": advice,
            "mean_error_40_to_55": rule,
        },
    )


def checks(
    table: Sequence[dict[str, float]],
    clue: dict[str, float],
    advice: Sequence[dict[str, Any]],
    rule: dict[str, Any],
) -> tuple[Check, ...]:
    """Every number of this chapter that must hold, with its tolerance."""
    rows: list[Check] = []
    for i, row in enumerate(table, 1):
        name = f"Table 1, row {i} (R = {row['r']:g}, Q = {row['q']:g}): mean error"
        for word, key in (("simulated", "simulated"), ("theory", "theoretical")):
            rows.append(Check(f"{name}, {word}", row[key], row["printed"], TABLE_TOLERANCE, relative=True))
    still, wander, swing = advice
    swing_theory, still_theory = swinging_rmse(ADVISED), theoretical_rmse(1.0 / ADVISED, SIGMA)
    middle, half = 0.5 * sum(RULE), 0.5 * (RULE[1] - RULE[0])
    return (
        *rows,
        Check("Rows 3 and 4 from p0 = 0: difference", clue["p0_zero"], 0.0, 1e-9),
        Check("Rows 3 and 4 from p0 = 1, 100 samples: difference", clue["p0_one"], 0.45, 0.03),
        Check("Stationary signal: best ratio is the largest tried", still["best_ratio"], 1e5, 0.0),
        Check("Signal that wanders with r/q = 100: RMSE at 100 over the best", loss(wander), 1.0, 0.01),
        Check("Signal that swings: RMSE at ratio 100", swing["advised_rmse"], swing_theory, 0.02, relative=True),
        Check("Stationary signal: RMSE at ratio 100", still["advised_rmse"], still_theory, 0.03, relative=True),
        Check("Rule 40 to 55 admits ratio 10: its mean error", rule["row_2"], middle, half),
    )


def table_1(rows: Sequence[dict[str, float]], draws: int) -> Figure:
    """Table 1 with the printed, simulated and theoretical mean error side by side."""
    off = [100 * (row["simulated"] / row["printed"] - 1) for row in rows]
    cells = [
        {**row, "i": i + 1, "ratio": row["r"] / row["q"], "off": f"{off[i]:+.2f}".replace("-", "−")}
        for i, row in enumerate(rows)
    ]
    worst = max(map(abs, off))
    return PROSE.table("table_1", cells, sigma=SIGMA, samples=SAMPLES, draws=draws, worst=worst)


def _advice_table(tests: Sequence[dict[str, Any]]) -> Figure:
    def best(ratio: float) -> str:
        return "≥ 100,000" if ratio >= RATIOS[-1] else f"{ratio:.3g}"

    rows = ({**test, "loss": loss(test), "best": best(test["best_ratio"])} for test in tests)
    return PROSE.table("advice", rows)
