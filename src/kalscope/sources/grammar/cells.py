"""The cells of a line: what is a number, a missing sample, a unit or a unit of time."""

from __future__ import annotations

import csv
import math
import re
from dataclasses import dataclass

# The cells of a line and the numbers in them: what is a number, a missing value, a comment, a blank line.


COMMENT_MARKS = ("#", "%", "//")
"""What a comment line begins with."""

MISSING = frozenset({"", "nan", "+nan", "-nan", "nil", "null", "na", "n/a", "none"})
"""Cells, in lower case, that say "no sample": ordinary missing values, never reported as bad."""

_MISSING_TEXT = r"""
m - -- --- ---- ----- * ** *** **** ***** / // /// //// ///// ? ?? ??? . .. ... _ __ \n
unavailable unknown offline disconnected missing invalid void undefined undef nodata no_data no-data
n.a. n.a [n/a] n/d n.d. n.d nd #n/a #n/a! #na #value! #div/0! #ref! #num! <na> <null> (null) nat
"""
MISSING_WORDS = frozenset((*_MISSING_TEXT.split(), "no data", "not available"))
"""Other cells, in lower case, that loggers write for "no sample": missing as well, and counted in the report."""

OVERFLOWS = frozenset(sign + word for sign in ("", "+", "-") for word in ("inf", "infinity", "ovf"))
"""What boards print, in lower case, for a float that they cannot print: no sample, and never a name."""

NUMBER = {
    # [0-9], not \d: float() would take the digits of any script. No hexadecimal, no infinity, no "1_000".
    # Some loggers write "+  21.5", Fortran 1.5D+02.
    ".": re.compile(r"(?:[-+] *)?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:(?:[eE][-+]?|[dD][-+])[0-9]+)?"),
    # A decimal comma needs a digit after it, else "155," of "155, 0.76" would be a number.
    ",": re.compile(r"(?:[-+] *)?(?:[0-9]+(?:,[0-9]+)?|,[0-9]+)(?:(?:[eE][-+]?|[dD][-+])[0-9]+)?"),
}
"""The whole grammar of a number, by its decimal mark."""

_FOR_FLOAT = str.maketrans(",dD", ".ee", " ")
_TYPED = str.maketrans({"\u00a0": " ", "\u2009": " ", "\u202f": " ", "\u2212": "-"})
"""Plain characters for non-breaking spaces, as browsers write them before AM, and for the typographic minus."""
_NUMBER_STARTS = (*"0123456789+-.", "nan", "NaN", "None", "null")
_CONTROL = re.compile(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f]")
DAMAGED = "\0"
"""Replaces a damaged line in sniffing: it counts as a line that is not a row, and costs nothing."""
_RUN_OF_SPACES = re.compile(r"[ \t]+")
_TOUCHING = re.compile(r"(\.[0-9]{1,20}(?:E[-+][0-9]{2})?)(?=-[0-9]?\.[0-9])")
"""Where columns of Fortran meet, `1.10477E+00-2.33183E-03`, on lines of such numbers alone."""


def is_comment(line: str) -> bool:
    """True where the first mark on the line is #, % or //."""
    return line.lstrip(" \t").startswith(COMMENT_MARKS)


def is_blank(line: str, delimiter: str = "") -> bool:
    """True where nothing but blanks and delimiters (a spreadsheet's empty row) is on the line."""
    return not line.strip(" \t\r\n" + delimiter)


def is_damaged(line: str) -> bool:
    """Whether a line was damaged on the wire or on the disk: where it has control characters no cell is trusted."""
    return _CONTROL.search(line) is not None


def split_fields(line: str, delimiter: str) -> list[str]:
    """Cells of one table line, without blanks and quotes around them; typographic blanks and minus made plain.

    A quoted cell never spans lines: a stray quote is a damaged cell, and must not swallow
    the rows below it.
    """
    cells = _split(line, delimiter)
    return cells if line.isascii() else [cell.translate(_TYPED).strip(" ") for cell in cells]


def _split(line: str, delimiter: str) -> list[str]:
    text = line.strip(" \t\r\n") if delimiter == " " else line.rstrip("\r\n")
    if text[-1:] == "#" and text[-2:-1].isalnum():  # as boards end a message
        text = text[:-1]
    if '="' in text:  # ="21.5" keeps a spreadsheet from reading the cell
        text = (delimiter + text).replace(f'{delimiter}="', f'{delimiter}"')[1:]
    if text.endswith(("]", ")", "}", "},", ">")):
        text = _without_brackets(text)
    if '"' in text and text.count('"') % 2 == 0:
        try:
            text = _RUN_OF_SPACES.sub(" ", text) if delimiter == " " else text
            # strict: else `" 3"25` would be glued to 325, a number that is not in the file.
            reader = csv.reader([text], delimiter=delimiter, skipinitialspace=True, strict=True)
            return [cell.strip(" \t") for row in reader for cell in row]
        except csv.Error:  # a stray quote, or a cell above the module's limit
            pass
    if delimiter == " ":
        text = _TOUCHING.sub(r"\1 ", text) if "E" in text and not text.strip("0123456789.+-E \t") else text
        cells = _RUN_OF_SPACES.split(text) if text else []
        if cells and cells[0][-1:] == ":" and cells[0][:-1].isdecimal():
            cells[0] = cells[0][:-1]  # RRDtool
        # `21,5, 40,2` and `26.69C, 40%` are separated by a comma and a blank.
        is_listed = ", " in text or "; " in text or text[-1:] == ","
        return [cell.rstrip(",;") or cell for cell in cells] if is_listed else cells
    cells = [cell.strip(" \t") for cell in text.split(delimiter)]
    if "'" in text:  # PhysioNet: 'Elapsed time','MLII'
        cells = [cell[1:-1] if len(cell) > 1 and cell[0] == cell[-1] == "'" else cell for cell in cells]
    return cells


