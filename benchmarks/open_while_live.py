"""Open large and hostile files beside a live board, in one process: does the reader of the port have to wait?

    python benchmarks/open_while_live.py [--json] [--rows 2000000]

A second process sends 1,000 numbered lines a second over a pseudo-terminal. A thread of this one opens one file
after another, as the dashboard does; the longest time between two reads of the port stands beside each. A machine
that is busy with something else is late by itself: the longest delay of a process that only sleeps stands beside it
and is left aside; the best of three turns counts. Exit status 1 where a file costs more than 0.25 s, the time for
which a recording may be behind.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from live import _watch_reads, board
from read_csv import write_log
from starved import Probe

from kalscope import read_recording
from kalscope.errors import KalscopeError
from kalscope.sources.live.live_source import LiveSource

RATE = 1000.0
MAX_GAP = 0.25
TURNS = 3
ROW = "2024-03-17 12:{:02}:{:02}.{:03};{},5;{}\n"


def make_files(folder: Path, rows: int) -> list[Path]:
    """An ordinary large log, one that goes line by line, one of few very long lines, one of hostile lines."""
    write_log(folder / "plain.csv", rows)
    with (folder / "stamped.csv").open("w") as out:
        out.write("time;temp;dist\n")
        out.writelines(
            ROW.format(i // 60_000 % 60, i // 1000 % 60, i % 1000, i % 37, i % 11) for i in range(rows // 10)
        )
    (folder / "wide.csv").write_text("".join(",".join(["1.5"] * 16_000) + "\n" for _ in range(200)))
    rows_of_three = "".join(f"{i / 100:.2f},{i % 7},{i % 5}\n" for i in range(100))
    for name, run in (("digits", "1"), ("blanks", " "), ("colons", "a:"), ("quotes", ' "'), ("separators", "1,")):
        hostile = "".join(lead + run * (65_000 // len(run)) + "x\n" for lead in ("", "# unit ", "a:", "1,"))
        (folder / f"hostile {name}.csv").write_text(rows_of_three + hostile * 5 + rows_of_three)
    return sorted(folder.iterdir())


def measure(files: list[Path]) -> list[dict[str, str | float]]:
    """For each file: seconds to open it, the longest wait of the port's reader, and that of the machine, in ms."""
    import tty

    master, slave = os.openpty()
    tty.setraw(slave)
    _own, other = multiprocessing.Pipe()
    found: list[dict[str, str | float]] = []
    with Probe() as probe, LiveSource(os.ttyname(slave)) as live:
        while live.status().word != "connected":
            time.sleep(0.01)
        gaps = _watch_reads(live)
        process = multiprocessing.Process(target=board, args=(master, RATE, 3600.0, 3, other), daemon=True)
        process.start()
        time.sleep(2.0)
        for name, work in [("nothing", lambda: time.sleep(3.0)), *((file.name, opener(file)) for file in files)]:
            # What the file costs, it costs each time; what else runs here is late once.
            found.append(min((turn(name, work, gaps, probe) for _ in range(TURNS)), key=own_wait))
        process.kill()
        process.join()
    os.close(slave)
    os.close(master)
    return found


def turn(name: str, work: Callable[[], None], gaps: list[float], probe: Probe) -> dict[str, str | float]:
    """Do the work on a thread of its own and watch the reader of the port."""
    gaps.clear()
    begin = time.monotonic()
    worker = threading.Thread(target=work)
    worker.start()
    worker.join()
    seconds = time.monotonic() - begin
    time.sleep(0.3)
    gap, late = max(gaps, default=seconds), probe.latest_since(begin)
    return {"file": name, "seconds": seconds, "gap_ms": 1000 * gap, "machine_ms": 1000 * late}


def own_wait(row: dict[str, str | float]) -> float:
    """Longest wait beyond the machine's own, ms."""
    return float(row["gap_ms"]) - float(row["machine_ms"])


def opener(file: Path) -> Callable[[], None]:
    """What opens a file and takes its refusal."""

    def work() -> None:
        with suppress(KalscopeError):
            read_recording(file)

    return work


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--rows", type=int, default=2_000_000)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        found = measure(make_files(Path(folder), options.rows))
    if options.json:
        print(json.dumps(found, indent=1))
    else:
        for row in found:
            waits = f"longest wait {row['gap_ms']:7.0f} ms  the machine's own {row['machine_ms']:7.0f} ms"
            print(f"{row['file']:25} {row['seconds']:7.2f} s  {waits}")
    return int(any(own_wait(row) > 1000 * MAX_GAP for row in found))


if __name__ == "__main__":
    sys.exit(main())
