"""Processor time and memory of processes, and how busy the whole machine is, for all benchmarks."""

from __future__ import annotations

import os
import re
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

TICKS = os.sysconf("SC_CLK_TCK")


def rss_mb(pid: int) -> float:
    """Resident memory of a process, MB."""
    return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


def cpu_seconds(pid: int) -> float:
    """Processor time of a process so far, s."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / TICKS


def busy_seconds() -> float:
    """Processor time that the whole machine has used so far, s."""
    fields = [int(word) for word in Path("/proc/stat").read_text().split("\n", 1)[0].split()[1:]]
    return (sum(fields[:8]) - fields[3] - fields[4]) / TICKS


def children_cpu(pid: int) -> dict[str, float]:
    """Processor time so far of all processes below one, by what they are, s."""
    found: dict[str, float] = {}
    for entry in Path("/proc").iterdir():
        with suppress(OSError, IndexError):  # it has ended
            if entry.name.isdigit() and _descends(int(entry.name), pid):
                kind = _kind_of(int(entry.name))
                found[kind] = found.get(kind, 0.0) + cpu_seconds(int(entry.name))
    return found


def _descends(pid: int, ancestor: int) -> bool:
    while pid > 1 and pid != ancestor:
        pid = int(Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[1])
    return pid == ancestor


def _kind_of(pid: int) -> str:
    command = Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ")  # chromium parts its own by spaces
    program, _, arguments = command.partition(b" ")
    if b"chrom" not in program:
        return "driver" if b"node" in program else "program"
    kind = re.search(rb"--type=([\w-]+)", arguments)
    return f"chromium {kind[1].decode() if kind else 'main'}"


class Load:
    """How busy the machine was during measurements, and how much of that the measured programs were themselves."""

    def __init__(self) -> None:
        self.seconds = self.busy = 0.0
        self.own: Counter[str] = Counter()
        """Processor time of the processes below this one, by what they are, s."""

    @contextmanager
    def stretch(self) -> Iterator[None]:
        """A stretch of time that counts, in which no process of this benchmark ends."""
        began, busy, own = time.monotonic(), busy_seconds(), Counter(children_cpu(os.getpid()))
        yield
        self.seconds += time.monotonic() - began
        self.busy += busy_seconds() - busy
        self.own += Counter(children_cpu(os.getpid())) - own

    def __add__(self, other: Load) -> Load:
        both = Load()
        both.seconds, both.busy, both.own = (
            self.seconds + other.seconds,
            self.busy + other.busy,
            self.own + other.own,
        )
        return both

    def summary(self) -> dict[str, float]:
        """Percent of all cores."""
        whole = max(self.seconds * (os.cpu_count() or 1), 1e-9)
        return {
            "cores": float(os.cpu_count() or 1),
            "load_average": os.getloadavg()[0],
            "busy_percent": 100.0 * self.busy / whole,
            "others_percent": 100.0 * max(0.0, self.busy - sum(self.own.values())) / whole,
        }

    def __str__(self) -> str:
        one = self.summary()
        return (
            f"machine: {one['cores']:.0f} cores, {one['busy_percent']:.0f} % busy, {one['others_percent']:.0f} %"
            f" by other programs; load average {one['load_average']:.1f}"
        )
