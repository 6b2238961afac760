"""The input of benchmarks/soak_hostile.py: hostile files, boards and web requests, step by step.

Each has a `step`, which `Repeated` calls on a thread of its own, again and again; what must not happen is a fault.
"""

from __future__ import annotations

import os
import random
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from dashboard_page import PROGRAM
from machine import cpu_seconds

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from tests.app.attack_table import ATTACKS, Victim, seen_by
from tests.app.wire import Guest
from tests.sources.hostile_files import PACKED, SPECIAL, TEXTS
from tests.sources.live.test_hostile_boards import BOARDS, send
from tests.support.hostile_case import Case

from kalscope.common.text import count

END_S = 2.0
"""Longest time from SIGTERM to the end of a program that passes, s, on a machine that has a processor for it."""
PATIENCE_S = 300.0
"""Time after which a file counts as one that holds up all others, s."""
CANCEL_AFTER_S = 3.0
"""Seconds in which the Cancel button must be there; what is read sooner has none."""
CANCELLED_WITHIN_S = 5.0
"""Longest time from Cancel until the next file is on screen that passes, s: a new process begins to read."""
CROWDED = 3.0
"""Tasks that share a processor from which on a recording may be left before it has said its last line."""
IDLE_CPU_S = 0.1
"""Processor time in a second of `record` that has taken all lines; it looks for more ten times."""
UPLOADED = 64 << 20
"""Largest file that is uploaded; a larger one is opened by its path."""
PART = 1 << 19
"""Bytes of a part of an upload, as browsers cut them."""
ROWS = range(7001, 7999)
"""Rows of the good files: no hostile one has as many."""
MOVING = ("W16a", "W16b")
"""Attacks that compare a slider with its range, which moves here with the file on screen; the suite has them."""
ACCOUNT = re.compile(r"received (\d+) lines = (\d+) written \+ (\d+) rejected \+ (\d+) dropped(?:; (\d+) other)?")
"""Lines with numbers, and what became of them; then the lines of text."""


def crowding() -> float:
    """Tasks that share a processor now; 1 while there is one for each. What takes longer by that is not slow."""
    return max(os.getloadavg()[0] / (os.cpu_count() or 1), 1.0)


@dataclass
class Tally:
    """What was done, and what of it went wrong."""

    done: Counter[str] = field(default_factory=Counter[str])
    faults: list[str] = field(default_factory=list[str])
    longest: dict[str, float] = field(default_factory=dict[str, float])
    """Seconds of each thing that took a while, at most."""

    def took(self, what: str, seconds: float) -> None:
        """Keep the longest time of each."""
        self.longest[what] = max(self.longest.get(what, 0.0), seconds)


class Repeated(threading.Thread):
    """Does a step again and again until the block of its `with` ends; a step that fails is a fault."""

    def __init__(self, name: str, step: Callable[[], None], tally: Tally) -> None:
        super().__init__(name=name, daemon=True)
        self._step, self._tally, self._end = step, tally, threading.Event()

    def __enter__(self) -> Repeated:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._end.set()

    def run(self) -> None:
        """Until the end."""
        while not self._end.is_set():
            try:
                self._step()
            except Exception as error:  # what it ran into is for the table
                if not self._end.is_set():  # the program has ended meanwhile
                    self._tally.faults.append(f"{self.name}: {type(error).__name__}: {error}"[:300])
                    self._end.wait(1.0)


