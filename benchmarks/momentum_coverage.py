"""How often the 95 % intervals of q, r and τ hold the truth, and how often momentum is found where there is none.

    python benchmarks/momentum_coverage.py [--runs 400] [--json]

Signals with momentum are simulated by its stochastic equation (three τ, n = 300 and 3,000) and fitted by maximum
likelihood, whether or not the evidence is enough to choose momentum. The interval of τ is that of the estimate,
those of q and r are q·exp(±1.96 q_se/q), because variances are skewed. Where the evidence is often not enough, the
intervals of q/r and τ of `estimate(z)` must cover the truth whether or not it chooses momentum. Then `estimate(z)`
gets random walks in noise, whose q/r is drawn from 1e-3 to 10 and whose length from 200 to 5,000: momentum must not
be chosen. Exit status 1 where a coverage lies outside 92 to 98 %, or more than 2 % of the walks get momentum.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

from kalscope import FilterParams, estimate
from kalscope.common.progress import Progress
from kalscope.estimation.likelihood import differences
from kalscope.estimation.momentum import fit_around, search
from kalscope.estimation.result import MomentumFit
from kalscope.filtering.kernels import transition

LENGTHS = (300, 3000)
TRUTHS = tuple(FilterParams(q=10.0, r=1.0, momentum=tau) for tau in (3.0, 10.0, 30.0))
UNCERTAIN = 500, FilterParams(q=1.0, r=1.0, momentum=5.0)
COVERED, MAX_FALSE = (0.92, 0.98), 0.02


@dataclass(frozen=True)
class Coverage:
    """Shares of the runs of one truth."""

    n: int
    momentum: float
    q: float
    r: float
    tau: float


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--runs", type=int, default=400)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    rows = [coverage(truth, n, options.runs) for n in LENGTHS for truth in TRUTHS]
    chosen, *uncertain = uncertain_choice(options.runs)
    false = false_momentum(options.runs)
    if options.json:
        found = {"coverage": [asdict(row) for row in rows], "uncertain": [chosen, *uncertain], "false": false}
        print(json.dumps(found, indent=1))
    else:
        print(f"{options.runs} runs each, standard error of a share {math.sqrt(0.05 * 0.95 / options.runs):.1%}")
        print("     n    τ      q      r      τ")
        for row in rows:
            shares = "".join(f"{share:7.1%}" for share in (row.q, row.r, row.tau))
            print(f"{row.n:6} {row.momentum:4g}{shares}")
        print(f"momentum chosen in {chosen:.1%}: q/r covered {uncertain[0]:.1%}, τ {uncertain[1]:.1%}")
        print(f"random walks that get momentum: {false:.2%}")
    shares = [share for row in rows for share in (row.q, row.r, row.tau)]
    wrong = not all(COVERED[0] <= share <= COVERED[1] for share in shares) or min(uncertain) < COVERED[0]
    return int(false > MAX_FALSE or wrong)


def coverage(truth: FilterParams, n: int, runs: int) -> Coverage:
    """How often the intervals hold `truth`."""
    rng = np.random.default_rng(2008)
    found = [holds(fitted(simulate(truth, n, rng)), truth) for _ in range(runs)]
    return Coverage(n, float(truth.momentum), *(float(share) for share in np.mean(found, axis=0)))


def fitted(z: NDArray[np.float64]) -> MomentumFit:
    """The maximum of the likelihood over q, r and τ."""
    data = differences(z, np.empty(0))
    return fit_around(data, search(data, Progress()), Progress())


def holds(found: MomentumFit, truth: FilterParams) -> tuple[bool, bool, bool]:
    """Whether the intervals of q, r and τ hold the truth."""
    low, high = found.tau_interval
    q, r = inside(found.q, found.q_se, float(truth.q)), inside(found.r, found.r_se, float(truth.r))
    return q, r, bool(low <= truth.momentum <= high)


def inside(value: float, error: float, true: float) -> bool:
    """Whether value·exp(±1.96 error/value) holds the true one."""
    return value > 0.0 and abs(math.log(true / value)) <= 1.96 * error / value


def simulate(truth: FilterParams, n: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """A record of the model, exact at its samples, shape (n,)."""
    q, tau = float(truth.q), float(truth.momentum)
    e, f, a, b, c = transition(1.0, q, tau)
    shocks = rng.standard_normal((n, 2)) @ np.linalg.cholesky([[a, b], [b, c]]).T
    x, v = 0.0, rng.normal(0.0, math.sqrt(0.5 * q / tau))
    signal = np.empty(n)
    for i, (move, turn) in enumerate(shocks):
        x, v = x + f * v + move, e * v + turn
        signal[i] = x
    return signal + rng.normal(0.0, math.sqrt(float(truth.r)), n)


def uncertain_choice(runs: int) -> list[float]:
    """How often momentum is chosen and the intervals of q/r and τ hold the truth where the choice is uncertain."""
    rng = np.random.default_rng(36)
    n, truth = UNCERTAIN
    rows: list[tuple[bool, ...]] = []
    for _ in range(runs):
        found = estimate(simulate(truth, n, rng))
        (least, most), (low, high) = found.ratio_interval, found.momentum_interval
        held = least <= truth.ratio <= most, low <= truth.momentum <= high
        rows.append((bool(found.momentum), *map(bool, held)))
    return np.mean(rows, axis=0).tolist()


def false_momentum(runs: int) -> float:
    """The share of simulated random walks in noise that get momentum."""
    rng = np.random.default_rng(1960)
    found = 0
    for _ in range(runs):
        n, ratio = round(math.exp(rng.uniform(*np.log([200.0, 5000.0])))), 10.0 ** rng.uniform(-3.0, 1.0)
        z = np.cumsum(rng.normal(0.0, math.sqrt(ratio), n)) + rng.normal(0.0, 1.0, n)
        found += float(estimate(z).momentum) > 0.0
    return found / runs


if __name__ == "__main__":
    sys.exit(main())
