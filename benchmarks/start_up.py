"""Start-up, warm: `import kalscope`, commands, and `kalscope open` until its first picture in a running browser.

Whole processes, wall clock and processor time, medians; the first run of each is not counted, because it fills the
file cache, the modules' byte code and the cache of compiled kernels. All take turns. Commands are compared with a
bare `python -c "import numpy, viser"`, the dashboard with bare viser with a raw and a filtered line of as many
samples. A Chromium is running, and an empty tab goes to the link as soon as it is printed; the picture is there
when the chart holds the lines. The program's processor time is what it has used by then.

    python benchmarks/start_up.py [--json] [--runs 7]
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path

from dashboard_page import SIGNAL_CHART, Program, chromium
from machine import cpu_seconds
from playwright.sync_api import Browser

SAMPLE = Path(__file__).parents[1] / "sample_data" / "nile.csv"
REFERENCE = 'python -c "import numpy, viser"'
COMMANDS = {
    "python -c pass": ("-c", "pass"),
    REFERENCE: ("-c", "import numpy, viser"),
    'python -c "import kalscope"': ("-c", "import kalscope"),
    "kalscope --help": ("-m", "kalscope_app.main", "--help"),
    "kalscope tune nile.csv": ("-m", "kalscope_app.main", "tune", str(SAMPLE)),
}
BARE_VISER = """
import time
import numpy as np
import viser
from viser.uplot import Series
server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
t = np.arange(1000.0)
raw = np.random.default_rng(1).normal(size=1000).cumsum()
lines = Series(label="time"), Series(label="raw", stroke="gray"), Series(label="filtered", stroke="red")
server.gui.add_uplot((t, raw, raw - 0.5), lines, height=400)
print(f"Kalscope: http://127.0.0.1:{server.get_port()}", flush=True)
time.sleep(600)
"""
"""The two lines that the first picture of Kalscope has, at as many samples as the demo, and nothing else."""
BARE = "bare viser"
SERVERS = {
    BARE: (sys.executable, "-c", BARE_VISER),
    "kalscope open demo": (sys.executable, "-m", "kalscope_app.main", "open"),
}


def run_python(arguments: Sequence[str], environment: dict[str, str]) -> tuple[float, float]:
    """Seconds of a Python process, by the clock and of the processor."""
    start, before = time.perf_counter(), os.times()
    subprocess.run([sys.executable, *arguments], check=True, stdout=subprocess.DEVNULL, env=environment)
    lasted, after = time.perf_counter() - start, os.times()
    spent = after.children_user + after.children_system - before.children_user - before.children_system
    return lasted, spent


def first_picture(
    browser: Browser, program: Sequence[str], environment: dict[str, str]
) -> dict[str, tuple[float, float]]:
    """Seconds from the start of the process to the printed link and to the picture; processor time by then."""
    context = browser.new_context(viewport={"width": 1600, "height": 900})
    page = context.new_page()
    start = time.perf_counter()
    with Program("demo", program, environment=environment) as server:
        link = time.perf_counter() - start, cpu_seconds(server.process.pid)
        page.goto(server.url, wait_until="commit")
        page.wait_for_function(f"() => {SIGNAL_CHART}?.data[0].length > 2", timeout=120_000)
        drawn = time.perf_counter() - start, cpu_seconds(server.process.pid)
        context.close()
    return {"link printed": link, "first picture": drawn}


def measure(runs: int) -> dict[str, dict[str, float]]:
    """Median, fastest and slowest of each, s; and the median of its processor time, which a busy machine leaves."""
    taken: dict[str, list[tuple[float, float]]] = defaultdict(list)
    with tempfile.TemporaryDirectory(prefix="kalscope-bench-") as byte_code, chromium() as browser:
        environment = {**os.environ, "PYTHONPYCACHEPREFIX": byte_code, "PYTHONDONTWRITEBYTECODE": ""}
        for _ in range(runs + 1):
            for name, arguments in COMMANDS.items():
                taken[name].append(run_python(arguments, environment))
            for name, program in SERVERS.items():
                for what, times in first_picture(browser, program, environment).items():
                    taken[f"{name}: {what}"].append(times)
    rows = {
        name: summary([wall for wall, _ in one[1:]], [cpu for _, cpu in one[1:]]) for name, one in taken.items()
    }
    for name, row in rows.items():
        _, of, what = name.partition(": ")
        reference = rows[f"{BARE}: {what}" if of else REFERENCE]
        row["ratio"] = row["median_s"] / reference["median_s"]
        row["cpu_ratio"] = row["cpu_median_s"] / reference["cpu_median_s"]
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
