"""A record of 10 million samples in the real program: how long everything takes, and how much memory.

Each source is opened in a program of its own; its window is changed, a move undone, a report made, and q is moved
in turns with bare viser that shows the same two lines (`peer_servers.py`). The clock is that of `press_clock.py`.
Memory is the most that the program ever held, with all that is computed while idle, less that of the same steps
with a record of a thousand samples; it is printed beside the bytes of the values and the time.

    python benchmarks/large_record.py [--json] [--samples 10000000] [--presses 9] [--kinds synthetic,csv,timed]
"""

from __future__ import annotations

import argparse
import json
import random
import re
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
from dashboard_page import Program, chromium, dashboard_page, slider
from peer_servers import PEERS
from playwright.sync_api import Browser, Locator, Page
from press_clock import Times, milliseconds, press, press_often, rotated, settle, summary, watch
from targets import Target

from kalscope import FilterParams, denoise, open_source
from kalscope_app.engine.filter_runs import FilterRuns, choose_samples
from kalscope_app.engine.frame import compute_frame
from kalscope_app.session.opening import opened

KINDS = ("synthetic", "csv", "timed")
"""A generated signal; a file of one column; one with a column of time."""
COLUMNS = 2
"""Numbers of a sample: its value, and its time, which is stored for a file without one too."""
TINY = 1000
"""Samples of the record whose memory is that of the program alone."""
MAX_MEMORY, MAX_RATIO = 6.0, 2.0
"""The promises: bytes over those of the samples, and key press to changed line over bare viser's."""
PATIENCE_MS = 120_000
FRAMES = 15
"""Frames whose time is compared without a browser."""


def source_of(kind: str, n: int, folder: Path) -> str:
    """Something to open with n samples."""
    synthetic = f"synthetic:random_walk?n={n}&sigma=0.5&seed=1"
    if kind == "synthetic":
        return synthetic
    path = folder / f"{kind}-{n}.csv"
    if not path.exists():
        recording = open_source(synthetic)
        with path.open("w", encoding="ascii") as file:
            file.write("time,x\n" if kind == "timed" else "x\n")
            for first in range(0, n, 100_000):
                values = recording.values[first : first + 100_000, 0]
                lines = (f"{i / 1000:.3f},{value:.4f}" for i, value in enumerate(values.tolist(), first))
                file.write("\n".join(lines if kind == "timed" else (f"{v:.4f}" for v in values.tolist())) + "\n")
    return str(path)


def most_mb(pid: int) -> float:
    """The most memory that a process ever held, MB."""
    status = Path(f"/proc/{pid}/status").read_text("ascii")
    return int(status.partition("VmHWM:")[2].split()[0]) * 1024 / 1e6


@contextmanager
def opened_page(browser: Browser, program: Program) -> Iterator[Page]:
    with dashboard_page(browser, program.url) as page:
        page.set_default_timeout(PATIENCE_MS)
        watch(page)
        yield page


def one_step(page: Page, thumb: Locator, key: str) -> float:
    """Milliseconds from one key press to the changed line."""
    thumb.focus()
    (value,) = milliseconds([press(page, key, 500)], "drawn")
    return value


def steps(page: Page, pid: int) -> dict[str, float]:
    """All that is done to a record but moves of q: milliseconds of each."""
    shown = page.locator("label", has_text=re.compile("^view$")).first
    thumb = shown.locator("xpath=ancestor::*[.//*[@role='slider']][1]//*[@role='slider']").first
    found = {"window": one_step(page, thumb, "ArrowRight")}
    slider(page, "q").focus()
    press(page, "ArrowRight", 500)
    found["undo"] = one_step(page, page.get_by_role("button", name="Undo", exact=True), "Enter")
    settle(page, pid)
    page.get_by_role("tab", name="Export", exact=True).click()
    folder = page.get_by_text("Report and data", exact=True)
    folder.click()
    button = page.get_by_role("button", name="Download report (HTML)")
    begin = time.monotonic()
    with page.expect_download(timeout=PATIENCE_MS):
        button.click()
    found["report"] = 1e3 * (time.monotonic() - begin)
    page.get_by_role("tab", name="Tune", exact=True).click()
    return found


def session_of(browser: Browser, source: str) -> tuple[dict[str, float], float]:
    """Milliseconds of each step in a program of its own, with the map shown, and the most memory in MB."""
    begin = time.monotonic()
    with Program(source, map_shown=True) as program:
        found = {"link": 1e3 * (time.monotonic() - begin)}
        with opened_page(browser, program) as page:
            found["first picture"] = 1e3 * (time.monotonic() - begin)
            settle(page, program.process.pid)
            found["studies end"] = 1e3 * (time.monotonic() - begin)
            found |= steps(page, program.process.pid)
            settle(page, program.process.pid)
        return found, most_mb(program.process.pid)


