"""The chapter of the page on interactive matter (2009): the walk through q and r, the listing, three answers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from kalscope.common.charts import Line, Panel, draw_svg, raw_and_filtered
from kalscope.common.progress import OnProgress
from kalscope.filtering.filter import denoise, kalman_filter
from kalscope.papers.appendices import c_listing
from kalscope.papers.interactive_matter_2009 import document as paper
from kalscope.papers.interactive_matter_2009 import questions, tilt
from kalscope.papers.interactive_matter_2009.document import WalkRow
from kalscope.papers.interactive_matter_2009.questions import ExponentialAnswer
from kalscope.papers.page.prose import Prose
from kalscope.papers.parts import Chapter, Check, Effort, Figure, ResultTable

PROSE = Prose(Path(__file__).parent / "chapter.toml")


def chapter(effort: Effort, report: OnProgress) -> Chapter:
    """Everything of this document, drawn and checked."""
    report(0.0, "the walk through q and r")
    walk = paper.try_walk()
    report(0.1, "estimating q and r")
    estimated = questions.answer_estimation(effort.estimate_draws)
    report(0.8, "two sensors, the listing, the figures")
    fused, board = questions.answer_fusion(), tilt.answer_tilt()
    simple = tuple(questions.answer_exponential(q, r) for _, q, r in paper.WALK)
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
            Check("q estimated, median", estimated.q_median, questions.TRUE_Q, 0.1, relative=True),
            Check("r estimated, median", estimated.r_median, questions.TRUE_R, 0.03, relative=True),
            Check("RMSE with the estimated pair over the true one", estimated.loss, 1.0, 0.02),
            Check("Two sensors fused: RMSE", fused.fused, fused.fused_theory, 0.05, relative=True),
            Check("Fused, against the filter of the weighted mean", fused.difference, 0.0, 1e-9),
            Check("Accelerometer and tilt: offset found", board.offset, tilt.OFFSET, 0.1, relative=True),
            Check("Accelerometer and tilt: predicted error", board.predicted, board.fused, 0.15, relative=True),
            Check("Exponential filter, worst of the walk, last half", max(a.at_end for a in simple), 0.0, 1e-6),
        ),
        results={
            "walk": [asdict(row) for row in walk],
            "walk_q_pictures_if_r": {str(r): [asdict(row) for row in paper.try_walk(r)[:3]] for r in (1.0, 32.0)},
            "assumed_r": paper.ASSUMED_R,
            "c_listing_difference": listing,
            "estimation": asdict(estimated),
            "fusion": asdict(fused),
            "tilt": asdict(board),
            "exponential": [asdict(answer) for answer in simple],
        },
    )


def listing_difference() -> float:
    """Largest difference of x, counts, or of p, counts², between the C listing and kalman_filter: rounding."""
    board, largest = paper.moved_board(), 0.0
    for _, q, r in paper.WALK:
        result = kalman_filter(board.values, paper.walk_params(q, r))
        for axis in range(3):
            x, p = c_listing(board.values[:, axis], q, r, paper.P0, paper.X0)
            apart = np.abs(x - result.x[:, axis]).max(), np.abs(p - result.p[:, axis]).max()
            largest = max(largest, *map(float, apart))
    return largest


def _walk_figure() -> Figure:
    board = paper.moved_board()
    z, shown = board.values[:, 0], slice(60, 330)
    panels: list[Panel] = []
    for name, q, r in paper.WALK:
        x = denoise(z, paper.walk_params(q, r))
        assumed = " (assumed)" if name.startswith("q_") else ""
        lines = raw_and_filtered(board.time[shown], z[shown], x[shown])
        panels.append(Panel(f"q = {q:g}, r = {r:g}{assumed}", lines, "time / s", "x / counts", (-15.0, 68.0)))
    return PROSE.figure(
        "walk_figure", draw_svg(panels, "Six settings on a moved accelerometer", columns=3, height=220)
    )


def _walk_table(walk: Sequence[WalkRow]) -> ResultTable:
    other = {f"gain_if_{r:g}": paper.try_walk(r) for r in (1.0, 32.0)}
    rows: list[dict[str, Any]] = []
    for i, row in enumerate(walk):
        gains = {key: f"{other[key][i].gain:.3f}" if row.name.startswith("q_") else "" for key in other}
        rows.append({**asdict(row), "percent": 100 * row.noise_left, **gains})
    best = min(walk, key=lambda row: row.rmse)
    return PROSE.table("walk", rows, best_q=best.q, best_r=best.r)


def _axes_figure() -> Figure:
    board = paper.moved_board()
    x = denoise(board.values, paper.walk_params(0.125, 4.0))
    panels: list[Panel] = []
    for i, name in enumerate(board.names):
        raw, filtered = raw_and_filtered(board.time, board.values[:, i], x[:, i])
        lines = (raw, Line(board.time, paper.truth_of(board)[:, i], "truth", "truth"), filtered)
        panels.append(Panel(f"{name} axis", lines, "time / s", "counts", (-60.0, 70.0)))
    return PROSE.figure("axes", draw_svg(panels, "Three axes filtered independently", columns=3, height=260))


def _exponential_table(answers: Sequence[ExponentialAnswer]) -> ResultTable:
    rows = ({**asdict(answer), "q": q, "r": r} for (_, q, r), answer in zip(paper.WALK, answers, strict=True))
    return PROSE.table("exponential", rows, samples=max(a.samples_to_agree for a in answers))


def _exponential_figure() -> Figure:
    board = paper.moved_board()
    z, q, r = board.values[:, 2], 0.125, 32.0
    params = paper.walk_params(q, r)
    x = denoise(z, params)
    simple = questions.exponential(z, questions.answer_exponential(q, r).gain, paper.X0)
    shown = slice(0, 120)
    lines = (
        *raw_and_filtered(board.time[shown], z[shown], x[shown], "Kalman filter"),
        Line(board.time[shown], simple[shown], "exponential smoothing", "s1"),
    )
    panel = Panel("z axis, q = 0.125, r = 32, both started at 0", lines, "time / s", "counts")
    svg = draw_svg([panel], "Kalman filter and exponential smoothing at the start", height=280)
    return PROSE.figure("start", svg)
