"""Which columns of a log are its time: all candidates are weighed against each other."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import pairwise, product, takewhile

import numpy as np

from kalscope.common.numbers import Array
from kalscope.errors import BadSetting
from kalscope.recording import Assumption
from kalscope.sources.grammar.cells import SECONDS_PER_UNIT, UNIT_OF_WORD, words
from kalscope.sources.grammar.read_options import DEFAULTS, ReadOptions
from kalscope.sources.grammar.timestamps import (
    CLOCK_PARSERS,
    DAY_US,
    MAX_BACK,
    MIN_EVEN,
    ClockForm,
    PartRole,
    TimeColumn,
    TimeName,
    find_epoch,
    find_stamp_form,
    in_order_is_even,
    judge,
    parse_part,
    row_stamp_parser,
)
from kalscope.sources.reading.columns import Cells, Column

# What the name of a column says about time: whether it is one, and in which unit.


_TIME_WORDS = words(
    """
    time times timestamp timestamps stamp tstamp ts datetime date dates elapsed uptime epoch unixtime clock timer
    tick ticks
    zeit uhrzeit zeitstempel datum tiempo fecha hora heure horodatage tempo yyyymmdd
    tow
    """
)
_DATE_WORDS = words("date dates datetime datum fecha yyyymmdd")
_DECIMAL_WORDS = words("decimal dec fractional")
"""Beside a word of time they mean years such as 1958.2027."""
_DAY_COUNTS = words("jd hjd bjd mjd datenum")
"""Julian dates: of the Earth, the sun and the solar system, modified ones; MATLAB's days since the year 0."""
# Beside these a word of time stays one: "Device Time", "time since start", "Timestamp (Formatted)".
_FILLERS = words(
    """
    in the since from start and utc gmt local host device gps unix system relative rel absolute abs sensor sample
    sampling record recorded recording measurement logger log formatted total boot iso iso8601
    string hh mm ss
    """
)
# Other words for a unit are also quantities or counts: h, d, min, hour.
_LONE_UNITS = {word for word, unit in UNIT_OF_WORD.items() if unit in ("s", "ms", "us", "ns")}
_RISING_UNITS = words("day days year years yr hours minutes mins")
_WORD = re.compile(r"[^\W_]+")
_CAMEL = re.compile(r"(?<=[a-z0-9])(?=[A-Z])")


def time_name(column: Column) -> TimeName:
    """What the name and the unit of a column say: `time_ms`, `t` in us, `micros`, `Time (UTC)`, `Time in seconds`.

    A lone capital is a quantity, T a temperature, unless its unit is one of time.
    """
    unit = UNIT_OF_WORD.get(column.unit.strip().lower(), "")
    name = column.name.strip()[:100]
    if len(name) == 1 and name.isupper() and not unit:
        return TimeName(0)
    said = [word.lower() for word in _WORD.findall(_CAMEL.sub(" ", name))]
    said = said[: said.index("of")] if "of" in said[1:] else said  # second of the day
    # The last word that is a unit; a single letter only at the end.
    units = [word for word in (*(word for word in said[:-1] if len(word) > 1), *said[-1:]) if word in UNIT_OF_WORD]
    written = next((unit for form, unit in (("m:s", "s"), ("h:m", "h")) if form in name.lower()), "")
    unit = unit or written or (UNIT_OF_WORD[units[-1]] if units else "")
    rest = [word for word in said if word not in _FILLERS]
    core = [word for word in rest if word not in UNIT_OF_WORD]
    is_time = any(word in _TIME_WORDS for word in said)
    if is_time and not _DECIMAL_WORDS.isdisjoint(said):
        unit, core = "year", [word for word in core if word not in _DECIMAL_WORDS]
    if not _DAY_COUNTS.isdisjoint(said):
        unit, is_time, core = unit or "day", True, [word for word in core if word not in _DAY_COUNTS] or ["t"]
    is_alone = not core and len(rest) == 1
    strength = 0
    if (core and all(word in _TIME_WORDS or word == "t" for word in core)) or (is_alone and rest[0] in _LONE_UNITS):
        strength = 2
    elif is_time or (is_alone and rest[0] in _RISING_UNITS):
        strength = 1
    return TimeName(strength, unit if strength else "", not _DATE_WORDS.isdisjoint(said))


