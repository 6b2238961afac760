"""A move of the q slider in Kalscope, in bare viser and in Dash, the latter two with the same two lines alone.

All run at once in processes of their own and take turns, a fresh page each, by the clock of `press_clock.py`: key
press -> changed line drawn -> painted. A line for each target says whether it is met; exit status 1 otherwise.

    python benchmarks/beside_others.py [--json] [--presses 60] [--samples 100000,1000000,10000000]
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import sys
from contextlib import ExitStack
from dataclasses import asdict
from typing import Any

from dashboard_page import PROGRAM, Program, chromium
from machine import Load
from peer_servers import PEERS
from playwright.sync_api import Browser
from press_clock import PLOTLY, UPLOT, in_turns, milliseconds, summary
from targets import Target

KINDS = {
    "kalscope": ((PROGRAM, "open"), UPLOT),
    "viser": ((sys.executable, PEERS, "viser"), UPLOT),
    "dash": ((sys.executable, PEERS, "dash"), PLOTLY),
}
VERY_LONG = 10_000_000
"""Samples from which Dash is left out, and twice the time of bare viser is enough."""
HAS_DASH = importlib.util.find_spec("dash") is not None
WHAT = {"drawn": "press to changed line", "painted": "press to painted"}


def measure(browser: Browser, samples: int, presses: int, names: list[str]) -> dict[str, Any]:
    """Median and 95th percentile of each program, ms, for one record."""
    source = f"synthetic:random_walk?n={samples}&sigma=0.5&seed=1"
    with ExitStack() as stack:
        programs = {name: (stack.enter_context(Program(source, KINDS[name][0])), KINDS[name][1]) for name in names}
        taken = in_turns(browser, programs, presses)
    rows = {
        name: {what: summary(milliseconds(times, what)) for what in WHAT} | {"presses": len(times)}
        for name, (times, _) in taken.items()
    }
    load = sum((one.load for one in taken.values()), Load())
    return {"samples": samples, "rows": rows, "machine": load.summary(), "load": str(load)}


def targets(found: dict[str, Any]) -> list[Target]:
    """What the project promises of one record."""
    ours, viser, dash = (found["rows"].get(name) for name in KINDS)
    very_long = found["samples"] >= VERY_LONG
    lines: list[Target] = []
    for what, words in WHAT.items():
        at = f"{words}, {found['samples']:,} samples"
        ratio = {how: ours[what][how] / viser[what][how] for how in ("median", "p95")}
        lines.append(Target(f"{at}, median", ratio["median"], 2.0 if very_long else 1.5, "× bare viser"))
        if not very_long:
            lines.append(Target(f"{at}, p95", ratio["p95"], 2.0, "× bare viser"))
        if dash:
            lines += [Target(f"{at}, {how}", ours[what][how] / dash[what][how], 1.0, "× Dash") for how in ratio]
    return lines


def table(found: dict[str, Any]) -> str:
    """The rows of one record, ms."""
    viser = found["rows"]["viser"]
    lines = [f"{found['samples']:,} samples; {found['load']}"]
    lines.append(f"{'':<10}" + "".join(f"{what + ' ms: median':>20}     p95   × viser" for what in WHAT))
    for name, row in found["rows"].items():
        pairs = ((row[what], row[what]["median"] / viser[what]["median"]) for what in WHAT)
        cells = (f"{one['median']:>20.1f} {one['p95']:>7.0f} {ratio:>9.2f}" for one, ratio in pairs)
        lines.append(f"{name:<10}" + "".join(cells))
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--presses", type=int, default=60)
    parser.add_argument("--samples", default="100000,1000000,10000000")
    options = parser.parse_args()
    if not HAS_DASH:
        print('left out: Dash is not installed (pip install -e ".[bench]")', file=sys.stderr)
    all_found: list[dict[str, Any]] = []
    with chromium() as browser:
        for samples in (int(part) for part in options.samples.split(",")):
            names = [name for name in KINDS if name != "dash" or (HAS_DASH and samples < VERY_LONG)]
            all_found.append(measure(browser, samples, options.presses, names))
            if not options.json:
                print(table(all_found[-1]), flush=True)
    verdict = [target for found in all_found for target in targets(found)]
    if options.json:
        print(
            json.dumps(
                {"found": all_found, "targets": [asdict(one) | {"met": one.met} for one in verdict]}, indent=1
            )
        )
    else:
        print(*verdict, sep="\n")
    sys.exit(0 if all(one.met for one in verdict) else 1)


if __name__ == "__main__":
    main()
