"""How often a faulty sensor is named: simulated pairs and triples, noise and offsets estimated from their readings.

    python benchmarks/fusion_faults.py [--draws 40] [--rows 2000] [--json]

Each recording is a random walk, or one that keeps its direction, seen by two or three sensors of random noise and
offset; a third of the recordings has missing readings. `estimate_fusion` and `judge_fusion` get the readings only.
A fault is found where it is reported for the sensor that has it; of two sensors it is unknown which one drifts or
changes its noise, so it is reported for both. A fault reported for a sensor that has none is a false alarm. Exit
status 1 where a fault is found in less than 85 % of the recordings, or more than 2 % of good sensors are blamed.
Noise that grows in the quieter of two sensors can hide in that of the other: that is what is missed.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from kalscope import estimate_fusion, judge_fusion

MIN_FOUND, MAX_FALSE = 0.85, 0.02
Readings = NDArray[np.float64]
Spoil = Callable[[Readings, float, np.random.Generator], None]


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--draws", type=int, default=40)
    parser.add_argument("--rows", type=int, default=2000)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    table = {fault: shares(fault, options.draws, options.rows) for fault in ("none", *FAULTS)}
    if options.json:
        print(json.dumps(table, indent=1))
    else:
        print(f"{options.draws} recordings of {options.rows:,} rows a line")
        print(f"  {'fault':10}{'found':>10}{'false alarms':>16}")
        for fault, row in table.items():
            print(f"  {fault:10}{row['found']:10.1%}{row['false']:16.2%}")
    good = all(row["found"] >= MIN_FOUND and row["false"] <= MAX_FALSE for row in table.values())
    return int(not good)


def shares(fault: str, draws: int, rows: int) -> dict[str, float]:
    """Share of the recordings in which the fault is found, and of good sensors that are said to have one."""
    found = alarms = good = 0
    for seed in range(draws):
        rng = np.random.default_rng(seed)
        z, sigma = recorded(rng, rows)
        sick = int(rng.integers(z.shape[1]))
        if fault != "none":
            FAULTS[fault](z[:, sick], float(sigma[sick]), rng)
        estimate = estimate_fusion(z, momentum="auto" if seed % 2 else 0.0)
        if estimate.params is None:
            continue
        said = [one.faults for one in judge_fusion(z, estimate).sensors]
        found += fault == "none" or fault in said[sick]
        others = [faults for i, faults in enumerate(said) if fault == "none" or i != sick]
        undecided = {"drift", "noise"} & {fault} if z.shape[1] == 2 else set[str]()
        alarms += sum(bool(set(faults) - undecided) for faults in others)
        good += len(others)
    return {"found": found / draws, "false": alarms / good}


def recorded(rng: np.random.Generator, rows: int) -> tuple[Readings, NDArray[np.float64]]:
    """Readings, and the standard deviation of the noise of each sensor."""
    steps = rng.normal(0.0, 10.0 ** rng.uniform(-1.5, 0.0), rows)
    if rng.random() < 0.5:  # the walk keeps its direction for ten rows
        steps = np.convolve(steps, 0.9 ** np.arange(100))[:rows] * 0.1
    sigma = 10.0 ** rng.uniform(-0.3, 0.3, int(rng.integers(2, 4)))
    z = np.cumsum(steps)[:, None] + rng.normal(0.0, 3.0, len(sigma)) + rng.normal(size=(rows, len(sigma))) * sigma
    if rng.random() < 1.0 / 3.0:
        z[rng.random(z.shape) < 0.2] = np.nan
    return z, sigma


def _drift(z: Readings, sigma: float, rng: np.random.Generator) -> None:
    z += rng.choice([-1.0, 1.0]) * np.linspace(0.0, 2.0 * sigma, len(z))


def _noise(z: Readings, sigma: float, rng: np.random.Generator) -> None:
    z[len(z) // 2 :] += rng.normal(0.0, 3.0 * sigma, len(z) - len(z) // 2)


def _spikes(z: Readings, sigma: float, rng: np.random.Generator) -> None:
    z[rng.choice(len(z), len(z) // 100, replace=False)] += 20.0 * sigma


def _stuck(z: Readings, sigma: float, rng: np.random.Generator) -> None:
    del sigma
    start = int(rng.integers(len(z) // 2))
    stretch = z[start : start + len(z) // 5]
    stretch[np.isfinite(stretch)] = float(np.nanmedian(z[: start + 1])) if start else 0.0


def _silent(z: Readings, sigma: float, rng: np.random.Generator) -> None:
    del sigma
    start = int(rng.integers(len(z) // 2))
    z[start : start + len(z) // 5] = np.nan


FAULTS: dict[str, Spoil] = {
    "drift": _drift,
    "noise": _noise,
    "spikes": _spikes,
    "stuck": _stuck,
    "silent": _silent,
}
"""What is done to one sensor, by the name of the fault."""


if __name__ == "__main__":
    sys.exit(main())