# A time in several columns: year, month, day, hour, minute, second, or a date and a clock.


_ROLE_OF_NAME: dict[str, PartRole] = {
    **dict.fromkeys(words("year years yr yyyy yy jahr año ano annee année"), "year"),
    **dict.fromkeys(words("month months mon mo monat mes mois"), "month"),
    **dict.fromkeys(words("day days dd dy dom tag dia día jour day_of_month dayofmonth"), "day"),
    **dict.fromkeys(words("doy jday yday jd julian_day julianday day_of_year dayofyear"), "day of year"),
    **dict.fromkeys(words("hour hours hr hrs hh stunde hora heure"), "hour"),
    **dict.fromkeys(words("minute minutes min mins minuten mi mn"), "minute"),
    **dict.fromkeys(words("second seconds sec secs ss s sekunde segundo"), "second"),
    **dict.fromkeys(words("millisecond milliseconds msec ms"), "millisecond"),
    **dict.fromkeys(words("hhmm hhmmss mst lst utc gmt est pst cst hour_minute time clock zeit uhrzeit"), "clock"),
}
_IN_ORDER: tuple[PartRole, ...] = ("year", "month", "day", "hour", "minute", "second", "millisecond")
_PART_ABOVE = {part: above for above, part in pairwise(_IN_ORDER) if part not in ("month", "hour")}
"""No part counts without this one."""


def named_parts(columns: list[Column], rows: list[Cells]) -> TimeColumn | None:
    """The time whose parts are named year, month, day, …; None without a year and a month or day of the year."""
    places: dict[PartRole, int] = {}
    for i, column in enumerate(columns):
        role = _role(column.name, places)
        if role is not None:
            places.setdefault(role, i)
    if "year" not in places or not {"month", "day of year"} & places.keys():
        return None
    clock = None
    if "hour" not in places and "clock" in places:
        clock = clock_form([row[places["clock"]] for row in rows])
    if clock is None:
        places.pop("clock", None)
    kept = tuple(part for part in places.items() if _PART_ABOVE.get(part[0], "year") in places)
    return TimeColumn(places["year"], "calendar", clock=clock or "h:m:s", parts=kept)


def unnamed_parts(rows: list[Cells]) -> TimeColumn | None:
    """Columns beside each other that hold a year, perhaps the day of the year, a month, a day and an hour.

    Four columns of whole numbers, each in its range, with a year in front, whose stamps hardly ever step back, are
    hardly anything else.
    """
    width = min(map(len, rows), default=0) if len(rows) >= _MIN_ROWS else 0
    for first, step in product(range(width - 3), (2, 1)):  # 2: the number of the day comes before the month
        pairs = zip(_IN_ORDER[:6], (first, *range(first + step, width)), strict=False)
        parts = tuple(takewhile(lambda part: _are_parts(rows, *part), pairs))
        time = TimeColumn(first, "calendar", parts=parts)
        if len(parts) < 4 or judge(stamps_of(time, rows, ".")).back > _MAX_BACK_WEAK:
            continue
        if step == 1:
            return time
        number: tuple[PartRole, int] = "day of year", first + 1
        by_month, by_number = (replace(time, parts=each) for each in (parts[:3], (parts[0], number)))
        if np.array_equal(stamps_of(by_month, rows, "."), stamps_of(by_number, rows, ".")):
            return replace(time, parts=(*parts, number))
    return None


def _are_parts(rows: list[Cells], role: PartRole, index: int) -> bool:
    return all(row[index].isdecimal() and parse_part(row[index], role) is not None for row in rows)


def clock_form(cells: list[str]) -> ClockForm | None:
    """How a column beside a date writes the time of day: `18:00`, `1800` or `180000`; None where it does not."""
    for form in ("h:m:s", "hhmm", "hhmmss"):
        if sum(CLOCK_PARSERS[form](cell) is not None for cell in cells) < max(1.0, 0.9 * len(cells)):
            continue
        # `0`, `10`, `20` beside a date count something else.
        return form if any(len(cell) > 2 for cell in cells) else None
    return None


def _role(name: str, places: Iterable[PartRole] = ()) -> PartRole | None:
    """The part that a name means; in `YY MM DD hh mm`, `mm` is first the month, then the minute."""
    base = name.partition("(")[0].strip(" #%").lower().replace(" ", "_").replace("-", "_")
    if base == "mm":
        return "minute" if "hour" in places or "month" in places else "month"
    return _ROLE_OF_NAME.get(base)


