"""The chapter of the page on interactive matter (2009): the walk through q and r, the listing, three answers."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from kalscope.common.charts import Line, Panel, draw_svg
from kalscope.filtering.batch import denoise, kalman_filter
from kalscope.papers.appendices import c_listing
from kalscope.papers.interactive_matter_2009 import document as paper
from kalscope.papers.interactive_matter_2009 import questions
from kalscope.papers.page.prose import Prose
from kalscope.papers.parts import Check

if TYPE_CHECKING:
    from collections.abc import Sequence

    from kalscope.common.progress import OnProgress
    from kalscope.papers.interactive_matter_2009.document import WalkRow
    from kalscope.papers.interactive_matter_2009.questions import EstimateAnswer, ExponentialAnswer, FusionAnswer
    from kalscope.papers.parts import Chapter, Effort, Figure, ResultTable

PROSE = Prose(Path(__file__).parent / "chapter.toml")


def chapter(effort: Effort, report: OnProgress) -> Chapter:
    """Everything of this document, drawn and checked."""
    report(0.0, "the walk through q and r")
    walk = paper.try_walk()
    report(0.1, "estimating q and r")
    estimated = questions.answer_estimation(effort.estimate_draws)
    report(0.8, "two sensors, the listing, the figures")
    fused = questions.answer_fusion()
    simple = tuple(questions.answer_exponential(q, r) for _, q, r in paper.WALK)
    listing = listing_difference()
    return PROSE.chapter(
        blocks=(
            _walk_figure(),
            _walk_table(walk),
            _axes_figure(),
            _estimate_table(estimated, effort.estimate_draws),
            _fusion_table(fused),
            _exponential_table(simple),
            _exponential_figure(),
        ),
        checks=(
            Check("C listing, three axes, six settings: samples that differ", listing, 0.0, 0.0),
            Check("q = 128: noise left, as a share", walk[0].noise_left, 1.0, 0.05),
            Check("q estimated, median", estimated.q_median, questions.TRUE_Q, 0.1, relative=True),
            Check("r estimated, median", estimated.r_median, questions.TRUE_R, 0.03, relative=True),
            Check("RMSE with the estimated pair over the true one", estimated.loss, 1.0, 0.02),
            Check("Two sensors fused: RMSE", fused.fused, fused.fused_theory, 0.05, relative=True),
            Check("Fused, against the filter of the weighted mean", fused.difference, 0.0, 1e-9),
            Check("Exponential filter, worst of the walk, last half", max(a.at_end for a in simple), 0.0, 1e-6),
        ),
        results={
            "walk": [asdict(row) for row in walk],
            "walk_q_pictures_if_r": {str(r): [asdict(row) for row in paper.try_walk(r)[:3]] for r in (1.0, 32.0)},
            "assumed_r": paper.ASSUMED_R,
            "c_listing_differences": listing,
            "estimation": asdict(estimated),
            "fusion": asdict(fused),
            "exponential": [asdict(answer) for answer in simple],
        },
    )


def listing_difference() -> int:
    """Values of x or p in which the C listing and kalman_filter differ, all axes and pictures."""
    board, different = paper.moved_board(), 0
    for _, q, r in paper.WALK:
        result = kalman_filter(board.values, paper.walk_params(q, r))
        for axis in range(3):
            x, p = c_listing(board.values[:, axis], q, r, paper.P0, paper.X0)
            different += int(np.sum(x != result.x[:, axis]) + np.sum(p != result.p[:, axis]))
    return different


def _walk_figure() -> Figure:
    board = paper.moved_board()
    z, shown = board.values[:, 0], slice(60, 330)
    panels: list[Panel] = []
    for name, q, r in paper.WALK:
        x = denoise(z, paper.walk_params(q, r))
        assumed = " (assumed)" if name.startswith("q_") else ""
        lines = (
            Line(board.time[shown], z[shown], "raw", "raw"),
            Line(board.time[shown], x[shown], "filtered", "s2"),
        )
        panels.append(Panel(f"q = {q:g}, r = {r:g}{assumed}", lines, "time / s", "x / counts", (-15.0, 68.0)))
    return PROSE.figure(
        "walk_figure", draw_svg(panels, "Six settings on a moved accelerometer", columns=3, height=220)
    )


def _walk_table(walk: Sequence[WalkRow]) -> ResultTable:
    other = {r: paper.try_walk(r) for r in (1.0, 32.0)}
    rows: list[tuple[str, ...]] = []
    for i, row in enumerate(walk):
        gains = [f"{other[r][i].gain:.3f}" if row.name.startswith("q_") else "" for r in other]
        cells = (f"{row.q:g}", f"{row.r:g}", f"{row.gain:.3f}", f"{row.lag_samples:.2f}")
        rows.append((*cells, f"{100 * row.noise_left:.0f} %", f"{row.rmse:.2f}", *gains))
    best = min(walk, key=lambda row: row.rmse)
    return PROSE.table("walk", rows, q=best.q, r=best.r)


def _axes_figure() -> Figure:
    board = paper.moved_board()
    x = denoise(board.values, paper.walk_params(0.125, 4.0))
    panels: list[Panel] = []
    for i, name in enumerate(board.names):
        lines = (
            Line(board.time, board.values[:, i], "raw", "raw"),
            Line(board.time, paper.truth_of(board)[:, i], "truth", "truth"),
            Line(board.time, x[:, i], "filtered", "s2"),
        )
        panels.append(Panel(f"{name} axis", lines, "time / s", "counts", (-60.0, 70.0)))
    return PROSE.figure("axes", draw_svg(panels, "Three axes filtered independently", columns=3, height=260))


def _estimate_table(answer: EstimateAnswer, draws: int) -> ResultTable:
    rows = (
        ("q / counts²", "0.125", f"{answer.q_median:.3f}", f"{answer.q_low:.3f} to {answer.q_high:.3f}"),
        ("r / counts²", "9", f"{answer.r_median:.2f}", f"{answer.r_low:.2f} to {answer.r_high:.2f}"),
        ("RMSE, estimated pair over true pair", "1", f"{answer.loss:.3f}", ""),
        ("moved board: RMSE / counts with (0.125, 4)", "", f"{answer.by_eye_rmse:.2f}", ""),
        ("moved board: RMSE / counts, estimated", "", f"{answer.board_rmse:.2f}", ""),
        ("board at rest, three axes", "", ", ".join(sorted(set(answer.resting_verdicts))).replace("_", " "), ""),
    )
    return PROSE.table("estimate", rows, draws=draws)


def _fusion_table(answer: FusionAnswer) -> ResultTable:
    rows = (
        ("first sensor alone, r = 9", f"{answer.first:.3f}"),
        ("second sensor alone, r = 25", f"{answer.second:.3f}"),
        ("both: one predict, two updates", f"{answer.fused:.3f}"),
        ("promised by the model, √(K r), 1/r = 1/9 + 1/25", f"{answer.fused_theory:.3f}"),
    )
    gain = 100 * (1 - answer.fused / answer.first)
    return PROSE.table("fusion", rows, difference=answer.difference, gain=gain)


def _exponential_table(answers: Sequence[ExponentialAnswer]) -> ResultTable:
    rows = tuple(
        (
            f"{q:g}",
            f"{r:g}",
            f"{a.gain:.4f}",
            f"{a.at_start:.2g}",
            str(a.samples_to_agree),
            f"{a.at_end:.0e}",
        )
        for (_, q, r), a in zip(paper.WALK, answers, strict=True)
    )
    return PROSE.table("exponential", rows, samples=max(a.samples_to_agree for a in answers))


def _exponential_figure() -> Figure:
    board = paper.moved_board()
    z, q, r = board.values[:, 2], 0.125, 32.0
    params = paper.walk_params(q, r)
    x = denoise(z, params)
    simple = questions.exponential(z, questions.answer_exponential(q, r).gain, paper.X0)
    shown = slice(0, 120)
    lines = (
        Line(board.time[shown], z[shown], "raw", "raw"),
        Line(board.time[shown], x[shown], "Kalman filter", "s2"),
        Line(board.time[shown], simple[shown], "exponential smoothing", "s1"),
    )
    panel = Panel("z axis, q = 0.125, r = 32, both started at 0", lines, "time / s", "counts")
    svg = draw_svg([panel], "Kalman filter and exponential smoothing at the start", height=280)
    return PROSE.figure("start", svg)
