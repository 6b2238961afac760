"""The files of one recording, by name: NAME.csv, NAME-2.csv, …, NAME.rejects, NAME.torn."""

from __future__ import annotations

import os
from itertools import count
from pathlib import Path

from kalscope.errors import BadFile
from kalscope.sources.recorder.format import escaped

_HEAD_BYTES = 4096


def rejects_path(path: Path) -> Path:
    """Where the rejected lines of a recording go."""
    return path.with_name(f"{path.stem}.rejects")


def part_path(path: Path, number: int) -> Path:
    """Part `number`, from 1, of a recording."""
    return path if number == 1 else path.with_name(f"{path.stem}-{number}{path.suffix}")


def torn_path(path: Path) -> Path:
    """Where the torn tail of a file goes: NAME.torn, NAME.rejects.torn."""
    return path.with_name(f"{path.name}.torn" if path.suffix == ".rejects" else f"{path.stem}.torn")


def free_part(path: Path, number: int) -> tuple[int, Path]:
    """The first part from `number` on whose name is free: its number and its path."""
    return next((n, part_path(path, n)) for n in count(number) if not os.path.lexists(part_path(path, n)))


def free_path(path: Path) -> Path:
    """A name similar to `path` that no recording has."""
    candidates = (path.with_name(f"{path.stem}_{n}{path.suffix}") for n in count(2))
    return next(p for p in candidates if not _is_taken(p))


def first_free(path: Path) -> Path:
    """`path`, or a similar name if a recording has it."""
    return free_path(path) if _is_taken(path) else path


def _is_taken(path: Path) -> bool:
    return os.path.lexists(path) or os.path.lexists(rejects_path(path))


def check_free(path: Path) -> None:
    """Refuse a name that is taken.

    Raises:
        BadFile: The name cannot be used; a free one is proposed.
    """
    if not path.name or path.is_dir():
        raise BadFile(f"a recording must be a file (got {str(path)!r})")
    if path.suffix.lower() in (".rejects", ".torn"):
        raise BadFile(f"a recording must not end in .rejects or .torn (got {path.name!r})")
    if _is_taken(path):
        raise taken(path)


def taken(path: Path) -> BadFile:
    """The error of a name that is taken."""
    return BadFile(f"{path.name!r} exists already: choose another name, such as {free_path(path).name!r}")


def unwritable(path: Path, error: Exception) -> BadFile:
    """The error of a file that cannot be created or opened."""
    reason = getattr(error, "strerror", None) or str(error)
    return BadFile(f"cannot write the recording {str(path)!r}: {reason}")


def continues_line(before: Path) -> str:
    """The comment by which a part names the one before it."""
    return f"# continues {escaped(before.name)}, with the same host time\n"


def existing_parts(path: Path) -> list[Path]:
    """The parts of a recording that exist; files of other recordings that have such names are left out.

    Raises:
        BadFile: not even the first does, or one cannot be read.
    """
    if not path.is_file():
        raise BadFile(f"there is no recording {str(path)!r} to resume")
    parts = [path]
    for n in count(2):
        part = part_path(path, n)
        if not part.is_file():
            break
        try:
            with part.open("rb") as file:
                head = file.read(_HEAD_BYTES)
        except OSError as error:
            raise unwritable(part, error) from None
        if continues_line(parts[-1]).encode() in head:
            parts.append(part)
    return parts
