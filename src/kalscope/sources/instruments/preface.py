"""What an instrument's own rules say about a table of text."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Preface:
    """What the lines above or beside a table say about it; None and () where they say nothing."""

    instrument: str
    """What wrote the file, as a report names it: "Rigol oscilloscope"; "" where only its text is understood."""
    delimiter: str | None = None
    """Delimiter of the table."""
    decimal: str | None = None
    """Decimal mark."""
    header_row: int | None = None
    """Line number, from 1, of the row of names; 0 where there is none. `names` takes precedence over it."""
    unit_row: int | None = None
    """Line number, from 1, of the row of units; 0 where there is none. `units` takes precedence over it."""
    first_row: int | None = None
    """Line number, from 1, of the first row of the table."""
    names: tuple[str, ...] = ()
    """Name of each column of the table, without an empty one at its end; "" where one has none."""
    units: tuple[str, ...] = ()
    """Unit of each column, "" where it has none; as many as `names`."""
    left_out: frozenset[int] = frozenset()
    """Columns, from 0, that hold no samples: metadata beside the data, a counter, a second form of the stamp."""
    time_column: int | None = None
    """Column, from 0, of the time; -1 where the table has none."""
    time_unit: str | None = None
    """Unit of the time column, a key of SECONDS_PER_UNIT."""
    period: float | None = None
    """Sample period in s."""
    start: float | None = None
    """What second 0 of the stamps is, or the first sample where there are none, in s since 1970 (UTC where no zone
    is given)."""
    offset: float | None = None
    """Stamp of the first sample in s, where the table has no time column: an oscilloscope counts from its
    trigger."""
    notes: tuple[str, ...] = ()
    """What else was understood, each a sentence for the report."""


@dataclass(frozen=True)
class TablePreface(Preface):
    """The same for a comma-separated table with decimal points, without rows of names and units.

    Rules see every file in this form: `dialect.py` restores the marks of the file.
    """

    delimiter: str | None = ","
    decimal: str | None = "."
    header_row: int | None = 0
    unit_row: int | None = 0
