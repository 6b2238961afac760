"""Khan et al., "Single Dimensional Generalized Kalman Filter": the slip in equation (3), figures 7–10.

The recordings are re-creations (sample_data/*.md). The paper states none of its σM. For each figure one is chosen
that makes equation (3) as printed look like the picture; it is then far from any data sheet, and the page says so.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from kalscope.common.charts import Line, Panel, raw_and_filtered
from kalscope.common.numbers import Array
from kalscope.common.progress import OnProgress
from kalscope.filtering.filter import denoise
from kalscope.filtering.params import FilterParams
from kalscope.filtering.steady import ratio_for
from kalscope.papers.document import Block, Chapter, Check, Experiment, Prose
from kalscope.papers.generalized import GeneralizedParams, printed_gain
from kalscope.recording import Recording
from kalscope.sources.samples import open_sample

PROSE = Prose(__name__)

FLEX = GeneralizedParams(sigma_m=1500.0, e0=1500.0)
"""Figure 7, counts: an estimate that starts far too high, and a σM under which the smoothing shows."""
FLEX_WITHOUT_SLIP = GeneralizedParams(12.0**2, 1500.0**2, 1500.0, "without_slip")
"""The same start in the reading without the slip, where errors are variances, counts²."""
LDR = GeneralizedParams(sigma_m=500.0, e0=1.0, sigma_e0=1.0)
"""Figure 8, counts: the reading starts at 0, where the printed equation must not."""
WATER = GeneralizedParams(sigma_m=200.0, e0=1.0, sigma_e0=1.0)
"""Figure 9, °C."""
WATER_DATASHEET = GeneralizedParams(sigma_m=0.8, e0=1.0, sigma_e0=1.0)
"""The same sensor with the standard deviation that its noise really has, °C."""
GAINS = (0.9, 0.3, 0.05, 0.01)
"""Figure 10: fixed gains. The paper gives no values."""
RAMP = slice(500, 1300)
"""Samples of the LDR recording in which the brightness rises steadily."""


@cache
def channel(sample: str) -> Array:
    """The only channel of a recording of sample_data, shape (n,); shared, so not to be changed."""
    return open_sample(sample).values[:, 0]


def fixed_gain(gain: float, x0: float) -> FilterParams:
    """The five-line filter whose gain is `gain` from the first sample on: λ = K²/(1 − K), p0 = K r, r = 1."""
    return FilterParams(q=ratio_for(gain=gain), r=1.0, p0=gain, x0=x0)


def try_gains() -> list[dict[str, float]]:
    """Figure 10's gains on the LDR ramp: the lag in samples, as mean (z − x) over the slope and by theory.

    `jumps` is what still jumps: the deviation of the output's second differences over that of the raw ones, %.
    """
    z = channel("ldr_pwm")
    slope = float(np.polyfit(np.arange(len(z))[RAMP], z[RAMP], 1)[0])
    rows: list[dict[str, float]] = []
    for gain in GAINS:
        x = denoise(z, fixed_gain(gain, float(z[0])))
        jumps, lag = (
            np.diff(x[RAMP], 2).std() / np.diff(z[RAMP], 2).std(),
            float(np.mean(z[RAMP] - x[RAMP])) / slope,
        )
        rows.append({"gain": gain, "lag": lag, "lag_theory": (1.0 - gain) / gain, "jumps": 100 * float(jumps)})
    return rows


def try_levels() -> list[dict[str, Any]]:
    """The printed filter's gain by formula and by simulation, at several levels and in three units."""
    cases = (
        ("1 count", 1.0, 4.0),
        ("10 counts", 10.0, 4.0),
        ("100 counts", 100.0, 4.0),
        ("1000 counts", 1000.0, 4.0),
        ("20 °C", 20.0, 0.8),
        ("68 °F, the same", 68.0, 1.44),
        ("293.15 K, the same", 293.15, 0.8),
    )
    rows: list[dict[str, Any]] = []
    for name, level, sigma_m in cases:
        settled = float(GeneralizedParams(sigma_m, e0=level).run(np.full(5000, level)).k[-1])
        formula = printed_gain(level, sigma_m)
        row = {"level": name, "sigma_m": sigma_m, "formula": formula, "simulated": settled}
        rows.append({**row, "difference": abs(settled - formula)})
    return rows


def samples_to_forget() -> tuple[int, float]:
    """Figure 7: samples until the start at 1500 counts is within 3 counts of a start at the first sample.

    The second number is what it would take if the gain were the settled one at the first reading: linear.
    """
    z, within = channel("flex_sensor"), 3.0
    x = FLEX.run(z).x
    far = np.flatnonzero(np.abs(x - GeneralizedParams(FLEX.sigma_m).run(z).x) > within)
    linear = math.log(within / (x[0] - z[0])) / math.log1p(-printed_gain(float(z[0]), FLEX.sigma_m))
    return int(far[-1]) + 1, linear


def water_noise(params: GeneralizedParams) -> float:
    """Output over input standard deviation while the water is still cold, samples 200–590."""
    z = channel("hot_water")
    return float(params.run(z).x[200:590].std() / z[200:590].std())


