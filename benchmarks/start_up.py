"""Start-up, warm: `import kalscope`, and `kalscope open` until it prints its link and until the page answers.

Whole processes, wall clock, medians; the first run of each is not counted, because it fills the file cache and
the cache of compiled kernels. A bare `python -c pass` is timed in the same turns, to judge the machine by.

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

from dashboard_page import Program, cpu_seconds


def run_python(code: str) -> tuple[float, float]:
    """Seconds of a Python process that runs `code`, by the clock and of the processor."""
    start, before = time.perf_counter(), os.times()
    subprocess.run([sys.executable, "-c", code], check=True)
    lasted, after = time.perf_counter() - start, os.times()
    spent = after.children_user + after.children_system - before.children_user - before.children_system
    return lasted, spent


def open_dashboard() -> tuple[float, float, float]:
    """Seconds from the start of the process to the printed link and to the page behind it; processor time."""
    start = time.perf_counter()
    with Program("demo") as program:
        link, spent = time.perf_counter() - start, cpu_seconds(program.process.pid)
        with urllib.request.urlopen(program.url, timeout=30.0) as answer:
            page = answer.read()
        answered = time.perf_counter() - start
    if b"<html" not in page.lower():
        raise RuntimeError(f"the link must lead to a page (got {page[:80]!r})")
    return link, answered, spent


def measure(runs: int) -> dict[str, dict[str, float]]:
    """Median, fastest and slowest of each, s; and the median of its processor time, which a busy machine leaves."""
    times: dict[str, list[tuple[float, float]]] = {name: [] for name in NAMES}
    for turn in range(runs + 1):
        bare, imported = run_python("pass"), run_python("import kalscope")
        link, page, spent = open_dashboard()
        if turn > 0:
            for taken, pair in zip(times.values(), (bare, imported, (link, spent), (page, spent)), strict=True):
                taken.append(pair)
    return {name: summary([wall for wall, _ in taken], [cpu for _, cpu in taken]) for name, taken in times.items()}


def summary(walls: list[float], cpus: list[float]) -> dict[str, float]:
    """One row."""
    return {
        "median_s": statistics.median(walls),
        "least_s": min(walls),
        "most_s": max(walls),
        "cpu_median_s": statistics.median(cpus),
        "runs": len(walls),
    }


NAMES = {
    "python -c pass": "python -c pass",
    "import kalscope": 'python -c "import kalscope"',
    "link": "kalscope open demo: link printed",
    "page": "kalscope open demo: page answered",
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
    print(f"{'':<34}  median s  least s   most s  processor s")
    for name, row in rows.items():
        times = f"{row['median_s']:>8.3f} {row['least_s']:>8.3f} {row['most_s']:>8.3f}"
        print(f"{NAMES[name]:<34}  {times} {row['cpu_median_s']:>12.3f}")


if __name__ == "__main__":
    main()