def _without_brackets(text: str) -> str:
    """`1, 2, 3` of `[1, 2, 3]`, `(1, 2, 3)` and `{1, 2, 3},`, as programs print lists; any other line unchanged."""
    bare = text.strip(" \t").removesuffix(",").replace("[[", "[").replace("]]", "]")
    inner = bare[1:-1]
    is_pair = bare[:1] + bare[-1] in ("[]", "()", "{}", "<>") and not any(mark in inner for mark in "[](){}<>")
    numbers = inner.strip(" \t").startswith(_NUMBER_STARTS) and any(mark in inner for mark in ",; \t")
    return inner.strip(" \t") if is_pair and numbers else text


def is_number(cell: str, decimal: str = ".") -> bool:
    """True where the whole cell is a plain decimal number, within float64 or not."""
    return NUMBER[decimal].fullmatch(cell) is not None


def parse_number(cell: str, decimal: str = ".") -> float | None:
    """The number in a cell.

    Returns:
        NaN for a missing value (empty, NaN, nil, null, NA, none); None for what is not a finite number
        (`12abc`, `0x1F`, `Infinity`, `ERR`, `1e999`, `1_000`).
    """
    if NUMBER[decimal].fullmatch(cell):
        try:
            value = float(cell.replace(",", "."))
        except ValueError:  # the rare forms; translate takes ten times as long
            value = float(cell.translate(_FOR_FLOAT))
        return value if math.isfinite(value) else None
    return math.nan if cell.lower() in MISSING else None


_MEASURE = re.compile(
    r"([-+]?(?:[0-9]+(?:[.,][0-9]+){0,4}|[.,][0-9]+)(?:[eE][-+]?[0-9]+)?) ?([^\s0-9.,+\-][^\s]{0,7}(?: [AD]C)?)"
)
_GROUPED = {
    # The thousands of "1,234.5" by its decimal mark, with blanks or the Swiss apostrophe: 1 234.5; 0,123 has none.
    mark: re.compile(rf"[-+]?[1-9][0-9]{{0,2}}(?:[{other} \u00a0\u202f'’][0-9]{{3}})+(?:{re.escape(mark)}[0-9]+)?")
    for mark, other in (".,", ",.")
}
CURRENCIES = frozenset("$€£¥")
"""Units that are written before the number as well."""
_NO_BLANKS = str.maketrans("", "", " \u00a0\u202f'’")
OTHER_MARK = {".": ",", ",": "."}
"""The mark that is not the decimal mark, and may separate thousands."""


@dataclass(frozen=True)
class NumberForm:
    """How the numbers of one column are written."""

    decimal: str = "."
    """Decimal mark, "." or ","."""
    thousands: bool = False
    """True where the other mark, a blank or an apostrophe may separate thousands: 1,234.5."""
    suffix: str = ""
    """Unit that is written after each number, a currency before it as well: the C of 26.69C, the $ of $0.11."""

    def fits(self, cell: str) -> bool:
        """True where the whole cell is a number of this form, within float64 or not."""
        cell = self._bare(cell)
        grouped = self.thousands and _GROUPED[self.decimal].fullmatch(cell) is not None
        return grouped or NUMBER[self.decimal].fullmatch(cell) is not None

    def parse(self, cell: str) -> float | None:
        """The number in a cell, as `parse_number`."""
        cell = self._bare(cell)
        if self.thousands and _GROUPED[self.decimal].fullmatch(cell):
            cell = cell.replace(OTHER_MARK[self.decimal], "").translate(_NO_BLANKS)
        return parse_number(cell, self.decimal)

    def _bare(self, cell: str) -> str:
        cell = cell.removeprefix(self.suffix).lstrip(" ") if self.suffix in CURRENCIES else cell
        return cell.removesuffix(self.suffix).rstrip(" ") if self.suffix else cell


