"""Merges the parts into one table, in the order of the fleet, batch by batch."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from kalscope.common.files import atomic_file
from kalscope.estimation.fleet.pool import Pool
from kalscope.tuning.fleet.libraries import library
from kalscope.tuning.fleet.store.begun import TABLE
from kalscope.tuning.fleet.store.table import KEY, POOL, read_table, schema, unpacked

MAX_OPEN = 16
"""Parts that are kept in memory at a time: a batch is in one or a few."""


@dataclass
class _Parts:
    """Parts that were read last."""

    tables: OrderedDict[Path, Any]

    def rows(self, path: Path, keys: Sequence[str]) -> Any:
        """The rows of some units of a part."""
        if path not in self.tables:
            self.tables[path] = read_table(path)
            if len(self.tables) > MAX_OPEN:
                self.tables.popitem(last=False)
        self.tables.move_to_end(path)
        table = self.tables[path]
        wanted = library("pyarrow").array(keys, library("pyarrow").string())
        return table.filter(library("pyarrow.compute").is_in(table[KEY], value_set=wanted))


def merge(folder: Path, batches: Sequence[Sequence[str]], parts: Mapping[str, Path]) -> Pool:
    """Write the table, whole or not at all, and add up the pools in its order.

    Args:
        folder: Of the fleet.
        batches: The keys of the units of each batch, in the order of the fleet.
        parts: The part of each unit. A unit in none, because its run was stopped, has no rows.

    Returns:
        What the whole fleet says about one filter for all.

    Raises:
        OSError: The disk is full; a table of an earlier run stays as it was.
    """
    pa, parquet = library("pyarrow"), library("pyarrow.parquet")
    cache, pool = _Parts(OrderedDict()), Pool.empty()
    with atomic_file(folder / TABLE) as file, parquet.ParquetWriter(file, schema(), compression="zstd") as writer:
        for keys in batches:
            found = _by_part(keys, parts)
            if not found:
                continue
            rows = pa.concat_tables([cache.rows(path, some) for path, some in found.items()])
            place = {key: i for i, key in enumerate(keys)}
            order = pa.array([place[key] for key in rows[KEY].to_pylist()], pa.int64())
            rows = rows.append_column("_place", order).append_column("_row", pa.array(range(len(rows))))
            rows = rows.sort_by([("_place", "ascending"), ("_row", "ascending")])
            writer.write_table(rows.select(schema().names).cast(schema()))
            for content in rows[POOL].drop_null().to_pylist():
                pool = pool + unpacked(content)
    return pool


def _by_part(keys: Sequence[str], parts: Mapping[str, Path]) -> dict[Path, list[str]]:
    found: dict[Path, list[str]] = {}
    for key in keys:
        if key in parts:
            found.setdefault(parts[key], []).append(key)
    return found
