"""The figures of the chapter on Ma'arif et al. (2019)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from kalscope.common.charts import Line, Mark, Panel, draw_svg, raw_and_filtered
from kalscope.filtering.filter import denoise
from kalscope.filtering.params import FilterParams
from kalscope.papers.maarif_2019 import paper
from kalscope.papers.maarif_2019.limits import ADVISED, RATIOS, RULE, AdviceTest
from kalscope.papers.page.prose import Prose
from kalscope.papers.parts import Figure

PROSE = Prose(Path(__file__).parent / "chapter.toml")


def figure_1() -> Figure:
    """Figure 1: the raw resting robot."""
    z = paper.robot_signal()
    lines = (Line(np.arange(600), z[:600], "raw", "raw"),)
    panel = Panel("Resting robot, raw", lines, "sample", "ADC reading / counts")
    numbers = {"low": z.min(), "high": z.max(), "mean": z.mean(), "spread": z.std()}
    return PROSE.figure("figure_1", draw_svg([panel], "Raw accelerometer of a resting robot"), **numbers)


def figure_2() -> Figure:
    """Figure 2: the flow chart, as a picture and in words."""
    return PROSE.figure("figure_2", PROSE.drawing("flow_chart.svg"))


def figures_3_to_8() -> Figure:
    """Figures 3–8: six pairs (R, Q) on one draw of the noise."""
    z = paper.white_noise(1)[:, 0]
    panels: list[Panel] = []
    for figure, r, q in paper.SIMULATED_FIGURES:
        x = denoise(z, FilterParams(q=q, r=r, p0=0.0, x0=0.0))
        title = f"Figure {figure}: R = {r:g}, Q = {q:g} (ratio {r / q:g})"
        lines = raw_and_filtered(np.arange(len(z)), z, x)
        panels.append(Panel(title, lines, "sample", "value", (-220.0, 220.0)))
    svg = draw_svg(panels, "Six filters on one noise", columns=2, height=230)
    return PROSE.figure("figures_3_to_8", svg, sigma=paper.SIGMA)


def figures_9_and_10() -> Figure:
    """Figures 9 and 10, the latter by its caption and by the text: start and settled filter."""
    z = paper.robot_signal()
    panels: list[Panel] = []
    words: list[str] = []
    for label, r, q in paper.ROBOT_FIGURES:
        x = paper.robot_filtered(r, q)
        source = {"9": "Figure 9", "10": "Figure 10, caption", "10_text": "Figure 10, text"}[label]
        title = f"{source}: R = {r:g}, Q = {q:g}"
        for start, stop, limits in ((0, 500, (0.0, 400.0)), (1000, 1500, (290.0, 390.0))):
            at = np.arange(start, stop)
            panels.append(Panel(title, raw_and_filtered(at, z[at], x[at]), "sample", "counts", limits))
        late = int(np.flatnonzero(np.abs(x - z.mean()) > 0.05 * z.mean())[-1]) + 1
        less = z[1000:].std() / x[1000:].std()
        words.append(f"{source}: {late} samples until within 5 %, then {less:.1f} times less noise")
    svg = draw_svg(panels, "Resting robot filtered with ratios 100 and 1000", columns=2, height=210)
    return PROSE.figure("figures_9_and_10", svg, numbers="; ".join(words))


def advice_figure(tests: Sequence[AdviceTest]) -> Figure:
    """RMSE and mean error over the ratio for the three kinds of signal."""
    titles = {
        "stationary": "stationary",
        "wandering": "wandering, true r/q = 100",
        "swinging": "swinging, 60 samples",
    }
    panels: list[Panel] = []
    for test in tests:
        lines = (
            Line(RATIOS, test.rmse, "RMSE against the truth", "s1"),
            Line(RATIOS, test.mean_error, "mean error against the raw signal", "s2"),
        )
        marks = (Mark(ADVISED, "100"), Mark(RULE[0], "40", "y"), Mark(RULE[1], "55", "y"))
        panels.append(Panel(titles[test.kind], lines, "R/Q", "error", (0.0, 160.0), log_x=True, marks=marks))
    svg = draw_svg(panels, "RMSE and mean error over the ratio for three signals", columns=3, height=290)
    return PROSE.figure("advice_figure", svg, sigma=paper.SIGMA)
