"""Ma'arif et al. (2019), "Kalman Filter for Noise Reducer on Sensor Readings": its signals, figures and table.

The paper prints neither its data nor its noise. Table 1 fixes the noise: on white noise around a constant, the
mean error mean |z − x| of the settled filter is c σ (1 − K) √(2/(2 − K)), c = √(2/π), and all five printed rows
agree with σ ≈ 72. The appendix's (rand − rand)·100 has σ = 100/√6 = 40.8 and cannot be the table's signal.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache, partial

import numpy as np
from numpy.typing import ArrayLike

from kalscope.common.array import Array
from kalscope.filtering.filter import denoise, kalman_filter
from kalscope.filtering.params import FilterParams
from kalscope.filtering.steady_state import steady_state
from kalscope.papers.parts import Experiment, Settings
from kalscope.recording import Recording
from kalscope.sources.samples import open_sample

PAPER = "Kalman Filter for Noise Reducer on Sensor Readings (Ma'arif et al. 2019)"
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


@dataclass(frozen=True)
class TableRow:
    """One row of Table 1, reproduced; all errors in the unit of the signal."""

    r: float
    """Measurement noise R, unit²."""
    q: float
    """Process noise Q, unit²."""
    printed: float
    """Mean error as printed."""
    simulated: float
    """Mean error, average over draws; start x = 0, p0 = 0 as in the MATLAB appendix."""
    theoretical: float
    """c σ (1 − K) √(2/(2 − K)), settled filter, infinitely long signal."""
    simulated_p0_1: float
    """As `simulated`, start p0 = 1 as in section 2.3 and the Arduino appendix."""
    rmse: float
    """Root mean square of x − truth over the same draws, p0 = 0: what a user wants small."""
    rmse_theoretical: float
    """σ √(K/(2 − K)), settled filter."""


@dataclass(frozen=True)
class StartClue:
    """What rows 3 and 4 of Table 1, with the same ratio, reveal about the start that the paper does not state."""

    printed: float
    """Printed difference, row 4 − row 3, unit."""
    p0_zero: float
    """Largest difference over the draws for p0 = 0: nothing but rounding."""
    p0_one: float
    """Mean difference for p0 = 1 over 100 samples."""
    p0_one_spread: float
    """Its standard deviation over draws."""
    share: float
    """Share of draws in which p0 = 1 comes as close to 0 as the printed difference."""
    own_signals_spread: float
    """Standard deviation of the difference if each row had a signal of its own."""
    p0_needed: float
    """p0 whose mean difference over 100 samples is the printed one, unit²."""
    samples_needed: float
    """Samples after which p0 = 1 leaves the printed difference on average."""


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


def simulate_table(draws: int) -> tuple[TableRow, ...]:
    """Table 1 over `draws` signals of 100 samples of white noise, σ = 72 around 0; the same ones for all rows."""
    z = white_noise(draws)
    rows: list[TableRow] = []
    for r, q, printed in PRINTED:
        x = kalman_filter(z, FilterParams(q=q, r=r, p0=0.0, x0=0.0)).x
        started_at_1 = kalman_filter(z, FilterParams(q=q, r=r, p0=1.0, x0=0.0)).x
        row = TableRow(
            r=r,
            q=q,
            printed=printed,
            simulated=mean_error(z, x),
            theoretical=theoretical_mean_error(q / r, SIGMA),
            simulated_p0_1=mean_error(z, started_at_1),
            rmse=float(np.sqrt(np.mean(x * x))),
            rmse_theoretical=theoretical_rmse(q / r, SIGMA),
        )
        rows.append(row)
    return tuple(rows)


def question_the_start(draws: int) -> StartClue:
    """Rows 3 and 4 under different starts, over `draws` signals."""
    z = white_noise(draws)
    printed = PRINTED[3][2] - PRINTED[2][2]
    zero, one = _row_difference(z, 0.0), _row_difference(z, 1.0)
    some, low, high = z[:, :400], 0.0, 1.0
    for _ in range(16):  # the difference grows with p0
        middle = 0.5 * (low + high)
        low, high = (middle, high) if _row_difference(some, middle).mean() < printed else (low, middle)
    # What the start adds to the sum of |z − x| is spent after a few time constants; the mean dilutes it as 1/n.
    longer = white_noise(max(draws // 10, 20), samples=1000, seed=SEED + 1)
    errors = np.abs(z - kalman_filter(z, FilterParams(q=0.01, r=1.0, p0=0.0, x0=0.0)).x).mean(axis=0)
    return StartClue(
        printed=printed,
        p0_zero=float(np.abs(zero).max()),
        p0_one=float(one.mean()),
        p0_one_spread=float(one.std()),
        share=float(np.mean(np.abs(one) <= printed)),
        own_signals_spread=math.sqrt(2.0) * float(errors.std()),
        p0_needed=0.5 * (low + high),
        samples_needed=1000.0 * float(_row_difference(longer, 1.0).mean()) / printed,
    )


def _row_difference(z: Array, p0: float) -> Array:
    """Mean error of row 4 − row 3 for each signal, shape (draws,)."""
    errors = [
        np.abs(z - kalman_filter(z, FilterParams(q=q, r=r, p0=p0, x0=0.0)).x).mean(axis=0)
        for r, q, _ in PRINTED[2:4]
    ]
    return errors[1] - errors[0]


def simulated_recording(name: str, values: Array, title: str) -> Recording:
    """A simulated signal around the constant truth 0, one channel, one sample per second."""
    return Recording(
        time=np.arange(len(values), dtype=np.float64),
        names=("signal",),
        units=("",),
        values=values[:, None],
        sample_period=1.0,
        truth=np.zeros((len(values), 1)),
        source=f"experiment:{name}",
        title=title,
    )


def robot_recording(name: str = "noise_reducer_figure_9", title: str = "Resting balancing robot") -> Recording:
    """The accelerometer of figures 1, 9 and 10, re-created: 2000 samples, counts."""
    return replace(open_sample("balancing_robot"), source=f"experiment:{name}", title=title)


@cache
def robot_signal() -> Array:
    """Its readings, counts, shape (2000,); shared, so not to be changed."""
    return robot_recording().values[:, 0]


def robot_filtered(r: float, q: float) -> Array:
    """The resting robot as the Arduino appendix filters it: Xt_prev = 0, Pt_prev = 1; shape (2000,)."""
    return denoise(robot_signal(), FilterParams(q=q, r=r, p0=1.0, x0=0.0))


def _load_simulation(name: str, title: str, r: float, q: float) -> tuple[Recording, dict[str, Settings]]:
    values = appendix_signal() if name.endswith("appendix") else white_noise(1)[:, 0]
    return simulated_recording(name, values, title), {"signal": FilterParams(q=q, r=r, p0=0.0, x0=0.0)}


def _load_robot(name: str, title: str, r: float, q: float) -> tuple[Recording, dict[str, Settings]]:
    recording = robot_recording(name, title)
    return recording, {recording.names[0]: FilterParams(q=q, r=r, p0=1.0, x0=0.0)}


def _simulation(figure: int, r: float, q: float) -> Experiment:
    name, title = f"noise_reducer_figure_{figure}", f"Figure {figure}: R = {r:g}, Q = {q:g}"
    says = {3: "hardly filtered", 4: "filtered a little", 5: "still jumpy", 6: "the paper's choice", 8: "too much"}
    summary = f"White noise of standard deviation 72; ratio {r / q:g}: {says.get(figure, 'like figure 6')}."
    load = partial(_load_simulation, name, title, r, q)
    return Experiment(name, title, PAPER, f"Figure {figure}", summary, load)


def _robot(label: str, r: float, q: float) -> Experiment:
    figure = label.removesuffix("_text")
    source = {"10": ", as captioned", "10_text": ", as in the text"}.get(label, "")
    name, title = f"noise_reducer_figure_{label}", f"Figure {figure}: resting robot, R = {r:g}, Q = {q:g}{source}"
    summary = f"10-bit accelerometer on a stationary robot, ratio {r / q:g}, started at 0 as on the Arduino."
    return Experiment(name, title, PAPER, f"Figure {figure}", summary, partial(_load_robot, name, title, r, q))


_APPENDIX = "Appendix: R = 100, Q = 1, (rand − rand)·100"

EXPERIMENTS = (
    *(_simulation(*row) for row in SIMULATED_FIGURES),
    *(_robot(*row) for row in ROBOT_FIGURES),
    Experiment(
        "noise_reducer_appendix",
        _APPENDIX,
        PAPER,
        "Appendix a",
        "The MATLAB program with its own noise, of standard deviation 40.8.",
        partial(_load_simulation, "noise_reducer_appendix", _APPENDIX, 100.0, 1.0),
    ),
)
"""What opens from this paper."""