def _at_all_gains() -> tuple[Recording, tuple[FilterParams, ...]]:
    """The LDR recording once for each gain, as channels, so that each has settings of its own."""
    recording, times = open_sample("ldr_pwm"), len(GAINS)
    names = tuple(f"ldr, K = {gain:g}" for gain in GAINS)
    values = np.repeat(recording.values, times, axis=1)
    repeated = replace(recording, names=names, units=recording.units * times, values=values, sha256="")
    return repeated, tuple(fixed_gain(gain, float(values[0, 0])) for gain in GAINS)


EXPERIMENTS = (
    Experiment(
        "generalized_figure_7",
        "Figure 7: flex sensor, first estimate far too high",
        lambda: (open_sample("flex_sensor"), FLEX),
    ),
    Experiment(
        "generalized_figure_7_without_slip",
        "Figure 7: flex sensor, equation (3) without the slip",
        lambda: (open_sample("flex_sensor"), FLEX_WITHOUT_SLIP),
    ),
    Experiment("generalized_figure_8", "Figure 8: LDR ramp", lambda: (open_sample("ldr_pwm"), LDR)),
    Experiment("generalized_figure_9", "Figure 9: temperature", lambda: (open_sample("hot_water"), WATER)),
    Experiment("generalized_figure_10", "Figure 10: LDR under fixed gains", _at_all_gains),
)
"""What opens from this paper."""


def chapter(report: OnProgress) -> Chapter:
    """Everything of this paper, drawn and checked."""
    report(0.0, "figures 7 to 10")
    gains, levels, (recovered, linear), smooth = try_gains(), try_levels(), samples_to_forget(), water_noise(WATER)
    frozen = float(GeneralizedParams(4.0, reading="without_slip").run(np.ones(1000)).k[-1])
    cold = printed_gain(24.0, WATER.sigma_m)
    return PROSE.chapter(
        blocks=(
            PROSE.figure("figure_1"),
            PROSE.table("levels", levels),
            _figure_7(recovered),
            _figure_8(),
            _figure_9(smooth, water_noise(WATER_DATASHEET)),
            _figure_10(),
            PROSE.table("gains", gains),
        ),
        checks=(
            *(
                Check(
                    f"Printed filter at {row['level']}: settled gain", row["simulated"], row["formula"], 1e-9, True
                )
                for row in levels
            ),
            Check("Without the slip: gain after 1000 samples", frozen, 1e-3, 1e-12, relative=True),
            Check("Figure 7: samples until a start at 1500 is forgotten", recovered, linear, 0.35, relative=True),
            Check("Figure 9: noise left with σM = 200 °C", smooth, math.sqrt(cold / (2.0 - cold)), 0.15, True),
            *(
                Check(
                    f"Figure 10: lag at K = {row['gain']:g}, samples",
                    row["lag"],
                    row["lag_theory"],
                    0.2 + 0.03 * row["lag_theory"],
                )
                for row in gains
            ),
        ),
    )


def _figure_7(recovered: int) -> Block:
    z = channel("flex_sensor")
    time = 0.02 * np.arange(len(z))
    shown = (
        ("Equation (3) as printed, σM = 1500, first estimate 1500", 400, FLEX, "as printed", "s2"),
        (
            "Without the slip: σM and σE are variances, 12² and 1500²",
            *(1000, FLEX_WITHOUT_SLIP, "without the slip", "s1"),
        ),
    )
    panels = [
        Panel(title, raw_and_filtered(time[:n], z[:n], params.run(z).x[:n], label, style), "time / s", "counts")
        for title, n, params, label, style in shown
    ]
    return PROSE.figure("figure_7", panels, recovered=recovered)


def _figure_8() -> Block:
    z = channel("ldr_pwm")
    time = 0.02 * np.arange(len(z))
    result = LDR.run(z)
    lines = raw_and_filtered(time, z, result.x, "as printed")
    panels = [
        Panel("LDR under a brightening LED, as printed, σM = 500", lines, "time / s", "counts"),
        Panel("Its gain", (Line(time, result.k, "gain K", "s3"),), "time / s", "K", (0.0, 0.25)),
    ]
    return PROSE.figure("figure_8", panels, dark=result.k[:50].mean(), light=result.k[-50:].mean())


def _figure_9(smooth: float, honest: float) -> Block:
    z = channel("hot_water")
    time = 0.1 * np.arange(len(z))
    panels: list[Panel] = []
    for params, style in ((WATER, "s2"), (WATER_DATASHEET, "s4")):
        label = f"as printed, σM = {params.sigma_m:g} °C"
        lines = raw_and_filtered(time, z, params.run(z).x, label, style)
        panels.append(Panel(f"σM = {params.sigma_m:g} °C", lines, "time / s", "temperature / °C", (0.0, 70.0)))
    return PROSE.figure("figure_9", panels, smooth=100 * smooth, honest=100 * honest)


def _figure_10() -> Block:
    z = channel("ldr_pwm")
    time = 0.02 * np.arange(len(z))
    filtered = [denoise(z, fixed_gain(gain, float(z[0]))) for gain in GAINS]
    panels: list[Panel] = []
    for title, shown in (("LDR ramp", slice(0, 1500)), ("2 s of it", slice(700, 800))):
        lines = [Line(time[shown], z[shown], "raw", "raw")]
        for gain, x, style in zip(GAINS, filtered, ("s1", "s3", "s2", "s4"), strict=True):
            lines.append(Line(time[shown], x[shown], f"K = {gain:g}", style))
        panels.append(Panel(title, tuple(lines), "time / s", "counts"))
    return PROSE.figure("figure_10", panels)
