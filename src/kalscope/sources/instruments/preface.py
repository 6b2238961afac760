"""What an instrument's own rules say about a table of text."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Preface:
    """What the lines above or beside a table say about it; None and () where they say nothing."""

    instrument: str
    """What wrote the file, as a report names it: "Rigol oscilloscope"."""
    delimiter: str | None = None
    """Between the cells of the table."""
    decimal: str | None = None
    """Decimal mark."""
    header_row: int | None = None
    """Line number, from 1, of the row of names; 0 where there is none."""
    unit_row: int | None = None
    """Line number, from 1, of the row of units; 0 where there is none."""
    first_row: int | None = None
    """Line number, from 1, of the first row of the table."""
    names: tuple[str, ...] = ()
    """Name of each column of the table, in place of a header row; "" where one has none."""
    units: tuple[str, ...] = ()
    """Unit of each column, in place of a units row."""
    left_out: frozenset[int] = frozenset()
    """Columns, from 0, that hold no samples: metadata beside the data."""
    time_column: int | None = None
    """Column, from 0, of the time; -1 where the table has none."""
    time_unit: str | None = None
    """Unit of the time column, a key of SECONDS_PER_UNIT."""
    period: float | None = None
    """Sample period in s."""
    start: float | None = None
    """Time of the first sample in s since 1970 (UTC where no zone is given)."""
    notes: tuple[str, ...] = ()
    """What else was understood, each a sentence for the report."""
