"""How long each command takes to end after Ctrl+C, SIGTERM and SIGHUP, whatever comes in and whatever it is doing.

Each command is really started, gets the signal in the middle of its work or while it starts, and must end within 2
s with the right status, without a traceback, an unfinished file or a process left behind (exit status 1 otherwise).

    python benchmarks/stopping.py [--only filter] [--quick] [--json]
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack, suppress
from dataclasses import asdict, dataclass
from pathlib import Path

import psutil
from dashboard_page import PROGRAM
from machine import cpu_seconds

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from tests.support.floods import FLOODS, Flood

LIMIT_S = 2.0
"""Longest time from the signal to the end that passes, s."""
PATIENCE_S = 60.0
"""Time after which a command counts as one that does not end, s."""
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
INTO_THE_WORK_S = 1.0
"""Processor time after which a command is in the middle of its work, s."""


@dataclass(frozen=True)
class Case:
    """A command, its input, and when it gets the signal."""

    command: str
    """Its arguments; {port} is the address of the flood, {folder} a folder with recordings."""
    flood: str = ""
    """What comes in, over a socket or on standard input; "" for nothing at all."""
    until: str = ""
    """A file that it has made by then; "" = it has used `after` of processor time."""
    after: float = INTO_THE_WORK_S
    """Processor time from its start to the signal, s: the same point of its start on a busy machine."""
    status: int | None = None
    """Its exit status; None = 128 + the signal."""
    env: tuple[tuple[str, str], ...] = ()
    """Environment."""


@dataclass(frozen=True)
class Row:
    """What one case showed."""

    command: str
    flood: str
    when: str
    signal: str
    seconds: float
    status: int
    memory_mb: float
    said: str
    faults: tuple[str, ...]


SLOW = "synthetic:random_walk?n=3000000"
CASES = [
    *(Case("filter - --q 1 --r 1", flood) for flood in FLOODS),
    *(Case("record {port} -o run.csv", flood, "run.csv", status=0) for flood in FLOODS),
    *(Case("open {port} --no-browser --port 0", flood, "link", status=0) for flood in FLOODS),
    Case(f"filter {SLOW} -o out.csv"),
    Case(f"tune {SLOW}"),
    Case("reproduce -o out"),
    Case("fleet {folder} -o out", until="out/units.sqlite"),
    Case("calibrate {port}", "lines"),
    Case("calibrate {port}", "nothing"),
    Case("tune demo", until="cache/*", env=(("NUMBA_CACHE_DIR", "cache"),)),
    Case("open demo --no-browser --port 0", until="cache/*", status=0, env=(("NUMBA_CACHE_DIR", "cache"),)),
    *(Case("tune demo", after=after) for after in (0.05, 0.1, 0.2, 0.3)),
    *(Case("fleet {folder} -o out", after=after) for after in (0.3, 0.6)),
    *(Case("open demo --no-browser --port 0", after=after) for after in (0.3, 0.7)),
]


def devices(folder: Path) -> None:
    """Recordings that keep the workers of a fleet busy."""
    rows = "".join(f"{k / 100:.2f},{(k * 7919) % 1000 / 100:.2f}\n" for k in range(20_000))
    for number in range(200):
        (folder / f"device{number:03}.csv").write_text(f"time (s),light\n0.00,{number}\n" + rows[10:])


def run(case: Case, number: signal.Signals, logs: Path) -> Row:
    """Start the command, tell it to end, and look at what is left."""
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="stopping-")))
        (folder / "tmp").mkdir()
        flood = stack.enter_context(Flood(FLOODS[case.flood])) if case.flood else None
        port = f"socket://127.0.0.1:{flood.port}" if flood else ""
        arguments = [word.format(port=port, folder=logs) for word in case.command.split()]
        stdin = subprocess.DEVNULL
        if flood and "-" in arguments:
            stdin = stack.enter_context(socket.create_connection(("127.0.0.1", flood.port))).fileno()
        env = {
            **os.environ,
            **dict(case.env),
            "TMPDIR": str(folder / "tmp"),
            "XDG_STATE_HOME": str(folder / "state"),
        }
        errors = stack.enter_context((folder / "tmp.stderr").open("w+b"))
        link = stack.enter_context((folder / "link").open("wb")) if case.until == "link" else subprocess.DEVNULL
        process = subprocess.Popen(
            [PROGRAM, *arguments], cwd=folder, stdin=stdin, stdout=link, stderr=errors, env=env
        )
        stack.callback(process.kill)
        wait_for(case, process, folder)
        family = psutil.Process(process.pid).children(recursive=True) if process.poll() is None else []
        memory = peak_mb(process.pid)
        began = time.monotonic()
        process.send_signal(number)
        with suppress(subprocess.TimeoutExpired):
            process.wait(PATIENCE_S)
        seconds = time.monotonic() - began
        errors.seek(0)
        said = errors.read().decode("utf-8", "replace")
        faults = faults_of(case, number, process.poll(), seconds, said, folder, family)
        last = (said.splitlines() or [""])[-1]
        return Row(
            case.command, case.flood, when(case), number.name, seconds, process.poll() or 0, memory, last, faults
        )


def when(case: Case) -> str:
    """When it gets the signal, in a word."""
    return case.until or f"{case.after:g} s work"


def wait_for(case: Case, process: subprocess.Popen[bytes], folder: Path) -> None:
    """Wait until the command is where it gets the signal; not for what does not come."""
    end = time.monotonic() + (5.0 if case.flood == "nothing" else PATIENCE_S)
    while process.poll() is None and time.monotonic() < end:
        made = any(path.stat().st_size for path in folder.glob(case.until)) if case.until else False
        if made or (not case.until and cpu_seconds(process.pid) >= case.after):
            break
        time.sleep(0.005)
    if case.flood:
        time.sleep(1.0)


def faults_of(
    case: Case,
    number: signal.Signals,
    status: int | None,
    seconds: float,
    said: str,
    folder: Path,
    family: list[psutil.Process],
) -> tuple[str, ...]:
    """What must not be."""
    expected = {128 + number, case.status}  # told while it starts it has nothing to finish
    _, alive = psutil.wait_procs(family, timeout=max(LIMIT_S - seconds, 0.0))
    alive = [one for one in alive if one.is_running() and one.status() != psutil.STATUS_ZOMBIE]
    unfinished = [path.name for path in folder.rglob("*.tmp")] + os.listdir(folder / "tmp")
    faults = {
        f"{seconds:.1f} s": seconds > LIMIT_S,
        f"status {status}": status not in expected,
        "traceback": "Traceback" in said,
        f"{len(alive)} processes left": bool(alive),
        f"left {unfinished}": bool(unfinished),
    }
    return tuple(fault for fault, is_so in faults.items() if is_so)


def peak_mb(pid: int) -> float:
    """Most memory that the process has used so far, MB."""
    with suppress(OSError):
        for line in Path(f"/proc/{pid}/status").read_text().splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) / 1e3
    return 0.0


def text_of(row: Row) -> str:
    """One line of the table."""
    command = row.command.replace(SLOW, "3 M samples")
    return (
        f"{command[:34]:34} {row.flood[:18]:18} {row.when[:10]:10} {row.signal:7} {row.seconds:6.2f} {row.status:4}"
        f" {row.memory_mb:7.0f}  {'; '.join(row.faults) or 'ok':24} {row.said[:80]}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--only", default="", help="cases whose command or input has this in it")
    parser.add_argument("--quick", action="store_true", help="one signal a case, in turn")
    options = parser.parse_args()
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a job in the background is started with it ignored
    cases = [case for case in CASES if options.only in f"{case.command} {case.flood}"]
    rows: list[Row] = []
    with tempfile.TemporaryDirectory(prefix="stopping-") as logs:
        devices(Path(logs))
        if not options.json:
            print(f"{'command':34} {'comes in':18} {'at':10} signal   ends s stat  peak MB")
        for at, case in enumerate(cases):
            for number in SIGNALS[at % 3 :][:1] if options.quick else SIGNALS:
                rows.append(run(case, number, Path(logs)))
                if not options.json:
                    print(text_of(rows[-1]), flush=True)
    slowest = max(row.seconds for row in rows)
    faults = sum(bool(row.faults) for row in rows)
    if options.json:
        print(json.dumps({"rows": [asdict(row) for row in rows], "slowest_s": slowest, "faults": faults}, indent=1))
    else:
        print(f"{len(rows)} ends, the slowest after {slowest:.2f} s, {faults} with a fault")
    sys.exit(1 if faults else 0)


if __name__ == "__main__":
    main()
