"""Half an hour of hostile files, boards and web requests beside a good board: is a line lost, or a file left?

A board on a pseudo-terminal sends 1,000 numbered lines a second to the real dashboard, which records them. Beside
it the files of the tests are opened and uploaded, small and large, every fourth cancelled and each
followed by a good one; the boards are recorded by `kalscope record`, every other one ended in the middle; and the
attacks of tests/app/attack_table.py are carried out. Exit status 1 where a line of the good board is
lost, where an input has another result than it must, where memory grows by more than the samples that are kept,
where the end takes more than 2 s, or where a process or a temporary file is left.

    python benchmarks/soak_hostile.py [--json] [--minutes 30] [--rate 1000] [--channels 2] [--every 30]
"""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path

import psutil
from dashboard_page import PROGRAM, Program
from hostile_input import END_S, HostileBoards, HostileFiles, Repeated, Tally, Victim, WebAttacks, crowding
from live_memory import MemoryLook, kept_mb, memory_of
from machine import rss_mb
from numbered_board import NumberedBoard, RecordedRows, soak_parser
from soak import pause_in
from starved import Probe
from tests.app.wire import Guest
from tests.support.program import port_of, token_of

ERROR = re.compile(r"^.* ERROR (?!websockets\.).*$", re.MULTILINE)
"""In the log; the server names each broken frame of the attacks."""
MEMORY_MB = 150.0
"""Growth of the program beyond the kept samples that passes, MB: libraries of formats, caches, the allocator."""
MEMORY_MINUTES = 2.0
"""Length of a run from which on memory is judged, minutes."""
RECORDING, LOG = "recording.csv", "kalscope.log"
CATCH_UP_S = 30.0
"""Longest time after the last line of the board in which it must be recorded, s."""
MOST_FAULTS = 20
"""Faults that are printed."""


@dataclass(frozen=True)
class Look:
    """What one interval showed."""

    minute: float
    """Its end, from the start of the stream."""
    rss_mb: float
    """Resident memory of the dashboard, whatever file it shows."""
    family_mb: float
    """The same with the processes that it started."""
    lost: int
    """Lines of the good board wrong or missing in its recording so far."""
    starved_ms: float
    """How late the machine woke a process that only sleeps, at most, in this interval."""
    load: float
    """The machine's load average over the last minute."""
    done: dict[str, int]
    """Files, boards and attacks so far."""
    faults: int
    """What was not as it must be, so far."""


class Watch:
    """The dashboard, its good board, and what is seen of both."""

    def __init__(self, program: Program, board: NumberedBoard, probe: Probe, guest: Guest, tally: Tally) -> None:
        self._pid, self._board, self._probe, self._tally = program.process.pid, board, probe, tally
        self._guest, self.rows = guest, RecordedRows(program.folder / RECORDING)
        self.begin = self._at = time.monotonic()
        self.rests: list[MemoryLook] = []
        """Memory while the dashboard holds on to nothing but small files and the board's samples."""

    def rest(self) -> None:
        """Note the memory; small files are open."""
        kept = kept_mb(self._board.sent, 1 + self._board.channels)
        self.rests.append(MemoryLook((time.monotonic() - self.begin) / 60.0, rss_mb(self._pid), kept))

    def look(self) -> Look:
        """One line of the table."""
        self.rows.look()
        look = Look(
            minute=(time.monotonic() - self.begin) / 60.0,
            rss_mb=rss_mb(self._pid),
            family_mb=sum(map(rss_of, family_of(self._pid))),
            lost=self.rows.wrong,
            starved_ms=1000.0 * self._probe.latest_since(self._at),
            load=os.getloadavg()[0],
            done=dict(self._tally.done),
            faults=len(self._tally.faults),
        )
        self._at = time.monotonic()
        return look

    def catch_up(self, sent: int) -> float:
        """Wait until the last line is recorded, CATCH_UP_S at most; the seconds that it took."""
        began = time.monotonic()
        while self.rows.first + self.rows.rows + self.rows.wrong < sent and time.monotonic() - began < CATCH_UP_S:
            time.sleep(0.1)
            self.rows.look()
        return time.monotonic() - began

    def longest_wait_ms(self) -> float:
        """The longest time for which bytes of the good board waited for its reader, from the status on screen."""
        return max(pause_in(text) for text in self._guest.markdown.values() if "max. read latency" in text)


def family_of(pid: int) -> list[psutil.Process]:
    """A process and all that it started."""
    with suppress(psutil.Error):
        own = psutil.Process(pid)
        return [own, *own.children(recursive=True)]
    return []


def rss_of(process: psutil.Process) -> float:
    """Resident memory, MB; 0 of one that has ended."""
    with suppress(psutil.Error):
        return process.memory_info().rss / 1e6
    return 0.0


def begin_recording(guest: Guest, file: Path) -> None:
    """As a user does it, without a browser."""
    guest.read_until(lambda: "Record" in [made["props"].get("label") for made in guest.widgets.values()])
    guest.set(guest.find("Record"), True)
    guest.read_until(file.exists)


