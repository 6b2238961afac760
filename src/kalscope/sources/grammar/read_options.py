"""Choices of the user that override what the reader detects."""

from __future__ import annotations

import math
import shlex
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, cast

from kalscope.errors import BadSetting
from kalscope.recording import Gaps
from kalscope.sources.grammar.cells import MISSING, SECONDS_PER_UNIT, UNIT_OF_WORD, is_number

WORD_OF_DELIMITER = {",": "comma", ";": "semicolon", "\t": "tab", "|": "bar", " ": "space"}
WORD_OF_DECIMAL = {".": "point", ",": "comma"}
"""How the options of the command line name the marks."""
DELIMITERS = tuple(WORD_OF_DELIMITER)
"""What may separate cells; a space is any run of blanks."""
_MARK_OF_WORD = {word: mark for mark, word in {**WORD_OF_DELIMITER, **WORD_OF_DECIMAL}.items()} | {"\\t": "\t"}


def word_of_mark(mark: str, option: str) -> str:
    """The word of the command line for a delimiter or a decimal mark, as its `option` takes it."""
    return (WORD_OF_DECIMAL if option == "decimal" else WORD_OF_DELIMITER)[mark]


def _is_line_number(value: object) -> bool:
    return value is None or (isinstance(value, int) and value >= 0)


def _is_positive(value: object) -> bool:
    return value is None or (isinstance(value, int | float) and 0 < value < math.inf)


@dataclass(frozen=True)
class ReadOptions:
    """How to read a file. Every field left at its default is detected."""

    delimiter: str | None = None
    """Delimiter of cells: one of `, ; TAB |`, or a space for any run of blanks."""
    decimal: str | None = None
    """Decimal mark, "." or ","; another mark than the delimiter."""
    time_column: str | int | None = None
    """Name of the time column, or its index from 0; "none" to count samples instead."""
    time_unit: str | None = None
    """Unit of a numeric time column: s, ms, us, ns, min, h, day or year."""
    missing: tuple[float | str, ...] = ()
    """Values that say "no sample": numbers such as -200, compared as numbers, or texts, compared as cells."""
    gaps: Gaps = "rows"
    """Gaps in time are ignored ("rows"), filled with missing samples ("missing"), or elapsed time ("dt")."""
    header_row: int | None = None
    """Line number, from 1, of the row of names; 0 where there is none."""
    unit_row: int | None = None
    """Line number, from 1, of the row of units; 0 where there is none."""
    time_format: str | None = None
    """How a stamp is written, in the codes of `datetime.strptime`: "%d.%m.%Y %H:%M:%S"."""
    day_first: bool | None = None
    """True: 03/04/2025 is 3 April; False: it is March 4."""
    rate: float | None = None
    """Sample rate in Hz, in place of that of the stamps; the samples keep the times of their stamps."""
    part: str | None = None
    """Which sheet, topic, group or variable of a file that holds several."""
    unpack_gb: float | None = None
    """What the file may unpack to, GB; by default 0.134, or 32 times its size where that is more."""

    def __post_init__(self) -> None:
        finite = all(isinstance(value, str) or math.isfinite(value) for value in self.missing)
        rules = (
            ("delimiter", self.delimiter in (None, *DELIMITERS), "one of , ; TAB | or a space"),
            ("decimal", self.decimal in (None, *WORD_OF_DECIMAL), '"." or ","'),
            ("decimal", self.decimal is None or self.decimal != self.delimiter, "another mark than the delimiter"),
            ("time_unit", self.time_unit in (None, *SECONDS_PER_UNIT), f"one of {', '.join(SECONDS_PER_UNIT)}"),
            ("gaps", self.gaps in ("rows", "missing", "dt"), "rows, missing or dt"),
            ("header_row", _is_line_number(self.header_row), "a line number from 1, or 0 for none"),
            ("unit_row", _is_line_number(self.unit_row), "a line number from 1, or 0 for none"),
            ("rate", _is_positive(self.rate), "a number of Hz above 0"),
            ("unpack_gb", _is_positive(self.unpack_gb), "a number of GB above 0"),
            ("missing", finite, "finite numbers or texts"),
        )
        for name, holds, what in rules:
            if not holds:
                raise BadSetting(f"{name} must be {what} (got {getattr(self, name)!r})")

    @property
    def missing_texts(self) -> frozenset[str]:
        """Cells, in lower case, that say "no sample": the ordinary words and those of `missing`."""
        return MISSING | {value.strip().lower() for value in self.missing if isinstance(value, str)}

    @property
    def missing_numbers(self) -> tuple[float, ...]:
        """The numbers of `missing`."""
        return tuple(float(value) for value in self.missing if not isinstance(value, str))

    def without_numbers(self) -> ReadOptions:
        """The same for a reader of lines, where the numbers of `missing` are removed later, all at once."""
        texts = tuple(value for value in self.missing if isinstance(value, str))
        return replace(self, missing=texts) if texts != self.missing else self


