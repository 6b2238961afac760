"""What `kalscope fleet` says of simulated fleets whose truth is known.

    python benchmarks/fleet_truth.py --fleets 100

Fleets of 500 like devices say how often one is named by chance, and how often the interval of the pooled q/r holds
the truth; fleets with five noisy and five drifting devices say how many of those are found.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np

from kalscope.common.numbers import Array
from kalscope.estimation.many import estimate_many
from kalscope.estimation.pool import Pool, held_out, loss_inputs, pool_of
from kalscope.estimation.request import Request
from kalscope.fleet.read import FleetOptions
from kalscope.fleet.results import Devices, Fleet, answer_for

Q, R = 0.04, 1.0
"""Of a device like the others."""
NOISY, DRIFTING = range(5), range(5, 10)
FACTORS = (2.0, 4.0, 10.0)
"""By which the noise of the noisy ones, and the movement of the drifting ones, is larger."""


def fleet(rng: np.random.Generator, devices: int, samples: int, factor: float) -> tuple[Devices, Pool]:
    """A fleet of random walks, and what it says about one filter."""
    q, r = np.full(devices, Q), np.full(devices, R)
    r[NOISY], q[DRIFTING] = factor * R, factor * Q
    walk = np.cumsum(np.sqrt(q)[:, None] * rng.standard_normal((devices, samples)), axis=1)
    series = walk + np.sqrt(r)[:, None] * rng.standard_normal((devices, samples))
    return devices_of(series), pool_of(series)


def devices_of(series: Array) -> Devices:
    """The table of a fleet, as its parts would give it."""
    table, n = estimate_many(series, robust=False), len(series)
    q, r = (np.where(table.usable, one, np.nan) for one in (table.q, table.r))
    left = loss_inputs(q / r, np.zeros(n), held_out(series))
    names, numbers = [f"dev{i:03d}" for i in range(n)], (q, r, *table.q_interval, *table.r_interval)
    zeros, texts = np.zeros(n), (["ok"] * n, [""] * n, [""] * n)
    return Devices(
        names, ["light"] * n, ["lx"] * n, zeros + 100.0, *numbers, zeros, zeros, *texts, loss_inputs=left
    )


def main() -> None:
    """Simulate, and print a table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--fleets", type=int, default=100)
    parser.add_argument("--devices", type=int, default=500)
    parser.add_argument("--samples", type=int, default=1000)
    asked = parser.parse_args()
    rng = np.random.default_rng(20)
    print(f"{asked.fleets} fleets of {asked.devices} devices, {asked.samples} samples each; q {Q}, r {R}")
    print("factor  found in r   found in q   wrongly named in r   in q   q/r interval holds truth   r within")
    for factor in (1.0, *FACTORS):
        found, wrong, held, errors = np.zeros(2), np.zeros(2), 0, list[float]()
        seconds = 0.0
        for _ in range(asked.fleets):
            given, begun = fleet(rng, asked.devices, asked.samples, factor), time.process_time()
            answer = answer_for(*given, FleetOptions(Request()), Path("out"))
            seconds += time.process_time() - begun
            for place, (name, odd) in enumerate((("r", NOISY), ("q", DRIFTING))):
                hits, misses = counted(answer, name, set(odd) if factor > 1.0 else set())
                found[place] += hits
                wrong[place] += misses > 0
            held += holds(answer)
            errors.append(abs(float(answer.shared.params.r) / R - 1.0) if answer.shared else 1.0)
        share = found / (5 * asked.fleets)
        print(
            f"{factor:6g}  {share[0]:10.1%}  {share[1]:11.1%}  {wrong[0]:8g} of {asked.fleets}  "
            f"{wrong[1]:11g} of {asked.fleets}  {held:11d} of {asked.fleets}  {max(errors):18.2%}   "
            f"(answer {1e3 * seconds / asked.fleets:.0f} ms)"
        )


def counted(answer: Fleet, name: str, odd: set[int]) -> tuple[int, int]:
    """How many of the odd devices are named as unlike the others, and how many others."""
    named = {int(i) for i in answer.outliers[name].devices}
    return len(named & odd), len(named - odd)


def holds(answer: Fleet) -> bool:
    """Whether the interval of the pooled q/r holds the truth of a device like the others."""
    low, high = (0.0, 0.0) if answer.shared is None else answer.shared.ratio_interval
    return low < Q / R < high


if __name__ == "__main__":
    main()
