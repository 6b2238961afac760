"""The chapter of the page on Ma'arif et al. (2019): figures 1–10, Table 1, the advice, the appendices."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from kalscope.common.array import Array
from kalscope.common.progress import OnProgress
from kalscope.filtering.filter import kalman_filter
from kalscope.filtering.params import FilterParams
from kalscope.papers.appendices import arduino_appendix, matlab_appendix
from kalscope.papers.maarif_2019 import paper
from kalscope.papers.maarif_2019.figures import (
    PROSE,
    advice_figure,
    figure_1,
    figure_2,
    figures_3_to_8,
    figures_9_and_10,
)
from kalscope.papers.maarif_2019.limits import (
    ADVISED,
    RATIOS,
    RULE,
    AdviceTest,
    RuleTest,
    judge_rule,
    swinging_rmse,
    try_advice,
)
from kalscope.papers.maarif_2019.paper import StartClue, TableRow
from kalscope.papers.parts import Chapter, Check, Effort, ResultTable

TABLE_TOLERANCE = 0.02
"""Simulated against printed, and against theory, as a share."""


def chapter(effort: Effort, report: OnProgress) -> Chapter:
    """Everything of this paper, drawn and checked."""
    report(0.0, "Table 1")
    table = paper.simulate_table(effort.table_draws)
    report(0.2, "rows 3 and 4 of Table 1")
    clue = paper.question_the_start(effort.table_draws)
    report(0.5, "the advice on three kinds of signal")
    advice, rule = try_advice(effort.limit_draws), judge_rule()
    report(0.9, "figures 1 to 10")
    same = compare_appendices()
    return PROSE.chapter(
        blocks=(
            figure_1(),
            figure_2(),
            figures_3_to_8(),
            table_1(table, effort.table_draws),
            PROSE.table("start", percent=100 * clue.share, about=round(clue.samples_needed, -2), **asdict(clue)),
            advice_figure(advice),
            _advice_table(advice),
            PROSE.table("rule", **asdict(rule)),
            figures_9_and_10(),
            PROSE.table("appendix", [{}], **same),
        ),
        checks=checks(table, clue, advice, rule, same),
        results={
            "sigma": paper.SIGMA,
            "table_1": [asdict(row) for row in table],
            "rows_3_and_4": asdict(clue),
            "ratio_100": [_advice_result(test) for test in advice],
            "mean_error_40_to_55": asdict(rule),
            "appendices": same,
        },
    )


def checks(
    table: Sequence[TableRow],
    clue: StartClue,
    advice: Sequence[AdviceTest],
    rule: RuleTest,
    same: dict[str, float],
) -> tuple[Check, ...]:
    """Every number of this chapter that must hold, with its tolerance."""
    rows: list[Check] = []
    for i, row in enumerate(table, 1):
        name = f"Table 1, row {i} (R = {row.r:g}, Q = {row.q:g}): mean error"
        rows.append(Check(f"{name}, simulated", row.simulated, row.printed, TABLE_TOLERANCE, relative=True))
        rows.append(Check(f"{name}, theory", row.theoretical, row.printed, TABLE_TOLERANCE, relative=True))
    still, wander, swing = advice
    theoretical_rmse = paper.theoretical_rmse(1.0 / ADVISED, paper.SIGMA)
    return (
        *rows,
        Check("Rows 3 and 4 from p0 = 0: difference", clue.p0_zero, 0.0, 1e-9),
        Check("Rows 3 and 4 from p0 = 1, 100 samples: difference", clue.p0_one, 0.45, 0.03),
        Check("Stationary signal: best ratio is the largest tried", still.best_ratio, 1e5, 0.0),
        Check("Signal that wanders with r/q = 100: RMSE at 100 over the best", wander.loss, 1.0, 0.01),
        Check(
            "Signal that swings: RMSE at ratio 100", swing.advised_rmse, swinging_rmse(ADVISED), 0.02, relative=True
        ),
        Check("Stationary signal: RMSE at ratio 100", still.advised_rmse, theoretical_rmse, 0.03, relative=True),
        Check("Rule 40 to 55 admits ratio 10: its mean error", rule.row_2, sum(RULE) / 2, (RULE[1] - RULE[0]) / 2),
        Check("MATLAB appendix, largest difference", same["matlab"], 0.0, 1e-12),
        Check("Arduino appendix in double, largest difference / 338", same["arduino_double"] / 338.0, 0.0, 1e-12),
        Check("Arduino appendix in float, largest difference in counts", same["arduino_float"], 0.0, 1e-3),
    )


def compare_appendices() -> dict[str, float]:
    """Largest |appendix − kalman_filter|, in the unit of the signal: u, and counts for the Arduino."""
    z, counts = paper.appendix_signal(), paper.robot_signal()
    matlab = kalman_filter(z, FilterParams(q=1.0, r=100.0, p0=0.0, x0=0.0)).x
    arduino = kalman_filter(counts, FilterParams(q=1.0, r=100.0, p0=1.0, x0=0.0)).x
    return {
        "matlab": _largest(matlab_appendix(z) - matlab),
        "arduino_double": _largest(arduino_appendix(counts) - arduino),
        "arduino_float": _largest(arduino_appendix(counts, number=np.float32) - arduino),
        "matlab_sigma": 100.0 / 6.0**0.5,
        "matlab_mean_error": paper.mean_error(z, matlab),
    }


def table_1(rows: Sequence[TableRow], draws: int) -> ResultTable:
    """Table 1 with the printed, simulated and theoretical mean error side by side."""
    off = [100 * (row.simulated / row.printed - 1) for row in rows]
    cells = [
        {**asdict(row), "i": i + 1, "ratio": row.r / row.q, "off": f"{off[i]:+.2f}".replace("-", "−")}
        for i, row in enumerate(rows)
    ]
    worst = max(map(abs, off))
    return PROSE.table("table_1", cells, sigma=paper.SIGMA, samples=paper.SAMPLES, draws=draws, worst=worst)


def _advice_table(tests: Sequence[AdviceTest]) -> ResultTable:
    def best(ratio: float) -> str:
        return "≥ 100,000" if ratio >= RATIOS[-1] else f"{ratio:.3g}"

    rows = ({**vars(test), "loss": test.loss, "best": best(test.best_ratio)} for test in tests)
    return PROSE.table("advice", rows)


def _advice_result(test: AdviceTest) -> dict[str, Any]:
    numbers = {key: value for key, value in asdict(test).items() if not isinstance(value, np.ndarray)}
    return {
        **numbers,
        "ratios": RATIOS.tolist(),
        "rmse": test.rmse.tolist(),
        "mean_error": test.mean_error.tolist(),
    }


def _largest(values: Array) -> float:
    return float(np.max(np.abs(values)))