class HostileFiles:
    """Opens file after file in the dashboard, by its path or as an upload; every fourth is cancelled."""

    def __init__(self, guest: Guest, folder: Path, tally: Tally, rest: Callable[[], None]) -> None:
        """Args: a browser; a folder for the files; what came of them; called after each file of every eighth."""
        self._guest, self._folder, self._tally, self._rest = guest, folder, tally, rest
        self._cases, self._rows, self._number = self._in_turns(), 0, 0

    @staticmethod
    def _in_turns() -> Iterator[tuple[Case, int]]:
        """Each file and its size, small and large, again and again in another order."""
        draw, cases = random.Random(3), (*TEXTS, *PACKED, *SPECIAL)
        sizes = [(case, size) for case in cases for size in {case.small, case.big} if size]
        while True:
            draw.shuffle(sizes)
            yield from sizes

    def step(self) -> None:
        """Open one hostile file, then a good one, which must come on screen."""
        case, size = next(self._cases)
        path = self._folder / case.file
        case.make(path, size)
        try:
            self._number += 1
            self._open_hostile(case, path)
        finally:
            if path.is_dir() and not path.is_symlink():
                path.rmdir()
            else:
                path.unlink(missing_ok=True)
        if self._number % 8 == 0:
            for _ in range(6):  # the history holds on to fewer recordings
                self.open_good()
            self._rest()

    def _open_hostile(self, case: Case, path: Path) -> None:
        notices, began = len(self._guest.notices), time.monotonic()
        is_plain = path.is_file() and not path.is_symlink() and case.during is None
        if self._number % 3 == 0 and is_plain and path.stat().st_size <= UPLOADED:
            self._upload(path)
        else:
            self._open(path)
        if case.during is not None:
            time.sleep(0.02)
            case.during(path)
        if self._number % 4 == 1:
            cancel = self._guest.find("Cancel")
            if self._is_shown_within(CANCEL_AFTER_S * crowding(), cancel):
                self._guest.set(cancel, True)
                self._tally.done["cancelled"] += 1
            began = time.monotonic()
            self.open_good()
            seconds = time.monotonic() - began
            self._tally.took("from Cancel to the next file", seconds)
            if seconds > CANCELLED_WITHIN_S * crowding():
                self._tally.faults.append(f"{case.name}: {seconds:.1f} s after Cancel the next file was on screen")
        else:
            self.open_good()
            self._tally.took(f"file: {case.name}", time.monotonic() - began)
        said = self._guest.notices[notices:]
        self._tally.done["refused" if any("Cannot open" in text for text in said) else "read or cancelled"] += 1
        self._tally.faults += [f"{case.name}: {text}" for text in said if "crashed" in text or "went wrong" in text]

    def open_good(self) -> None:
        """Open a file of another number of rows and wait until it is on screen."""
        self._rows = (self._rows + 1) % len(ROWS)
        path, rows = self._folder / "good.csv", ROWS[self._rows]
        path.write_text("t,z\n" + "".join(f"{n},{n % 5}\n" for n in range(rows)))
        self._open(path)
        wanted = re.compile(rf"\b{count(rows)} rows, ")
        self._guest.read_until(lambda: any(map(wanted.search, self._guest.markdown.values())), PATIENCE_S)

    def _open(self, path: Path) -> None:
        self._guest.set(self._guest.find("path"), str(path))
        self._guest.set(self._guest.find("Open this path"), True)

    def _upload(self, path: Path) -> None:
        content, transfer = path.read_bytes(), f"t{self._number}"
        parts = [content[at : at + PART] for at in range(0, len(content), PART)] or [b""]
        which = {"source_component_uuid": self._guest.find("Upload a file …"), "transfer_uuid": transfer}
        size = {"part_count": len(parts), "size_bytes": len(content)}
        self._guest.send("FileTransferStartUpload", **which, **size, filename=path.name, mime_type="text/csv")
        for index, part in enumerate(parts):
            self._guest.send("FileTransferPart", **which, part_index=index, content=part)
        self._tally.done["uploaded"] += 1

    def _is_shown_within(self, seconds: float, uuid: str) -> bool:
        end, shown = time.monotonic() + seconds, self._guest.widgets[uuid]["props"]
        while (left := end - time.monotonic()) > 0 and not shown["visible"]:
            self._guest.read(timeout=left)
        return shown["visible"]


