"""Write the made recordings of this folder again, bit for bit: python sample_data/make.py [FOLDER].

Each re-creates an experiment of the three documents that Kalscope implements, or a common fault. They are
drawn from a model of the sensor, not measured: the authors published pictures, not data. nile.csv is no
such file: it holds published numbers.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def lis302dl() -> str:
    """Three axes at rest, 8 bits, 1 g on z; the breakout board's noise with its odd spike."""
    rng = np.random.default_rng(302)
    n = 2000
    rest = np.array([2.0, -3.0, 55.0])  # 18 mg a count: 1 g is 55 counts
    noise = rng.normal(0.0, 3.0, (n, 3))
    spikes = (rng.random((n, 3)) < 0.005) * rng.choice((-18.0, 18.0), (n, 3))
    counts = _convert(rest + noise + spikes, -128, 127)
    rows = [f"{10 * i},{x},{y},{z}" for i, (x, y, z) in enumerate(counts)]
    return _csv("time_ms,x (counts),y (counts),z (counts)", rows)


def flex_sensor() -> str:
    """A servo bends the sensor 0…180° in 1.8 s and back; noisiest where it turns round."""
    rng = np.random.default_rng(180)
    time = 0.02 * np.arange(1800)
    sweep = 1 - np.abs(1 - np.mod(time / 1.8, 2.0))  # 0…1…0, the servo's angle / 180°
    truth = 340 + 260 * sweep**1.2  # the divider bends the straight line a little
    turning = np.exp(-np.minimum(sweep, 1 - sweep) / 0.06)
    noise = rng.normal(0.0, 1.0, len(time)) * (6 + 12 * turning)
    counts = _convert(truth + noise, 0, 1023)
    return _csv("time (s),flex (counts)", [f"{t:.2f},{z}" for t, z in zip(time, counts, strict=True)])


def flex_finger() -> str:
    """A finger bends and holds, again and again; each move takes 0.3 to 0.5 s, and no two are alike."""
    rng = np.random.default_rng(52)
    time = 0.02 * np.arange(1000)
    truth = np.full(len(time), 400.0)
    for start in np.arange(0.9, 19.5, 1.0) + rng.uniform(-0.25, 0.25, 19):
        progress = np.clip((time - start) / rng.uniform(0.3, 0.5), 0.0, 1.0)
        target = rng.choice(np.arange(370, 710, 20))
        truth += (target - truth[-1]) * progress**2 * (3 - 2 * progress)
    counts = _convert(truth + rng.normal(0.0, 18.0, len(time)), 0, 1023)
    return _csv("time (s),flex (counts)", [f"{t:.2f},{z}" for t, z in zip(time, counts, strict=True)])


def ldr_pwm() -> str:
    """The LED's duty cycle rises by steps from dark to bright; the reading follows from 0 to 170."""
    rng = np.random.default_rng(170)
    n = 1500
    duty = np.floor(np.minimum(np.arange(n) / (0.9 * n), 1.0) * 255) / 255
    light = 170 * duty**0.8
    truth = _lagged(light, gain=0.15)  # a photoresistor needs tens of milliseconds
    counts = _convert(truth + rng.normal(0.0, 4.0, n) * (0.3 + 0.7 * duty), 0, 1023)
    return _csv("time_ms,ldr (counts)", [f"{20 * i},{z}" for i, z in enumerate(counts)])


def hot_water() -> str:
    """A coarse sensor (0.49 °C a count) at rest, then hot water is poured in at 60 s."""
    rng = np.random.default_rng(60)
    time = 0.1 * np.arange(1800)
    since = np.maximum(time - 60.0, 0.0)
    truth = 24.0 + 41.0 * (1 - np.exp(-since / 9.0)) * np.exp(-since / 900.0)
    count = 500.0 / 1024  # 5 V over 1024 counts at 10 mV per °C
    counts = _convert((truth + rng.normal(0.0, 0.8, len(time))) / count, 0, 1023)
    rows = [f"{t:.1f},{z * count:.2f}" for t, z in zip(time, counts, strict=True)]
    return _csv("time (s),temperature (degC)", rows)


