"""The options of every command that reads a file: how it is written, where looking at it is not enough.

A command declares `delimiter: Delimiter = None` and so on, and gives what came to `options_from_text`.
"""

from __future__ import annotations

from typing import Annotated

import typer

from kalscope.sources.lines.read_options import options_from_text

__all__ = [
    "Delimiter",
    "GapsChoice",
    "Missing",
    "SamplePeriod",
    "TimeColumnChoice",
    "TimeUnit",
    "options_from_text",
]

SamplePeriod = Annotated[
    str | None,
    typer.Option("--sample-period", metavar="NUMBER", help="Sample period in s; overrules that of SOURCE."),
]
Delimiter = Annotated[
    str | None,
    typer.Option("--delimiter", metavar="MARK", help="comma, semicolon, tab, bar or space; else found."),
]
TimeColumnChoice = Annotated[
    str | None,
    typer.Option("--time-column", metavar="NAME", help='Name or number (from 1) of the time column, or "none".'),
]
TimeUnit = Annotated[
    str | None,
    typer.Option("--time-unit", metavar="UNIT", help="Unit of a numeric time column: s, ms, us, ns, min, h, day."),
]
Missing = Annotated[
    list[str] | None,
    typer.Option("--missing", metavar="VALUE", help='A value that says "no sample", such as -200; may come again.'),
]
GapsChoice = Annotated[
    str | None,
    typer.Option("--gaps", metavar="HOW", help="Gaps in time: rows (none, default), missing samples, or dt."),
]
