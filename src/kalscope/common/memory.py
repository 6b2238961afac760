"""How much memory is free, so that what will not fit is refused before the system kills the program."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from kalscope.errors import NoMemory

MEMORY_FACTOR = 2.2
"""Memory that a reading takes, in bytes of its numbers, until the Recording is made and passed on."""
_MEMORY = Path("/proc/meminfo")
_GROUPS = Path("/sys/fs/cgroup")
_OWN_GROUP = Path("/proc/self/cgroup")
_USED = Path("/proc/self/statm")


def free_memory() -> int | None:
    """Bytes that can still be allocated without swapping, within the limits of a container; None if unknown.

    Known on Linux only: the smallest of what the kernel calls available and what is left in each control group.
    """
    with suppress(OSError, ValueError):
        fields = dict(line.split(":", 1) for line in _MEMORY.read_text().splitlines())
        available = int(fields["MemAvailable"].split()[0]) << 10
        return max(0, min([available, *_left_in_groups()]))
    return None


def does_not_fit(name: str) -> NoMemory:
    """The error for something that filled the memory while it was read."""
    return NoMemory(f"{name} must fit into the memory that is free, and it does not: open a part of it")


def require_memory(need: float, name: str, what: str, instead: str = "open a part of it") -> None:
    """Refuse what will not fit into the memory.

    Args:
        need: What it takes, bytes.
        name: The file.
        what: What is in it.
        instead: What the user can do.

    Raises:
        NoMemory: it does not fit.
    """
    free = free_memory()
    if free is not None and need > free:
        raise NoMemory(
            f"{name} must fit into the memory that is free, {free / 1e9:.1f} GB (got {what}, which take"
            f" {need / 1e9:.1f} GB): {instead}"
        )


def require_memory_for_numbers(count: int, name: str) -> None:
    """Refuse a recording of so many numbers that it will not fit into the memory, see `require_memory`."""
    require_memory(8 * MEMORY_FACTOR * count, name, f"{count} numbers")


def _left_in_groups() -> Iterator[int]:
    """What is left in the control group of this process and in each parent; file caches can be reclaimed."""
    with suppress(OSError, ValueError):
        own = next(line[3:] for line in _OWN_GROUP.read_text().splitlines() if line.startswith("0::"))
        folder = _GROUPS / own.strip("/")
        for group in (folder, *folder.parents):
            if not group.is_relative_to(_GROUPS):
                return
            with suppress(OSError, ValueError):  # "max" is not a limit, and the root group has no such file
                most = int((group / "memory.max").read_text())
                kept = dict(line.split() for line in (group / "memory.stat").read_text().splitlines())
                yield most - int((group / "memory.current").read_text()) + int(kept["file"])


def limit_memory(more: int) -> None:
    """Let this process allocate this many more bytes, then raise MemoryError; only Linux has such a limit."""
    with suppress(ImportError, OSError, ValueError):
        import resource

        data = int(_USED.read_text().split()[5]) * os.sysconf("SC_PAGE_SIZE")
        _, hard = resource.getrlimit(resource.RLIMIT_DATA)
        most = data + more
        resource.setrlimit(resource.RLIMIT_DATA, (most if hard < 0 else min(most, hard), hard))
