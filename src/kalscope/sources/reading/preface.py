"""What a file says about its table above it: Empatica's own form, the sample rate."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import zip_longest

from kalscope.common.text import duration
from kalscope.sources.grammar.cells import SECONDS_PER_UNIT, UNIT_OF_WORD, is_comment, is_number, split_fields

_MAX_LINES = 120
"""Lines in which a rate is looked for."""
_MAX_LENGTH = 400
"""Characters of each."""


@dataclass(frozen=True)
class Preface:
    """What the lines above a table say about it; None and () where they say nothing."""

    header_row: int | None = None
    """Line number, from 1, of the row of names; 0 where there is none."""
    first_row: int = 1
    """Line number, from 1, of the first row of the table."""
    time_column: int | str | None = None
    """Column, from 0, of the time; "none" where the table has none."""
    period: float | None = None
    """Sample period in s."""
    start: float | None = None
    """What second 0 of the stamps is, or the first sample where there are none, in s since 1970 (UTC)."""
    notes: tuple[str, ...] = ()
    """What else was understood, each a sentence for the report."""


def find_preface(head: Sequence[str]) -> Preface:
    """What the first lines of a file, without their newlines, say about its table."""
    return _empatica(head) or _stated_rate(head) or Preface()


def _empatica(head: Sequence[str]) -> Preface | None:
    """The start, then the rate, then the samples, without a header; of IBI.csv the start and "IBI", then beats.

    Source: Empatica's "Data export and formatting from E4 connect": row 1 is the start in Unix seconds (UTC), row 2
    the rate in Hz, both written once per column.
    """
    above = next((i for i, line in enumerate(head[:_MAX_LINES]) if line.strip()), 0)
    rows = [split_fields(line.removeprefix("\ufeff").rstrip("\r,"), ",") for line in head[above : above + 3]]
    if len(rows) < 3 or not _is_start(rows[0][0]):
        return None
    first, second, third = rows
    found = Preface(0, first_row=above + 2, start=float(first[0]), notes=("written by Empatica E4",))
    if len(first) == 2 and first[1].upper() == "IBI":
        return replace(found, header_row=above + 1, time_column=0)
    once = len(first) == len(second) == len(third) and len({*first}) == len({*second}) == 1
    rate = float(second[0]) if is_number(second[0]) else 0.0
    if not once or _is_start(third[0]) or rate not in (1, 4, 8, 16, 32, 64, 128):
        return None
    return replace(found, first_row=above + 3, time_column="none", period=1 / rate)


def _is_start(cell: str) -> bool:
    return is_number(cell) and 1262304000.0 <= float(cell) <= 2051222400.0  # 2010 to 2035


# A rate or an interval that a logger writes above its table: `# Sampling Rate: 250 Hz`, `Sample Interval,1E-6`.
#
# Source: the lines above the tables of PicoQuake, GENEActiv ("Measurement Frequency"), MetaWear, and many scripts.


_RATE = r"""
    (?:sampl(?:e|ing)[ ]?|(?:data|output[ ]data|measurement|logging|acquisition|store)[ ])(?:rate|freq(?:uency)?)
    |sampl(?:ed|ing)[ ]at|samples[ ]per[ ]sec(?:ond)?|fps
    |rate|fs|odr|sfreq|(?:abtast|mess)(?:rate|frequenz)|samplefrequenz
"""
_INTERVAL = r"""
    (?:sampl(?:e|ing)[ ]?|log(?:ging)?[ ]|recording[ ]|measurement[ ]|epoch[ ])(?:interval|period|length)
    |sample[ ]?time|time[ ]?step|dt|delta[ -]t|(?:time[ ]|x[ ]?)?increment|interval|x[ ]?inc|tinc
    |(?:abtast|mess)?intervall
