"""Parquet data sets in the long form, id, time, value: which row groups make up a unit.

A unit owns a span of ids, and reads every row group that contains one of them: each series is whole, and no id has
two owners. Where the rows are sorted by id a unit owns the ids of a row group up to its largest, and only footers
are read here. Where mixed, the ids are counted and cut into spans of about equal size, each of which reads all.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from kalscope.errors import BadFile, describe
from kalscope.tuning.fleet.libraries import library
from kalscope.tuning.fleet.recordings.long_form import id_column, plain_ids
from kalscope.tuning.fleet.recordings.unit import Piece, Unit

MAX_READINGS = 8
"""How often the bytes of a data set may be read in all, where its ids are mixed."""
SORTED_READINGS = 2
"""How often at most where they are sorted: a row group holds the end of one unit and the beginning of another."""
MIXED_BYTES = 64 << 20
"""Bytes of the rows of a unit of mixed ids, where the data set is not too large for that."""
MAX_UNIT_BYTES = 256 << 20
"""Most bytes of the rows of such a unit: a worker holds four copies of them."""
WITHOUT = "rows without an id"
"""Name in the table of the rows that belong to no series."""


@dataclass(frozen=True)
class _Group:
    """A row group and the ids in it."""

    path: str
    index: int
    size: int
    stamp: int
    first: Any
    """The least id, or less; None where it has none."""
    last: Any
    """The largest id, or more."""
    missing: int
    """Rows without an id."""


Share = tuple[tuple[Any, Any], Sequence[_Group]]
"""A span of ids, above the first and up to the second, and the row groups that may hold any of them."""


def data_set_units(paths: Sequence[str], name: str, label: str) -> list[Unit]:
    """The units of the files of one data set; one with the reason where it cannot be divided.

    Args:
        paths: Its files, which have an id column.
        name: Of the folder in the table, "" for none; the ids of its series follow.
        label: Name in the table for the whole data set.
    """
    try:
        groups = [group for path in paths for group in _groups(path)]
        units = [
            Unit(f"{name}{i:09d}", _pieces(inside), span=span, data_set=name)
            for i, (span, inside) in enumerate(_shares([group for group in groups if group.first is not None]))
        ]
    except (library("pyarrow").ArrowException, OSError, ValueError, TypeError) as error:
        reason = " ".join(describe(error).split()) or type(error).__name__
        return [Unit(label, tuple(map(_whole, paths)), reason=reason)]
    without = [group for group in groups if group.missing]
    if without:
        count = sum(group.missing for group in without)
        reason = f"{count} {'rows have' if count > 1 else 'row has'} no id, so that no series can take them"
        files = tuple(_whole(path) for path in dict.fromkeys(group.path for group in without))
        units.append(Unit(f"{name}{WITHOUT}", files, reason=reason, data_set=name))
    return units


def _shares(groups: Sequence[_Group]) -> list[Share]:
    """The spans of ids that are read together.

    Raises:
        BadFile: the ids are of several types, or mixed over more bytes than may be read again and again.
    """
    kinds = sorted({type(group.first).__name__ for group in groups})
    if len(kinds) > 1:
        raise BadFile(
            f"the ids of a data set must be of one type in all files (got {' and '.join(kinds)}): move the files"
            " of each type into a folder of their own"
        )
    shares, whole = list(_owned(groups)), sum(group.size for group in groups)
    read = sum(group.size for _, inside in shares for group in inside)
    if read <= SORTED_READINGS * whole and not any(_is_mixed(inside) for _, inside in shares):
        return shares
    if whole > MAX_READINGS * MAX_UNIT_BYTES:
        raise BadFile(_how_to_sort(groups[0].path, whole))
    return _cut(groups, max(MIXED_BYTES, whole // MAX_READINGS + 1) / whole)


def _is_mixed(groups: Sequence[_Group]) -> bool:
    """Whether row groups that are read together hold more than the end of a unit and the beginning of the next."""
    several = [group for group in groups if group.first != group.last]
    return len(several) > 2 and sum(group.size for group in several) > MIXED_BYTES


def _owned(groups: Sequence[_Group]) -> Iterator[Share]:
    """The spans up to the largest id of each row group."""
    waiting = sorted(groups, key=lambda group: (group.first, group.last), reverse=True)
    active: list[_Group] = []
    low = None
    for end in sorted({group.last for group in groups}):
        while waiting and waiting[-1].first <= end:
            active.append(waiting.pop())
        yield (low, end), tuple(active)
        active, low = [group for group in active if group.last > end], end


def _cut(groups: Sequence[_Group], share: float) -> list[Share]:
    """Spans of ids that hold about this share of all rows each, at least one id."""
    pa = library("pyarrow")
    counted = [_counted(path, indices) for path, indices in _by_file(groups).items()]
    table = pa.concat_tables(counted, promote_options="permissive")
    table = table.group_by("id").aggregate([("rows", "sum")]).sort_by("id")
    upto = np.cumsum(table["rows_sum"].to_numpy())
    last_of_each = np.flatnonzero(np.diff(np.ceil(upto / (share * upto[-1])), append=np.inf))
    ends = table["id"].take(pa.array(last_of_each)).to_pylist()
    spans = list(zip([None, *ends], ends, strict=False))
    return [
        (span, tuple(group for group in groups if group.first <= span[1] and (i == 0 or group.last > span[0])))
        for i, span in enumerate(spans)
    ]


def _counted(path: str, indices: Sequence[int]) -> Any:
    """The ids of some row groups and how many rows each has."""
    pa = library("pyarrow")
    file = library("pyarrow.parquet").ParquetFile(path, memory_map=False)
    name = str(id_column(file.schema_arrow.names))
    several = [_present(file.read_row_group(i, columns=[name])[name]).value_counts() for i in indices]
    return pa.concat_tables([pa.table({"id": one.field("values"), "rows": one.field("counts")}) for one in several])


def _present(column: Any) -> Any:
    """The ids without those that are missing, null or NaN."""
    ids = plain_ids(column)
    if library("pyarrow").types.is_floating(ids.type):
        compute = library("pyarrow.compute")
        ids = ids.filter(compute.invert(compute.is_nan(ids)))
    return ids.drop_null()


def _how_to_sort(path: str, size: int) -> str:
    folder, name = os.path.dirname(path), id_column(library("pyarrow.parquet").read_schema(path).names)
    return (
        f"a data set of more than {MAX_READINGS * MAX_UNIT_BYTES >> 30} GiB must be sorted by {name} (got"
        f" {size / 1e9:.3g} GB with mixed ids): duckdb -c"
        f" \"COPY (FROM '{folder}/*.parquet' ORDER BY {name}) TO 'sorted.parquet'\""
    )


def row_group_units(path: str, name: str) -> list[Unit]:
    """A unit for each row group of a file, each a recording of its own; none where its footer cannot be read."""
    try:
        state = os.stat(path)
        footer = library("pyarrow.parquet").read_metadata(path)
    except (library("pyarrow").ArrowException, OSError, ValueError):
        return []
    sizes = [_size(footer.row_group(i)) for i in range(footer.num_row_groups)]
    return [
        Unit(f"{name}#{i}", (Piece(os.path.abspath(path), size, state.st_mtime_ns, (i,)),))
        for i, size in enumerate(sizes)
    ]


def _groups(path: str) -> Iterator[_Group]:
    """The row groups of a file with the ids in them; those without rows left out."""
    file = library("pyarrow.parquet").ParquetFile(path, memory_map=False)
    stamp, name = os.stat(path).st_mtime_ns, str(id_column(file.schema_arrow.names))
    exact = not library("pyarrow").types.is_floating(file.schema_arrow.field(name).type)  # footers do not count NaN
    for i in range(file.num_row_groups):
        footer = file.metadata.row_group(i)
        if footer.num_rows:
            columns = map(footer.column, range(footer.num_columns))
            column = next((one for one in columns if one.path_in_schema == name), None)
            known = column.statistics if exact and column is not None else None
            ends = _known_ends(known) or _read_ends(file, i, name)
            yield _Group(os.path.abspath(path), i, _size(footer), stamp, *ends)


def _size(group: Any) -> int:
    """Bytes of a row group in memory: a file holds equal values once."""
    return max(group.total_byte_size, 8 * group.num_rows * group.num_columns)


def _known_ends(known: Any) -> tuple[Any, Any, int] | None:
    """The least and the largest id and the number of rows without one by the footer; None where it has none."""
    if known is None or not (known.has_min_max and known.has_null_count):
        return None
    try:
        return known.min, known.max, known.null_count
    except (ValueError, library("pyarrow").ArrowException):  # a text that was cut within a character
        return None


def _read_ends(file: Any, index: int, name: str) -> tuple[Any, Any, int]:
    column = file.read_row_group(index, columns=[name])[name]
    ids = _present(column)
    both = library("pyarrow.compute").min_max(ids)
    return both["min"].as_py(), both["max"].as_py(), len(column) - len(ids)


def _by_file(groups: Sequence[_Group]) -> dict[str, list[int]]:
    """The numbers of row groups by their files."""
    found: dict[str, list[int]] = {}
    for group in sorted(groups, key=lambda group: (group.path, group.index)):
        found.setdefault(group.path, []).append(group.index)
    return found


def _pieces(groups: Sequence[_Group]) -> tuple[Piece, ...]:
    """Row groups as pieces of their files."""
    size = {(group.path, group.index): group.size for group in groups}
    stamp = {group.path: group.stamp for group in groups}
    return tuple(
        Piece(path, sum(size[path, i] for i in indices), stamp[path], tuple(indices))
        for path, indices in _by_file(groups).items()
    )


def _whole(path: str) -> Piece:
    """A file of which nothing is read, as it is now."""
    try:
        return Piece(os.path.abspath(path), stamp=os.stat(path).st_mtime_ns)
    except OSError:
        return Piece(os.path.abspath(path))
