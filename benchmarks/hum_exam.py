"""Hum of 2 σ that drifts: a notch and the best fit behind it, against the best fit alone and a record without hum.

Found on the first half of simulated records, judged on the second by their truth. Exit status 1 where the error
behind the notch is above 1.1 times that without hum, or a notch is offered on more than 1 % of the others.

    python benchmarks/hum_exam.py [RECORDS of each kind] [--false RECORDS of each kind without a line]
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator

import numpy as np
from scipy.signal import lfilter

from kalscope.estimation.hum import find_line
from kalscope.estimation.request import FitResult, Request, find_parameters
from kalscope.filtering.classic import ChainFilter
from kalscope.filtering.filter import denoise

SAMPLES, RATE = 4000, 500.0
"""Of a record, and a second."""


def movements(n: int, rng: np.random.Generator) -> Iterator[tuple[str, np.ndarray]]:
    """Signals without noise, unit: the σ of the noise."""
    steps = rng.normal(size=n)
    yield "slow walk", np.cumsum(0.1 * steps)
    yield "fast walk", np.cumsum(0.5 * steps)
    yield "momentum", np.cumsum(lfilter([1.0], [1.0, -np.exp(-1 / 20)], 0.02 * steps))
    yield "sine", 8.0 * np.sin(2.0 * np.pi * np.arange(n) / 400)
    yield "steps", np.cumsum((rng.random(n) < 0.004) * steps * 15.0)


def lineless(n: int, rng: np.random.Generator) -> Iterator[np.ndarray]:
    """Records without a line."""
    noise, spikes = rng.normal(size=n), rng.random(n) < 0.03
    yield noise
    for _, signal in movements(n, rng):
        yield signal + noise
    yield np.cumsum(0.1 * noise) + rng.standard_t(3, size=n)
    yield np.cumsum(0.1 * noise) + rng.normal(size=n) + spikes * rng.uniform(-40.0, 40.0, n)
    yield np.round(np.cumsum(0.05 * noise) + rng.normal(size=n))
    yield lfilter([1.0], [1.0, -0.9], noise)


def error(found: FitResult, z: np.ndarray, truth: np.ndarray) -> float:
    """RMS error of the filter on the second half."""
    assert found.params is not None
    x = denoise(z, found.params) if found.chain is None else ChainFilter(found.chain, found.params).denoise(z)
    return float(np.sqrt(np.mean((x - truth)[len(z) // 2 :] ** 2)))


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("records", nargs="?", type=int, default=6)
    parser.add_argument("--false", type=int, default=50, help="records of each kind without a line")
    options = parser.parse_args()
    rng, rows, t = np.random.default_rng(3), dict[str, list[list[float]]](), np.arange(SAMPLES)
    for _ in range(options.records):
        for name, truth in movements(SAMPLES, rng):
            clean, size = truth + rng.normal(size=SAMPLES), 1.0 + 0.1 * np.cumsum(rng.normal(size=SAMPLES)) / 63.0
            z = clean + 2.0 * size * np.sin(2.0 * np.pi * t / rng.uniform(3.0, 12.0) + 1.0)
            half, notch = SAMPLES // 2, Request(notch="auto")
            errors = [
                error(find_parameters(z[:half]), z, truth),
                error(find_parameters(z[:half], notch), z, truth),
                error(find_parameters(clean[:half]), clean, truth),
            ]
            rows.setdefault(name, []).append(errors)
    print(f"{'error on the second half, σ':28}{'best fit':>10}{'notch':>10}{'no hum':>10}{'notch/no hum':>14}")
    ratios = dict[str, float]()
    for name, errors in rows.items():
        fit, notched, clean = np.median(errors, axis=0)
        ratios[name] = float(np.median(np.divide(*np.transpose(errors)[1:])))
        print(f"{name:28}{fit:10.3g}{notched:10.3g}{clean:10.3g}{ratios[name]:14.3f}")
    lines = [find_line(z) for n in (600, 4000) for _ in range(options.false // 2) for z in lineless(n, rng)]
    false = sum(line is not None and line.advice(1.0 / RATE) != "" for line in lines)
    print(f"notch offered without a line: {false} of {len(lines)}")
    return int(max(ratios.values()) > 1.1 or false > 0.01 * len(lines))


if __name__ == "__main__":
    sys.exit(main())
