"""A fleet from Parquet to Parquet: rate, memory, time outside the compiled fit; and what kills cost.

    python benchmarks/fleet.py [--series 20000] [--samples 1000] [--kills 5] [--keep FOLDER]

Writes a data set of SERIES recordings of one kind, and fits it with `--momentum 0 --no-robust` on all cores: rows a
second and how that held from the first fifth to the last, rows a second of processor time of the tasks, the most
memory of a worker, and the share of their time outside the compiled fit. A data set that FOLDER already has is used
again; a million series of 1,000 samples take 8 GB there, and are written and fitted by

    python benchmarks/fleet.py --series 1000000 --kills 0 --keep FOLDER

With KILLS above 0, it runs once more while KILLS workers and finally the driver are killed (kill -9) at
random moments, and is started again: the table must be equal, each id once, no temporary file left (exit
status 1 otherwise, and where more than 2 % of the work may have been done twice).
"""

from __future__ import annotations

import argparse
import json
import random
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pyarrow as pa
import pyarrow.parquet as pq

from kalscope.estimation.request import Request
from kalscope.fleet.read import FleetOptions, find_units
from kalscope.fleet.run import lay_out, run_fleet
from kalscope.fleet.store import STORE

GROUPS = 400
"""Row groups of a data set, at least."""
MAX_IN_GROUP = 1000
"""Series of a row group, at most."""
MAX_TWICE = 0.02
"""Most work that kills may have done twice."""


