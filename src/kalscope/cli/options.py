"""Options that several commands share, and the numbers that options take."""

from __future__ import annotations

import functools
import inspect
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any

import typer

from kalscope.sources.grammar.read_options import ReadOptions, options_from_text


class BadValue(typer.BadParameter):
    """A value that an option does not take. The message begins with the option: --q must be a number (got 'x')."""

    def __init__(self, must: str, text: str) -> None:
        super().__init__(f"must be {must} (got {text!r})")

    def format_message(self) -> str:
        """The whole message; by now typer has set the option."""
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


def percentage(text: str) -> float:
    """The percentage that was typed, with or without a % sign, as a share."""
    value = _float(text.removesuffix("%"))
    if not 0.0 <= value < 100.0:
        raise BadValue("a percentage of at least 0 and below 100", text)
    return value / 100.0


def number_or(word: str) -> Callable[[str], float]:
    """A parser that takes a number, or `word`, for which it returns NaN."""

    def parse(text: str) -> float:
        value = _float(text)
        if math.isnan(value) and text != word:
            raise BadValue(f'a number or "{word}"', text)
        return value

    return parse


@dataclass(frozen=True)
class SensorNumbers:
    """One number for every sensor, or numbers for some of them."""

    each: dict[str, float] | float
    """The number, or the numbers by the names of their sensors."""


def number_or_each(one: Callable[[str], float]) -> Callable[[str], SensorNumbers]:
    """A parser that takes a number as `one` does, or one for each of several sensors: a=4,b=9."""

    def parse(text: str) -> SensorNumbers:
        from kalscope.tuning.choose import named_numbers

        named = named_numbers(text, one) if "=" in text else {}
        return SensorNumbers(named or one(text))

    return parse


def _float(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan


def number_option(text: str, parser: Callable[[str], Any] = positive) -> Any:
    """An option that takes a number and has the name of its argument; `text` is its help."""
    return typer.Option(metavar="NUMBER", help=text, parser=parser)


Source = Annotated[
    str, typer.Argument(metavar="SOURCE", help='A file, "demo", "sample:NAME", "synthetic:SHAPE?…".')
]
SamplePeriod = Annotated[float | None, number_option("Sample period in s; replaces that of SOURCE.")]


def text_option(name: str, text: str) -> Any:
    """An option that takes a text, named by the word `name` in --help."""
    return typer.Option(metavar=name, help=text)


def read_options(
    delimiter: Annotated[
        str | None, text_option("MARK", "comma, semicolon, tab, bar or space; default: detected.")
    ] = None,
    decimal: Annotated[str | None, text_option("MARK", "Decimal mark: point or comma; default: detected.")] = None,
    header_row: Annotated[str | None, text_option("N", "Line with the names, counted from 1; 0 = none.")] = None,
    unit_row: Annotated[str | None, text_option("N", "Line with the units, counted from 1; 0 = none.")] = None,
    time_column: Annotated[
        str | None, text_option("NAME", 'Name or number (from 1) of the time column, or "none".')
    ] = None,
    time_unit: Annotated[
        str | None, text_option("UNIT", "Unit of a numeric time column: s, ms, us, ns, min, h, day, year.")
    ] = None,
    time_format: Annotated[
        str | None, text_option("FORMAT", 'How a time stamp is written, such as "%d.%m.%Y %H:%M:%S".')
    ] = None,
    day_first: Annotated[
        bool | None, typer.Option("--day-first/--month-first", help="03/04/2025: 3 April, or March 4.")
    ] = None,
    rate: Annotated[str | None, text_option("HZ", "Sample rate; replaces that of the time stamps.")] = None,
    missing: Annotated[
        list[str] | None, text_option("VALUE", 'A value that means "no sample", such as -200; may be repeated.')
    ] = None,
    gaps: Annotated[
        str | None,
        text_option(
            "HOW", "Gaps in time: rows (ignored; default), missing (adds missing samples), dt (elapsed time)."
        ),
    ] = None,
    part: Annotated[
        str | None, text_option("NAME", "Sheet, topic, group or variable of a file that holds several.")
    ] = None,
    unpack_gb: Annotated[
        str | None,
        text_option("GB", "What a packed file may unpack to; default: 0.134 GB, or 32 times its size."),
    ] = None,
) -> ReadOptions:
    """The options about reading a file, as every command that reads one takes them; see `reads_source`."""
    return options_from_text(
        delimiter,
        time_column,
        time_unit,
        missing or (),
        gaps,
        decimal=decimal,
        header_row=header_row,
        unit_row=unit_row,
        time_format=time_format,
        day_first=day_first,
        rate=rate,
        part=part,
        unpack_gb=unpack_gb,
    )


def with_options(**groups: Callable[..., Any]) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Give a command all the options of a function in place of the parameter that takes its result.

    Typer makes its options from the signature that it finds, so the result has one with all of them.

    Args:
        groups: the functions, by the name of the parameter.
    """
    shared = {name: inspect.signature(group, eval_str=True).parameters for name, group in groups.items()}

    def decorate(command: Callable[..., None]) -> Callable[..., None]:
        @functools.wraps(command)
        def with_groups(**given: Any) -> None:
            for name, group in groups.items():
                given[name] = group(**{option: given.pop(option) for option in shared[name] if option in given})
            command(**given)

        merged: dict[str, inspect.Parameter] = {}
        for name, parameter in inspect.signature(command, eval_str=True).parameters.items():
            merged.update(shared.get(name, {name: parameter}))
        with_groups.__annotations__ = {name: parameter.annotation for name, parameter in merged.items()}
        with_groups.__dict__["__signature__"] = inspect.Signature(list(merged.values()))
        return with_groups

    return decorate


reads_source = with_options(reading=read_options)
"""The command with all the options of `read_options` in place of its parameter `reading`."""