def balancing_robot() -> str:
    """The accelerometer of an unmoving robot: 10 bits, noise, and now and then an extreme reading."""
    rng = np.random.default_rng(100)
    n = 2000
    noise = 14.0 * (rng.random(n) - rng.random(n))  # the paper's own noise law, rand - rand
    extreme = (rng.random(n) < 0.01) * rng.choice((-40.0, 40.0), n)
    counts = _convert(338.0 + noise + extreme, 0, 1023)
    return _csv("time_ms,accel (counts)", [f"{5 * i},{z}" for i, z in enumerate(counts)])


def ultrasonic() -> str:
    """A hand moves before an echo sensor; where no echo comes back the cell is empty."""
    rng = np.random.default_rng(4004)
    time = 0.06 * np.arange(1200)
    truth = 45 + 25 * np.sin(2 * np.pi * time / 11) + 6 * np.sin(2 * np.pi * time / 2.9)
    distance = truth + rng.normal(0.0, 0.6, len(time))
    lost = rng.random(len(time)) < 0.04
    lost[500:512] = True  # the hand leaves the beam
    rows = [f"{t:.2f}," + ("" if gone else f"{z:.1f}") for t, z, gone in zip(time, distance, lost, strict=True)]
    return _csv("time (s),distance (cm)", rows)


def tank_level() -> str:
    """A tank fills and empties under three level sensors; the sonar sees only foam for a while."""
    rng = np.random.default_rng(2020)
    time = np.arange(1200.0)
    flow = np.repeat(rng.choice((-1.2, -0.4, 0.0, 0.6, 1.5), 24), 50)  # a pump and a drain, switched now and then
    truth = 900.0 + np.cumsum(_lagged(flow, gain=0.05)) + np.cumsum(rng.normal(0.0, 0.6, len(time)))
    sonar = truth + 12.0 + rng.normal(0.0, 6.0, len(time))
    float_arm = truth - 9.0 + rng.normal(0.0, 14.0, len(time))
    pressure = truth - 31.0 + rng.normal(0.0, 4.0, len(time))
    lost = (rng.random(len(time)) < 0.03) | ((time >= 700) & (time < 780))
    slow = np.mod(time, 5.0) > 0.0
    columns = [_cells(sonar, lost), _cells(float_arm, time < 0), _cells(pressure, slow)]
    rows = [f"{t:.0f},{','.join(cells)}" for t, *cells in zip(time, *columns, strict=True)]
    return _csv("time (s),sonar (mm),float (mm),pressure (mm)", rows)


RECORDINGS = {
    "balancing_robot": balancing_robot,
    "flex_finger": flex_finger,
    "flex_sensor": flex_sensor,
    "hot_water": hot_water,
    "ldr_pwm": ldr_pwm,
    "lis302dl": lis302dl,
    "tank_level": tank_level,
    "ultrasonic": ultrasonic,
}
"""What makes each file, by its name without .csv."""


def make(folder: Path) -> None:
    """Write all made recordings into `folder`."""
    for name, text in RECORDINGS.items():
        (folder / f"{name}.csv").write_bytes(text().encode("ascii"))


def _convert(values: Array, low: int, high: int) -> NDArray[np.int64]:
    """What a converter of whole counts from `low` to `high` says."""
    return np.clip(np.round(values), low, high).astype(np.int64)


def _lagged(values: Array, gain: float) -> Array:
    """First-order lag: each step goes `gain` of the way."""
    out = np.empty_like(values)
    state = values[0]
    for i, value in enumerate(values):
        state += gain * (value - state)
        out[i] = state
    return out


def _cells(values: Array, missing: NDArray[np.bool_]) -> list[str]:
    """Readings to a tenth, empty where there is none."""
    return ["" if gone else f"{value:.1f}" for value, gone in zip(values, missing, strict=True)]


def _csv(header: str, rows: list[str]) -> str:
    return "\n".join([header, *rows]) + "\n"


if __name__ == "__main__":
    make(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent)
