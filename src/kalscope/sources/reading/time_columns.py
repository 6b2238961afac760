"""Which columns of a log are its time: all candidates are weighed against each other."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from datetime import datetime, timedelta

import numpy as np

from kalscope.common.numbers import Array
from kalscope.errors import BadSetting
from kalscope.recording import Assumption
from kalscope.sources.grammar.cells import UNIT_OF_WORD, words
from kalscope.sources.grammar.read_options import DEFAULTS, ReadOptions
from kalscope.sources.grammar.stamps import CLOCK_PARSERS, ClockForm
from kalscope.sources.grammar.timestamps import (
    MAX_YEAR,
    MIN_YEAR,
    PartRole,
    TimeColumn,
    TimeName,
    find_stamp_form,
    row_stamp_parser,
    stamp_parser,
    whole,
)
from kalscope.sources.reading.columns import Cells, Column

# What the name of a column says about time: whether it is one, and in which unit.


_TIME_WORDS = words(
    """
    time times timestamp timestamps stamp tstamp ts datetime date dates elapsed uptime epoch unixtime clock timer
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
    in of the since from start and utc gmt local host device gps unix system relative rel absolute abs sensor sample
    sampling record recorded recording measurement logger log formatted total boot iso iso8601 string
    """
)
# Other words for a unit are also quantities or counts: h, d, min, hour.
_LONE_UNITS = words(
    """
    s sec secs second seconds ms msec millis millisecond milliseconds us µs μs usec micros microsecond microseconds
    ns nsec nanos nanosecond nanoseconds
    """
)
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
    unit = unit or _unit_of(said)
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


def _unit_of(said: list[str]) -> str:
    """The unit among the words of a name: the last of them that is one; single letters only at the end."""
    for i in range(len(said) - 1, -1, -1):
        word = said[i]
        if word in UNIT_OF_WORD and (len(word) > 1 or i == len(said) - 1):
            return UNIT_OF_WORD[word]
    return ""


# How well the stamps of a candidate show that they are the time: fill, order, resolution, evenness.


_WEIGHT_FILL, _WEIGHT_BACK = 10.0, 20.0
_WEIGHT_DISTINCT, _WEIGHT_EVEN = 3.0, 1.0
_EVEN_WITHIN = 0.2
_COUNTERS = (2.0**16, 2.0**32)


@dataclass(frozen=True)
class Evidence:
    """What the stamps of the sampled rows show, each as a share of 1."""

    fill: float
    """Rows whose stamp can be read."""
    back: float
    """Of the steps that move, those against the direction of most; a clock that passes midnight moves forward."""
    distinct: float
    """Stamps that do not repeat the one before: below 1 the clock is coarser than the sampling."""
    even: float
    """Steps within a fifth of the median step."""
    moves: bool
    """True where any two stamps differ."""

    @property
    def weight(self) -> float:
        """Points of a candidate; those for its name and form are added."""
        lost = _WEIGHT_FILL * (1.0 - self.fill) + _WEIGHT_BACK * self.back
        return _WEIGHT_DISTINCT * self.distinct + _WEIGHT_EVEN * self.even - lost


def judge(stamps: Array, turn: float = 0.0) -> Evidence:
    """What stamps show.

    Args:
        stamps: Of the sampled rows, shape (n,), NaN where unreadable.
        turn: Where a clock wraps to 0, in the unit of the stamps; 0 where it never does.
    """
    read = stamps[np.isfinite(stamps)]
    if not read.size:
        return Evidence(0.0, 0.0, 0.0, 0.0, moves=False)
    steps = np.diff(read)
    for size in (turn,) if turn else _COUNTERS:
        if float(read.max()) < size:
            steps = np.where(steps < -size / 2, steps + size, steps)
    ahead, back = int(np.count_nonzero(steps > 0)), int(np.count_nonzero(steps < 0))
    sizes = np.abs(steps[steps != 0])
    usual = float(np.median(sizes)) if sizes.size else 0.0
    even = float(np.mean(np.abs(steps - usual) <= _EVEN_WITHIN * usual)) if sizes.size else 0.0
    share = min(ahead, back) / max(ahead + back, 1)
    if share > _MAX_BACK and _in_order_is_even(read):
        share = _MAX_BACK
    return Evidence(
        fill=read.size / stamps.size,
        back=share,
        distinct=np.count_nonzero(steps) / max(steps.size, 1) if steps.size else 1.0,
        even=even,
        moves=bool(sizes.size),
    )


def _in_order_is_even(stamps: Array) -> bool:
    """True for even stamps whose rows are out of order."""
    steps = np.diff(np.sort(stamps))
    return bool(np.mean(np.abs(steps - np.median(steps)) < _EVEN_WITHIN * np.median(steps)) > _MIN_EVEN)


def is_since_1970(stamps: Array) -> bool:
    """True where the first stamp is one of 2001 to 2100, counted from 1970 in s, ms, µs or ns."""
    return bool(stamps.size) and any(size <= float(stamps[0]) < 4.2 * size for size in (1e9, 1e12, 1e15, 1e18))


# A time in several columns: year, month, day, hour, minute, second, or a date and a clock.


_ROLE_OF_NAME: dict[str, PartRole] = {
    **dict.fromkeys(words("year years yr yyyy yy jahr año ano annee année"), "year"),
    **dict.fromkeys(words("month months mon mo monat mes mois"), "month"),
    **dict.fromkeys(words("day days dd dy dom tag dia día jour day_of_month dayofmonth"), "day"),
    **dict.fromkeys(words("doy jday yday jd julian_day julianday day_of_year dayofyear"), "day of year"),
    **dict.fromkeys(words("hour hours hr hrs hh stunde hora heure"), "hour"),
    **dict.fromkeys(words("minute minutes min mins minuten mi mn"), "minute"),
    **dict.fromkeys(words("second seconds sec secs ss s sekunde segundo"), "second"),
    **dict.fromkeys(words("hhmm hhmmss mst lst utc gmt est pst cst hour_minute time clock zeit uhrzeit"), "clock"),
}
_EPOCH, _MAX_US = datetime(1970, 1, 1), 6e16  # 1 to 3871: within the calendar of datetime
_IN_ORDER: tuple[PartRole, ...] = ("year", "month", "day", "hour", "minute", "second")
_RANGES: tuple[tuple[int, int], ...] = (
    (MIN_YEAR + 100, MAX_YEAR - 100),
    (1, 12),
    (1, 31),
    (0, 23),
    (0, 59),
    (0, 60),
)


def named_parts(columns: list[Column], rows: list[Cells]) -> TimeColumn | None:
    """The time whose parts are named year, month, day, …; None without a year and a month or day of the year."""
    places: dict[PartRole, int] = {}
    for i, column in enumerate(columns):
        role = _role(column.name, places)
        if role is not None and role not in places:
            places[role] = i
    if "year" not in places or not {"month", "day of year"} & places.keys():
        return None
    clock = None
    if "hour" not in places and "clock" in places:
        clock = clock_form([row[places["clock"]] for row in rows])
    if clock is None:
        places.pop("clock", None)
    kept: tuple[tuple[PartRole, int], ...] = tuple(
        (role, i) for role, i in places.items() if _belongs(role, places)
    )
    return TimeColumn(places["year"], "calendar", clock=clock or "h:m:s", parts=kept)


def unnamed_parts(rows: list[Cells]) -> TimeColumn | None:
    """Columns beside each other that hold a year, perhaps the day of the year, month, day, hour and minute.

    Five columns of whole numbers, each in its range, with a year in front, are hardly anything else; nor are four
    whose stamps never step back.
    """
    width = min(map(len, rows), default=0)
    for first in range(width - 3):
        for is_numbered in (True, False):
            places = range(first + is_numbered, first + is_numbered + len(_IN_ORDER))
            parts: list[tuple[PartRole, int]] = [
                (role, first if role == "year" else i)
                for role, i, ends in zip(_IN_ORDER, places, _RANGES, strict=True)
                if i < width and _in_range(rows, first if role == "year" else i, *ends)
            ]
            if tuple(role for role, _ in parts[:4]) != _IN_ORDER[:4]:
                continue
            if (
                len(parts) == 4
                and judge(stamps_of(TimeColumn(first, "calendar", parts=tuple(parts)), rows, ".")).back
            ):
                continue
            if not is_numbered:
                return TimeColumn(first, "calendar", parts=tuple(parts))
            numbered = TimeColumn(first, "calendar", parts=(("year", first), ("day of year", first + 1)))
            days = row_stamp_parser(numbered, "."), row_stamp_parser(replace(numbered, parts=tuple(parts[:3])), ".")
            if all(days[0](row) == days[1](row) for row in rows):
                return replace(numbered, parts=(*numbered.parts, *parts[1:]))
    return None


def repeated_parts(columns: list[Column], rows: list[Cells], stamps: Array) -> tuple[int, ...]:
    """Columns that only repeat a part of the time: a year, a month, an hour beside a whole stamp.

    Args:
        columns: Names and roles.
        rows: Their cells.
        stamps: Microseconds since 1970 of the rows, NaN where unreadable, shape (n,).
    """
    known = np.flatnonzero(np.abs(stamps) < _MAX_US).tolist()
    read = [(_EPOCH + timedelta(microseconds=float(stamps[i])), rows[i]) for i in known]
    found: list[int] = []
    for i, column in enumerate(columns):
        part = _PARTS.get(_role(column.name, {}) or "clock")
        if part is None or column.role != "channel" or not read:
            continue
        if all(part(at) == whole(row[i]) for at, row in read):
            found.append(i)
    return tuple(found)


_PARTS: dict[PartRole, Callable[[datetime], int]] = {
    "year": lambda at: at.year,
    "month": lambda at: at.month,
    "day": lambda at: at.day,
    "day of year": lambda at: at.timetuple().tm_yday,
    "hour": lambda at: at.hour,
    "minute": lambda at: at.minute,
    "second": lambda at: at.second,
}


def clock_form(cells: list[str]) -> ClockForm | None:
    """How a column beside a date writes the time of day: `18:00`, `1800` or `180000`; None where it does not."""
    for form in ("h:m:s", "hhmm", "hhmmss"):
        if sum(CLOCK_PARSERS[form](cell) is not None for cell in cells) < max(1.0, 0.9 * len(cells)):
            continue
        # `0`, `10`, `20` beside a date count something else.
        return form if any(len(cell) > 2 for cell in cells) else None
    return None


def _role(name: str, places: dict[PartRole, int]) -> PartRole | None:
    """The part that a name means; in `YY MM DD hh mm`, `mm` is first the month, then the minute."""
    base = name.partition("(")[0].strip(" #%").lower().replace(" ", "_").replace("-", "_")
    if base == "mm":
        return "minute" if "hour" in places or "month" in places else "month"
    return _ROLE_OF_NAME.get(base)


def _belongs(role: PartRole, places: dict[PartRole, int]) -> bool:
    """False for a part without the one above it."""
    above = {"minute": "hour", "second": "minute", "day": "month"}.get(role)
    return above is None or above in places


def _in_range(rows: list[Cells], index: int, low: int, high: int) -> bool:
    if len(rows) < 8:
        return False
    values = [whole(row[index]) for row in rows]
    return all(value is not None and low <= value <= high for value in values)


# All columns, alone or together, that may be the time, and the points of each.


_MAX_BACK, _MAX_BACK_WEAK = 0.25, 0.02
"""Share of steps back with which numbers may be a time, with a clear name and with a mere hint."""
_MIN_JUDGED = 8
"""Rows from which a clear name can be wrong."""
_MIN_FILL = 0.5
_DAY_US = 86400e6
_NEVER = ("row name", "row number", "metadata", "empty")


@dataclass(frozen=True)
class Candidate:
    """Columns that may be the time."""

    column: TimeColumn
    """How they are read."""
    evidence: Evidence
    """What their stamps show."""
    points: float
    """Weight of name, form and evidence."""


def find_candidates(
    columns: list[Column], rows: list[Cells], decimal: str, options: ReadOptions
) -> list[Candidate]:
    """All columns, alone or together, that may be the time, in the order of the file."""
    names = [time_name(column) for column in columns]
    forms: dict[int, TimeColumn] = {}
    for i, (column, name) in enumerate(zip(columns, names, strict=True)):
        if column.role in _NEVER:
            continue
        if name.strength or column.role == "text" or options.time_format is not None:
            form = find_stamp_form([row[i] for row in rows], decimal, name, options)
            if form is not None and (name.strength or form.kind != "number"):
                unit = name.unit if form.kind == "number" else ""
                forms[i] = replace(form, index=i, unit=unit)
    proposed = [*_joined(forms, columns, names, rows, decimal), *forms.values()]
    parts = named_parts(columns, rows) or (None if any(c.name for c in columns) else unnamed_parts(rows))
    weighed = [_weighed(column, names, rows, decimal) for column in (*proposed, *([parts] if parts else []))]
    return [candidate for candidate in weighed if _is_plausible(candidate, names, len(rows))]


def _joined(
    forms: dict[int, TimeColumn], columns: list[Column], names: list[TimeName], rows: list[Cells], decimal: str
) -> list[TimeColumn]:
    """Each date with the clock of the same row, in the column beside it or in one that is named as a time.

    Digits are a clock (`1800`) only where their name gives no unit: `time_ms` counts milliseconds.
    """
    dates = [i for i, form in forms.items() if form.kind == "calendar" and _has_days_only(form, rows, decimal)]
    if not dates:
        return []
    clocks: dict[int, ClockForm] = {}
    for i, column in enumerate(columns):
        form = forms.get(i)
        may_be_digits = (
            _role(column.name, {}) == "clock" if form is None else form.kind == "number" and not form.unit
        )
        if form is not None and form.kind == "clock" and not form.odd:
            clocks[i] = form.clock
        elif may_be_digits and (digits := clock_form([row[i] for row in rows])):
            clocks[i] = digits
    joined: list[TimeColumn] = []
    units = {role: j for j, column in enumerate(columns) if (role := _role(column.name, {})) in ("hour", "minute")}
    for i in dates:
        beside = [j for j in (i + 1, i - 1) if j in clocks] + [j for j in clocks if names[j].strength == 2]
        days = stamps_of(forms[i], rows, decimal)
        dated = replace(forms[i], day=float(days[np.isfinite(days)][0]), parts=(("date", i), *units.items()))
        if beside:
            dated = replace(dated, clock=clocks[beside[0]], parts=(("date", i), ("clock", beside[0])))
        if beside or "hour" in units:
            joined.append(dated)
    return joined


def _has_days_only(form: TimeColumn, rows: list[Cells], decimal: str) -> bool:
    stamps = stamps_of(form, rows[:50], decimal)
    read = stamps[np.isfinite(stamps)]
    return bool(read.size) and bool(np.all(read % _DAY_US == 0))


def _weighed(column: TimeColumn, names: list[TimeName], rows: list[Cells], decimal: str) -> Candidate:
    evidence = judge(stamps_of(column, rows, decimal), column.turn_s * 1e6)
    strength = max(names[i].strength for i in column.indices)
    return Candidate(column, evidence, evidence.weight + strength + _points_of_form(column, rows, decimal))


def _points_of_form(column: TimeColumn, rows: list[Cells], decimal: str) -> float:
    """A date with a clock says most, a bare number least."""
    if column.kind == "calendar":
        return 0.75 if _has_days_only(column, rows, decimal) else 1.5
    if column.kind == "clock":
        return 0.75
    if column.unit in ("day", "year"):
        return -0.5
    stamps = stamps_of(column, rows[:50], decimal)
    return 0.75 if column.unit or is_since_1970(stamps[np.isfinite(stamps)]) else 0.0


def _is_plausible(candidate: Candidate, names: list[TimeName], count: int) -> bool:
    """False for a stamp that never changes, is mostly missing, or goes back and forth."""
    evidence, column = candidate.evidence, candidate.column
    clear = names[column.index].strength == 2
    if evidence.fill < _MIN_FILL or (count > 1 and not evidence.moves):
        return False
    if column.kind != "number" or (clear and count < _MIN_JUDGED):
        return True
    return evidence.back <= (_MAX_BACK if clear else _MAX_BACK_WEAK)


def stamps_of(column: TimeColumn, rows: Sequence[Cells], decimal: str) -> Array:
    """The stamps of rows, shape (n,), NaN where unreadable."""
    parse = row_stamp_parser(column, decimal)
    return np.array([np.nan if (stamp := parse(row)) is None else stamp for row in rows])


# Numbers that are the time although no name says it.


_MIN_DATES = 8
"""Fewest rows to recognise dates in digits without a name."""
_MIN_EVEN = 0.9
"""Share of alike steps of a ramp that is a time although it is not the first column."""
_MIN_STEPS_FROM_1970 = 3
"""Steps forward that stamps since 1970 without a name must show; between them they may repeat."""


def unnamed_time(columns: list[Column], rows: list[Cells], decimal: str, *, named: bool) -> TimeColumn | None:
    """Numbers with no name of a time: dates in digits, a first column without a name that rises, or since 1970."""
    if len(columns) < 2:
        return None
    unit = UNIT_OF_WORD.get(columns[0].unit.strip().lower(), "")
    others = columns[1:] if columns[0].name.lower() == "x" else []
    may_lead = not named or unit or any(column.unit or column.name.lower().startswith("ch") for column in others)
    table = [[row[i] for row in rows] for i in range(len(columns))]
    channels = [i for i, column in enumerate(columns) if column.role == "channel"]
    steps = (np.diff(_numbers(table[i], decimal)) for i in channels)
    all_rise = all(size.size > 0 and bool(np.all(size > 0)) for size in steps)
    found: list[tuple[int, TimeColumn]] = []
    for i, cells in enumerate(table):
        if i in channels and (dated := _dates_in_digits(cells, decimal)):
            found.append((4, replace(dated, index=i)))
        elif i == 0 and may_lead and _rises_steadily(cells, decimal):
            found.append((3, TimeColumn(0, "number", unit)))
        elif i not in channels:
            continue
        elif not (named or all_rise) and _rises_steadily(cells, decimal, even=_MIN_EVEN):
            found.append((2, TimeColumn(i, "number", UNIT_OF_WORD.get(columns[i].unit.lower(), ""))))
        elif _counts_from_1970(cells, decimal):
            found.append((1, TimeColumn(i, "number")))
    return max(found, key=lambda one: one[0], default=(0, None))[1]


def _dates_in_digits(cells: list[str], decimal: str) -> TimeColumn | None:
    """2024022923, 2024030100: numbers whose steps are even only as dates, and that never step back."""
    form = find_stamp_form(cells, decimal)
    if form is None or form.kind != "calendar" or len(cells) < _MIN_DATES:
        return None
    parse = stamp_parser(form, decimal)
    stamps = np.array([stamp for cell in cells if (stamp := parse(cell)) is not None])
    return form if bool(np.all(np.diff(stamps) >= 0)) else None


def _numbers(cells: list[str], decimal: str) -> Array:
    stamps = stamps_of(TimeColumn(0, "number"), [(cell,) for cell in cells], decimal)
    return stamps[np.isfinite(stamps) & (np.abs(stamps) < 1e20)]


def _rises_steadily(cells: list[str], decimal: str, even: float = 0.0) -> bool:
    """True for eight or more rising stamps, a share of them `even`; a counter 0, 1, 2, … is not one."""
    stamps = _numbers(cells, decimal)
    if stamps.size < 8 or stamps.size < 0.9 * len(cells):
        return False
    steps = np.diff(stamps)
    # Between rows of the head, the middle and the end the steps are longer, also those of a counter.
    few_long = np.count_nonzero(steps > 50 * np.median(steps)) <= max(2, 0.01 * steps.size)
    is_counter = np.count_nonzero(steps != 1) <= min(2, 0.02 * steps.size)
    return bool(np.all(steps > 0) and few_long and not is_counter) and judge(stamps).even >= even


def _counts_from_1970(cells: list[str], decimal: str) -> bool:
    """True for eight or more rising numbers that are stamps of 2001 to 2100 in s, ms, µs or ns.

    A burst of samples may share its stamp.
    """
    if not is_since_1970(_numbers(cells[:8], decimal)):
        return False
    stamps = _numbers(cells, decimal)
    steps = np.diff(stamps)
    rising = bool(np.all(steps >= 0)) and int(np.count_nonzero(steps)) >= _MIN_STEPS_FROM_1970
    return rising and stamps.size >= 8 and stamps.size == len(cells)


# Which columns of a log are its time: all candidates are weighed against each other.
#
# A name is a hint. How many rows have a stamp, whether the stamps rise, and how fine they are decide.


_MAX_ROWS = 600
"""Rows that are weighed: the first, and some of the middle and the end."""
_CLOSE = 1.0
"""A candidate at most this many points below the best is named."""


def find_time(
    columns: list[Column], rows: list[Cells], decimal: str, *, named: bool, options: ReadOptions = DEFAULTS
) -> TimeColumn | None:
    """The candidate with the most points; None where there is none.

    Args:
        columns: Names and roles.
        rows: Cells of rows from the head of the file and, if available, from its middle and end.
        decimal: Decimal mark.
        named: True where the names are those of the source.
        options: Format of the stamps, order of day and month.

    Raises:
        BadSetting: the format of the stamps fits no column.
    """
    rows = _sampled(rows)
    found = find_candidates(columns, rows, decimal, options)
    if options.time_format is not None and not found:
        raise BadSetting(f"time_format must fit a column of stamps (got {options.time_format!r}, which fits none)")
    if not found:
        return unnamed_time(columns, rows, decimal, named=named)
    best = max(found, key=lambda candidate: candidate.points)
    column = replace(best.column, notes=(*best.column.notes, *_about_rival(best, found, columns)))
    return _with_repeated(column, columns, rows, decimal)


def chosen_time(
    columns: list[Column],
    rows: list[Cells],
    decimal: str,
    choice: str | int,
    labels: Cells = (),
    options: ReadOptions = DEFAULTS,
) -> TimeColumn | None:
    """The time column that the user chose, by name or by index from 0; None for "none".

    Raises:
        BadSetting: there is no such column, or it holds neither numbers nor stamps.
    """
    names = [column.name for column in columns]
    if choice == "none" and "none" not in names:
        return None
    if isinstance(choice, str):
        # As the file writes it, `time [ms]`, or as the report shows it, `time`.
        alike = [i for known in (names, list(labels)) for i, name in enumerate(known) if name == choice.strip()]
        index = alike[0] if alike else -1
    else:
        index = choice
    if not 0 <= index < len(columns):
        shown = ", ".join(name or f"column {i}" for i, name in enumerate(names, 1))
        raise BadSetting(f'the time column must be one of {shown}, or "none" (got {choice!r})')
    rows = _sampled(rows)
    joined = [
        one
        for one in find_candidates(columns, rows, decimal, options)
        if one.column.parts and index in one.column.indices
    ]
    if joined:
        return _with_repeated(max(joined, key=lambda one: one.points).column, columns, rows, decimal)
    said = time_name(columns[index])
    cells = [row[index] for row in rows]
    form = find_stamp_form(cells, decimal, replace(said, strength=2), options)
    if form is None:
        example = next(filter(None, cells), "")[:40]
        if options.time_format is not None:
            raise BadSetting(f"time_format must fit the stamps (got {options.time_format!r} for {example!r})")
        raise BadSetting(f"the time column must hold numbers or stamps (got {example!r})")
    column = replace(form, index=index, unit=said.unit if form.kind == "number" else "")
    return _with_repeated(column, columns, rows, decimal)


def _with_repeated(column: TimeColumn, columns: list[Column], rows: list[Cells], decimal: str) -> TimeColumn:
    """The time with the columns that only repeat a part of it, which are not channels either."""
    if column.kind != "calendar":
        return column
    others = repeated_parts(columns, rows, stamps_of(column, rows, decimal))
    return replace(column, also=tuple(i for i in others if i not in column.indices))


def _about_rival(best: Candidate, found: list[Candidate], columns: list[Column]) -> list[str]:
    """A sentence about the next best, where it is close and its column has a name."""
    others = [c for c in found if not {*c.column.indices} & {*best.column.indices}]
    rival = max(others, key=lambda candidate: candidate.points, default=None)
    if rival is None or rival.points < best.points - _CLOSE or not columns[rival.column.index].name:
        return []
    name = columns[rival.column.index].name
    return [Assumption(f'the time could also be "{name}": --time-column "{name}"')]


def _sampled(rows: list[Cells]) -> list[Cells]:
    """The first rows, some from the middle and the last ones, none of them twice."""
    if len(rows) <= _MAX_ROWS:
        return rows
    third = _MAX_ROWS // 3
    middle = (len(rows) - third) // 2
    return rows[:third] + rows[middle : middle + third] + rows[-third:]