# All columns, alone or together, that may be the time, and the points of each.


_MAX_BACK_WEAK = 0.02
"""Share of steps back with which numbers may be a time where there is a mere hint."""
_MIN_ROWS = 8
"""Rows from which a clear name can be wrong, and fewest by which numbers without a name are recognised."""
_DIGITS = re.compile(r"(?:19|20)[0-9]{2}[01][0-9][0-3][0-9] [0-2][0-9](?:[0-5][0-9]){2}")
"""`20240105 120030` of two columns without names."""

Weighed = tuple[float, TimeColumn]
"""Columns that may be the time, with their points."""


def find_candidates(columns: list[Column], rows: list[Cells], decimal: str, options: ReadOptions) -> list[Weighed]:
    """All columns, alone or together, that may be the time, in the order of the file."""
    names = [time_name(column) for column in columns]
    forms: dict[int, TimeColumn] = {}
    if len(columns) > 1 and not columns[0].name and all(_DIGITS.fullmatch(f"{row[0]} {row[1]}") for row in rows):
        names[:2] = TimeName(2, is_date=True), TimeName(2)
    for i, (column, name) in enumerate(zip(columns, names, strict=True)):
        if column.role in ("row name", "row number", "metadata", "empty"):
            continue
        if name.strength or column.role == "text" or options.time_format is not None:
            form = find_stamp_form([row[i] for row in rows], decimal, name, options)
            if form is not None and (name.strength or form.kind != "number"):
                unit = (form.unit or name.unit) if form.kind == "number" else ""
                forms[i] = replace(form, index=i, unit=unit)
                forms[i] = _after_turns(forms[i], rows, decimal) if unit and i else forms[i]
    proposed = [*_joined(forms, columns, names, rows, decimal), *forms.values()]
    parts = named_parts(columns, rows) or (None if any(c.name for c in columns) else unnamed_parts(rows))
    weighed = [_weighed(column, names, rows, decimal) for column in (*proposed, *([parts] if parts else []))]
    return [one for one in weighed if one is not None]


def _after_turns(form: TimeColumn, rows: list[Cells], decimal: str) -> TimeColumn:
    """Numbers that begin again at each full second, day or week, with the column before that counts those."""
    stamps = stamps_of(form, rows, decimal)
    if np.all(np.diff(stamps) >= 0) or not np.all(stamps >= 0):
        return form
    for seconds in (1.0, 86_400.0, 604_800.0):
        turn = seconds / SECONDS_PER_UNIT[form.unit]
        whole = replace(form, parts=(("turns", form.index - 1), ("rest", form.index)), turn=turn)
        if np.all(stamps < turn) and np.all(np.diff(stamps_of(whole, rows, decimal)) >= 0):
            return whole
    return form


def _joined(
    forms: dict[int, TimeColumn], columns: list[Column], names: list[TimeName], rows: list[Cells], decimal: str
) -> list[TimeColumn]:
    """Each date with the clock of the same row, in the column beside it or in one that is named as a time.

    Digits are a clock (`1800`) only where their name gives no unit: `time_ms` counts milliseconds.
    """
    read = {i: stamps_of(form, rows, decimal) for i, form in forms.items() if form.kind == "calendar"}
    days = {i: known for i, stamps in read.items() if _are_days(known := stamps[np.isfinite(stamps)])}
    clocks: dict[int, ClockForm] = {}
    for i, column in enumerate(columns if days else ()):
        form = forms.get(i)
        named = _role(column.name) in ("clock", "hour") or names[i].strength == 2
        may_be_digits = named if form is None else form.kind == "number" and not form.unit
        if form is not None and form.kind == "clock" and not form.odd:
            clocks[i] = form.clock
        elif may_be_digits and (digits := clock_form([row[i] for row in rows])):
            clocks[i] = digits
    joined: list[TimeColumn] = []
    places = {_role(column.name): j for j, column in enumerate(columns)}
    numbered: list[tuple[PartRole, int]] = [(role, places[role]) for role in ("hour", "minute") if role in places]
    for i, stamps in days.items():
        beside = [j for j in (i + 1, i - 1) if j in clocks] + [j for j in clocks if names[j].strength == 2]
        dated = replace(forms[i], parts=(("date", i), *numbered), day=float(stamps[0]))
        if beside:
            joined.append(replace(dated, clock=clocks[beside[0]], parts=(("date", i), ("clock", beside[0]))))
        elif "hour" in places:
            joined.append(dated)
    return joined


