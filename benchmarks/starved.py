"""How long a program was kept from the processor: what is late on a busy machine is not always its own fault."""

from __future__ import annotations

import math
import multiprocessing
import os
import select
import time
from contextlib import suppress
from multiprocessing.sharedctypes import RawArray
from pathlib import Path
from typing import NoReturn

import numpy as np

NAP = 0.005
"""Seconds between two wake-ups of the probe."""
KEPT = 1 << 15
"""Wake-ups that are remembered: 160 s."""


class Probe:
    """A process that only sleeps, and notes how late it was woken; use it in a `with`."""

    def __init__(self) -> None:
        self._late = RawArray("d", 2 * KEPT)
        self._process = multiprocessing.get_context("fork").Process(target=self._run, daemon=True)

    def __enter__(self) -> Probe:
        self._process.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        self._process.join()

    def latest_since(self, since: float) -> float:
        """Longest time in s by which it was woken too late, from a monotonic moment on."""
        return self.latest_between(since, math.inf)

    def latest_between(self, begin: float, end: float) -> float:
        """The same of the waits that fell, with a part of them at least, between two monotonic moments."""
        woken, late = np.frombuffer(self._late).reshape(KEPT, 2).T
        return float(late[(woken >= begin) & (woken - late <= end)].max(initial=0.0))

    def _run(self) -> None:
        table, i = np.frombuffer(self._late).reshape(KEPT, 2), 0
        while True:
            due = time.monotonic() + NAP
            time.sleep(NAP)
            now = time.monotonic()
            table[i] = now, now - due
            i = (i + 1) % KEPT


class BareReader(Probe):
    """A process that only reads a pseudo-terminal, to which another writes every millisecond, and notes its waits.

    The kernel hands the bytes of a terminal over by a task of its own, which a busy machine lets wait as well: half
    a second where a process that sleeps is woken 0.03 s late.
    """

    def _run(self) -> None:
        import tty

        table, i = np.frombuffer(self._late).reshape(KEPT, 2), 0
        master, slave = os.openpty()
        tty.setraw(slave)
        if os.fork() == 0:
            _write_until_alone(master)
        before = time.monotonic()
        while True:
            select.select([slave], [], [])
            os.read(slave, 1 << 16)
            now = time.monotonic()
            if now - before > NAP:
                table[i] = now, now - before
                i = (i + 1) % KEPT
            before = now


class Starved(Probe):
    """A process that notes for how long a thread of another one was ready to run and had no processor."""

    def __init__(self, pid: int) -> None:
        super().__init__()
        self._pid = pid

    def between(self, begin: float, end: float) -> float:
        """That time between two monotonic moments, s; 0 on other systems than Linux."""
        looked, without = np.frombuffer(self._late).reshape(KEPT, 2).T
        seen_by = looked[looked >= end].min(initial=math.inf)
        return float(without[(looked >= begin) & (looked <= seen_by)].sum())

    def _run(self) -> None:
        table, i, before = np.frombuffer(self._late).reshape(KEPT, 2), 0, waited(self._pid)
        while True:
            time.sleep(NAP)
            now = waited(self._pid)
            table[i] = time.monotonic(), max((now[one] - before.get(one, now[one]) for one in now), default=0.0)
            before, i = now, (i + 1) % KEPT


def _write_until_alone(master: int) -> NoReturn:
    """Write a byte a millisecond while the process that reads them is there."""
    reader = os.getppid()
    while os.getppid() == reader:
        os.write(master, b"1")
        time.sleep(0.001)
    os._exit(0)


def waited(pid: int) -> dict[str, float]:
    """Seconds that each thread of a process was ready to run and had no processor; {} on other systems than Linux.

    A wait that has not ended is not in it.
    """
    found = {}
    with suppress(OSError):
        for task in Path(f"/proc/{pid}/task").iterdir():
            with suppress(OSError, IndexError):
                found[task.name] = int((task / "schedstat").read_text().split()[1]) / 1e9
    return found
