"""Khan et al., "Single Dimensional Generalized Kalman Filter": the slip in equation (3), figures 7–10.

The recordings are re-creations (sample_data/*.md). The paper states none of its σM. For each figure one is chosen
that makes equation (3) as printed look like the picture; it is then far from any data sheet, and the page says so.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from kalscope.common.charts import Line, Panel, raw_and_filtered
from kalscope.common.numbers import Array
from kalscope.common.progress import OnProgress
from kalscope.errors import BadSetting
from kalscope.filtering.filter import denoise
from kalscope.filtering.params import FilterParams
from kalscope.filtering.steady import ratio_for
from kalscope.papers.generalized import GeneralizedParams, generalized_filter, printed_gain
from kalscope.papers.parts import Chapter, Check, Experiment, Figure, Prose, Settings
from kalscope.recording import Recording
from kalscope.sources.samples import open_sample

PAPER = "Single Dimensional Generalized Kalman Filter (Khan et al.)"
PROSE = Prose(__name__)

FLEX = GeneralizedParams(sigma_m=1500.0, e0=1500.0)
"""Figure 7, counts: an estimate that starts far too high, and a σM under which the smoothing shows."""
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


def without_slip(params: GeneralizedParams, sigma: float) -> GeneralizedParams:
    """The same start in the reading without the slip, where errors are variances: σM = sigma²."""
    first = params.sigma_e0 if params.sigma_e0 is not None else params.e0
    return GeneralizedParams(sigma**2, None if first is None else first**2, params.e0, "without_slip")


def fixed_gain(gain: float, x0: float) -> FilterParams:
    """The five-line filter whose gain is `gain` from the first sample on: λ = K²/(1 − K), p0 = K r, r = 1."""
    return FilterParams(q=ratio_for(gain=gain), r=1.0, p0=gain, x0=x0)


def try_gains() -> list[dict[str, float]]:
    """Figure 10's gains on the LDR ramp: the lag in samples, as mean (z − x) over the slope and by theory.

    `noise` is what still jumps: the deviation of the output's second differences over that of the raw ones.
    """
    z = channel("ldr_pwm")
    ramp = np.arange(len(z))[RAMP]
    slope = float(np.polyfit(ramp, z[RAMP], 1)[0])
    rows: list[dict[str, float]] = []
    for gain in GAINS:
        x = denoise(z, fixed_gain(gain, float(z[0])))
        jumps = np.diff(x[RAMP], 2).std() / np.diff(z[RAMP], 2).std()
        lag = float(np.mean(z[RAMP] - x[RAMP])) / slope
        rows.append({"gain": gain, "lag": lag, "lag_theory": (1.0 - gain) / gain, "noise": float(jumps)})
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
        settled = generalized_filter(np.full(5000, level), GeneralizedParams(sigma_m, e0=level)).k[-1]
        row = {"level": name, "value": level, "sigma_m": sigma_m}
        rows.append({**row, "formula": printed_gain(level, sigma_m), "simulated": float(settled)})
    return rows


def samples_to_recover(x: Array, reference: Array, within: float) -> int:
    """Samples until x stays within `within` units of `reference`, the same filter with a good start."""
    far = np.flatnonzero(np.abs(x - reference) > within)
    return int(far[-1]) + 1 if len(far) else 0


def expected_recovery(within: float) -> float:
    """Samples in which FLEX forgets its start, if its gain were the settled one at the first reading: linear."""
    first = float(channel("flex_sensor")[0])
    start = generalized_filter(channel("flex_sensor")[:1], FLEX).x[0] - first
    return math.log(within / start) / math.log1p(-printed_gain(first, FLEX.sigma_m))


def expected_water_noise(params: GeneralizedParams) -> float:
    """√(K/(2 − K)) with the gain of the fixed point at 24 °C, the cold water."""
    gain = printed_gain(24.0, params.sigma_m)
    return math.sqrt(gain / (2.0 - gain))


def frozen_gain(n: int) -> float:
    """Gain of the reading without the slip after n samples from a diffuse start: 1/n."""
    return float(generalized_filter(np.ones(n), GeneralizedParams(4.0, reading="without_slip")).k[-1])


def water_noise(params: GeneralizedParams) -> float:
    """Output over input standard deviation while the water is still cold, samples 200–590."""
    z = channel("hot_water")
    return float(generalized_filter(z, params).x[200:590].std() / z[200:590].std())


@cache
def channel(sample: str) -> Array:
    """The only channel of a recording of sample_data, shape (n,); shared, so not to be changed."""
    return open_sample(sample).values[:, 0]


def _at_all_gains() -> tuple[Recording, tuple[FilterParams, ...]]:
    """The LDR recording once for each gain, as channels, so that each has settings of its own."""
    recording, times = open_sample("ldr_pwm"), len(GAINS)
    names = tuple(f"ldr, K = {gain:g}" for gain in GAINS)
    values = np.repeat(recording.values, times, axis=1)
    repeated = replace(recording, names=names, units=recording.units * times, values=values, sha256="")
    return repeated, tuple(fixed_gain(gain, float(values[0, 0])) for gain in GAINS)


def _experiment(key: str, make: Callable[[], tuple[Recording, Settings | tuple[Settings, ...]]]) -> Experiment:
    title, summary = PROSE.words(f"experiment_{key}", "title", "summary")
    return Experiment(f"generalized_{key}", title, PAPER, title.partition(":")[0], summary, make)


EXPERIMENTS = (
    _experiment("figure_7", lambda: (open_sample("flex_sensor"), FLEX)),
    _experiment("figure_7_without_slip", lambda: (open_sample("flex_sensor"), without_slip(FLEX, 12.0))),
    _experiment("figure_8", lambda: (open_sample("ldr_pwm"), LDR)),
    _experiment("figure_9", lambda: (open_sample("hot_water"), WATER)),
    _experiment("figure_10", _at_all_gains),
)
"""What opens from this paper."""


def chapter(report: OnProgress) -> Chapter:
    """Everything of this paper, drawn and checked."""
    report(0.0, "figures 7 to 10")
    gains, levels = try_gains(), try_levels()
    recovered = _samples_to_forget()
    smooth, honest = water_noise(WATER), water_noise(WATER_DATASHEET)
    return PROSE.chapter(
        blocks=(
            PROSE.figure("figure_1"),
            PROSE.table(
                "levels", ({**row, "difference": abs(row["simulated"] - row["formula"])} for row in levels)
            ),
            _figure_7(recovered),
            _figure_8(),
            _figure_9(smooth, honest),
            _figure_10(),
            PROSE.table("gains", ({**row, "jumps": 100 * row["noise"]} for row in gains)),
            _failure_table(),
        ),
        checks=_checks(gains, levels, recovered, smooth),
        results={
            "fixed_point": levels,
            "figure_7": {"samples_to_forget_the_start": recovered},
            "figure_9": {"noise_left_sigma_m_200": smooth, "noise_left_sigma_m_0_8": honest},
            "figure_10": gains,
            "frozen_gain_after_1000": frozen_gain(1000),
        },
    )


def _checks(
    gains: Sequence[dict[str, float]], levels: Sequence[dict[str, Any]], recovered: int, smooth: float
) -> tuple[Check, ...]:
    """What the figures show beside what the theory says."""
    name, forgotten = "Figure 7: samples until a start at 1500 is forgotten", expected_recovery(3.0)
    return (
        *(_gain_check(row["level"], row["simulated"], row["formula"]) for row in levels),
        Check("Without the slip: gain after 1000 samples", frozen_gain(1000), 1e-3, 1e-12, relative=True),
        Check(name, recovered, forgotten, 0.35, relative=True),
        Check("Figure 9: noise left with σM = 200 °C", smooth, expected_water_noise(WATER), 0.15, relative=True),
        *(_lag_check(row["gain"], row["lag"], row["lag_theory"]) for row in gains),
    )


def _gain_check(level: str, simulated: float, formula: float) -> Check:
    return Check(f"Printed filter at {level}: settled gain", simulated, formula, 1e-9, relative=True)


def _lag_check(gain: float, lag: float, theory: float) -> Check:
    return Check(f"Figure 10: lag at K = {gain:g}, samples", lag, theory, 0.2 + 0.03 * theory)


def _samples_to_forget() -> int:
    """Figure 7: samples until the start at 1500 counts is within 3 counts of a start at the first sample."""
    z = channel("flex_sensor")
    started_well = generalized_filter(z, GeneralizedParams(FLEX.sigma_m)).x
    return samples_to_recover(generalized_filter(z, FLEX).x, started_well, within=3.0)


def _figure_7(recovered: int) -> Figure:
    z = channel("flex_sensor")
    time = 0.02 * np.arange(len(z))
    frozen = generalized_filter(z, without_slip(FLEX, 12.0)).x
    printed = generalized_filter(z, FLEX).x
    shown = (
        ("Equation (3) as printed, σM = 1500, first estimate 1500", 400, printed, "as printed", "s2"),
        ("Without the slip: σM and σE are variances, 12² and 1500²", 1000, frozen, "without the slip", "s1"),
    )
    panels = [
        Panel(title, raw_and_filtered(time[:n], z[:n], x[:n], label, style), "time / s", "counts")
        for title, n, x, label, style in shown
    ]
    return PROSE.figure("figure_7", panels, recovered=recovered)


def _figure_8() -> Figure:
    z = channel("ldr_pwm")
    time = 0.02 * np.arange(len(z))
    result = generalized_filter(z, LDR)
    lines = raw_and_filtered(time, z, result.x, "as printed")
    panels = [
        Panel("LDR under a brightening LED, as printed, σM = 500", lines, "time / s", "counts"),
        Panel("Its gain", (Line(time, result.k, "gain K", "s3"),), "time / s", "K", (0.0, 0.25)),
    ]
    return PROSE.figure("figure_8", panels, dark=result.k[:50].mean(), light=result.k[-50:].mean())


def _figure_9(smooth: float, honest: float) -> Figure:
    z = channel("hot_water")
    time = 0.1 * np.arange(len(z))
    panels: list[Panel] = []
    for params, style in ((WATER, "s2"), (WATER_DATASHEET, "s4")):
        label = f"as printed, σM = {params.sigma_m:g} °C"
        lines = raw_and_filtered(time, z, generalized_filter(z, params).x, label, style)
        panels.append(Panel(f"σM = {params.sigma_m:g} °C", lines, "time / s", "temperature / °C", (0.0, 70.0)))
    return PROSE.figure("figure_9", panels, smooth=100 * smooth, honest=100 * honest)


def _figure_10() -> Figure:
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


def _failure_table() -> Figure:
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
    return PROSE.table("failures", rows, gain=printed_gain(100.0, 4.0))
