"""Tables of a fleet that may have been written by anything: checked once, here, and refused with one line."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from kalscope.errors import BadFile
from kalscope.tuning.fleet.libraries import library
from kalscope.tuning.fleet.store.row import COLUMNS, FINISHED
from kalscope.tuning.fleet.store.table import MAX_LETTERS, POOL, schema

MAX_ROWS = 5_000_000
"""Rows of a table, at most: one of a million devices needs about 1 GB of memory."""
MAX_BYTES = 2 << 30
"""Bytes of its columns, at most."""


def checked_table(path: Path, *, part: bool = False) -> Any:
    """The table, or a part with its pools, as a pyarrow Table of the known columns and types; no text is missing.

    Raises:
        BadFile: it is not such a table, or one that would fill the memory.
    """
    pa, parquet = library("pyarrow"), library("pyarrow.parquet")
    texts = [one.name for one in schema() if pa.types.is_string(one.type)]
    try:
        file = parquet.ParquetFile(path, memory_map=False, read_dictionary=texts)
        _check_size(file.metadata)
        names = set(file.schema_arrow.names)
        wanted = (*COLUMNS, POOL) if part else FINISHED
        missing = [name for name in wanted if name not in names]
        if missing:
            raise ValueError(f"no column {missing[0]}; an older Kalscope may have written it: run the fleet again")
        table = file.read(columns=list(wanted))
        known = [one for one in schema() if one.name in wanted]
        columns = [_text(table[one.name]) if one.name in texts else table[one.name] for one in known]
        columns = [column.cast(one.type) for column, one in zip(columns, known, strict=True)]
        plain = pa.table(columns, names=[one.name for one in known])
        return plain.append_column(POOL, table[POOL].cast(pa.binary())) if part else plain
    except (pa.ArrowException, OSError, ValueError, TypeError, KeyError, OverflowError) as error:
        said = str(error).splitlines() or [type(error).__name__]
        raise BadFile(f"{str(path)!r} must be a table of kalscope fleet (got {said[0][:200]})") from None


def _check_size(footer: Any) -> None:
    size = sum(footer.row_group(i).total_byte_size for i in range(footer.num_row_groups))
    if footer.num_rows > MAX_ROWS or size > MAX_BYTES:
        raise ValueError(f"{footer.num_rows} rows of {size} bytes; at most {MAX_ROWS} rows and {MAX_BYTES} bytes")


def _text(column: Any) -> Any:
    """A column of texts, each short; a text that many rows share is checked once, before it is expanded."""
    pa, compute = library("pyarrow"), library("pyarrow.compute")
    for chunk in column.chunks:
        words = chunk.dictionary if pa.types.is_dictionary(column.type) else chunk
        longest = compute.max(compute.binary_length(words)).as_py() if len(words) else 0
        if (longest or 0) > MAX_LETTERS:
            raise ValueError(f"a text of {longest} bytes, at most {MAX_LETTERS}")
    return compute.fill_null(column.cast(pa.string()), "")