def main() -> None:
    """Measure, or with --drive be the run that is measured and killed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--series", type=int, default=20_000)
    parser.add_argument("--samples", type=int, default=1000)
    parser.add_argument("--kills", type=int, default=5)
    parser.add_argument(
        "--keep", type=Path, help="folder for the data set and the results; default: a temporary one"
    )
    parser.add_argument("--drive", nargs=2, metavar=("SOURCE", "DIR"), help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.drive:
        drive(*given.drive)
    elif given.keep:
        sys.exit(measure(given.keep, given.series, given.samples, given.kills))
    else:
        with tempfile.TemporaryDirectory() as folder:
            sys.exit(measure(Path(folder), given.series, given.samples, given.kills))


def measure(folder: Path, series: int, samples: int, kills: int) -> int:
    source = folder / f"set-{series}-{samples}"
    if not source.exists():
        write_set(source, series, samples)
    size = sum(path.stat().st_size for path in source.iterdir())
    print(f"{series:,} series × {samples:,} samples, {size / 1e6:,.0f} MB, {psutil.cpu_count()} cores")
    whole = folder / f"whole-{series}"
    shutil.rmtree(whole, ignore_errors=True)
    begun = time.monotonic()
    tally = json.loads(subprocess.run(driver(source, whole), check=True, stdout=subprocess.PIPE, text=True).stdout)
    seconds = time.monotonic() - begun
    print(
        f"{series / tally['seconds']:,.0f} rows/s on all cores ({seconds:.1f} s with start"
        f" and merge); {series / tally['total_s']:,.0f} rows a second of processor time;"
        f" {1 - tally['fitting_s'] / tally['total_s']:.0%} of it outside the compiled fit, start included;"
        f" at most {tally['peak_bytes'] / 1e6:,.0f} MB a worker, {tally['driver_bytes'] / 1e6:,.0f} MB the driver"
    )
    print(f"row groups a second by fifths of the run: {', '.join(f'{rate:,.0f}' for rate in tally['fifths'])}")
    return disturbed(source, whole, folder / f"killed-{series}", kills, tally) if kills else 0


def disturbed(source: Path, whole: Path, out: Path, kills: int, undisturbed: dict[str, Any]) -> int:
    """The same run under kills; 1 where it ends otherwise."""
    shutil.rmtree(out, ignore_errors=True)
    draw, pause = random.Random(1), undisturbed["seconds"] / (kills + 2)
    process = subprocess.Popen(driver(source, out), stdout=subprocess.DEVNULL)
    while not (out / STORE).exists() or (out / STORE).stat().st_size < 100_000:  # until some batches are kept
        time.sleep(0.01)
    done = 0
    for _ in range(kills):
        time.sleep(draw.uniform(0.2, 1.0) * pause)
        workers = workers_of(process.pid)
        if workers:
            draw.choice(workers).kill()
            done += 1
    process.kill()
    process.wait()
    print(f"killed {done} workers and the driver")
    again = json.loads(subprocess.run(driver(source, out), check=True, stdout=subprocess.PIPE, text=True).stdout)
    batches = lay_out([unit.size for unit in find_units([str(source)], out)])
    largest = max(map(len, batches)) / again["units"]
    twice = (done + (psutil.cpu_count() or 1)) * largest
    same = table(out).equals(table(whole))
    ids = table(out)["id"].to_pylist()
    left = [path for path in out.iterdir() if path.suffix in (".tmp", ".note")]
    print(
        f"the rerun did {again['done']:,} of {again['units']:,} row groups; at most {twice:.2%} done twice;"
        f" tables {'equal' if same else 'DIFFERENT'}, {len(ids) - len(set(ids))} ids twice, {len(left)} files left"
    )
    return int(not same or len(ids) != len(set(ids)) or bool(left) or twice > MAX_TWICE)


def driver(source: Path, out: Path) -> list[str]:
    return [sys.executable, __file__, "--drive", str(source), str(out)]


def drive(source: str, out: str) -> None:
    """One run, as `kalscope fleet` does it."""
    seen: list[tuple[float, int]] = [(0.0, 0)]
    options = FleetOptions(Request(momentum=0.0, robust=False))
    tally, _ = run_fleet([source], options, Path(out), show=lambda tally: seen.append((tally.seconds, tally.done)))
    driver, workers = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    used = {
        "total_s": workers.ru_utime + workers.ru_stime,
        "fitting_s": sum(pq.read_table(Path(out) / "fleet.parquet")["seconds"].to_pylist()),
        "peak_bytes": workers.ru_maxrss * 1024,
        "driver_bytes": driver.ru_maxrss * 1024,
    }
    print(json.dumps(asdict(tally) | used | {"fifths": fifths(seen)}))


def fifths(seen: list[tuple[float, int]]) -> list[float]:
    """Row groups a second in each fifth of the run."""
    seconds, groups = np.array(seen).T
    ends = np.interp(np.linspace(0.0, groups[-1], 6), groups, seconds)
    return [groups[-1] / 5 / max(step, 1e-9) for step in np.diff(ends).tolist()]


def workers_of(pid: int) -> list[psutil.Process]:
    try:
        below = psutil.Process(pid).children(recursive=True)
        return [one for one in below if "spawn_main" in " ".join(one.cmdline())]
    except psutil.Error:
        return []


def table(out: Path) -> pa.Table:
    return pq.ParquetFile(out / "fleet.parquet").read().drop_columns(["seconds"])


def write_set(folder: Path, series: int, samples: int) -> None:
    """Random walks under noise, q = 0.09 and r = 1, sorted by id, one row group in memory at a time."""
    unfinished = folder.with_suffix(".unfinished")
    shutil.rmtree(unfinished, ignore_errors=True)
    unfinished.mkdir(parents=True)
    rng = np.random.default_rng(0)
    schema = pa.schema([("id", pa.int64()), ("time", pa.float64()), ("value", pa.float64())])
    with pq.ParquetWriter(unfinished / "part-0.parquet", schema, compression="zstd") as writer:
        group = min(max(1, series // GROUPS), MAX_IN_GROUP)
        for first in range(0, series, group):
            n = min(group, series - first)
            z = np.cumsum(0.3 * rng.normal(size=(n, samples)), axis=1) + rng.normal(size=(n, samples))
            ids, time_s = np.repeat(np.arange(first, first + n), samples), np.tile(np.arange(samples) / 100, n)
            writer.write_table(pa.table([ids, time_s, z.ravel()], schema=schema))
    unfinished.rename(folder)


if __name__ == "__main__":
    main()
