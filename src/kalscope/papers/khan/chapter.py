"""The chapter of the page on Khan et al.: the slip in equation (3), its fixed point, figures 7–10."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np

from kalscope.common.charts import Line, Panel, draw_svg, raw_and_filtered
from kalscope.common.progress import OnProgress
from kalscope.errors import BadSetting
from kalscope.filtering.filter import denoise
from kalscope.papers.generalized.filter import GeneralizedParams, generalized_filter, printed_fixed_point
from kalscope.papers.khan import paper
from kalscope.papers.khan.paper import GainRow, LevelRow, channel
from kalscope.papers.page.prose import Prose
from kalscope.papers.parts import Chapter, Check, Figure, ResultTable

PROSE = Prose(Path(__file__).parent / "chapter.toml")


def chapter(report: OnProgress) -> Chapter:
    """Everything of this paper, drawn and checked."""
    report(0.0, "figures 7 to 10")
    gains, levels = paper.try_gains(), paper.try_levels()
    recovered = _samples_to_forget()
    smooth, honest = paper.water_noise(paper.WATER), paper.water_noise(paper.WATER_DATASHEET)
    return PROSE.chapter(
        blocks=(
            PROSE.figure("figure_1", PROSE.drawing("block_diagram.svg")),
            PROSE.table(
                "levels", ({**asdict(row), "difference": abs(row.simulated - row.formula)} for row in levels)
            ),
            _figure_7(recovered),
            _figure_8(),
            _figure_9(smooth, honest),
            _figure_10(),
            PROSE.table("gains", ({**asdict(row), "jumps": 100 * row.noise} for row in gains)),
            _failure_table(),
        ),
        checks=_checks(gains, levels, recovered, smooth),
        results={
            "fixed_point": [asdict(row) for row in levels],
            "figure_7": {"samples_to_forget_the_start": recovered},
            "figure_9": {"noise_left_sigma_m_200": smooth, "noise_left_sigma_m_0_8": honest},
            "figure_10": [asdict(row) for row in gains],
            "frozen_gain_after_1000": paper.frozen_gain(1000),
        },
    )


def _checks(
    gains: Sequence[GainRow], levels: Sequence[LevelRow], recovered: int, smooth: float
) -> tuple[Check, ...]:
    """What the figures show beside what the theory says."""
    return (
        *(
            Check(f"Printed filter at {row.level}: settled gain", row.simulated, row.formula, 1e-9, relative=True)
            for row in levels
        ),
        Check("Without the slip: gain after 1000 samples", paper.frozen_gain(1000), 1e-3, 1e-12, relative=True),
        Check(
            "Figure 7: samples until a start at 1500 is forgotten",
            recovered,
            paper.expected_recovery(3.0),
            0.35,
            relative=True,
        ),
        Check(
            "Figure 9: noise left with σM = 200 °C",
            smooth,
            paper.expected_water_noise(paper.WATER),
            0.15,
            relative=True,
        ),
        *(
            Check(
                f"Figure 10: lag at K = {row.gain:g}, samples",
                row.lag,
                row.lag_theory,
                0.2 + 0.03 * row.lag_theory,
            )
            for row in gains
        ),
    )


def _samples_to_forget() -> int:
    """Figure 7: samples until the start at 1500 counts is within 3 counts of a start at the first sample."""
    z = channel("flex_sensor")
    started_well = generalized_filter(z, GeneralizedParams(paper.FLEX.sigma_m)).x
    return paper.samples_to_recover(generalized_filter(z, paper.FLEX).x, started_well, within=3.0)


def _figure_7(recovered: int) -> Figure:
    z = channel("flex_sensor")
    time = 0.02 * np.arange(len(z))
    frozen = generalized_filter(z, paper.without_slip(paper.FLEX, 12.0)).x
    printed = generalized_filter(z, paper.FLEX).x
    shown = (
        ("Equation (3) as printed, σM = 1500, first estimate 1500", 400, printed, "as printed", "s2"),
        ("Without the slip: σM and σE are variances, 12² and 1500²", 1000, frozen, "without the slip", "s1"),
    )
    panels = [
        Panel(title, raw_and_filtered(time[:n], z[:n], x[:n], label, style), "time / s", "counts")
        for title, n, x, label, style in shown
    ]
    return PROSE.figure("figure_7", draw_svg(panels, "Flex sensor filtered by both readings"), recovered=recovered)


def _figure_8() -> Figure:
    z = channel("ldr_pwm")
    time = 0.02 * np.arange(len(z))
    result = generalized_filter(z, paper.LDR)
    lines = raw_and_filtered(time, z, result.x, "as printed")
    panels = [
        Panel("LDR under a brightening LED, as printed, σM = 500", lines, "time / s", "counts"),
        Panel("Its gain", (Line(time, result.k, "gain K", "s3"),), "time / s", "K", (0.0, 0.25)),
    ]
    svg = draw_svg(panels, "LDR ramp and the gain of the printed filter", columns=2, height=280)
    return PROSE.figure("figure_8", svg, dark=result.k[:50].mean(), light=result.k[-50:].mean())


def _figure_9(smooth: float, honest: float) -> Figure:
    z = channel("hot_water")
    time = 0.1 * np.arange(len(z))
    panels: list[Panel] = []
    for params, style in ((paper.WATER, "s2"), (paper.WATER_DATASHEET, "s4")):
        label = f"as printed, σM = {params.sigma_m:g} °C"
        lines = raw_and_filtered(time, z, generalized_filter(z, params).x, label, style)
        panels.append(Panel(f"σM = {params.sigma_m:g} °C", lines, "time / s", "temperature / °C", (0.0, 70.0)))
    svg = draw_svg(panels, "Temperature filtered with two measured errors", columns=2, height=280)
    return PROSE.figure("figure_9", svg, smooth=100 * smooth, honest=100 * honest)


def _figure_10() -> Figure:
    z = channel("ldr_pwm")
    time = 0.02 * np.arange(len(z))
    filtered = [denoise(z, paper.fixed_gain(gain, float(z[0]))) for gain in paper.GAINS]
    panels: list[Panel] = []
    for title, shown in (("LDR ramp", slice(0, 1500)), ("2 s of it", slice(700, 800))):
        lines = [Line(time[shown], z[shown], "raw", "raw")]
        for gain, x, style in zip(paper.GAINS, filtered, ("s1", "s3", "s2", "s4"), strict=True):
            lines.append(Line(time[shown], x[shown], f"K = {gain:g}", style))
        panels.append(Panel(title, tuple(lines), "time / s", "counts"))
    return PROSE.figure("figure_10", draw_svg(panels, "LDR ramp under four fixed gains", columns=2, height=340))


def _failure_table() -> ResultTable:
    rows: list[dict[str, str]] = []
    cases = (
        ("a reading of −50 after one of 3", np.array([3.0, -50.0]), GeneralizedParams(3.0)),
        ("a first sample of 0", np.array([0.0, 1.0]), GeneralizedParams(4.0)),
    )
    for name, z, params in cases:
        try:
            generalized_filter(z, params)
        except BadSetting as error:
            rows.append({"signal": name, "answer": str(error)})
    return PROSE.table("failures", rows, gain=printed_fixed_point(100.0, 4.0).gain)
