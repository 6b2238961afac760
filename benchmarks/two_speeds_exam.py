"""Two speeds against one on signals with known truth: fitted on the first half, judged on the second.

    python benchmarks/two_speeds_exam.py [RECORDS]

For each kind of signal it prints the error of two speeds where `find_parameters` chooses them, of the one-euro
filter of Casiez et al. (2012) with the settings of a grid that are best on the first half, whose truth it alone
knows, and of the best fixed gain, which knows the truth of the second half; each over that of the best fit, as
median of RECORDS.
Exit status 1 where a goal is missed: 0.35 on steps, 0.9 on rests with walks, 1.01 on what one speed describes.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from kalscope import FilterParams, denoise
from kalscope.estimation.request import Request, find_parameters
from kalscope.filtering.classic import Chain, ChainFilter, OneEuro
from kalscope.filtering.steady import ratio_for

Samples = NDArray[np.float64]
N = 4000
GOALS = {"steps": 0.35, "rest and walk": 0.9, "random walk": 1.01, "momentum": 1.01}
EURO = [(cut, beta) for cut in (1e-3, 3e-3, 0.01, 0.03) for beta in (0.0, 1e-3, 3e-3, 0.01, 0.03, 0.1)]
GAINS = np.geomspace(0.01, 0.99, 40)


def steps(rng: np.random.Generator, size: float = 15.0) -> Samples:
    """Levels that jump once in 250 samples."""
    return np.cumsum((rng.random(N) < 1 / 250) * rng.normal(size=N) * size)


def rest_and_walk(rng: np.random.Generator) -> Samples:
    """A walk in a third of the time."""
    return np.cumsum(rng.normal(size=N) * np.where((np.arange(N) // 125) % 3 == 2, 1.0, 0.01))


def rest_and_ramp(rng: np.random.Generator) -> Samples:
    """A ramp in a third of the time."""
    moves, sign = (np.arange(N) // 125) % 3 == 2, np.repeat(rng.choice([-1.0, 1.0], N // 125), 125)
    return np.cumsum(moves * sign * 0.3)


def bursts(rng: np.random.Generator) -> Samples:  # noqa: ARG001
    """A vibration in a quarter of the time."""
    return ((np.arange(N) // 200) % 4 == 3) * 8.0 * np.sin(2.0 * np.pi * np.arange(N) / 40.0)


def moving_on(rng: np.random.Generator) -> Samples:
    """A movement that keeps its direction for 20 samples."""
    e = math.exp(-1 / 20)
    v, x, out = 0.16 * rng.normal(), 0.0, np.empty(N)
    for i in range(N):
        x += v * 20 * (1 - e)
        v = e * v + 0.16 * math.sqrt(1 - e * e) * rng.normal()
        out[i] = x
    return out


KINDS: dict[str, Callable[[np.random.Generator], Samples]] = {
    "steps": steps,
    "small steps": lambda rng: steps(rng, 5.0),
    "rest and walk": rest_and_walk,
    "rest and ramp": rest_and_ramp,
    "bursts": bursts,
    "random walk": lambda rng: np.cumsum(0.3 * rng.normal(size=N)),
    "momentum": moving_on,
}


def errors(x: Samples, z: Samples) -> tuple[list[float], bool]:
    """Error of the best fit, two speeds, one-euro and the best gain on the second half; whether two were chosen."""
    half = N // 2

    def error(out: Samples, part: slice = slice(half, N)) -> float:
        return float(np.sqrt(np.mean((out - x)[part] ** 2)))

    found = find_parameters(z[:half], Request(two_speeds=True))
    best = find_parameters(z[:half]).params
    assert found.params is not None
    assert best is not None
    outs = [ChainFilter(Chain(1, OneEuro(cut, beta, 0.03)), best).denoise(z) for cut, beta in EURO]
    euro = min(outs, key=lambda out: error(out, slice(50, half)))
    gains = [FilterParams(ratio_for(gain=float(gain)), 1.0) for gain in GAINS]
    fixed = min(error(denoise(z, one)) for one in gains)
    two = error(denoise(z, replace(found.params, x0=None, p0=None)))
    return [
        error(denoise(z, replace(best, x0=None, p0=None))),
        two,
        error(euro),
        fixed,
    ], found.params.fast is not None


def main() -> int:
    """Print the table; whether a goal is missed."""
    records, missed = int(sys.argv[1]) if len(sys.argv) > 1 else 20, False
    print("| signal | chosen | two speeds | worst | one-euro | best fixed gain |\n|---|--:|--:|--:|--:|--:|")
    for name, kind in KINDS.items():
        rng, ratios, chosen = np.random.default_rng(1), [], 0
        for _ in range(records):
            x = kind(rng)
            each, is_two = errors(x, x + rng.normal(size=N))
            ratios.append([one / each[0] for one in each[1:]])
            chosen += is_two
        two, euro, fixed = np.median(ratios, axis=0)
        worst = max(one[0] for one in ratios)
        print(
            f"| {name} | {chosen} of {records} | {two:.2f} | {worst:.2f} | {euro:.2f} | {fixed:.2f} |", flush=True
        )
        missed |= two > GOALS.get(name, math.inf)
    return int(missed)


if __name__ == "__main__":
    sys.exit(main())
