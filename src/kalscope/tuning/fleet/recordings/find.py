"""What SOURCE names: folders, files, patterns, Parquet data sets, and lists of files."""

from __future__ import annotations

import glob
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from fnmatch import fnmatch
from pathlib import Path

from kalscope.errors import BadSetting, describe
from kalscope.tuning.fleet.recordings.data_set import data_set_units, row_group_units
from kalscope.tuning.fleet.recordings.listed import read_list
from kalscope.tuning.fleet.recordings.long_form import long_files
from kalscope.tuning.fleet.recordings.unit import Piece, Unit, unit_of

ENDINGS = (".parquet", ".pq")
"""Endings of Parquet files."""
_REPORT_EVERY = 1000
"""Files between two reports of how many were found."""


def find_units(
    sources: Sequence[str],
    output: str | os.PathLike[str],
    row_groups: bool = False,
    looked: Callable[[int], None] | None = None,
) -> list[Unit]:
    """Everything that the sources name, each once, in the order of the names.

    A folder stands for everything below it except hidden names; a file that is not a recording becomes a row with
    the reason.

    Args:
        sources: Paths of files and folders, patterns such as "logs/*.csv", and @LIST.
        output: The folder of the results, which is not a source.
        row_groups: Whether each row group of a Parquet file is a recording of its own.
        looked: Called with the number of files found so far, every thousand.

    Raises:
        BadSetting: A source names nothing, or all of them nothing.
        BadFile: A list cannot be read.
    """
    listed = [entry for source in sources if source.startswith("@") for entry in read_list(source[1:])]
    roots = [path for source in sources if not source.startswith("@") for path in _matches(source)]
    base = _base([*roots, *(path for path, _ in listed)])
    skipped = os.path.realpath(output)
    units: dict[tuple[str, str | None], Unit] = {}
    for root in roots:
        if _is_within(root, skipped):  # a pattern such as ** finds the results of an earlier run
            continue
        for path, reason in _below(root, skipped):
            unit = unit_of(path, _name(path, base)) if not reason else _unreadable(path, base, reason)
            units.setdefault((unit.pieces[0].path, None), unit)
            if looked is not None and len(units) % _REPORT_EVERY == 0:
                looked(len(units))
    for path, channel in listed:
        unit = unit_of(path, _name(path, base), channel)
        units.setdefault((unit.pieces[0].path, channel), unit)
    if not units:
        raise BadSetting(f"SOURCE must name at least one file (got {', '.join(map(repr, sources))}, all empty)")
    return sorted(
        _spread(units.values(), row_groups), key=lambda unit: (unit.data_set, unit.id, unit.channel or "")
    )


def _spread(units: Iterable[Unit], row_groups: bool) -> Iterator[Unit]:
    """The units with those of Parquet data sets in place of their files; the files of a folder are one data set."""
    folders: dict[str, dict[str, Unit]] = {}
    for unit in units:
        path = unit.pieces[0].path
        if unit.reason or unit.channel or not path.lower().endswith(ENDINGS):
            yield unit
        elif row_groups:
            yield from row_group_units(path, unit.id) or [unit]
        else:
            folders.setdefault(os.path.dirname(path), {})[path] = unit
    for folder, by_path in folders.items():
        together = long_files(by_path)
        yield from (unit for path, unit in by_path.items() if path not in together)
        if together:
            paths = [path for path in by_path if path in together]
            first = by_path[paths[0]].id
            name = os.path.dirname(first)
            label = first if len(paths) == 1 else name or os.path.basename(folder)
            yield from data_set_units(paths, f"{name}/" if name else "", label)


def _matches(source: str) -> list[str]:
    """The paths that a source stands for."""
    if os.path.lexists(source):
        return [os.path.abspath(source)]
    found = sorted(_expanded(source)) if glob.has_magic(source) else []
    if not found:
        raise BadSetting(
            f"SOURCE must be a folder, a file, a pattern such as 'logs/*.csv' or @LIST (got {source!r})"
        )
    return [os.path.abspath(path) for path in found]


def _expanded(pattern: str) -> Iterator[str]:
    """What a pattern stands for; ** is any depth of folders, and follows no link to one, which might be a loop."""
    parts = Path(pattern).parts
    if "**" not in parts:
        yield from glob.glob(pattern)
        return
    at = parts.index("**")
    roots = glob.glob(os.path.join(*parts[:at])) if at else [os.curdir]
    if set(parts[at:]) <= {"**", "*"}:
        yield from roots
        return
    for root in roots:
        for path, _ in _below(root, ""):
            if _fits(Path(os.path.relpath(path, root)).parts, parts[at:]):
                yield path


def _fits(parts: Sequence[str], pattern: Sequence[str]) -> bool:
    """Whether the parts of a path fit those of a pattern."""
    if not pattern:
        return not parts
    if pattern[0] == "**":
        return _fits(parts, pattern[1:]) or (bool(parts) and _fits(parts[1:], pattern))
    return bool(parts) and fnmatch(parts[0], pattern[0]) and _fits(parts[1:], pattern[1:])


def _base(paths: Sequence[str]) -> str:
    """The folder that names are relative to: the only folder given, or the one that contains all."""
    if len(paths) == 1:
        return paths[0] if os.path.isdir(paths[0]) else os.path.dirname(paths[0])
    try:
        return os.path.commonpath([os.path.dirname(path) for path in paths]) if paths else ""
    except ValueError:  # two drives of Windows
        return ""


def _is_within(path: str, folder: str) -> bool:
    return os.path.join(os.path.realpath(path), "").startswith(os.path.join(folder, ""))


def _name(path: str, base: str) -> str:
    name = os.path.relpath(path, base) if base else path
    return Path(name).as_posix().encode("utf-8", "backslashreplace").decode()


def _below(root: str, skipped: str) -> Iterator[tuple[str, str]]:
    """The files at or below a path, each with the reason why it cannot be read, "" where none is known."""
    if not os.path.isdir(root):
        yield root, ""
        return
    waiting = [] if os.path.realpath(root) == skipped else [root]
    while waiting:
        folder = waiting.pop()
        try:
            with os.scandir(folder) as entries:
                seen = [
                    (entry.path, entry.is_dir(follow_symlinks=False)) for entry in entries if entry.name[0] != "."
                ]
        except OSError as error:
            yield folder, describe(error)
            continue
        if not seen:
            yield folder, "the folder is empty"
        for path, is_folder in seen:
            if not is_folder:
                yield path, ""
            elif os.path.basename(path) != os.path.basename(skipped) or os.path.realpath(path) != skipped:
                waiting.append(path)


def _unreadable(path: str, base: str, reason: str) -> Unit:
    return Unit(_name(path, base), (Piece(path),), reason=reason)
