"""What a container holds, which part of it is read, and the optional libraries that read it."""

from __future__ import annotations

import importlib
import subprocess
import sys
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from kalscope.common.numbers import Array
from kalscope.common.progress import Progress
from kalscope.common.stopping import done_at_stop
from kalscope.common.text import count, one_line
from kalscope.errors import BadFile, BadSetting
from kalscope.sources.containers import convert

# The libraries that read containers: optional, imported where a file needs one.


def load_library(module: str, package: str, name: str, kind: str) -> Any:
    """The module of a library.

    Args:
        module: Its name for import.
        package: Its name for pip.
        name: The file to be read.
        kind: What the file is: "an HDF5 file".

    Raises:
        BadFile: it is not installed.
    """
    try:
        return importlib.import_module(module)
    except ImportError:
        raise BadFile(f'{name} needs {package} to be read (got {kind}): pip install "kalscope[formats]"') from None


# What a container holds: a table of numbers, or text that is read by the rules of text files.


MAX_NUMBERS = 1 << 28
"""Most numbers of one table: 2 GiB as float64. A small file can claim any size."""
MAX_COLUMNS = 256
"""Most channels of one table; what is wider is a list or an image."""


@dataclass(frozen=True)
class Table:
    """Columns of one length, before the time axis is judged."""

    names: tuple[str, ...]
    """Name of each channel."""
    units: tuple[str, ...]
    """Unit of each channel; "" where none is given: its name may still hold one."""
    columns: tuple[Array, ...]
    """Samples of each channel, shape (n,), NaN where missing."""
    time: int | None = None
    """Column, from 0, that the file gives as the time in s; None: a column may still be found to be the time."""
    start: float | None = None
    """Time of the stamp 0 in s since 1970, where the file gives it."""
    period: float | None = None
    """Sample period in s that the file gives; None where it gives none."""
    notes: tuple[str, ...] = ()
    """What was decided, each a sentence: the format, the part that was chosen, the others."""
    dates: frozenset[int] = frozenset()
    """Columns, from 0, that are calendar stamps in µs since 1970."""


@dataclass(frozen=True)
class Text:
    """A table as lines of text, whose header, units and stamps are found as in any text file."""

    lines: Iterable[str | bytes]
    """The lines, without their newlines; or pieces of a text file as its bytes."""
    notes: tuple[str, ...]
    """What was decided, each a sentence."""
    delimiter: str | None = None
    """The mark between cells; None where the lines name their values."""
    part: str | None = None
    """The part to choose within the text: a name of a long table."""


# Which part of a file is read: one of its sheets, groups or segments, all of one time axis.


_MAX_NAMED = 12
"""Parts that a note or a refusal names."""


@dataclass(frozen=True)
class Part:
    """One part of a file, before it is read."""

    name: str
    """Its name, as the user gives it."""
    rows: int
    """Rows that it holds."""
    channels: int
    """Columns of numbers that it holds."""
    size: str = ""
    """How large it is, where that is no number of rows and columns."""


def choose_part(parts: Sequence[Part], wanted: str | None, name: str, what: str) -> tuple[int, tuple[str, ...]]:
    """Index of the part to read, and a sentence that names the others.

    Args:
        parts: The parts that hold numbers, in the order of the file.
        wanted: `ReadOptions.part`: the whole name of one, or the end of exactly one name; None for the part with
            most numbers.
        name: The file.
        what: What a part is called there: "sheet", "group".

    Raises:
        BadFile: there is no part with numbers.
        BadSetting: there is no such part, or more than one.
    """
    if not parts:
        raise BadFile(f"{name} must hold a {what} with numbers (got none)")
    if wanted is None:
        chosen = max(range(len(parts)), key=lambda i: parts[i].rows * parts[i].channels)
    else:
        chosen = _wanted(parts, wanted, what)
    if len(parts) == 1:
        return chosen, ()
    others = _listed([part for i, part in enumerate(parts) if i != chosen])
    return chosen, (f"read the {what} {_described(parts[chosen])}; --part NAME chooses another: {others}",)


def refuse_part(wanted: str | None, name: str) -> None:
    """Raise BadSetting where a part is requested of a file that is one table."""
    if wanted is not None:
        raise BadSetting(f"part must be left out, because {name} holds one table (got {wanted!r})")


def choose_text_part(
    parts: Sequence[Part], wanted: str | None, name: str, what: str
) -> tuple[int, tuple[str, ...], str | None]:
    """As `choose_part`, for parts that are text; and the part to choose within the text, a name of a long table."""
    if len(parts) == 1 and wanted is not None and not parts[0].name.endswith(wanted):
        return 0, (), wanted
    return (*choose_part(parts, wanted, name, what), None)


def _wanted(parts: Sequence[Part], wanted: str, what: str) -> int:
    names = [part.name for part in parts]
    if wanted in names:
        return names.index(wanted)
    ending = [i for i, name in enumerate(names) if wanted and name.endswith(wanted)]
    if len(ending) == 1:
        return ending[0]
    choices = _listed([parts[i] for i in ending] if ending else parts)
    raise BadSetting(f"part must be one {what} of {choices} (got {wanted!r})")


def _described(part: Part) -> str:
    return f'"{part.name}" ({part.size or f"{count(part.rows)} × {part.channels}"})'


def _listed(parts: Sequence[Part]) -> str:
    shown = ", ".join(_described(part) for part in parts[:_MAX_NAMED])
    return shown if len(parts) <= _MAX_NAMED else f"{shown} and {len(parts) - _MAX_NAMED} more"


# Files at which a library may abort its process are read in another one.


def convert_apart(kind: str, path: Path, folder: Path, progress: Progress) -> None:
    """Have `convert.py` write what a file holds into a folder; its process is killed when the task is cancelled."""
    process = subprocess.Popen(
        [sys.executable, convert.__file__, kind, str(path), str(folder)],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,  # one line, which the pipe holds until it is read
    )
    with process, done_at_stop(process.kill):
        try:
            while process.poll() is None:
                progress(0.5, "reading")
                with suppress(subprocess.TimeoutExpired):
                    process.wait(0.05)
        except BaseException:  # leaving the block waits for the process, after Ctrl+C as well
            process.kill()
            raise
        said = process.stderr.read() if process.stderr else b""
    if process.returncode:
        raise ValueError(one_line(said.decode("utf-8", "replace"))[:120] or "the library failed")