"""
_HERTZ = {
    **{
        prefix + word: factor
        for prefix, factor in (("", 1.0), ("k", 1e3), ("m", 1e6), ("g", 1e9))
        for word in ("hz", "sps", "s/s", "sa/s")
    },
    **dict.fromkeys(("", "hertz", "1/s", "samples/s", "samples/sec", "samples/second", "samples per second"), 1.0),
}
_SECONDS = {"": 1.0} | {word: SECONDS_PER_UNIT[unit] for word, unit in UNIT_OF_WORD.items()}


_STATED = re.compile(
    rf"""(?:^|[{{,;|\t:=\#%/])[ "']{{0,4}}(?:(?P<rate>{_RATE})|(?P<step>{_INTERVAL}))
    [ ]{{0,4}}(?:[(\[](?P<unit>[^()\[\]]{{0,24}})[)\]])?[ "':=,;|\t]{{1,8}}
    (?P<number>[-+]?(?=[.,]?[0-9])[0-9]{{0,20}}(?:[.,][0-9]{{1,20}}){{0,3}}(?:e[-+]?[0-9]{{1,3}})?)
    (?P<mark>[ "',;|\t]{{0,4}})(?P<written>[^0-9,;|\t"'()]{{0,24}})""",
    re.VERBOSE,
)
"""A key at the begin of a cell, its unit in brackets, the value, and the unit after it or in the next cell."""

_AT = re.compile(r"(?<!filter )(?<!pass)(?<!cutoff)(?<!notch) at ([0-9]{1,5}(?:\.[0-9]{1,5})?) hz\b")
"""`date format M/d/yyyy at 30 Hz` of ActiGraph."""
_NUMBER = re.compile(r"[-+]? {0,3}\.?[0-9]")
_THOUSANDS = re.compile(r"[-+]?0*[1-9][0-9]*,[0-9]{3}(?![0-9])")


def _stated_rate(head: Sequence[str]) -> Preface | None:
    """The sample period that the lines above a table give; None where they give none, or more than one.

    A key that repeats on each line is a value of each row, such as `dt: 12` from a board.
    """
    found: list[tuple[float, str]] = []
    header_row = None
    for number, (before, line, after) in enumerate(
        zip(["", *head], head[:_MAX_LINES], [*head[1:], ""], strict=False)
    ):
        above = before[:_MAX_LENGTH].rstrip()
        start = above if above.endswith(":") else ""  # LabVIEW: `dt:` above its value
        text = f"{start} {line[:_MAX_LENGTH]}".strip(" \t\r\"',;").lower().replace("_", " ")
        if not is_comment(line) and _NUMBER.match(text):
            break
        if '{"' in text or sum(map(text.count, ",;|\t")) < 12:  # more are names, or samples
            below = _below_names(above.lower(), line, after)
            text += below
            if below and not any(map(is_number, split_fields(above, ","))):
                header_row = number
            found += [setting for match in _STATED.finditer(text) if (setting := _period(match))]
            found += [(1 / float(rate), f"at {rate} Hz") for rate in _AT.findall(text) if float(rate)]
    if not 0 < len(found) < 3 or len({period for period, _ in found}) > 1:
        return None
    period, key = found[0]
    said = f'"{key}" above the table gives a sample interval of {duration(period)}'
    return Preface(header_row, period=period, notes=(said,))


def _below_names(above: str, line: str, after: str) -> str:
    """`,increment:1e-05` of `X,CH1,Increment` above `Sequence,Volt,1e-05` of a Rigol, with no such cell below."""
    cells = zip_longest(*(split_fields(text[:_MAX_LENGTH], ",") for text in (above, line, after)), fillvalue="")
    return "".join(f",{name}:{value}" for name, value, more in cells if name and is_number(value) and not more)


def _period(match: re.Match[str]) -> tuple[float, str] | None:
    """The period in s and its key; None where the value is neither a rate nor an interval."""
    units, unit = (_HERTZ if match["rate"] else _SECONDS), match["written"].strip(" .")
    if unit not in units and any(mark in match["mark"] for mark in ",;|\t"):
        unit = ""  # another setting in the next cell
    # `1,000` may be one or a thousand; `12,5` and `0,001` can only be decimals.
    text = "" if _THOUSANDS.match(match["number"]) else match["number"].replace(",", ".", 1)
    value = float(text) * units.get(unit or (match["unit"] or "").strip(), 0.0) if is_number(text) else 0.0
    period = 1 / value if match["rate"] and value > 0 else value
    return (period, match["rate"] or match["step"]) if 1e-13 < period < 1e8 else None