def soak(minutes: float, board: NumberedBoard, every: float, tell: bool) -> dict[str, object]:
    """One run."""
    tally, looks = Tally(), list[Look]()
    with tempfile.TemporaryDirectory(prefix="soak-") as name, board, Probe() as probe:
        folders = {part: Path(name) / part for part in ("files", "boards", "tmp", "state", "program")}
        for folder in folders.values():
            folder.mkdir()
        environment = {"TMPDIR": str(folders["tmp"]), "XDG_STATE_HOME": str(folders["state"])}
        with (
            Program(
                f"serial:{board.port}@115200",
                (PROGRAM, "open", "--log", folders["state"] / LOG),
                folder=folders["program"],
                environment=environment,
            ) as program,
            Guest(port_of(program.url), token_of(program.url)) as guest,
        ):
            begin_recording(guest, program.folder / RECORDING)
            board.start()
            watch = Watch(program, board, probe, guest, tally)
            victim = Victim(port_of(program.url), token_of(program.url))
            with (
                Repeated("files", HostileFiles(guest, folders["files"], tally, watch.rest).step, tally),
                Repeated("boards", HostileBoards(folders["boards"], environment, tally).step, tally),
                Repeated("attacks", WebAttacks(victim, tally).step, tally),
            ):
                while time.monotonic() - watch.begin < 60.0 * minutes:
                    time.sleep(every)
                    looks.append(watch.look())
                    if tell:
                        print(row(looks[-1]), flush=True)
                sent, wait_ms = board.stop(), watch.longest_wait_ms()
                behind_s = watch.catch_up(sent)
            faults = tally.faults[:]  # what is attacked next finds no program
            end_s, lost = end(program, watch.rows, sent)
            faults += faults_of_end(program, end_s, folders)
    return {
        **judged(watch.rests, minutes),
        "minutes": minutes,
        "rate": board.rate,
        "sent": sent,
        "recorded": watch.rows.rows,
        "lost": lost,
        "account": watch.rows.account,
        "longest_wait_ms": wait_ms,
        "longest_starved_ms": max(one.starved_ms for one in looks),
        "longest_write_ms": 1000.0 * board.longest_write,
        "recorded_after_s": behind_s,
        "peak_family_mb": max(one.family_mb for one in looks),
        "end_s": end_s,
        "done": dict(tally.done),
        "longest_s": dict(sorted(tally.longest.items(), key=lambda one: -one[1])[:12]),
        "faults": faults,
        "rests": [asdict(one) for one in watch.rests],
        "looks": [asdict(one) for one in looks],
    }


def judged(rests: list[MemoryLook], minutes: float) -> dict[str, object]:
    """What the memory showed, and whether it passes; a short run only shows how the program warms up."""
    if minutes < MEMORY_MINUTES:
        return {"memory": "too short to judge memory", "memory_flat": True}
    memory = memory_of(rests) if rests else {"unexplained_mb": float("nan")}
    return {**memory, "memory_flat": memory["unexplained_mb"] <= MEMORY_MB}


def end(program: Program, rows: RecordedRows, sent: int) -> tuple[float, int]:
    """End the program while it is attacked: the seconds that it takes, and the lines lost."""
    began = time.monotonic()
    program.process.send_signal(signal.SIGTERM)
    with suppress(subprocess.TimeoutExpired):
        program.process.wait(timeout=60.0)
    took = time.monotonic() - began
    rows.look()
    return took, rows.wrong + max(sent - rows.first - rows.rows - rows.wrong, 0)


def faults_of_end(program: Program, end_s: float, folders: dict[str, Path]) -> list[str]:
    """What must not be left of the program and of what it started."""
    deadline = time.monotonic() + 60.0
    while (left := processes_with(folders["tmp"])) and time.monotonic() < deadline:
        if not any("record" in words for words in left):  # the last hostile board is recorded to its end
            break
        time.sleep(0.2)
    said, files = (folders["state"] / LOG).read_text("utf-8", "replace"), os.listdir(folders["tmp"])
    faults = {
        f"the end took {end_s:.1f} s": end_s > END_S * crowding(),
        f"status {program.process.poll()} at the end": program.process.poll() != 0,
        f"processes left: {left}": bool(left),
        f"temporary files left: {files}": bool(files),
        f"errors in the log: {(errors := ERROR.findall(said))[:5]}": bool(errors),
    }
    return [fault for fault, is_so in faults.items() if is_so]


def processes_with(folder: Path) -> list[list[str]]:
    """Command lines of the processes that were started with this folder for temporary files."""
    found: list[list[str]] = []
    for process in psutil.process_iter():
        with suppress(psutil.Error, OSError):
            if process.environ().get("TMPDIR") == str(folder) and process.status() != psutil.STATUS_ZOMBIE:
                found.append(process.cmdline())
    return found


HEAD = "  min   RSS MB  all MB  lost  starved ms  load  faults  files read / refused, boards, attacks"


def row(look: Look) -> str:
    """One line of the table."""
    done = look.done
    boards = done.get("recorded", 0) + done.get("ended in the middle", 0)
    return (
        f"{look.minute:5.1f} {look.rss_mb:8.0f} {look.family_mb:7.0f} {look.lost:5} {look.starved_ms:11.0f}"
        f" {look.load:5.1f} {look.faults:7}  {done.get('read or cancelled', 0)} / {done.get('refused', 0)},"
        f" {boards}, {done.get('attacks', 0)}"
    )


def main() -> None:
    options = soak_parser(__doc__).parse_args()
    if not options.json:
        print(HEAD)
    board = NumberedBoard(options.rate, options.channels, 60.0 * options.minutes + 120.0)
    found = soak(options.minutes, board, options.every, tell=not options.json)
    faults = found["faults"]
    assert isinstance(faults, list)
    if options.json:
        print(json.dumps(found, indent=1))
    else:
        left_out = ("rests", "looks", "faults")
        print(*(f"{name:20} {value}" for name, value in found.items() if name not in left_out), sep="\n")
        print(f"{len(faults)} faults", *faults[:MOST_FAULTS], sep="\n")
    sys.exit(0 if found["lost"] == 0 and found["memory_flat"] and not faults else 1)


if __name__ == "__main__":
    main()
