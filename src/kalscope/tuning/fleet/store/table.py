"""Rows as Parquet and back."""

from __future__ import annotations

import hashlib
import io
import json
from collections.abc import Collection, Mapping, Sequence
from dataclasses import fields
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np

from kalscope.estimation.fleet.pool import Pool
from kalscope.tuning.fleet.libraries import library
from kalscope.tuning.fleet.store.row import COLUMNS, Row

KEY = "unit_key"
"""Column of a part that says which unit a row belongs to."""
POOL = "unit_pool"
"""Column of a part that holds the pool of a unit, on its first row."""
IN_PART = [KEY, *COLUMNS, POOL]
"""The columns of a part."""
UNITS = b"kalscope_units"
"""Entry of the metadata of a part: the keys of all its units, those without rows too."""
MAX_LETTERS = 4096
"""Bytes of a text in it, at most: no path is longer."""
AGAIN = b"kalscope_again"
"""Entry of its metadata: the keys of those that the next run tries again."""


def schema() -> Any:
    """The schema of the table."""
    pa = library("pyarrow")
    number = pa.float64()
    kinds = {
        "str": pa.string(),
        "int": pa.int64(),
        "float": number,
        "float | None": number,
        "bytes | None": pa.binary(),
    }
    return pa.schema([pa.field(one.name, kinds[str(one.type)]) for one in fields(Row)])


def part_bytes(units: Mapping[str, tuple[Sequence[Row], Pool]], again: Collection[str] = ()) -> bytes:
    """The content of a part: the rows of some units, and on the first row of each its pool.

    Args:
        units: The rows and the pool of each, by its key.
        again: The keys of those that the next run tries again.
    """
    pa, parquet = library("pyarrow"), library("pyarrow.parquet")
    rows = [row for several, _ in units.values() for row in several]
    columns = [pa.array([key for key, (several, _) in units.items() for _ in several], pa.string())]
    by_column = zip(*map(attrgetter(*COLUMNS), rows), strict=True) if rows else [()] * len(COLUMNS)
    for one, cells in zip(schema(), by_column, strict=True):
        columns.append(pa.array(map(told, cells) if one.type == pa.string() else cells, one.type))
    pools = [_packed(pool) if i == 0 else None for several, pool in units.values() for i in range(len(several))]
    columns.append(pa.array(pools, pa.binary()))
    table = pa.table(columns, names=IN_PART).replace_schema_metadata(
        {UNITS: json.dumps(list(units)), AGAIN: json.dumps(sorted(again))}
    )
    buffer = io.BytesIO()
    parquet.write_table(
        table, buffer, compression="zstd", use_dictionary=[KEY, "channel", "unit", "verdict", "source"]
    )
    return buffer.getvalue()


def told(text: str) -> str:
    """A text as the table holds it: bytes that are not UTF-8 escaped, the end of a long text replaced by a hash."""
    if text.isascii() and len(text) <= MAX_LETTERS:  # nearly all of them, millions in a large fleet
        return text
    data = text.encode("utf-8", "backslashreplace")
    if len(data) <= MAX_LETTERS:
        return data.decode()
    return f"{data[: MAX_LETTERS - 24].decode('utf-8', 'ignore')}… {hashlib.sha256(data).hexdigest()[:16]}"


def _packed(pool: Pool) -> bytes | None:
    """The pool as bytes; None for one without devices."""
    counts = np.array([pool.devices, pool.innovations], dtype="<f8")
    return np.concatenate((counts, pool.sums.ravel())).astype("<f8").tobytes() if pool.devices else None


def unpacked(content: bytes) -> Pool:
    """The pool in a cell of a part."""
    numbers = np.frombuffer(content, dtype="<f8")
    return Pool(numbers[2:].reshape(Pool.empty().sums.shape).copy(), int(numbers[0]), int(numbers[1]))


def units_of(path: Path) -> dict[str, bool] | None:
    """The keys of the units of a part, each with whether it is done for good; None where it is not a part."""
    pa, parquet = library("pyarrow"), library("pyarrow.parquet")
    try:
        footer = parquet.read_metadata(path)
        keys, again = (list(map(str, json.loads(footer.metadata[name]))) for name in (UNITS, AGAIN))
        names = [footer.schema.column(i).name for i in range(footer.num_columns)]
    except (pa.ArrowException, OSError, KeyError, TypeError, ValueError):
        return None
    return dict.fromkeys(keys, True) | dict.fromkeys(again, False) if names == IN_PART else None


def read_table(path: Path) -> Any:
    """A part or the table as a pyarrow Table, read whole: no memory map of the file is left open."""
    return library("pyarrow.parquet").ParquetFile(path, memory_map=False).read()
