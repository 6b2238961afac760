"""What a container holds: a table of numbers, or text that is read by the rules of text files."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from kalscope.common.array import Array
from kalscope.recording import LineIssue

MAX_NUMBERS = 1 << 28
"""Most numbers of one table: 2 GiB as float64. A small file can claim any size."""

MAX_COLUMNS = 256
"""Most channels of one table; what is wider is a list or an image."""


@dataclass(frozen=True)
class Table:
    """Columns of one length, before the time axis is judged."""

    names: tuple[str, ...]
    """Full name of each channel: the topic or group, and the field."""
    units: tuple[str, ...]
    """Unit of each channel; "" where none is given: its name may still hold one."""
    columns: tuple[Array, ...]
    """Samples of each channel, shape (n,), NaN where missing."""
    time: Array | None = None
    """Stamps in s, shape (n,), as the file gives them; None where it gives none: a column may still be the time."""
    clock: str = ""
    """A sentence that says where the stamps come from; "" where the file has only one clock."""
    start: float | None = None
    """Time of the stamp 0 in s since 1970, where the file gives it."""
    period: float | None = None
    """Sample period in s that the file gives; None where it gives none."""
    notes: tuple[str, ...] = ()
    """What was decided, each a sentence: the format, the part that was chosen, the others."""
    dates: frozenset[int] = frozenset()
    """Columns, from 0, that are calendar stamps in µs since 1970."""
    texts: tuple[str, ...] = ()
    """Names of columns that hold no numbers and were left out."""
    headers: int = 0
    """Lines of the file that are not rows: headers, and blank lines between its parts."""
    rejected: int = 0
    """Lines that were rejected."""
    bad_cells: int = 0
    """Cells of rows that hold something other than a number: missing samples."""
    issues: tuple[LineIssue, ...] = ()
    """The first MAX_ISSUES of both, in file order."""
    filled: int = 0
    """Rows of missing samples that keep the places of rejected lines."""

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and channels."""
        return (len(self.columns[0]) if self.columns else 0), len(self.columns)


@dataclass(frozen=True)
class Text:
    """A table as lines of text, whose header, units and stamps are found as in any text file."""

    lines: Iterable[str]
    """The lines, without their newlines."""
    notes: tuple[str, ...]
    """What was decided, each a sentence."""
    delimiter: str | None = None
    """The mark between cells; None where the lines name their values."""
    part: str | None = None
    """The part to choose within the text: a name of a long table."""
