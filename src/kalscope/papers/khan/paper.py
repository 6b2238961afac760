"""Khan et al., "Single Dimensional Generalized Kalman Filter": its three sensors, figures 7–10.

The recordings are re-creations (sample_data/*.md). The paper states none of its σM. For each figure one is chosen
that makes equation (3) as printed look like the picture; it is then far from any data sheet, and the page says so.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache, partial

import numpy as np

from kalscope.common.array import Array
from kalscope.filtering.filter import denoise
from kalscope.filtering.params import FilterParams
from kalscope.filtering.steady_state import ratio_for
from kalscope.papers.generalized.filter import GeneralizedParams, generalized_filter, printed_fixed_point
from kalscope.papers.parts import Experiment, Settings
from kalscope.recording import Recording
from kalscope.sources.samples import open_sample

PAPER = "Single Dimensional Generalized Kalman Filter (Khan et al.)"

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


@dataclass(frozen=True)
class GainRow:
    """One fixed gain on the LDR ramp."""

    gain: float
    """K, 0 … 1."""
    lag: float
    """Samples by which the output trails the ramp, measured: mean (z − x) over the slope."""
    lag_theory: float
    """(1 − K)/K."""
    noise: float
    """Standard deviation of the output's second differences over that of the raw signal's: what still jumps."""


@dataclass(frozen=True)
class LevelRow:
    """The printed filter on a constant level."""

    level: str
    """The quantity and its unit."""
    value: float
    """E in that unit."""
    sigma_m: float
    """σM in that unit."""
    formula: float
    """Gain from the fixed point."""
    simulated: float
    """Gain after 5000 samples of that constant."""


def without_slip(params: GeneralizedParams, sigma: float) -> GeneralizedParams:
    """The same start in the reading without the slip, where errors are variances: σM = sigma²."""
    first = params.sigma_e0 if params.sigma_e0 is not None else params.e0
    return GeneralizedParams(sigma**2, None if first is None else first**2, params.e0, "without_slip")


def fixed_gain(gain: float, x0: float) -> FilterParams:
    """The five-line filter whose gain is `gain` from the first sample on: λ = K²/(1 − K), p0 = K r, r = 1."""
    return FilterParams(q=ratio_for(gain=gain), r=1.0, p0=gain, x0=x0)


def try_gains() -> tuple[GainRow, ...]:
    """Figure 10's gains on the LDR ramp, against the lag of a settled filter."""
    z = channel("ldr_pwm")
    ramp = np.arange(len(z))[RAMP]
    slope = float(np.polyfit(ramp, z[RAMP], 1)[0])
    rows: list[GainRow] = []
    for gain in GAINS:
        x = denoise(z, fixed_gain(gain, float(z[0])))
        jumps = np.diff(x[RAMP], 2).std() / np.diff(z[RAMP], 2).std()
        lag = float(np.mean(z[RAMP] - x[RAMP])) / slope
        rows.append(GainRow(gain, lag, (1.0 - gain) / gain, float(jumps)))
    return tuple(rows)


def try_levels() -> tuple[LevelRow, ...]:
    """The printed filter's gain at several levels, and for one temperature in three units."""
    cases = (
        ("1 count", 1.0, 4.0),
        ("10 counts", 10.0, 4.0),
        ("100 counts", 100.0, 4.0),
        ("1000 counts", 1000.0, 4.0),
        ("20 °C", 20.0, 0.8),
        ("68 °F, the same", 68.0, 1.44),
        ("293.15 K, the same", 293.15, 0.8),
    )
    return tuple(
        LevelRow(name, level, sigma_m, printed_fixed_point(level, sigma_m).gain, _settled_gain(level, sigma_m))
        for name, level, sigma_m in cases
    )


def samples_to_recover(x: Array, reference: Array, within: float) -> int:
    """Samples until x stays within `within` units of `reference`, the same filter with a good start."""
    far = np.flatnonzero(np.abs(x - reference) > within)
    return int(far[-1]) + 1 if len(far) else 0


def expected_recovery(within: float) -> float:
    """Samples in which FLEX forgets its start, if its gain were the settled one at the first reading: linear."""
    first = float(channel("flex_sensor")[0])
    start = generalized_filter(channel("flex_sensor")[:1], FLEX).x[0] - first
    return math.log(within / start) / math.log1p(-printed_fixed_point(first, FLEX.sigma_m).gain)


def expected_water_noise(params: GeneralizedParams) -> float:
    """√(K/(2 − K)) with the gain of the fixed point at 24 °C, the cold water."""
    gain = printed_fixed_point(24.0, params.sigma_m).gain
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


def _settled_gain(level: float, sigma_m: float) -> float:
    return float(generalized_filter(np.full(5000, level), GeneralizedParams(sigma_m, e0=level)).k[-1])


def _load(name: str, title: str, sample: str, params: GeneralizedParams) -> tuple[Recording, dict[str, Settings]]:
    recording = replace(open_sample(sample), source=f"experiment:{name}", title=title)
    return recording, {recording.names[0]: params}


def _load_gains(name: str, title: str) -> tuple[Recording, dict[str, Settings]]:
    """The LDR recording once for each gain, as channels, so that each has settings of its own."""
    recording = open_sample("ldr_pwm")
    names = tuple(f"ldr, K = {gain:g}" for gain in GAINS)
    z = recording.values[:, 0]
    repeated = replace(
        recording,
        names=names,
        units=recording.units * len(GAINS),
        values=np.column_stack([z] * len(GAINS)),
        source=f"experiment:{name}",
        title=title,
        sha256="",
    )
    first = float(z[0])
    return repeated, {name: fixed_gain(gain, first) for name, gain in zip(names, GAINS, strict=True)}


def _sensor(figure: str, key: str, sample: str, words: str, params: GeneralizedParams, summary: str) -> Experiment:
    name, title = f"generalized_{key}", f"{figure}: {words}"
    return Experiment(name, title, PAPER, figure, summary, partial(_load, name, title, sample, params))


EXPERIMENTS = (
    _sensor(
        "Figure 7",
        "figure_7",
        "flex_sensor",
        "flex sensor, first estimate far too high",
        FLEX,
        "Equation (3) as printed, σM = 1500, forgets a start at 1500 counts within a second.",
    ),
    _sensor(
        "Figure 7",
        "figure_7_without_slip",
        "flex_sensor",
        "flex sensor, equation (3) without the slip",
        without_slip(FLEX, 12.0),
        "The gain falls like 1/n: the filter freezes and stops following the servo.",
    ),
    _sensor(
        "Figure 8",
        "figure_8",
        "ldr_pwm",
        "LDR ramp",
        LDR,
        "Equation (3) as printed: slow near 0, quicker and noisier as the level rises.",
    ),
    _sensor(
        "Figure 9",
        "figure_9",
        "hot_water",
        "temperature",
        WATER,
        "Equation (3) as printed needs σM = 200 °C to be as smooth as the picture.",
    ),
    Experiment(
        "generalized_figure_10",
        "Figure 10: LDR under fixed gains",
        PAPER,
        "Figure 10",
        "K = 0.9, 0.3, 0.05 and 0.01 side by side: the lag is (1 − K)/K samples.",
        partial(_load_gains, "generalized_figure_10", "Figure 10: LDR under fixed gains"),
    ),
)
"""What opens from this paper."""