def split_measure(cell: str) -> tuple[str, str] | None:
    """(number, unit) of `26.69C`, `45 %`, `3,3V`, whatever the unit; None for any other cell."""
    match = (
        _MEASURE.fullmatch(cell if cell[:1] not in CURRENCIES else cell[1:] + cell[0]) if len(cell) <= 40 else None
    )
    return (match[1], match[2]) if match else None


def is_grouped(cell: str) -> bool:
    """True for a number that has thousands separators, or may have them: 1,234.5, 1 234,5 and 1.234."""
    return any(pattern.fullmatch(cell) for pattern in _GROUPED.values())


# Words that are units, in a header, in a row of their own or after a number.


def words(text: str) -> frozenset[str]:
    """The words of a text."""
    return frozenset(text.split())


_UNITS = words(
    """
    s sec second seconds secs ms msec msecs millis us usec µs μs ns min mins minute minutes h hr hour hours
    d day days yr year years unitless
    lb lbs oz kgf gf
    v volt volts mv uv µv kv a amp amps ampere amperes ma ua µa na g mg kg m mm cm km um µm meter meters
    metre metres
    m/s m/s2 m/s^2 m/s² m/s/s km/h kph mph mps knots kn ft in gal deg ° degree degrees rad deg/s °/s dps rad/s rpm
    degc °c 'c c celsius f degf °f 'f k kelvin fahrenheit % %rh rh percent pct
    pa hpa kpa mpa mbar bar psi mmhg inhg torr at atm hz khz mhz ghz lux lx ppm ppb count counts lsb adc raw ts rn
    w kw mw watt watts w/m2 w/m^2 w/m² kwh wh n newton newtons nm n·m joule joules j db dbm dbv ohm ohms kohm ω kω
    $ € £ ¥ farad f/m kb gb kib mib gib ut µt mt tesla gauss l ml liter liters litre litres l/min bpm no_units
    """
)
_SPELLED_OF = {"s": "second", "V": "volt volts", "A": "ampere amperes amp amps", "": "- -- no_units unitless"}
_SPELLED = {word: symbol for symbol, said in _SPELLED_OF.items() for word in said.split()}
"""Units in lower case that are written as their symbols."""
MAX_UNIT = 24
"""Most characters of a unit that is recognised only by a sign such as / or °."""
SUFFIX_UNITS = words("mm cm km mv ma mg ms us degc degf hpa kpa mbar hz lux ppm ppb rpm dps kg")
"""Suffixes of a channel's name that can hardly be anything else; one letter (a_g, a_x) could be."""


def is_unit(text: str, *, alone: bool = False) -> bool:
    """True for a known unit, and for a text with a sign that only units have; `alone`, Date/Time is none."""
    text = text.strip().lower()
    parts = [part.strip("()^-+23 ") for part in text.replace("deg ", "deg").split("/")]
    signs = set("°℃℉²³%µμ" if alone else "/^°℃℉²³%µμ")
    marked = len(text) <= MAX_UNIT and signs.intersection(text) and not set("[(:").intersection(text)
    return bool(marked) or text in _UNITS or all(part in _UNITS for part in parts)


def is_measure(text: str) -> bool:
    """True for a unit that may follow each number of a column: the C of 26.69C, the % of 45%."""
    return text.removesuffix("DC").removesuffix("AC").rstrip().lower() in _UNITS  # a multimeter writes 3.3 V DC


def bare_unit(unit: str) -> str:
    """The unit without its brackets, V for volt; "" for "-"."""
    unit = unit[1:-1] if unit[:1] + unit[-1:] in ("[]", "()") and len(unit) > 1 else unit
    unit = unit.strip()
    return _SPELLED.get(unit.lower(), unit)


def are_units(cells: tuple[str, ...]) -> bool:
    """True for a row of units: half of its cells or more are known, the others are short or "-", none is long."""
    said = [cell for cell in cells if cell and cell != "-"]
    known = sum(cell != bare_unit(cell) or is_unit(cell, alone=True) for cell in said)
    return known > 0 and 2 * known >= len(said) and all(len(cell) <= MAX_UNIT for cell in said)


# Units of time and the words for them.


_TIME_UNITS = {
    "s": (1.0, "s sec secs second seconds"),
    "ms": (1e-3, "ms msec msecs millis millisecond milliseconds"),
    "us": (1e-6, "us µs μs usec usecs micros microsecond microseconds"),
    "100ns": (1e-7, "100ns"),
    "ns": (1e-9, "ns nsec nsecs nanos nanosec nanosecond nanoseconds"),
    "min": (60.0, "min mins minute minutes"),
    "h": (3600.0, "h hr hour hours"),
    "day": (86400.0, "d day days"),
    "year": (31557600.0, "year years yr yrs"),  # the Julian year of 365.25 days
}
SECONDS_PER_UNIT = {unit: seconds for unit, (seconds, _) in _TIME_UNITS.items()}
"""Seconds in one unit of time."""
UNIT_OF_WORD = {word: unit for unit, (_, said) in _TIME_UNITS.items() for word in said.split()}
"""The unit that a word in a header names, lower case."""
