"""Reading a large CSV: time and memory beside DuckDB alone on the same file.

    python benchmarks/read_csv.py [--rows 5000000] [--turns 5] [--before CHECKOUT]

Writes a log of ROWS × 3 columns (time and two channels, 119 MB for 5,000,000 rows) into a temporary folder. Each
measurement is a process of its own, in turns; the medians and the best are printed, and the peak of the resident
memory above that of the process with everything imported. With --before another checkout takes its turns
as well.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

WAYS = ("kalscope", "duckdb", "before")
BLOCK = 100_000


def main() -> None:
    """Measure, or with --way be the process that is measured."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rows", type=int, default=5_000_000)
    parser.add_argument("--turns", type=int, default=5)
    parser.add_argument("--before", type=Path, help="a checkout to compare with")
    parser.add_argument("--way", choices=WAYS, help=argparse.SUPPRESS)
    parser.add_argument("--file", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.way:
        print(json.dumps(read_once(options.way, options.file)))
    else:
        compare(options.rows, options.turns, options.before)


def compare(rows: int, turns: int, before: Path | None) -> None:
    ways = WAYS if before else WAYS[:2]
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "long.csv"
        write_log(file, rows)
        size = file.stat().st_size
        print(f"{rows:,} rows × 3 columns, {size / 1e6:.0f} MB, {os.cpu_count()} cores")
        found: dict[str, list[tuple[float, float]]] = {way: [] for way in ways}
        for _ in range(turns):
            for way in ways:
                command = [sys.executable, __file__, "--way", way, "--file", str(file)]
                path = {"PYTHONPATH": f"{before}/src"} if way == "before" else {}
                answer = subprocess.run(
                    command, check=True, capture_output=True, text=True, env=os.environ | path
                ).stdout
                found[way].append(tuple(json.loads(answer)))
        for way, turns_of_way in found.items():
            seconds = [second for second, _ in turns_of_way]
            peak = max(memory for _, memory in turns_of_way)
            print(
                f"{way:8} {statistics.median(seconds):6.2f} s (best {min(seconds):.2f} s)"
                f"  +{peak / 1e6:5.0f} MB = {peak / size:.1f} × the file"
            )
        ours = [second for second, _ in found["kalscope"]]
        for way in ways[1:]:
            theirs = [second for second, _ in found[way]]
            print(f"kalscope / {way}: median {statistics.median(ours) / statistics.median(theirs):.2f}, ", end="")
            print(f"best {min(ours) / min(theirs):.2f}")


def read_once(way: str, file: str) -> tuple[float, float]:
    """(seconds, bytes of memory above the beginning) of one reading."""
    import duckdb

    from kalscope import read_recording

    kinds = "{'a': 'DOUBLE', 'b': 'DOUBLE', 'c': 'DOUBLE'}"
    before, begin = peak_memory(), time.perf_counter()
    if way == "duckdb":
        connection = duckdb.connect()
        connection.execute(
            f"SELECT * FROM read_csv(?, auto_detect=false, columns={kinds}, header=false, skip=1, delim=',')",
            [file],
        ).fetchnumpy()
    else:
        read_recording(file)
    return time.perf_counter() - begin, peak_memory() - before


def peak_memory() -> float:
    # Linux counts in KiB, macOS in bytes.
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)


def write_log(file: Path, rows: int) -> None:
    rng = np.random.default_rng(1)
    with file.open("w") as out:
        out.write("t,temp,dist\n")
        for start in range(0, rows, BLOCK):
            n = min(BLOCK, rows - start)
            pairs = zip(
                (20 + 0.3 * rng.normal(size=n)).tolist(), (5 + 0.1 * rng.normal(size=n)).tolist(), strict=True
            )
            out.writelines(f"{i * 0.01:.2f},{a:.4f},{b:.4f}\n" for i, (a, b) in enumerate(pairs, start))


if __name__ == "__main__":
    main()
