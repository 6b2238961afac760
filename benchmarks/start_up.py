"""Start-up, warm: `import kalscope`, commands, and `kalscope open` until its link is printed and its page answers.

Whole processes, wall clock, medians; the first run of each is not counted, because it fills the file cache and
the cache of compiled kernels. All take turns with a bare `python -c "import numpy, viser"`, which every ratio is
to, and with a bare viser server.

    python benchmarks/start_up.py [--json] [--runs 7]
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import time
import urllib.request
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path

from dashboard_page import PROGRAM, Program
from machine import cpu_seconds

SAMPLE = Path(__file__).parents[1] / "sample_data" / "nile.csv"
BARE_VISER = """
import numpy, viser, time
server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
print(f"Kalscope: http://127.0.0.1:{server.get_port()}", flush=True)
time.sleep(600)
"""
REFERENCE = 'python -c "import numpy, viser"'
COMMANDS = {
    "python -c pass": ("-c", "pass"),
    REFERENCE: ("-c", "import numpy, viser"),
    'python -c "import kalscope"': ("-c", "import kalscope"),
    "kalscope --help": ("-m", "kalscope_app.main", "--help"),
    "kalscope tune nile.csv": ("-m", "kalscope_app.main", "tune", str(SAMPLE)),
}
SERVERS = {
    "bare viser": (sys.executable, "-c", BARE_VISER),
    "kalscope open demo": (PROGRAM, "open"),
}


def run_python(arguments: Sequence[str]) -> tuple[float, float]:
    """Seconds of a Python process, by the clock and of the processor."""
    start, before = time.perf_counter(), os.times()
    subprocess.run([sys.executable, *arguments], check=True, stdout=subprocess.DEVNULL)
    lasted, after = time.perf_counter() - start, os.times()
    spent = after.children_user + after.children_system - before.children_user - before.children_system
    return lasted, spent


def open_server(program: Sequence[str | Path]) -> tuple[float, float, float]:
    """Seconds from the start of the process to the printed link and to the page behind it; processor time."""
    start = time.perf_counter()
    with Program("demo", program) as server:
        link, spent = time.perf_counter() - start, cpu_seconds(server.process.pid)
        with urllib.request.urlopen(server.url, timeout=30.0) as answer:
            page = answer.read()
        answered = time.perf_counter() - start
    if b"<html" not in page.lower():
        raise RuntimeError(f"the link must lead to a page (got {page[:80]!r})")
    return link, answered, spent


def measure(runs: int) -> dict[str, dict[str, float]]:
    """Median, fastest and slowest of each, s; and the median of its processor time, which a busy machine leaves."""
    taken: dict[str, list[tuple[float, float]]] = defaultdict(list)
    for _ in range(runs + 1):
        for name, arguments in COMMANDS.items():
            taken[name].append(run_python(arguments))
        for name, program in SERVERS.items():
            link, page, spent = open_server(program)
            taken[f"{name}: link printed"].append((link, spent))
            taken[f"{name}: page answered"].append((page, spent))
    rows = {
        name: summary([wall for wall, _ in one[1:]], [cpu for _, cpu in one[1:]]) for name, one in taken.items()
    }
    for row in rows.values():
        row["ratio"] = row["median_s"] / rows[REFERENCE]["median_s"]
        row["cpu_ratio"] = row["cpu_median_s"] / rows[REFERENCE]["cpu_median_s"]
    return rows


def summary(walls: list[float], cpus: list[float]) -> dict[str, float]:
    """One row."""
    return {
        "median_s": statistics.median(walls),
        "least_s": min(walls),
        "most_s": max(walls),
        "cpu_median_s": statistics.median(cpus),
        "runs": len(walls),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--runs", type=int, default=7)
    options = parser.parse_args()
    rows = measure(options.runs)
    if options.json:
        print(json.dumps(rows, indent=1))
        return
    print(f"{'':<34}  median s  least s   most s  processor s   ratio  of processor")
    for name, row in rows.items():
        times = f"{row['median_s']:>8.3f} {row['least_s']:>8.3f} {row['most_s']:>8.3f}"
        ratios = f"{row['ratio']:>5.2f} × {row['cpu_ratio']:>11.2f} ×"
        print(f"{name:<34}  {times} {row['cpu_median_s']:>12.3f} {ratios}")


if __name__ == "__main__":
    main()
