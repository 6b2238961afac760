"""Parquet files, read by DuckDB: one row a sample, the file gives the column types."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from kalscope.common.array import Array
from kalscope.errors import BadFile
from kalscope.sources.grammar.line_format import LineFormat
from kalscope.sources.grammar.read_options import ReadOptions
from kalscope.sources.grammar.timestamps import TimeColumn
from kalscope.sources.layout.columns import Column, named_column, settle_roles
from kalscope.sources.layout.sniffer import Layout
from kalscope.sources.layout.time_column import chosen_time, find_time
from kalscope.sources.readers.assemble import Reading
from kalscope.sources.readers.csv_rows import Tally
from kalscope.sources.readers.text_file import RawFile

_HEAD_ROWS = 1000
_DATES = ("DATE", "TIMESTAMP")
_NUMBERS = ("TINYINT", "SMALLINT", "INTEGER", "BIGINT", "HUGEINT", "UTINYINT", "USMALLINT", "UINTEGER", "UBIGINT")
_FRACTIONS = ("FLOAT", "DOUBLE", "DECIMAL")


def read_parquet(raw: RawFile, options: ReadOptions) -> Reading:
    """Read a Parquet file.

    Raises:
        BadFile: it is damaged, holds no column of numbers, or DuckDB is not installed.
        BadSetting: there is no such time column.
    """
    try:
        import duckdb
    except ImportError:
        raise BadFile(f'{raw.name} needs "pip install duckdb" to be read (got a Parquet file)') from None
    connection = duckdb.connect(config={"autoinstall_known_extensions": False, "autoload_known_extensions": False})
    try:
        return _read(connection, raw, options)
    except duckdb.Error as error:
        said = " ".join(str(error).split())[:120]
        raise BadFile(f"{raw.name} must be a whole Parquet file (got: {said})") from None
    finally:
        connection.close()


def _read(connection: Any, raw: RawFile, options: ReadOptions) -> Reading:
    source, path = "FROM read_parquet(?)", [str(raw.path)]
    described = connection.execute(f"DESCRIBE SELECT * {source}", path).fetchall()
    kinds = [str(row[1]).upper() for row in described]
    columns = [
        replace(named_column(str(row[0])), role="channel" if kind.startswith((*_NUMBERS, *_FRACTIONS)) else "text")
        for row, kind in zip(described, kinds, strict=True)
    ]
    head = connection.execute(f"SELECT CAST(COLUMNS(*) AS VARCHAR) {source} LIMIT {_HEAD_ROWS}", path).fetchall()
    rows = [tuple("" if cell is None else cell for cell in row) for row in head]
    time = _find_time(columns, rows, kinds, options)
    columns, time, notes = settle_roles(columns, time)
    layout = Layout(LineFormat(), tuple(columns), time, 1, frozenset(), (), ("a Parquet file", *notes))
    if not layout.channels or not rows:
        raise BadFile(f"{raw.name} must hold a column of numbers (got {len(columns)} columns, {len(rows)} rows)")
    wanted = [*layout.channels, *(time.indices if time else ())]
    expressions = [_as_double(str(described[i][0]), kinds[i], i) for i in wanted]
    answer = connection.execute(f"SELECT {', '.join(expressions)} {source}", path).fetchnumpy()
    return _reading({i: np.ma.filled(answer[f"c{i}"], np.nan) for i in wanted}, layout)


def _find_time(
    columns: list[Column], rows: list[tuple[str, ...]], kinds: list[str], options: ReadOptions
) -> TimeColumn | None:
    named = [column.name for column in columns]
    choice = options.time_column
    index = named.index(choice) if isinstance(choice, str) and choice in named else choice
    dated = [i for i, kind in enumerate(kinds) if kind.startswith(_DATES)]
    if index is None and dated:
        index = dated[0]
    if isinstance(index, int) and index in dated:
        return TimeColumn(index, "calendar")
    time = find_time(columns, rows, ".", named=True) if index is None else chosen_time(columns, rows, ".", index)
    # Text stamps would have to be parsed one by one: a Parquet file says TIMESTAMP where it means one.
    return time if time is not None and time.kind == "number" else None


def _as_double(name: str, kind: str, index: int) -> str:
    quoted = '"' + name.replace('"', '""') + '"'
    value = f"epoch_us(CAST({quoted} AS TIMESTAMP))" if kind.startswith(_DATES) else quoted
    return f"CAST({value} AS DOUBLE) AS c{index}"


def _reading(columns: dict[int, Array], layout: Layout) -> Reading:
    """Rows without a stamp are rejected; infinite samples are missing ones, counted as cells that are no number."""
    tally, rejected, n = Tally(), 0, len(next(iter(columns.values())))
    if layout.time is not None:
        known = np.isfinite(columns[layout.time.index])
        rejected = int(np.count_nonzero(~known))
        if rejected:
            columns = {i: column[known] for i, column in columns.items()}
    for i in layout.channels:
        infinite = np.isinf(columns[i])
        tally.bad_cells += int(np.count_nonzero(infinite))
        columns[i][infinite] = np.nan
    tally.lines.update(row=n - rejected, rejected=rejected)
    return Reading(columns, tally, layout)
