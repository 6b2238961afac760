"""What is printed of a finished fleet, in words."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

from kalscope.common.text import count, duration, number, plural
from kalscope.tuning.fleet.libraries import library
from kalscope.tuning.fleet.run import Tally
from kalscope.tuning.fleet.store.merge import TABLE

MAX_REASONS = 5
"""Reasons that are printed; the table has them all."""


def summary(folder: Path, tally: Tally) -> str:
    """How many recordings, how many without q and r and why, and where the table is."""
    table = library("pyarrow.parquet").ParquetFile(folder / TABLE, memory_map=False).read(["id", "reason"])
    reasons = [reason for reason in table["reason"].to_pylist() if reason]
    lines = [_done(len(table), tally)]
    if reasons:
        lines.append(f"{count(len(reasons))} without q and r:")
        common = Counter(reasons).most_common(MAX_REASONS)
        lines += [f"  {count(times)} × {reason}" for reason, times in common]
        others = len(reasons) - sum(times for _, times in common)
        lines += [f"  {count(others)} for other reasons"] if others else []
    return "\n".join([*lines, f"Table: {folder / TABLE}"]) + "\n"


def _done(rows: int, tally: Tally) -> str:
    """How many rows there are, and what this run did for them."""
    new = "nothing was missing" if not tally.done else f"{count(tally.done)} of {plural(tally.units, 'file')} read"
    speed = f" in {duration(tally.seconds)}, {number(tally.rows / tally.seconds)} rows/s" if tally.done else ""
    return f"{plural(rows, 'row')}: {new}{speed}"