def _are_days(stamps: Array) -> bool:
    return bool(stamps.size) and not (stamps % DAY_US).any()


def _weighed(column: TimeColumn, names: list[TimeName], rows: list[Cells], decimal: str) -> Weighed | None:
    """The points of name, form and evidence; None for stamps that never change, are mostly missing or go back.

    A date with a clock says most, a bare number least.
    """
    stamps = stamps_of(column, rows, decimal)
    evidence = judge(stamps, column)
    stamps = stamps[np.isfinite(stamps)]
    clear = names[column.index].strength == 2
    if evidence.fill < 0.5 or (len(rows) > 1 and not evidence.distinct):
        return None
    if column.kind != "number":
        form = 1.5 if column.kind == "calendar" and not _are_days(stamps) else 0.75
    else:
        if not (clear and len(rows) < _MIN_ROWS) and evidence.back > (MAX_BACK if clear else _MAX_BACK_WEAK):
            return None
        form = 0.75 if column.unit or find_epoch(stamps[:1]) else 0.0
        form = -0.5 if column.unit in ("day", "year") else form
    strength = max(names[i].strength for i in column.indices)
    return evidence.weight + strength + form, column


def stamps_of(column: TimeColumn, rows: Sequence[Cells], decimal: str) -> Array:
    """The stamps of rows, shape (n,), NaN where unreadable."""
    parse = row_stamp_parser(column, decimal)
    return np.array([np.nan if (stamp := parse(row)) is None else stamp for row in rows])


# Numbers that are the time although no name says it.


def unnamed_time(columns: list[Column], rows: list[Cells], decimal: str, *, named: bool) -> TimeColumn | None:
    """Numbers with no name of a time: dates in digits, a first column without a name that rises, or since 1970."""
    if len(columns) < 2 or len(rows) < _MIN_ROWS:
        return None
    others = columns[1:] if columns[0].name.lower() == "x" else []
    channels = [i for i, column in enumerate(columns) if column.role == "channel"]
    read: dict[int, tuple[TimeColumn, Array]] = {}
    for i in {0, *channels}:
        form = find_stamp_form([row[i] for row in rows], decimal)
        if form is not None:
            said = [
                columns[i].unit.strip(),
                *([] if i else _WORD.findall(columns[i].name)),
            ]  # `Min` in front, of HPLC
            units = [unit for text in said if (unit := UNIT_OF_WORD.get(text.lower()))]
            form = replace(form, index=i, unit=next(iter(units), ""))
            stamps = stamps_of(form, rows, decimal)
            read[i] = form, stamps[np.isfinite(stamps)]
    may_lead = not named or (0 in read and read[0][0].unit)
    may_lead = may_lead or any(column.unit or column.name.lower().startswith("ch") for column in others)
    all_rise = all(i in read and bool(np.all(np.diff(read[i][1]) > 0)) for i in channels)
    found: list[Weighed] = []
    for i, (form, stamps) in read.items():
        if stamps.size < _MIN_ROWS:
            continue
        is_channel, is_ramp, steps = i in channels, _is_ramp(stamps), np.diff(stamps)
        rises, is_whole = bool(np.all(steps >= 0)), stamps.size >= MIN_EVEN * len(rows)
        in_order = np.count_nonzero(steps) >= 3 and (rises or in_order_is_even(stamps))
        rules = (
            (4, is_channel and form.kind == "calendar" and rises),
            (3, i == 0 and may_lead and is_ramp),
            (2, is_channel and is_whole and not (named or all_rise) and is_ramp and judge(stamps).even >= MIN_EVEN),
            # A burst may share one stamp.
            (1, is_channel and stamps.size == len(rows) and in_order and find_epoch(stamps)),
        )
        found += [(points, form) for points, holds in rules if holds]
    points, best = max(found, key=lambda one: one[0], default=(0, None))
    if best is None or best.unit or points not in (2, 3):
        return best
    note = f"column {best.index + 1} is the time, because it rises evenly; if not: --time-column none"
    return replace(best, notes=(*best.notes, Assumption(note)))


