"""How well several sensors of one quantity are estimated: the coverage of the intervals, and the fused value.

    python benchmarks/fusion_exam.py [--records 400] [--seed 20] [--json] [--speed]

Pairs and triples are simulated: 300, 1,000, 3,000 or 10,000 rows, q over the smallest r from 1e-3 to 10, noise
that differs by up to 30 times between the sensors, offsets, in a third of the records 20 % of the readings
missing, in a third a second sensor at a fifth of the rate. `estimate_fusion` gets each. Reported: how often the
95 % intervals hold the true r and b; the RMS error of the fused value against that of the best single sensor
with the q and r that `estimate` finds for it alone; and against the fused filter with the true parameters. Both
errors are of the next 10,000 rows, which no fit has seen: over a short record the luckiest of three sensors
beats any filter, even the true one. Exit status 1 where a coverage is outside 92 to 98 %, where the fused value
is worse than the best sensor by over 2 % in more than 1 % of the records, or, from 3,000 rows on, worse than
the filter that knows the truth by over 3 % in more than 1 %. `--speed` measures the time of one estimate
instead.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

from kalscope import FilterParams, denoise, estimate, estimate_fusion, fuse

Array = NDArray[np.float64]

LENGTHS = (300, 1000, 3000, 10_000)
COVERED = (0.92, 0.98)
MAX_WORSE_THAN_SINGLE, MAX_WORSE_THAN_TRUTH, SHARE = 1.02, 1.03, 0.99
UNSEEN = 10_000
"""Rows after the record that show the error of a filter."""
SETTLING = 1000
"""Further rows before them, while a slow filter settles."""


@dataclass(frozen=True)
class Record:
    """One simulated record."""

    n: int
    """Rows that the fit sees."""
    x: Array
    """The true quantity, shape (n + SETTLING + UNSEEN,)."""
    z: Array
    """Readings, shape (n + SETTLING + UNSEEN, sensors)."""
    truth: FilterParams
    """What it was made with; the offsets add up to 0."""


@dataclass(frozen=True)
class Row:
    """What came out of one record."""

    n: int
    sensors: int
    verdict: str
    r_held: tuple[bool, ...]
    offset_held: tuple[bool, ...]
    to_single: float
    """RMS error of the fused value over that of the best single sensor."""
    to_truth: float
    """RMS error of the fused value over that of the filter that knows the truth."""
    below_truth: bool
    """Whether the likelihood found is below that of the truth."""


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--records", type=int, default=400)
    parser.add_argument("--seed", type=int, default=20)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--speed", action="store_true")
    options = parser.parse_args()
    if options.speed:
        return speed()
    rng = np.random.default_rng(options.seed)
    rows = [examine(simulate(i, rng)) for i in range(options.records)]
    if options.json:
        print(json.dumps([asdict(row) for row in rows]))
    return report(rows)


def simulate(index: int, rng: np.random.Generator) -> Record:
    """A record with drawn parameters; the kind of gaps goes round with the index."""
    n, sensors = LENGTHS[index % 4], 2 + index // 4 % 2
    r = 10.0 ** rng.uniform(-1.5, 0.0, sensors)
    q = float(r.min()) * 10.0 ** rng.uniform(-3.0, 1.0)
    offset = rng.normal(0.0, 3.0, sensors)
    offset -= offset.mean()
    rows = n + SETTLING + UNSEEN
    x = np.cumsum(rng.normal(0.0, math.sqrt(q), rows)) + rng.normal(0.0, 30.0)
    z = x[:, None] + offset + rng.normal(0.0, 1.0, (rows, sensors)) * np.sqrt(r)
    if index // 8 % 3 == 1:
        z[rng.random(z.shape) < 0.2] = np.nan
    elif index // 8 % 3 == 2:
        z[np.arange(rows) % 5 != 0, 1] = np.nan
    return Record(n, x, z, FilterParams(q=q, r=r, offset=offset))


def examine(record: Record) -> Row:
    """One estimate against the truth."""
    z, truth = record.z[: record.n], record.truth
    found = estimate_fusion(z)
    if found.params is None:
        return Row(record.n, truth.sensors, found.verdict, (), (), math.inf, math.inf, False)
    unseen = record.z[record.n :]
    singles = [error(denoise(unseen[:, i], single_params(z[:, i])), record) for i in range(truth.sensors)]
    fused = error(fuse(unseen, found.params).x, record)
    return Row(
        n=record.n,
        sensors=truth.sensors,
        verdict=found.verdict,
        r_held=held(found.r_interval, truth.sensor_r),
        offset_held=held(found.offset_interval, truth.offset),
        to_single=fused / min(singles),
        to_truth=fused / error(fuse(unseen, truth).x, record),
        below_truth=bool(found.loglik < fuse(z, truth).loglik - 1e-6),
    )


def single_params(column: Array) -> FilterParams:
    """What `estimate` finds for one sensor, or the best that the record allows where q or r is 0."""
    one = estimate(column)
    if one.params is not None:
        return one.params
    low, high = one.ratio_interval
    return FilterParams(q=high * one.r, r=one.r) if one.r > 0.0 else FilterParams(q=one.q, r=one.q / low)


def held(interval: Array, true: Array) -> tuple[bool, ...]:
    return tuple(((interval[:, 0] <= true) & (true <= interval[:, 1])).tolist())


def error(value: Array, record: Record) -> float:
    """RMS error of the unseen rows less its mean: an offset of all sensors, or of one alone, cannot be known."""
    return float(np.std(value[SETTLING:] - record.x[record.n + SETTLING :]))


def report(rows: list[Row]) -> int:
    """Print the table; exit status."""
    print(f"{len(rows)} records, standard error of a coverage at most {math.sqrt(0.05 * 0.95 / len(rows)):.1%}")
    print("sensors      n  records   r      b    fused/best single  fused/true filter")
    for sensors in (2, 3):
        for n in LENGTHS:
            some = [row for row in rows if (row.sensors, row.n) == (sensors, n)]
            if some:
                print(f"{sensors:7} {n:6} {line(some)}")
    print(f"    all        {line(rows)}")
    verdicts = {name: sum(row.verdict == name for row in rows) for name in sorted({row.verdict for row in rows})}
    print(f"verdicts: {verdicts}; likelihood below that of the truth: {sum(row.below_truth for row in rows)}")
    long = [row for row in rows if row.n >= 3000]
    not_worse = float(np.mean([row.to_single <= MAX_WORSE_THAN_SINGLE for row in rows]))
    near = float(np.mean([row.to_truth <= MAX_WORSE_THAN_TRUTH for row in long]))
    print(f"not worse than the best single sensor by over 2 %: {not_worse:.2%}")
    print(f"within 3 % of the filter that knows the truth, n of 3,000 or more: {near:.2%}")
    shares = coverage(rows)
    fine = all(COVERED[0] <= share <= COVERED[1] for share in shares) and min(not_worse, near) >= SHARE
    return int(not fine)


def coverage(rows: list[Row]) -> tuple[float, float]:
    """Shares of the intervals of r and of b that hold the truth."""
    return (
        float(np.mean([one for row in rows for one in row.r_held])),
        float(np.mean([one for row in rows for one in row.offset_held])),
    )


def line(rows: list[Row]) -> str:
    r, b = coverage(rows)
    single, truth = (np.array([getattr(row, name) for row in rows]) for name in ("to_single", "to_truth"))
    return (
        f"{len(rows):8} {r:6.1%} {b:6.1%}  {np.median(single):.3f} (most {single.max():.3f})"
        f"  {np.median(truth):.4f} (most {truth.max():.3f})"
    )


def speed() -> int:
    """Processor time of one estimate of a triple, least of three."""
    rng = np.random.default_rng(1)
    print("      n   s, all   s, robust=False, momentum=0   µs a reading")
    for n in (1000, 10_000, 100_000):
        x = np.cumsum(rng.normal(0.0, 0.3, n))
        z = x[:, None] + rng.normal(0.0, 1.0, (n, 3)) * [0.5, 1.0, 2.0]
        whole, plain = (
            seconds(lambda z=z: estimate_fusion(z)),
            seconds(lambda z=z: estimate_fusion(z, robust=False, momentum=0)),
        )
        print(f"{n:7} {whole:8.3f} {plain:12.3f} {whole / z.size * 1e6:26.2f}")
    return 0


def seconds(run) -> float:
    times: list[float] = []
    for _ in range(4):
        start = time.process_time()
        run()
        times.append(time.process_time() - start)
    return min(times)


if __name__ == "__main__":
    sys.exit(main())
