"""What fusing costs: `fuse` of k sensors against k runs of `kalman_filter`, one per sensor.

    python benchmarks/fusion_speed.py [--readings 1000000] [--turns 7] [--json]

Both take the same readings in turns, process time; the ratio is the median of the turns. Regular rows, rows with a
fifth of the readings missing, a gate, uneven times, and momentum. Exit status 1 where fusing takes more than 1.5
times as long.
"""

from __future__ import annotations

import argparse
import json
import statistics
import sys
import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from kalscope import FilterParams, fuse, kalman_filter

Q, MAX_RATIO = 0.09, 1.5
Samples = NDArray[np.float64]


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--readings", type=int, default=1_000_000)
    parser.add_argument("--turns", type=int, default=15)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    rows = {k: ratios(options.readings // k, k, options.turns) for k in (2, 3, 8)}
    if options.json:
        print(json.dumps(rows, indent=1))
    else:
        print(f"time of fuse over that of the single filters, {options.readings:,} readings")
        print(f"  {'sensors':24}" + "".join(f"{k:>8}" for k in rows))
        for case in rows[2]:
            print(f"  {case:24}" + "".join(f"{row[case]:8.2f}" for row in rows.values()))
    return int(max(ratio for row in rows.values() for ratio in row.values()) > MAX_RATIO)


def ratios(n: int, k: int, turns: int) -> dict[str, float]:
    """Time of `fuse` over that of k single filters, by the kind of record."""
    rng = np.random.default_rng(1)
    z = np.cumsum(rng.normal(0.0, Q**0.5, n))[:, None] + rng.normal(size=(n, k))
    gaps, dt = np.where(rng.random(z.shape) < 0.2, np.nan, z), rng.exponential(1.0, n)
    return {
        "regular": ratio(z, None, turns),
        "a gate": ratio(z, None, turns, gate=9.0),
        "a fifth missing": ratio(gaps, None, turns),
        "uneven times": ratio(z, dt, turns),
        "momentum": ratio(z, None, turns, momentum=20.0),
        "momentum, uneven times": ratio(z, dt, turns, momentum=20.0),
    }


def ratio(z: Samples, dt: Samples | None, turns: int, gate: float | None = None, momentum: float = 0.0) -> float:
    """One of them."""
    r, offset = np.linspace(1.0, 2.0, z.shape[1]), np.linspace(0.0, 1.0, z.shape[1])
    together = FilterParams(Q, r, gate=gate, momentum=momentum, offset=offset)
    alone = [FilterParams(Q, float(one), gate=gate, momentum=momentum) for one in r]
    columns = [np.ascontiguousarray(column) for column in z.T]

    def fused() -> None:
        fuse(z, together, dt)

    def single() -> None:
        for column, params in zip(columns, alone, strict=True):
            kalman_filter(column, params, dt)

    for run in (fused, single):
        run()  # compiles
    return statistics.median(seconds(fused) / seconds(single) for _ in range(turns))


def seconds(run: Callable[[], None]) -> float:
    """Time of the processor."""
    start = time.process_time()
    run()
    return time.process_time() - start


if __name__ == "__main__":
    sys.exit(main())
