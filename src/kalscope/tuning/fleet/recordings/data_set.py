"""Parquet data sets in the long form, id, time, value: which row groups make up a unit.

A unit owns the ids of a row group up to its largest, and reads every row group in which one of them lies. So a
series that runs over the end of a row group is whole, and no id has two owners. Only footers are read here.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from kalscope.errors import BadFile
from kalscope.tuning.fleet.libraries import library
from kalscope.tuning.fleet.recordings.unit import Piece, Unit

ENDINGS = (".parquet", ".pq")
"""Endings of Parquet files."""
ID_NAMES = ("id", "series_id", "unique_id", "device_id", "sensor_id", "device", "sensor")
"""Names of the column that says which series a row belongs to, in lower case, the first one found."""
MAX_READINGS = 4
"""How often the bytes of a data set may be read in all: more where its ids are not sorted."""
MAX_UNIT_BYTES = 1 << 30
"""Most bytes of a unit of several row groups: a worker holds it twice or three times."""


@dataclass(frozen=True)
class _Group:
    """A row group and the ids that lie in it."""

    path: str
    index: int
    size: int
    stamp: int
    first: Any
    last: Any


def id_column(names: Sequence[str]) -> str | None:
    """The column that holds the ids; None where there is none."""
    lower = {name.lower(): name for name in reversed(names)}
    return next((lower[name] for name in ID_NAMES if name in lower), None)


def plain_ids(column: Any) -> Any:
    """The ids themselves where a column holds numbers that stand for them."""
    return column.cast(column.type.value_type) if library("pyarrow").types.is_dictionary(column.type) else column


def is_data_set(path: str) -> bool:
    """Whether the file is Parquet in the long form: one that can be read, whose ids do not just number its rows."""
    pa = library("pyarrow")
    try:
        file = library("pyarrow.parquet").ParquetFile(path, memory_map=False)
        name = id_column(file.schema_arrow.names)
        if name is None or len(file.schema_arrow.names) < 2 or not file.num_row_groups:
            return False
        ids = file.read_row_groups(list(range(min(file.num_row_groups, 8))), columns=[name])[name]
        return 2 * len(ids.unique()) <= len(ids)
    except (pa.ArrowException, OSError, ValueError):
        return False


def data_set_units(paths: Sequence[str], name: str) -> list[Unit]:
    """The units of the files of one data set.

    Args:
        paths: Its files, which have an id column.
        name: Of the folder in the table, "" for none; the ids of its series follow.

    Raises:
        BadFile: its ids are of several types, or so mixed that a row group would be read many times.
    """
    groups = [group for path in paths for group in _groups(path)]
    if not groups:
        return []
    kinds = sorted({type(group.first).__name__ for group in groups})
    if len(kinds) > 1:
        raise BadFile(
            f"the ids of {os.path.dirname(paths[0])!r} must be of one type in all files (got {' and '.join(kinds)})"
        )
    units = [
        Unit(f"{name}{i:09d}", _pieces(inside), span=span, data_set=name)
        for i, (span, inside) in enumerate(_owned(groups))
    ]
    read, whole = sum(unit.size for unit in units), sum(group.size for group in groups)
    largest = max((unit.size for unit in units if sum(len(piece.groups) for piece in unit.pieces) > 1), default=0)
    if read > MAX_READINGS * whole or largest > MAX_UNIT_BYTES:
        raise BadFile(
            f"the rows of {os.path.dirname(paths[0])!r} must be sorted by {_id_of(paths[0])}, so that a series lies"
            f" in few row groups (got ids mixed over many): write them again with ORDER BY"
        )
    return units


def _owned(groups: Sequence[_Group]) -> Iterator[tuple[tuple[Any, Any], list[_Group]]]:
    """The spans of ids, each up to the largest of a row group, and the row groups that hold any of them."""
    waiting = sorted(groups, key=lambda group: (group.first, group.last), reverse=True)
    active: list[_Group] = []
    low = None
    for end in sorted({group.last for group in groups}):
        while waiting and waiting[-1].first <= end:
            active.append(waiting.pop())
        yield (low, end), active
        active, low = [group for group in active if group.last > end], end


def row_group_units(path: str, name: str) -> list[Unit]:
    """A unit for each row group of a file, each a recording of its own; none where its footer cannot be read."""
    try:
        state = os.stat(path)
        footer = library("pyarrow.parquet").read_metadata(path)
    except (library("pyarrow").ArrowException, OSError, ValueError):
        return []
    sizes = [footer.row_group(i).total_byte_size for i in range(footer.num_row_groups)]
    return [
        Unit(f"{name}#{i}", (Piece(os.path.abspath(path), size, state.st_mtime_ns, (i,)),))
        for i, size in enumerate(sizes)
    ]


def _id_of(path: str) -> str:
    return str(id_column(library("pyarrow.parquet").read_schema(path).names))


def _groups(path: str) -> list[_Group]:
    """The row groups of a file with the ids in them; those without rows or ids left out."""
    file = library("pyarrow.parquet").ParquetFile(path, memory_map=False)
    stamp, name = os.stat(path).st_mtime_ns, str(id_column(file.schema_arrow.names))
    found: list[_Group] = []
    for i in range(file.num_row_groups):
        footer = file.metadata.row_group(i)
        column = next(c for c in map(footer.column, range(footer.num_columns)) if c.path_in_schema == name)
        ends = _limits(file, i, name, column.statistics)
        if ends is not None:
            found.append(_Group(os.path.abspath(path), i, footer.total_byte_size, stamp, *ends))
    return found


def _limits(file: Any, index: int, name: str, known: Any) -> tuple[Any, Any] | None:
    """The smallest and the largest id of a row group, read where its footer does not say."""
    if known is not None and known.has_min_max:
        return known.min, known.max
    both = library("pyarrow.compute").min_max(plain_ids(file.read_row_group(index, columns=[name])[name]))
    low, high = both["min"].as_py(), both["max"].as_py()
    return None if low is None else (low, high)


def _pieces(groups: Sequence[_Group]) -> tuple[Piece, ...]:
    """Row groups by their files."""
    by_file: dict[str, list[_Group]] = {}
    for group in sorted(groups, key=lambda group: (group.path, group.index)):
        by_file.setdefault(group.path, []).append(group)
    return tuple(
        Piece(path, sum(group.size for group in some), some[0].stamp, tuple(group.index for group in some))
        for path, some in by_file.items()
    )
