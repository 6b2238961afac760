"""Parquet files, read by DuckDB: one row per sample, the file gives the column types."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np

from kalscope.common.files import require_memory_for_numbers
from kalscope.common.progress import Progress
from kalscope.errors import BadFile
from kalscope.sources.containers.table import MAX_NUMBERS, Table, load_library, refuse_part

MAX_COLUMNS = 4096
"""Most columns of numbers: DuckDB's time grows with the square of their number, 2 s for this many."""
_DATES = ("DATE", "TIMESTAMP")
_NUMBERS = (
    *("TINYINT", "SMALLINT", "INTEGER", "BIGINT", "HUGEINT", "UTINYINT", "USMALLINT", "UINTEGER", "UBIGINT"),
    *("FLOAT", "DOUBLE", "DECIMAL"),
)


def read_parquet(path: Path, name: str, part: str | None, progress: Progress) -> Table:
    """Read a Parquet file.

    Raises:
        BadFile: it holds no column of numbers, too many rows or columns, or DuckDB is not installed.
        BadSetting: a part is wanted.
    """
    refuse_part(part, name)
    progress(0.0, "reading")
    duckdb = load_library("duckdb", "duckdb", name, "a Parquet file")
    connection = duckdb.connect(config={"autoinstall_known_extensions": False, "autoload_known_extensions": False})
    try:
        return _read(connection, path, name, progress)
    finally:
        connection.close()


def _read(connection: Any, path: Path, name: str, progress: Progress) -> Table:
    # DuckDB takes a path for a pattern, and a folder "a=1" for a column.
    source = "FROM read_parquet(?, hive_partitioning=false)"
    given = [re.sub(r"([*?\[])", r"[\1]", str(path))]
    described = connection.execute(f"DESCRIBE SELECT * {source}", given).fetchall()
    kinds = {str(row[0]): str(row[1]).upper() for row in described}
    rows = int(connection.execute(f"SELECT count(*) {source}", given).fetchall()[0][0])
    names = [column for column, kind in kinds.items() if kind.startswith((*_NUMBERS, *_DATES))]
    if not any(kinds[column].startswith(_NUMBERS) for column in names) or not rows:
        raise BadFile(f"{name} must hold a column of numbers (got {len(kinds)} columns, {rows} rows)")
    if rows * len(names) > MAX_NUMBERS or len(names) > MAX_COLUMNS:
        raise BadFile(
            f"{name} must hold at most {MAX_NUMBERS} numbers in {MAX_COLUMNS} columns (got {rows} rows of"
            f" {len(names)} columns)"
        )
    progress.unpack(8 * rows * len(names))
    require_memory_for_numbers(rows * len(names), name)
    expressions = [_as_double(column, kinds[column], i) for i, column in enumerate(names)]
    answer = connection.execute(f"SELECT {', '.join(expressions)} {source}", given).fetchnumpy()
    return Table(
        names=tuple(names),
        units=("",) * len(names),
        columns=tuple(np.ma.filled(answer[f"c{i}"], np.nan) for i in range(len(names))),
        dates=frozenset(i for i, column in enumerate(names) if kinds[column].startswith(_DATES)),
        texts=tuple(column for column in kinds if column not in names),
        notes=("a Parquet file",),
    )


def _as_double(name: str, kind: str, index: int) -> str:
    quoted = '"' + name.replace('"', '""') + '"'
    value = f"epoch_us(CAST({quoted} AS TIMESTAMP))" if kind.startswith(_DATES) else quoted
    return f"CAST({value} AS DOUBLE) AS c{index}"