def presses_beside_viser(browser: Browser, source: str, presses: int) -> dict[str, dict[str, float]]:
    """Moves of q in turns with bare viser, a page each."""
    taken: dict[str, list[Times]] = {"kalscope": [], "viser": []}
    with ExitStack() as stack:
        programs = {
            "kalscope": stack.enter_context(Program(source)),
            "viser": stack.enter_context(Program(source, (sys.executable, PEERS, "viser"))),
        }
        for turn in range(3):
            for name in rotated(list(programs), turn):
                with opened_page(browser, programs[name]) as page:
                    settle(page, programs[name].process.pid)
                    slider(page, "q").focus()
                    taken[name] += press_often(page, -(-presses // 3), random.Random(turn))
    return {name: summary(milliseconds(times, "drawn")) for name, times in taken.items()}


def frame_beside_denoise(source: str) -> dict[str, float]:
    """Milliseconds that a move takes without a browser: our frame, and `denoise` with the drawn samples picked."""
    recording = open_source(source)
    state = opened(recording)
    drawn, runs, z = choose_samples(recording, state.channel, None), FilterRuns(), np.ascontiguousarray(state.z)
    works: dict[str, Callable[[float], object]] = {
        "frame": lambda q: compute_frame(state.with_tuning(q=q), 1, drawn, runs),
        "denoise": lambda q: denoise(z, FilterParams(q, 0.25))[drawn.indices],
    }
    taken: dict[str, list[float]] = {name: [] for name in works}
    for i in range(FRAMES):
        for name, work in works.items():
            begin = time.perf_counter()
            work(1.0 + 0.01 * i)
            taken[name].append(1e3 * (time.perf_counter() - begin))
    return {name: float(np.median(times)) for name, times in taken.items()}


def measure(kind: str, n: int, presses: int, folder: Path) -> dict[str, Any]:
    """One source."""
    source = source_of(kind, n, folder)
    row: dict[str, Any] = {"kind": kind, "samples": n, "samples_mb": 8e-6 * n * COLUMNS}
    row["without_browser_ms"] = frame_beside_denoise(source)
    with chromium() as browser:
        _, alone = session_of(browser, source_of(kind, TINY, folder))
        row["steps_ms"], most = session_of(browser, source)
        row["moves_ms"] = presses_beside_viser(browser, source, presses)
    row["memory_mb"] = most - alone
    row["memory_ratio"] = row["memory_mb"] / row["samples_mb"]
    row["move_ratio"] = row["moves_ms"]["kalscope"]["median"] / row["moves_ms"]["viser"]["median"]
    return row


def shown(row: dict[str, Any]) -> str:
    """The rows of one source, and its promises."""
    ours, bare = (row["moves_ms"][name]["median"] for name in ("kalscope", "viser"))
    frame, alone = (row["without_browser_ms"][name] for name in ("frame", "denoise"))
    lines = [f"{row['kind']}, {row['samples']:,} samples, {row['samples_mb']:.0f} MB"]
    lines += [f"  {name:<44}{value / 1e3:>9.2f} s" for name, value in row["steps_ms"].items()]
    lines.append(f"  {'a move of q, beside bare viser':<44}{ours:>9.1f} ms {bare:>9.1f} ms {ours / bare:>6.2f} ×")
    lines.append(
        f"  {'its frame, beside denoise alone':<44}{frame:>9.1f} ms {alone:>9.1f} ms {frame / alone:>6.2f} ×"
    )
    lines.append(f"  {'memory, beside the samples':<44}{row['memory_mb']:>9.0f} MB {row['memory_ratio']:>19.1f} ×")
    return "\n".join((*lines, *map(str, targets(row))))


def targets(row: dict[str, Any]) -> tuple[Target, ...]:
    """What is promised of one source."""
    return (
        Target(f"{row['kind']}: memory over the samples' bytes", row["memory_ratio"], MAX_MEMORY, "×"),
        Target(f"{row['kind']}: a move beside bare viser", row["move_ratio"], MAX_RATIO, "×"),
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--samples", type=int, default=10_000_000)
    parser.add_argument("--presses", type=int, default=9)
    parser.add_argument("--kinds", default=",".join(KINDS))
    options = parser.parse_args()
    rows: list[dict[str, Any]] = []
    with tempfile.TemporaryDirectory() as folder, suppress(KeyboardInterrupt):
        for kind in options.kinds.split(","):
            rows.append(measure(kind, options.samples, options.presses, Path(folder)))
            if not options.json:
                print(shown(rows[-1]), end="\n\n", flush=True)
    if options.json:
        print(json.dumps(rows, indent=1))
    sys.exit(0 if all(one.met for row in rows for one in targets(row)) else 1)


if __name__ == "__main__":
    main()
