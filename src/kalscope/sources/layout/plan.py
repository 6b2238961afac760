"""What is decided before anything is weighed: by the user, else by the rules of the instrument."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from kalscope.errors import BadSetting
from kalscope.sources.grammar.read_options import ReadOptions
from kalscope.sources.instruments.preface import Preface
from kalscope.sources.instruments.registry import find_preface


@dataclass(frozen=True)
class Plan:
    """The choices that hold for one file; what is None is weighed."""

    options: ReadOptions
    """The choices of the user, which outrank the instrument's."""
    preface: Preface
    """What the instrument's rules say, without what the user chose otherwise."""

    @property
    def delimiter(self) -> str | None:
        """Delimiter of cells."""
        return self.options.delimiter or self.preface.delimiter

    @property
    def decimal(self) -> str | None:
        """Decimal mark."""
        return self.options.decimal or self.preface.decimal

    @property
    def header_row(self) -> int | None:
        """Line number of the row of names; 0 where there is none."""
        if self.options.header_row is None and self.options.header is False:
            return 0
        return self.options.header_row if self.options.header_row is not None else self.preface.header_row

    @property
    def unit_row(self) -> int | None:
        """Line number of the row of units; 0 where there is none."""
        return self.options.unit_row if self.options.unit_row is not None else self.preface.unit_row

    @property
    def first_row(self) -> int:
        """Line number of the first line that may be data."""
        rows = (self.preface.first_row, self.options.header_row, self.options.unit_row)
        return max(self.preface.first_row or 1, *((row or 0) + 1 for row in rows[1:]))


def make_plan(head: Sequence[str], options: ReadOptions) -> Plan:
    """The choices for a file with this head.

    Raises:
        BadSetting: a row is chosen that the head of the file does not have.
    """
    for word, row in (("header", options.header_row), ("unit", options.unit_row)):
        if row is not None and row > len(head):
            raise BadSetting(
                f"{word} row must be one of the first {len(head)} lines, above the data (got --{word}-row {row})"
            )
    preface = find_preface(head) or Preface("")
    if options.header_row is not None or options.header is not None:
        preface = replace(preface, names=(), header_row=None)
    if options.unit_row is not None:
        preface = replace(preface, units=(), unit_row=None)
    if options.delimiter is not None and options.delimiter != preface.delimiter:
        preface = replace(preface, left_out=frozenset(), names=(), units=(), time_column=None)
    return Plan(options, preface)
