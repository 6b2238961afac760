"""Rows as Parquet and back."""

from __future__ import annotations

import io
import json
from collections.abc import Iterable, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

from kalscope.tuning.fleet.libraries import library
from kalscope.tuning.fleet.store.row import COLUMNS, Row

KEY = "unit_key"
"""Column of a part that says which unit a row belongs to."""
UNITS = b"kalscope_units"
"""Entry of the metadata of a part: the keys of all its units, those without rows too."""


def schema() -> Any:
    """The schema of the table."""
    pa = library("pyarrow")
    kinds = {"str": pa.string(), "int": pa.int64(), "float": pa.float64(), "float | None": pa.float64()}
    return pa.schema([pa.field(one.name, kinds[str(one.type)]) for one in fields(Row)])


def part_bytes(rows: Sequence[tuple[str, Row]], keys: Iterable[str]) -> bytes:
    """The content of a part.

    Args:
        rows: Each with the key of its unit.
        keys: Of all its units.
    """
    pa, parquet = library("pyarrow"), library("pyarrow.parquet")
    columns = [pa.array([key for key, _ in rows], pa.string())]
    columns += [pa.array([getattr(row, one.name) for _, row in rows], one.type) for one in schema()]
    names = [KEY, *COLUMNS]
    table = pa.table(columns, names=names).replace_schema_metadata({UNITS: json.dumps(list(keys))})
    buffer = io.BytesIO()
    parquet.write_table(table, buffer, compression="zstd")
    return buffer.getvalue()


def units_of(path: Path) -> list[str] | None:
    """The keys of the units of a part; None where it is no part that can be read."""
    pa, parquet = library("pyarrow"), library("pyarrow.parquet")
    try:
        footer = parquet.read_metadata(path)
        keys = json.loads(footer.metadata[UNITS])
        names = [footer.schema.column(i).name for i in range(footer.num_columns)]
    except (pa.ArrowException, OSError, KeyError, TypeError, ValueError):
        return None
    return keys if names == [KEY, *COLUMNS] else None


def read_table(path: Path) -> Any:
    """A part or the table as a pyarrow Table, read whole: no map of the file is left open."""
    return library("pyarrow.parquet").ParquetFile(path, memory_map=False).read()