def _is_ramp(stamps: Array) -> bool:
    """True for stamps that rise, and seldom begin again with the first; a counter 0, 1, 2, … is not one."""
    steps = np.diff(stamps)
    # Between rows of the head, the middle and the end the steps are longer, also those of a counter.
    few_long = np.count_nonzero(steps > 50 * np.median(steps)) <= max(2, 0.01 * steps.size)
    is_counter = np.count_nonzero(steps != 1) <= min(2, 0.02 * steps.size)
    back = stamps[1:][steps <= 0]
    rises = np.all(back == stamps[0]) and back.size <= 0.02 * steps.size
    return bool(rises and few_long and not is_counter)


# Which columns of a log are its time: all candidates are weighed against each other.
#
# A name is a hint. How many rows have a stamp, whether the stamps rise, and how fine they are decide.


_MAX_ROWS = 600
"""Rows that are weighed: the first, and some of the middle and the end."""


def find_time(
    columns: list[Column],
    rows: list[Cells],
    decimal: str,
    *,
    named: bool,
    choice: str | int | None = None,
    labels: Cells = (),
    options: ReadOptions = DEFAULTS,
) -> TimeColumn | None:
    """The time column that the user chose, else the candidate with the most points; None where there is none.

    Args:
        columns: Names and roles.
        rows: Cells of rows from the head of the file and, if available, from its middle and end.
        decimal: Decimal mark.
        named: True where the names are those of the source.
        choice: A name, an index from 0, or "none"; None: the points decide.
        labels: The names as the file writes them, `time [ms]`.
        options: Format of the stamps, order of day and month.

    Raises:
        BadSetting: no column fits the format of the stamps, or the choice; that column holds no numbers or stamps.
    """
    names = [column.name for column in columns]
    if choice == "none" and "none" not in names:
        return None
    rows = _sampled(rows)
    found = sorted(find_candidates(columns, rows, decimal, options), key=lambda one: -one[0])
    if choice is not None:
        index = _index_of(choice, names, labels)
        joined = (one for _, one in found if one.parts and index in one.indices)
        return next(joined, None) or _chosen(index, columns[index], [row[index] for row in rows], decimal, options)
    if options.time_format is not None and not found:
        raise BadSetting(f"time_format must fit a column of stamps (got {options.time_format!r}, which fits none)")
    if not found:
        return unnamed_time(columns, rows, decimal, named=named)
    points, best = found[0]
    rival = next((one for one in found if not {*one[1].indices} & {*best.indices}), None)
    if rival is not None and rival[0] >= points - 1 and (name := names[rival[1].index]):
        note = Assumption(f'the time could also be "{name}": --time-column "{name}"')
        best = replace(best, notes=(*best.notes, note))
    return best


def _index_of(choice: str | int, names: list[str], labels: Cells) -> int:
    """Index of the column that the user chose, by its name in the file or in the report, or by its index."""
    index = choice
    if isinstance(index, str):
        alike = [i for known in (names, list(labels)) for i, name in enumerate(known) if name == index.strip()]
        index = alike[0] if alike else -1
    if not 0 <= index < len(names):
        shown = ", ".join(name or f"column {i}" for i, name in enumerate(names, 1))
        raise BadSetting(f'the time column must be one of {shown}, or "none" (got {choice!r})')
    return index


def _chosen(index: int, column: Column, cells: list[str], decimal: str, options: ReadOptions) -> TimeColumn:
    name = time_name(column)
    form = find_stamp_form(cells, decimal, replace(name, strength=2), options)
    if form is None:
        example, form = next(filter(None, cells), "")[:40], options.time_format
        got = f"{example!r}" if form is None else f"{form!r} for {example!r}"
        must = "the time column must hold numbers or stamps" if form is None else "time_format must fit the stamps"
        raise BadSetting(f"{must} (got {got})")
    return replace(form, index=index, unit=name.unit if form.kind == "number" else "")


def _sampled(rows: list[Cells]) -> list[Cells]:
    """The first rows, some from the middle and the last ones, none of them twice."""
    third, middle = _MAX_ROWS // 3, (len(rows) - _MAX_ROWS // 3) // 2
    return rows if len(rows) <= _MAX_ROWS else rows[:third] + rows[middle : middle + third] + rows[-third:]
