"""Which Parquet files are in the long form, id, time, value: judged together for the files of a folder.

A single file may hold each id once, for example where each file is a day: then the other files decide.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from kalscope.tuning.fleet.libraries import library

ID_NAMES = ("id", "series_id", "unique_id", "device_id", "sensor_id", "device", "sensor")
"""Names of the column that says which series a row belongs to, in lower case, the first one found."""
MAX_LOOKED_AT = 8
"""Row groups of a file whose ids are read first."""
MAX_TOGETHER = 16
"""Files whose ids are compared with each other."""
MAX_COMPARED = 50_000
"""Ids of a file that are compared with those of others."""


@dataclass(frozen=True)
class _Look:
    """A first look at the ids of a file."""

    path: str
    name: str
    """Of the column of ids."""
    columns: frozenset[str]
    """Names of all columns."""
    repeats: bool
    """Whether an id has two rows or more, on average."""
    counts: bool
    """Whether the ids just number the rows."""
    ids: frozenset[Any]
    """Some of them."""


def id_column(names: Sequence[str]) -> str | None:
    """The column that holds the ids; None where there is none."""
    lower = {name.lower(): name for name in reversed(names)}
    return next((lower[name] for name in ID_NAMES if name in lower), None)


def plain_ids(column: Any) -> Any:
    """The ids themselves where a column is dictionary-encoded."""
    return column.cast(column.type.value_type) if library("pyarrow").types.is_dictionary(column.type) else column


def long_files(paths: Iterable[str]) -> set[str]:
    """Those Parquet files of a folder that are one data set in the long form; none that cannot be read.

    Args:
        paths: Parquet files of one folder.
    """
    looked = [one for path in paths if (one := _look(path)) is not None]
    found: set[str] = set()
    for name in {one.name for one in looked}:
        several = [one for one in looked if one.name == name]
        kinds = {one.columns for one in several if one.repeats}
        joining = [one for one in several if one.columns in kinds or not one.counts]
        if kinds or _repeat_together(joining[:MAX_TOGETHER]):
            found.update(one.path for one in joining)
    return found


def _repeat_together(several: Sequence[_Look]) -> bool:
    """Whether files that hold each id once hold the same ids."""
    held = sum(len(one.ids) for one in several)
    return held > 0 and 2 * len(frozenset[Any]().union(*(one.ids for one in several))) <= held


def _look(path: str) -> _Look | None:
    """The ids of a file; None where it has none, or cannot be read."""
    pa = library("pyarrow")
    try:
        file = library("pyarrow.parquet").ParquetFile(path, memory_map=False)
        names = file.schema_arrow.names
        name = id_column(names)
        if name is None or len(names) < 2:
            return None
        groups = range(file.num_row_groups)
        ids = plain_ids(file.read_row_groups(list(groups[:MAX_LOOKED_AT]), columns=[name])[name])
        if len(ids.unique()) < len(ids) < 2 * len(ids.unique()):  # mixed, so that few are seen twice so far
            ids = plain_ids(file.read_row_groups(list(groups), columns=[name])[name])
        repeats = len(ids) > 0 and 2 * len(ids.unique()) <= len(ids)
        some = frozenset[Any]() if repeats else frozenset(ids.slice(0, MAX_COMPARED).drop_null().to_pylist())
    except (pa.ArrowException, OSError, ValueError, TypeError):
        return None
    if not len(ids):
        return None
    return _Look(path, name, frozenset(names), repeats, _counts(ids), some)


def _counts(ids: Any) -> bool:
    if not library("pyarrow").types.is_integer(ids.type) or ids.null_count:
        return False
    return bool(np.all(np.diff(ids.to_numpy().astype(np.float64)) == 1.0))
