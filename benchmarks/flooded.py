"""A board that floods `kalscope record` and a recording dashboard: memory, the account of every line, and the end.

Each run sends lines for some seconds. In odd runs the flood ends first, and received = written + rejected + dropped
must be the lines that were sent; in even ones SIGTERM comes in the flood. The dashboard has a page whose messages
are read, or, in every second pair of runs, one that stops reading; with `--chromium` a real one. Exit status 1
where a line is not accounted for, the end takes more than 2 s, or the memory of the second half grows by more than
the samples that the dashboard keeps.

    python benchmarks/flooded.py [--seconds 60] [--times 20] [--rate 10] [--only record] [--chromium] [--json]
"""

from __future__ import annotations

import argparse
import importlib
import json
import logging
import re
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Generator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import asdict, dataclass
from pathlib import Path

from dashboard_page import PROGRAM, Program, chromium
from machine import rss_mb

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from tests.support.floods import LINES, Flood

LIMIT_S = 2.0
"""Longest time from SIGTERM to the end that passes, s."""
GROWTH_MB = {"record": 20.0, "open": 100.0}
"""Growth of the memory in the second half that passes, MB: the dashboard keeps a million samples a channel."""
PAGES = ("reads", "stops")
"""What a page of which only the messages are read does with them."""
ACCOUNT = re.compile(r"received (\d+) lines = (\d+) written \+ (\d+) rejected \+ (\d+) dropped")


@dataclass(frozen=True)
class Row:
    """What one run showed."""

    command: str
    page: str
    """What is connected to the dashboard."""
    rate: float | None
    """Bytes a second; None = as fast as they are taken."""
    ends_first: bool
    """Whether the flood ended before the command."""
    sent: int
    """Lines."""
    received: int
    written: int
    rejected: int
    dropped: int
    memory_mb: tuple[float, ...]
    """After each quarter of the time."""
    end_s: float

    @property
    def faults(self) -> list[str]:
        """What must not be."""
        is_whole = self.received == self.written + self.rejected + self.dropped
        missing = self.sent - self.received
        faults = {
            f"ends after {self.end_s:.2f} s": self.end_s > LIMIT_S,
            "the account does not add up": not is_whole,
            f"{missing} lines not accounted for": missing != 0 if self.ends_first else missing < 0,
            "memory grows": self.memory_mb[-1] > self.memory_mb[1] + GROWTH_MB[self.command],
        }
        return [fault for fault, is_so in faults.items() if is_so]


@contextmanager
def recorder(port: str, folder: Path) -> Generator[subprocess.Popen[str]]:
    """`kalscope record`, started."""
    with subprocess.Popen(
        [PROGRAM, "record", port, "-o", "recording.csv"],
        cwd=folder,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        text=True,
    ) as process:
        time.sleep(2.0)
        yield process


@contextmanager
def dashboard(port: str, folder: Path, page: str) -> Generator[subprocess.Popen[str]]:
    """`kalscope open` with a page, and the recorder on."""
    guest_of = importlib.import_module("tests.app.wire").Guest
    with Program(port, folder=folder) as program, ExitStack() as pages:
        number, token = re.findall(r":(\d+)/\?token=(\S+)", program.url)[0]
        guest = pages.enter_context(guest_of(int(number), token))
        guest.read_until(
            lambda: "Record" in [made.get("props", {}).get("label") for made in guest.widgets.values()]
        )
        guest.set(guest.find("Record"), True)
        guest.read_until((folder / "recording.csv").exists)
        if page == "stops":
            pages.enter_context(guest.connection.recv_flow_control)  # holding it, nothing more is read
        elif page == "chromium":
            opened = pages.enter_context(chromium()).new_page()
            opened.goto(program.url)
            opened.get_by_role("tab", name="Source").wait_for(timeout=120_000)
        yield program.process


def run(command: str, page: str, rate: float | None, seconds: float, *, ends_first: bool) -> Row:
    """One flood."""
    with tempfile.TemporaryDirectory(prefix="flooded-") as name, Flood(LINES, rate=rate) as flood:
        folder, memory, port = Path(name), list[float](), f"socket://127.0.0.1:{flood.port}"
        flood.pause()
        with recorder(port, folder) if command == "record" else dashboard(port, folder, page) as process:
            flood.resume()
            end = time.monotonic() + seconds
            for quarter in (3, 2, 1, 0):
                time.sleep(max(end - quarter * seconds / 4 - time.monotonic(), 0.0))
                memory.append(rss_mb(process.pid))
            if ends_first:
                flood.pause()
                time.sleep(6.0)  # what waits is taken
            began = time.monotonic()
            process.send_signal(signal.SIGTERM)
            with suppress(subprocess.TimeoutExpired):
                process.wait(60.0)
            took = time.monotonic() - began
        sent = (flood.sent + len(LINES) - 1) // len(LINES) * LINES.count(b"\n")
        found = ACCOUNT.search((folder / "recording.csv").read_text()[-1000:])
        received, written, rejected, dropped = map(int, found.groups() if found else "1000")
    return Row(command, page, rate, ends_first, sent, received, written, rejected, dropped, tuple(memory), took)


def text_of(row: Row) -> str:
    """One line of the table."""
    rate = "any" if row.rate is None else f"{row.rate / 1e6:.0f}"
    memory = " ".join(f"{one:5.0f}" for one in row.memory_mb)
    page = row.page if row.command == "open" else ""
    return (
        f"{row.command:7} {page:8} {rate:>4} {'yes' if row.ends_first else 'no':5} {row.sent:11,} {row.written:11,}"
        f" {row.rejected:9,} {row.dropped:11,} {row.sent - row.received:9,}  {memory}  {row.end_s:5.2f}"
        f"  {'; '.join(row.faults) or 'ok'}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--times", type=int, default=20, help="runs of each command")
    parser.add_argument("--only", choices=GROWTH_MB, help="only this command")
    parser.add_argument("--rate", type=float, default=10.0, help="MB/s; 0 = as fast as they are taken")
    parser.add_argument("--chromium", action="store_true", help="the page of the dashboard is a real one")
    options = parser.parse_args()
    logging.getLogger("websockets").setLevel(
        logging.CRITICAL
    )  # a page that stops reading is disconnected after 40 s
    if not options.json:
        print("command page MB/s first; lines sent, written, rejected, dropped, unread; MB in each quarter; end s")
    rate = options.rate * 1e6 or None
    rows: list[Row] = []
    for number in range(options.times):
        page = "chromium" if options.chromium else PAGES[number // 2 % 2]
        for command in [options.only] if options.only else GROWTH_MB:
            rows.append(run(command, page, rate, options.seconds, ends_first=number % 2 == 0))
            if not options.json:
                print(text_of(rows[-1]), flush=True)
    faults = sum(bool(row.faults) for row in rows)
    if options.json:
        print(json.dumps({"rows": [asdict(row) for row in rows], "faults": faults}, indent=1))
    else:
        ends = [row.end_s for row in rows]
        print(
            f"{len(rows)} ends, median {statistics.median(ends):.2f} s, slowest {max(ends):.2f} s; {faults} faults"
        )
    sys.exit(1 if faults else 0)


if __name__ == "__main__":
    main()
