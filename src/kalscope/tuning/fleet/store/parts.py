"""The parts of a fleet: what is finished, on disk, whatever process dies next.

A part is written under a temporary name, synced and renamed, so that it is whole or absent. Its name is the hash of
its units, and its metadata name them: a rerun needs only the footers to know what is done. Two parts may hold the
same unit, as when a worker that seemed dead ends its task after all; they are equal, and the later one is taken.
"""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path

from kalscope.common.files import write_atomic
from kalscope.estimation.fleet.pool import Pool
from kalscope.tuning.fleet.store.row import Row
from kalscope.tuning.fleet.store.table import part_bytes, units_of

_OWN = re.compile(r"[0-9a-f]{32}\.(?:parquet|note)|\.[0-9a-f]{32}\.parquet\.kalscope-[0-9a-f]{16}\.tmp")
"""Names of parts, of their notes and temporary files; others below `parts` are left alone."""
_TEMPORARY = re.compile(r"\..+\.kalscope-[0-9a-f]{16}\.tmp")
"""Names that `atomic_file` gives; other hidden files of the folder are the user's."""
FOLDER = "parts"
"""Their folder in that of a fleet; they are spread over folders of two hexadecimal digits."""


def part_path(folder: Path, keys: Iterable[str]) -> Path:
    """The path of the part with these units."""
    name = hashlib.sha256("\n".join(keys).encode()).hexdigest()[:32]
    return folder / FOLDER / name[:2] / f"{name}.parquet"


def note_path(folder: Path, keys: Iterable[str]) -> Path:
    """The path of the note about the unit of a batch that is being done, see `work.deadline`."""
    return part_path(folder, keys).with_suffix(".note")


def write_part(folder: Path, units: Mapping[str, tuple[Sequence[Row], Pool]], again: Collection[str] = ()) -> Path:
    """Write the results of some units, durably.

    Args:
        folder: Of the fleet.
        units: The rows and the pool of each, by its key.
        again: The keys of those that the next run tries again.

    Returns:
        The path of the part.

    Raises:
        OSError: The disk is full or the folder cannot be written; nothing is left behind.
    """
    path = part_path(folder, units)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_atomic(path, part_bytes(units, again))
    return path


def find_parts(folder: Path, *, settled: bool = False) -> dict[str, Path]:
    """The part of each finished unit, by its key. What is not a part, or cannot be read, is ignored.

    Args:
        folder: Of the fleet.
        settled: Only the units that are done for good, none that is to be tried again.
    """
    good: dict[str, Path] = {}
    again: dict[str, Path] = {}
    for path in part_files(folder):  # of those to be tried again the last attempt counts
        for key, done in (units_of(path) or {}).items():
            (good if done else again)[key] = path
    return good if settled else again | good


def part_files(folder: Path) -> list[Path]:
    """The files that may be parts, in the order in which they were written, by their time stamps."""
    found: list[tuple[int, Path]] = []
    for path in _files(folder, ".parquet"):
        with suppress(OSError):  # removed meanwhile
            found.append((path.stat().st_mtime_ns, path))
    return [path for _, path in sorted(found)]


def sweep(folder: Path, keep: Iterable[Path] | None = None) -> None:
    """Remove the temporary files and notes of killed runs, and the parts that are not to be kept.

    Args:
        folder: Of the fleet, which this run holds.
        keep: The parts that are needed; None = all.
    """
    kept = None if keep is None else set(keep)
    useless = [path for path in _files(folder, ".parquet") if kept is not None and path not in kept]
    tops = [folder / name for name in os.listdir(folder) if _TEMPORARY.fullmatch(name)]
    for path in (*_files(folder, ".tmp"), *_files(folder, ".note"), *tops, *useless):
        with suppress(OSError):
            path.unlink()
    for path in (folder / FOLDER).glob("??"):
        with suppress(OSError):
            path.rmdir()  # only where it is empty


def _files(folder: Path, ending: str) -> Iterator[Path]:
    """The files of the parts with this ending, in the order of their names."""
    return iter(sorted(path for path in (folder / FOLDER).glob(f"??/*{ending}") if _OWN.fullmatch(path.name)))
