"""Options that several commands share, and the numbers that options take."""

from __future__ import annotations

import functools
import inspect
import math
from collections.abc import Callable, Mapping
from typing import Annotated, Any, TypeVar

import typer
from typer.models import OptionInfo

from kalscope.common.text import without_blanks
from kalscope.sources.grammar.read_options import options_from_text

Made = TypeVar("Made")


class BadValue(typer.BadParameter):
    """A value that an option does not take. The message begins with the option: --q must be a number (got 'x')."""

    def __init__(self, must: str, text: str) -> None:
        super().__init__(f"must be {must} (got {text!r})")

    def format_message(self) -> str:
        """The whole message; by now typer has set the option."""
        return f"{self.param.opts[0]} {self.message}" if self.param else self.message


def _float(text: str) -> float:
    try:
        return float(without_blanks(str(text)))  # a default is a number already
    except ValueError:
        return math.nan


def _parser(must: str, holds: Callable[[float], bool], word: str | None = None) -> Callable[[str], float]:
    """A parser that takes a number for which `holds` is true, or `word`, for which it returns NaN."""

    def parse(text: str) -> float:
        value = _float(text)
        if not holds(value) and text != word:
            raise BadValue(must, text)
        return value

    return parse


number = _parser("a number", lambda value: not math.isnan(value))
"""The number that was typed, of either sign."""
positive = _parser("a number above 0", lambda value: 0.0 < value < math.inf)
"""The number that was typed, above 0 and finite."""


def whole(text: str) -> int:
    """The whole number that was typed, 0 or above."""
    if not str(text).isdecimal():  # a default is a number already
        raise BadValue("a whole number", text)
    return int(text)


def number_or(word: str) -> Callable[[str], float]:
    """A parser that takes a number, or `word`, for which it returns NaN."""
    return _parser(f'a number or "{word}"', lambda value: not math.isnan(value), word)


def percentage(text: str) -> float:
    """The percentage that was typed, with or without a % sign, as a share."""
    value = _float(text.removesuffix("%"))
    if not 0.0 <= value < 100.0:
        raise BadValue("a percentage of at least 0 and below 100", text)
    return value / 100.0


def number_or_each(one: Callable[[str], float]) -> Callable[[str], dict[str, float] | float]:
    """A parser that takes a number as `one` does, or one for each of several sensors: a=4,b=9."""

    def parse(text: str) -> dict[str, float] | float:
        from kalscope.tuning.choose import named_numbers

        return ("=" in text and named_numbers(text, one)) or one(text)

    return parse


def number_option(text: str, parser: Callable[[str], Any] = positive) -> Any:
    """An option that takes a number and has the name of its argument; `text` is its help."""
    return typer.Option(metavar="NUMBER", help=text, parser=parser)


def text_option(name: str, text: str) -> Any:
    """An option that takes a text, named by the word `name` in --help."""
    return typer.Option(metavar=name, help=text)


Source = Annotated[
    str, typer.Argument(metavar="SOURCE", help='A file, "demo", "sample:NAME", "synthetic:SHAPE?…".')
]
SamplePeriod = Annotated[float | None, number_option("Sample period in s; replaces that of SOURCE.")]


def option_group(options: Mapping[str, Any], make: Callable[..., Made]) -> Callable[..., Made]:
    """`make` with these options as its arguments, for `with_options`; those that are not given are left out.

    Args:
        options: the type of each as typer reads it, or what `number_option` or `text_option` returns, by name.
        make: takes those that are given.
    """

    def group(**given: Any) -> Made:
        return make(**{name: value for name, value in given.items() if value is not None})

    def parameter(name: str, option: Any) -> inspect.Parameter:
        if isinstance(option, OptionInfo):
            option = Annotated[Any if option.parser else str | None, option]
        return inspect.Parameter(name, inspect.Parameter.POSITIONAL_OR_KEYWORD, default=None, annotation=option)

    group.__dict__["__signature__"] = inspect.Signature([parameter(*item) for item in options.items()])
    return group


read_options = option_group(
    {
        "delimiter": text_option("MARK", "comma, semicolon, tab, bar or space; default: detected."),
        "decimal": text_option("MARK", "Decimal mark: point or comma; default: detected."),
        "header_row": text_option("N", "Line with the names, counted from 1; 0 = none."),
        "unit_row": text_option("N", "Line with the units, counted from 1; 0 = none."),
        "time_column": text_option("NAME", 'Name or number (from 1) of the time column, or "none".'),
        "time_unit": text_option("UNIT", "Unit of a numeric time column: s, ms, us, ns, min, h, day, year."),
        "time_format": text_option("FORMAT", 'How a time stamp is written, such as "%d.%m.%Y %H:%M:%S".'),
        "day_first": Annotated[
            bool | None, typer.Option("--day-first/--month-first", help="03/04/2025: 3 April, or March 4.")
        ],
        "rate": text_option("HZ", "Sample rate; replaces that of the time stamps."),
        "missing": Annotated[
            list[str] | None, text_option("VALUE", 'A value that means "no sample", such as -200; may be repeated.')
        ],
        "gaps": text_option(
            "HOW", "Gaps in time: rows (ignored; default), missing (adds missing samples), dt (elapsed time)."
        ),
        "part": text_option("NAME", "Sheet, topic, group or variable of a file that holds several."),
        "unpack_gb": text_option(
            "GB", "What a packed file may unpack to; default: 0.134 GB, or 32 times its size."
        ),
    },
    options_from_text,
)
"""The options about reading a file, as every command that reads one takes them; see `reads_source`."""


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