DEFAULTS = ReadOptions()
"""Everything is detected."""


OPTIONS = (
    *("--delimiter", "--decimal", "--header-row", "--unit-row", "--time-column", "--time-unit", "--time-format"),
    *("--day-first", "--month-first", "--rate", "--missing", "--gaps", "--part", "--unpack-gb"),
)
"""The options of the command line that override what was detected."""


def options_from_text(
    *, missing: Sequence[str] = (), gaps: str | None = None, day_first: bool | None = None, **texts: str | None
) -> ReadOptions:
    r"""Options as the user types them, on the command line or into a form.

    Args:
        missing: Numbers and texts.
        gaps: rows, missing or dt.
        day_first: See ReadOptions.
        texts: Its other fields: a mark itself, or comma, semicolon, tab, bar, space, point; a column's name,
            "none", or "column 2" / "2" counted from 1 as the reports do; any common word for a unit of time; a line
            number; a number of Hz or GB, with or without the unit; codes of `datetime.strptime`.

    Raises:
        BadSetting: a choice that is none of these.
    """
    read: dict[str, Callable[[str], object]] = {
        **dict.fromkeys(("delimiter", "decimal"), lambda text: _MARK_OF_WORD.get(text.strip().lower(), text)),
        "time_unit": lambda text: UNIT_OF_WORD.get(text.strip().lower(), text),
        "time_column": _column,
        **dict.fromkeys(("header_row", "unit_row", "rate", "unpack_gb"), _number),
    }
    chosen: dict[str, Any] = {name: read.get(name, str)(text) for name, text in texts.items() if text is not None}
    values = tuple(float(text) if is_number(text.strip()) else text for text in missing)
    return ReadOptions(missing=values, gaps=cast("Gaps", gaps or "rows"), day_first=day_first, **chosen)


def option_words(options: ReadOptions) -> tuple[str, ...]:
    """What was decided, in the words of the command line: ("--delimiter", "comma", "--missing=-200")."""
    words: dict[str, Callable[[Any], object]] = {
        "delimiter": WORD_OF_DELIMITER.get,
        "decimal": WORD_OF_DECIMAL.get,
        "time_column": lambda column: column + 1 if isinstance(column, int) else column,
    }
    given = {field.name: getattr(options, field.name) for field in fields(options)}
    given = {name: value for name, value in given.items() if value != getattr(DEFAULTS, name)}
    day_first, missing = given.pop("day_first", None), given.pop("missing", ())
    order = [] if day_first is None else ["--day-first" if day_first else "--month-first"]
    texts = [(name.replace("_", "-"), str(words.get(name, str)(value))) for name, value in given.items()]
    texts += [
        ("missing", v if isinstance(v, str) else repr(v).removesuffix(".0")) for v in missing
    ]  # -200, not -200.0
    return (*order, *(word for name, text in texts for word in option(name, text)))


def split_values(text: str) -> list[str]:
    r"""Values of one line, separated by blanks: `-200 "no data" \N`; quotes hold a text with blanks together.

    Raises:
        BadSetting: a quote is not closed.
    """
    words = shlex.shlex(text, posix=True, punctuation_chars=False)
    words.whitespace_split, words.commenters, words.escape = True, "", ""
    try:
        return list(words)
    except ValueError:
        raise BadSetting(f"""quotes must come in pairs, "no data" or 'no data' (got {text!r})""") from None


def option(name: str, value: str) -> tuple[str, ...]:
    """An option of the command line: two words, or one where the value could be taken for an option."""
    return (f"--{name}={value}",) if value.startswith("-") else (f"--{name}", value)


def _column(text: str) -> str | int:
    number = text.lower().removeprefix("column").strip()
    return int(number) - 1 if number.isascii() and number.isdecimal() and number != "0" else text


def _number(text: str) -> float | str:
    """A number, with or without Hz or GB; what is none is returned as it is, and refused by ReadOptions."""
    digits = text.strip().lower().removesuffix("hz").removesuffix("gb").strip()
    if not is_number(digits):
        return text
    return int(digits) if digits.lstrip("+-").isdecimal() and len(digits) < 10 else float(digits)
