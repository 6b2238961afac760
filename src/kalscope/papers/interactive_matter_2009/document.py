"""Interactive matter (2009), "Filtering Sensor Data with a Kalman Filter": a LIS302DL, three filters, one walk.

The pictures show a board that is moved by hand. It is re-created here: three axes, ±128 counts, tilted and put
down again, under white noise of σ = 3 counts. The text gives q for three pictures without r; r = 4 is assumed.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from kalscope.common.array import Array
from kalscope.filtering.filter import denoise
from kalscope.filtering.params import FilterParams
from kalscope.filtering.steady_state import steady_state
from kalscope.papers.parts import Experiment, Settings
from kalscope.recording import Recording

PAPER = "Filtering Sensor Data with a Kalman Filter (interactive matter 2009)"
ASSUMED_R = 4.0
"""r of the three q pictures, counts²: more than 1, because the text then turns it down to 1."""
WALK = (
    ("q_128", 128.0, ASSUMED_R),
    ("q_4", 4.0, ASSUMED_R),
    ("q_0125", 0.125, ASSUMED_R),
    ("r_1", 0.125, 1.0),
    ("r_4", 0.125, 4.0),
    ("r_32", 0.125, 32.0),
)
"""Name, q and r of the six pictures, in the order of the text."""
NOISE = 3.0
"""Standard deviation of the board's noise, counts."""
P0, X0 = 1023.0, 0.0
"""A start "just high enough", counts², and a first value that does not matter, counts."""
SAMPLES = 600
SAMPLE_PERIOD = 0.01
"""s: the sensor's 100 Hz."""


@dataclass(frozen=True)
class WalkRow:
    """One picture of the walk."""

    name: str
    """Key of the picture."""
    q: float
    """Process noise, counts²."""
    r: float
    """Sensor noise, counts²."""
    gain: float
    """Settled gain K."""
    lag_samples: float
    """Lag on a ramp, (1 − K)/K samples."""
    noise_left: float
    """Standard deviation of white noise, out over in, √(K/(2 − K))."""
    rmse: float
    """Root mean square of x − truth over the three axes after the start, counts; the raw signal has about 3."""


def moved_board(source: str = "experiment:lis302dl_q_128", title: str = "LIS302DL moved by hand") -> Recording:
    """Three axes of a board that is tilted, held and put down; 600 samples at 100 Hz, whole counts ±128."""
    time: Array = np.arange(SAMPLES, dtype=np.float64) * SAMPLE_PERIOD
    tilt = 70.0 * _hold(time, 1.0, 2.2) - 40.0 * _hold(time, 3.4, 4.4)
    roll = 50.0 * _hold(time, 1.6, 3.0) + 25.0 * np.sin(2.0 * np.pi * 1.2 * time) * _hold(time, 4.2, 5.4)
    angle_x, angle_y = np.radians(tilt), np.radians(roll)
    gravity = 55.0  # 18 mg a count
    x = gravity * np.sin(angle_x)
    y = gravity * np.sin(angle_y) * np.cos(angle_x)
    z = gravity * np.cos(angle_x) * np.cos(angle_y)
    truth = np.column_stack([x, y, z])
    noise = NOISE * np.random.default_rng(302).standard_normal(truth.shape)
    return Recording(
        time=time,
        names=("x", "y", "z"),
        units=("counts",) * 3,
        values=np.clip(np.round(truth + noise), -128, 127),
        sample_period=SAMPLE_PERIOD,
        truth=truth,
        source=source,
        title=title,
    )


def walk_params(q: float, r: float) -> FilterParams:
    """One of the three independent filters, as kalman_init(q, r, 1023, 0)."""
    return FilterParams(q=q, r=r, p0=P0, x0=X0)


def try_walk(r_of_q_pictures: float = ASSUMED_R) -> tuple[WalkRow, ...]:
    """The six pictures in numbers, with another r for the first three if given."""
    board = moved_board()
    rows: list[WalkRow] = []
    for name, q, r in WALK:
        used = r_of_q_pictures if name.startswith("q_") else r
        params = walk_params(q, used)
        settled = steady_state(params)
        gain = settled.gain
        error = (denoise(board.values, params) - truth_of(board))[20:]
        rows.append(
            WalkRow(
                name=name,
                q=q,
                r=used,
                gain=gain,
                lag_samples=settled.lag_samples,
                noise_left=(gain / (2.0 - gain)) ** 0.5,
                rmse=float(np.sqrt(np.mean(error * error))),
            )
        )
    return tuple(rows)


def truth_of(recording: Recording) -> Array:
    """The noise-free signal of a simulated recording, shape (n, channels)."""
    return recording.values if recording.truth is None else recording.truth


def _hold(time: Array, start: float, stop: float) -> Array:
    """0, a quick rise to 1 at `start`, and back at `stop`; each takes about 0.2 s."""
    return 0.5 * (np.tanh((time - start) / 0.1) - np.tanh((time - stop) / 0.1))


def _load(name: str, title: str, q: float, r: float) -> tuple[Recording, dict[str, Settings]]:
    board = moved_board(f"experiment:{name}", title)
    return board, dict.fromkeys(board.names, walk_params(q, r))


def _picture(key: str, q: float, r: float) -> Experiment:
    name = f"lis302dl_{key}"
    assumed = " (r assumed)" if key.startswith("q_") else ""
    title = f"LIS302DL: q = {q:g}, r = {r:g}{assumed}"
    gain = float(steady_state(walk_params(q, r)).gain)
    summary = f"Three independent filters on a board moved by hand; settled gain {gain:.3g}."
    figure = f"Picture of {'q' if key.startswith('q_') else 'r'} = {q if key.startswith('q_') else r:g}"
    return Experiment(name, title, PAPER, figure, summary, partial(_load, name, title, q, r))


EXPERIMENTS = tuple(_picture(*row) for row in WALK)
"""What opens from this document."""