class HostileBoards:
    """Connects board after board with `kalscope record`, which is ended in the middle or when it has all."""

    def __init__(self, folder: Path, environment: Mapping[str, str], tally: Tally) -> None:
        """Args: a folder for the recordings; variables of the programs; what came of them."""
        self._folder, self._environment, self._tally = folder, environment, tally
        self._draw, self._number = random.Random(4), 0

    def step(self) -> None:
        """One board."""
        turn, index = divmod(self._number, len(BOARDS))
        board, is_cut = BOARDS[index], (index + turn) % 2 == 0
        self._number += 1
        ends, may_leave, output = list[int](), threading.Event(), self._folder / f"{self._number}.csv"
        with socket.create_server(("127.0.0.1", 0)) as server:
            pieces = board.send(board.big if turn % 4 else board.small)

            def serve() -> None:
                with suppress(OSError), server.accept()[0] as connection:
                    ends.append(send(connection, pieces))
                    may_leave.wait()

            sender = threading.Thread(target=serve, daemon=True)
            sender.start()
            process = subprocess.Popen(
                [PROGRAM, "record", f"socket://127.0.0.1:{server.getsockname()[1]}", "-o", output],
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True,
                env={**os.environ, **self._environment},
            )
            try:
                self._wait(process, output, ends, is_cut=is_cut)
                began = time.monotonic()
                process.send_signal(signal.SIGTERM)
                out, errors = process.communicate(timeout=60.0)
                took = time.monotonic() - began
            finally:
                process.kill()
                may_leave.set()
            sender.join(timeout=10.0)
        self._judge(board.name, out + errors, took, None if is_cut else sum(ends))
        for path in self._folder.glob(f"{self._number}[._]*"):
            path.unlink()

    def _wait(self, process: subprocess.Popen[str], output: Path, ends: list[int], *, is_cut: bool) -> None:
        """Until the program is in the middle of it, or until nothing is left to be taken."""
        end = time.monotonic() + PATIENCE_S
        while not output.exists() and process.poll() is None and time.monotonic() < end:
            time.sleep(0.02)
        if is_cut:
            time.sleep(self._draw.uniform(0.2, 3.0))
            return
        while not ends and process.poll() is None and time.monotonic() < end:
            time.sleep(0.05)
        used = -1.0
        while process.poll() is None and (now := cpu_seconds(process.pid)) - used > IDLE_CPU_S:
            used = now
            time.sleep(crowding())

    def _judge(self, name: str, said: str, took: float, ends: int | None) -> None:
        self._tally.done["recorded" if ends is not None else "ended in the middle"] += 1
        self._tally.took("from SIGTERM to the end of `record`", took)
        found, is_forced = ACCOUNT.search(said), "stopped by SIGTERM" in said  # it had no processor to finish
        received, *parts, others = map(int, found.groups("0")) if found else (0, 0, 0)
        is_whole = ends is None or is_forced or received + others == ends
        faults = {
            f"ended after {took:.1f} s, crowding {crowding():.1f}": took > END_S * crowding(),
            f"left before its end, crowding {crowding():.1f}": is_forced and crowding() < CROWDED,
            f"no account: {said[-300:]}": found is None and not is_forced,
            f"{received} lines are not {parts}": received != sum(parts),
            f"{received + others} lines received of {ends}": not is_whole,
            "traceback": "Traceback" in said,
        }
        self._tally.faults += [f"board {name}: {fault}" for fault, is_so in faults.items() if is_so]


class WebAttacks:
    """The attacks of tests/app/attack_table.py, one after the other."""

    def __init__(self, victim: Victim, tally: Tally) -> None:
        self._victim, self._tally, self._number = victim, tally, 0
        self._attacks: Sequence[str] = tuple(number for number in ATTACKS if number not in MOVING)

    def step(self) -> None:
        """One attack."""
        number = self._attacks[self._number % len(self._attacks)]
        self._number += 1
        attack, began = ATTACKS[number], time.monotonic()
        seen = seen_by(attack, self._victim)
        self._tally.took(f"attack {number}", time.monotonic() - began)
        self._tally.done["attacks"] += 1
        if seen != attack.expected:
            self._tally.faults.append(f"attack {number}: {seen} (must be {attack.expected})")
        time.sleep(0.1)
