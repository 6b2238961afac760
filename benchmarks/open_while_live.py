"""Open large and hostile files beside a live board that is recorded: does the port's reader or the recorder wait?

    python benchmarks/open_while_live.py [--json] [--rows 2000000] [--only WORD] [--here]

A second process sends 1,000 numbered lines a second over a pseudo-terminal; this one reads and records them. A
thread opens one file after another, as the dashboard does: in the worker process, then the first State. The longest
time between two reads of the port, and the greatest age of a line when it is written, are printed beside each. A
busy machine is late by itself: beside them is the longest wait of a process that only reads
another pseudo-terminal, and how long a thread here was ready to run without a processor in one of them. What a wait
lasted longer than either at that time is the program's own, and is what counts, in the best of three turns. Exit
status 1 where it is more than 0.05 s. With --here the files are read in this process, as commands read them.
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
from functools import partial
from pathlib import Path
from typing import Any

from live import board
from read_csv import write_log
from starved import BareReader, Starved

from kalscope import read_recording
from kalscope.errors import KalscopeError
from kalscope.sources.live.source import LiveSource
from kalscope.sources.port.reader import BytesReceived
from kalscope_app.session.opening import opened
from kalscope_app.worker.worker import Worker

RATE = 1000.0
MAX_WAIT = 0.05
TURNS = 3
COLUMNS = ("read", "write", "bare", "starved", "own")
Wait = tuple[float, float]
"""Its begin and end, monotonic, s."""
Row = dict[str, Any]
"""What one turn showed: the file, and times in s and ms."""
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
    samples = ",".join(f'{{"t": {i}, "a": {i % 7}.5}}' for i in range(rows))
    (folder / "document.json").write_text(f"[{samples}]")
    return sorted(folder.iterdir())


def open_it(file: Path, worker: Worker | None) -> None:
    """Open a file and take its refusal; in this process where there is no worker."""
    work = partial(read_recording, file)
    with suppress(KalscopeError):
        opened(work() if worker is None else worker.run(work, file.name, lambda *_: None))


def measure(files: list[Path], recording: Path, worker: Worker | None) -> list[Row]:
    """For each file: seconds to open it, the longest waits, and what of them is the program's own, in ms."""
    import tty

    master, slave = os.openpty()
    tty.setraw(slave)
    _own, other = multiprocessing.Pipe()
    found: list[Row] = []
    bare, starved = BareReader(), Starved(os.getpid())
    with bare, starved, LiveSource(os.ttyname(slave)) as live:
        while live.status().word != "connected":
            time.sleep(0.01)
        reads, writes = watch_reads(live), watch_writes(live)
        live.record(recording)
        process = multiprocessing.Process(target=board, args=(master, RATE, 3600.0, 3, other), daemon=True)
        process.start()
        time.sleep(2.0)
        for file in (None, *files):
            work = partial(time.sleep, 3.0) if file is None else partial(open_it, file, worker)
            name = "nothing" if file is None else file.name
            # What the file costs, it costs each time; what else runs here is late once.
            turns = (turn(name, work, reads, writes, bare, starved) for _ in range(TURNS))
            found.append(min(turns, key=lambda row: row["own_ms"]))
        process.kill()
        process.join()
    os.close(slave)
    os.close(master)
    return found


def watch_reads(live: LiveSource) -> list[Wait]:
    """From each read of the port to the next."""
    waits: list[Wait] = []
    take = live._take

    def note(received: BytesReceived) -> None:
        waits.append((received.begin, received.end))
        take(received)

    live._take = note
    return waits


def watch_writes(live: LiveSource) -> list[Wait]:
    """From the arrival of the newest line to its being written, each time that lines are."""
    waits: list[Wait] = []
    write = live._write

    def note(stamped):
        write(stamped)
        if stamped:
            waits.append((stamped[-1][0], time.monotonic()))

    live._write = note
    return waits


def turn(
    name: str,
    work: Callable[[], None],
    reads: list[Wait],
    writes: list[Wait],
    bare: BareReader,
    starved: Starved,
) -> Row:
    """Do the work on a thread of its own and watch the reader of the port and the recorder."""
    reads.clear()
    writes.clear()
    begin = time.monotonic()
    worker = threading.Thread(target=work)
    worker.start()
    worker.join()
    end = time.monotonic()
    time.sleep(0.3)
    reads, writes = (waits or [(begin, end)] for waits in (reads, writes))
    long = [wait for wait in (*reads, *writes) if wait[1] - wait[0] > MAX_WAIT]
    return {
        "file": name,
        "seconds": end - begin,
        "read_ms": 1000 * max(until - since for since, until in reads),
        "write_ms": 1000 * max(until - since for since, until in writes),
        "bare_ms": 1000 * bare.latest_since(begin),
        "starved_ms": 1000 * max((starved.between(*wait) for wait in long), default=0.0),
        "own_ms": 1000 * max((own_part(wait, bare, starved) for wait in long), default=0.0),
    }


def own_part(wait: Wait, bare: BareReader, starved: Starved) -> float:
    """What a wait lasted longer than those of the machine at that time, s."""
    begin, end = wait
    return max(end - begin - max(bare.latest_between(begin, end), starved.between(begin, end)), 0.0)


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--rows", type=int, default=2_000_000)
    parser.add_argument("--only", default="", help="files whose name holds this word")
    parser.add_argument("--here", action="store_true", help="read in this process")
    options = parser.parse_args()
    worker = None if options.here else Worker()
    with tempfile.TemporaryDirectory() as folder, tempfile.TemporaryDirectory() as other:
        files = [file for file in make_files(Path(folder), options.rows) if options.only in file.name]
        found = measure(files, Path(other) / "board.csv", worker)
    if worker is not None:
        worker.close()
    if options.json:
        print(json.dumps(found, indent=1))
    else:
        for row in found:
            waits = "  ".join(f"{name} {row[f'{name}_ms']:6.0f} ms" for name in COLUMNS)
            print(f"{row['file']:25} {row['seconds']:7.2f} s  {waits}")
    return int(any(row["own_ms"] > 1000 * MAX_WAIT for row in found))


if __name__ == "__main__":
    sys.exit(main())
