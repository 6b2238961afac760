"""The chapter of the page on Ma'arif et al. (2019): figures 1–10, Table 1, the advice, the appendices."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np

from kalscope.common.array import Array
from kalscope.filtering.batch import kalman_filter
from kalscope.filtering.params import FilterParams
from kalscope.papers.appendices import arduino_appendix, matlab_appendix
from kalscope.papers.maarif_2019 import paper
from kalscope.papers.maarif_2019.figures import advice_figure, figure_1, figure_2, figures_3_to_8, figures_9_and_10
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
from kalscope.papers.parts import Chapter, Check, Effort, ResultTable

if TYPE_CHECKING:
    from collections.abc import Sequence

    from kalscope.common.progress import OnProgress
    from kalscope.papers.maarif_2019.paper import StartClue, TableRow

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
    return Chapter(
        key="noise_reducer",
        title="Kalman Filter for Noise Reducer on Sensor Readings",
        citation="A. Ma'arif, Iswanto, A. A. Nuryono, R. I. Alfian, 2019. Equations (11)–(15).",
        intro=(
            "The five lines of this paper are the filter of Kalscope: predict x and p + Q, then gain, value and"
            " variance. The paper tries six pairs (R, Q) on a noise it does not state, and recommends R = 100 Q.",
        ),
        blocks=(
            figure_1(),
            figure_2(),
            figures_3_to_8(),
            table_1(table, effort.table_draws),
            _start_table(clue),
            advice_figure(advice),
            _advice_table(advice),
            _rule_table(rule),
            figures_9_and_10(),
            _appendix_table(same),
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
        Check("Signal at rest: best ratio is the largest tried", still.best_ratio, 1e5, 0.0),
        Check("Signal that wanders with r/q = 100: RMSE at 100 over the best", wander.loss, 1.0, 0.01),
        Check(
            "Signal that swings: RMSE at ratio 100", swing.advised_rmse, swinging_rmse(ADVISED), 0.02, relative=True
        ),
        Check("Signal at rest: RMSE at ratio 100", still.advised_rmse, theoretical_rmse, 0.03, relative=True),
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
    cells = tuple(
        (
            str(i),
            f"{row.r:g}",
            f"{row.q:g}",
            f"{row.r / row.q:g}",
            f"{row.printed:.4f}",
            f"{row.simulated:.4f}",
            f"{row.theoretical:.4f}",
            f"{100 * (row.simulated / row.printed - 1):+.2f} %".replace("-", "−"),
            f"{row.simulated_p0_1:.4f}",
            f"{row.rmse:.2f}",
            f"{row.rmse_theoretical:.2f}",
        )
        for i, row in enumerate(rows, 1)
    )
    worst = max(abs(row.simulated / row.printed - 1) for row in rows)
    return ResultTable(
        "Table 1: mean error, printed, simulated and from theory",
        (
            "row",
            "R",
            "Q",
            "R/Q",
            "printed",
            "simulated",
            "theory",
            "sim. − printed",
            "from p0 = 1",
            "RMSE",
            "RMSE, theory",
        ),
        cells,
        f"White noise of standard deviation {paper.SIGMA:g} around 0, {paper.SAMPLES} samples, average over {draws}"
        " draws, start x = 0, p0 = 0 (one column: p0 = 1). Theory: c·σ·(1 − K)·√(2/(2 − K)), c = √(2/π), settled"
        " filter. The last two columns are the RMSE against the known truth, simulated and σ·√(K/(2 − K)). The"
        " noise of the appendix, (rand − rand)·100, has a standard deviation of only 40.8: it is not the table's.",
        f"All five rows agree within {100 * worst:.1f} %. But a single signal of 100 samples scatters by about 8 %,"
        " and the mean error is a distance to the raw signal: no filter at all would score 0, the best. The RMSE"
        " against the truth falls from row to row, in the opposite order.",
    )


def _start_table(clue: StartClue) -> ResultTable:
    rows = (
        ("printed, row 4 − row 3", f"{clue.printed:.4f}"),
        ("p0 = 0, 100 samples", f"{clue.p0_zero:.1g} at most (rounding)"),
        ("p0 = 1, 100 samples", f"{clue.p0_one:.2f} ± {clue.p0_one_spread:.2f}"),
        ("p0 = 1: draws at most as far apart as printed", f"{100 * clue.share:.1f} %"),
        ("each row on a signal of its own", f"0 ± {clue.own_signals_spread:.1f}"),
        ("p0 that gives the printed difference over 100 samples", f"{clue.p0_needed:.4f}"),
        ("samples after which p0 = 1 gives it", f"about {round(clue.samples_needed, -2):,.0f}"),
    )
    return ResultTable(
        "Rows 3 and 4: the same ratio, so what start?",
        ("case", "difference of the mean errors"),
        rows,
        "Rows 3 and 4 have the ratio 100 both, so their settled filters are one and the same; only p0, which is not"
        " scaled with them, can tell them apart.",
        "Neither start of the paper gives 0.0075: from p0 = 0 the rows are equal, from p0 = 1 they differ"
        " sixtyfold. Both rows were made on one signal, started near 0 or much longer than 100 samples.",
    )


def _advice_table(tests: Sequence[AdviceTest]) -> ResultTable:
    rows = tuple(
        (
            test.kind,
            "≥ 100,000" if test.best_ratio >= RATIOS[-1] else f"{test.best_ratio:.3g}",
            f"{test.best_rmse:.1f}",
            f"{test.advised_rmse:.1f}",
            f"{test.loss:.2f} ×",
            f"{test.raw_rmse:.1f}",
        )
        for test in tests
    )
    return ResultTable(
        "“The recommended ratio is 100”",
        ("signal", "best R/Q", "RMSE there", "RMSE at 100", "worse by", "RMSE raw"),
        rows,
        "RMSE against the known truth, settled filter, average over draws.",
        "100 is right for a signal that wanders by a tenth of the noise each sample, and a fair first try. At"
        " rest a larger ratio is five times better; on a fast swing 100 is twice as bad as no filter at all.",
    )


def _rule_table(rule: RuleTest) -> ResultTable:
    rows = (
        ("R/Q admitted at σ = 72", f"{rule.ratios[0]:.2g} to {rule.ratios[1]:.0f}"),
        ("mean error of ratio 10, called too aggressive", f"{rule.row_2:.1f}: admitted"),
        ("σ below which no filter reaches 40", f"{rule.sigma_too_small:.1f}"),
        ("σ above which even ratio 100 is refused", f"{rule.sigma_too_large:.1f}"),
    )
    return ResultTable(
        "“Good parameters have a mean error of 40 to 55”",
        ("question", "answer"),
        rows,
        "White noise around a constant, by the formula of the mean error.",
        "The rule holds for this noise only: it is 0.56 to 0.76 σ in disguise, it spans a factor of 66 in the"
        " ratio, and it admits the row that the paper itself calls too aggressive.",
    )


def _appendix_table(same: dict[str, float]) -> ResultTable:
    rows = (
        ("a. MATLAB, 100 samples of its own noise", "double", f"{same['matlab']:.1g}"),
        ("b. Arduino, resting robot", "double", f"{same['arduino_double']:.1g} counts"),
        ("b. Arduino, resting robot", "float", f"{same['arduino_float']:.1g} counts"),
    )
    return ResultTable(
        "The appendices, line for line",
        ("program", "numbers", "largest difference"),
        rows,
        "Each program, transcribed line for line, against kalman_filter with R = 100, Q = 1. The tests also run"
        " the MATLAB program in Octave and the Arduino program through a C++ compiler. Its own noise gives a mean"
        f" error of {same['matlab_mean_error']:.1f} at ratio 100, not 53.4.",
        "The same filter: in double to the last digit or so, in the Arduino's float to a thousandth of a count.",
    )


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
