"""Options that several commands share, and the numbers that options take."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Annotated, Any

import typer


class BadValue(typer.BadParameter):
    """A value that an option does not take. The message begins with the option: --q must be a number (got 'x')."""

    def __init__(self, must: str, text: str) -> None:
        super().__init__(f"must be {must} (got {text!r})")

    def format_message(self) -> str:
        """The whole message; typer has noted the option meanwhile."""
        return f"{self.param.opts[0]} {self.message}" if self.param else self.message


def number(text: str) -> float:
    """The number that was typed, of either sign."""
    value = _float(text)
    if math.isnan(value):
        raise BadValue("a number", text)
    return value


def positive(text: str) -> float:
    """The number that was typed, above 0 and finite."""
    value = _float(text)
    if not 0.0 < value < math.inf:
        raise BadValue("a number above 0", text)
    return value


def number_or(word: str) -> Callable[[str], float]:
    """A parser that takes a number, or `word` and then gives NaN."""

    def parse(text: str) -> float:
        value = _float(text)
        if math.isnan(value) and text != word:
            raise BadValue(f'a number or "{word}"', text)
        return value

    return parse


def _float(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan


def number_option(text: str, parser: Callable[[str], float] = positive) -> Any:
    """An option that takes a number and has the name of its argument; `text` is its help."""
    return typer.Option(metavar="NUMBER", help=text, parser=parser)


Source = Annotated[
    str, typer.Argument(metavar="SOURCE", help='A file, "demo", "sample:NAME", "synthetic:SHAPE?…".')
]
SamplePeriod = Annotated[float | None, number_option("Sample period in s; replaces that of SOURCE.")]
Delimiter = Annotated[
    str | None, typer.Option(metavar="MARK", help="comma, semicolon, tab, bar or space; else detected.")
]
TimeColumnChoice = Annotated[
    str | None, typer.Option(metavar="NAME", help='Name or number (from 1) of the time column, or "none".')
]
TimeUnit = Annotated[
    str | None, typer.Option(metavar="UNIT", help="Unit of a numeric time column: s, ms, us, ns, min, h, day.")
]
Missing = Annotated[
    list[str] | None,
    typer.Option(metavar="VALUE", help='A value that means "no sample", such as -200; may be repeated.'),
]
GapsChoice = Annotated[
    str | None, typer.Option(metavar="HOW", help="Gaps in time: rows (none, default), missing samples, or dt.")
]
