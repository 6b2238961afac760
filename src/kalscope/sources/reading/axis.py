"""From stamps to the time of the samples: seconds, wraps, bursts, coarse clocks, gaps."""

from __future__ import annotations

from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta

import numpy as np

from kalscope.common.numbers import PERIODS, Array, Indices
from kalscope.common.text import count, duration, percent, sample_rate
from kalscope.errors import BadSetting
from kalscope.recording import Assumption, Gaps, RateSource, Timing
from kalscope.sources.grammar.cells import SECONDS_PER_UNIT
from kalscope.sources.grammar.timestamps import TimeColumn
from kalscope.sources.reading.period import GAP_PERIODS, SampleRate, find_rate, level

# Seconds from the stamps of a column, their unit by magnitude, and the nominal period.


_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_DAY_NUMBERS = (
    (20_000.0, 80_000.0, 25_569.0),  # spreadsheets: 1954 to 2119
    (725_000.0, 770_000.0, 719_529.0),  # MATLAB's datenum: 1984 to 2108
    (2_440_000.0, 2_490_000.0, 2_440_587.5),  # Julian dates: 1968 to 2105
)
"""Lowest and highest number of a day that is counted from a date long ago, and the number of 1970-01-01."""
_SHEETS_FROM = 40_000.0
"""2009: smaller numbers without a name are no days."""
_MINUTE_JITTER, _LONG_STEP_MS, _WEEK_MS = 100, 100_000, 5e8
"""Milliseconds: by how much a step of minutes may miss them, the longest step, and the latest stamp, of 6 days."""
_EXACT = 0.95
"""Share of equal steps of a count of seconds."""
_WHOLE_SECOND = 0.02
"""Days with seven or more decimals are this close, in s, to the whole seconds they mean."""


def unit_by_magnitude(stamps: Array) -> str:  # noqa: PLR0911 (one for each rule)
    """Unit of numeric stamps that name none: epoch stamps by their size, others by their step.

    Whole numbers are milliseconds, as of `millis()`: their steps vary, repeat, or do not start at 0. They are
    seconds where they count from 0 in equal steps of up to a minute, and where their steps are whole minutes that
    divide an hour, or hours; microseconds where milliseconds would mean weeks, or minutes between two samples.
    Fractions are seconds, or days where they are numbers of days that lie whole seconds apart (45123.506944444).
    """
    low, high = float(stamps.min()), float(stamps.max())
    step = _median_step(stamps[:100_000])
    # The head is checked first: most stamps with fractions show them there.
    whole = all(bool(np.all(part == np.floor(part))) for part in (stamps[:1000], stamps))
    for size, unit in ((1e9, "s"), (1e12, "ms"), (1e15, "us"), (1e18, "ns")):
        # 2001 to 2100; whole seconds that step by thousands but not by minutes are a counter of µs.
        counter = unit == "s" and whole and step >= 1000 and step % 60 != 0
        if size <= low and high < 4.2 * size and not counter:
            return unit
    if not whole and low >= _SHEETS_FROM and _day_of_1970(stamps) is not None and _are_seconds_in_days(stamps):
        return "day"
    in_minutes = abs(step - 60_000 * round(step / 60_000)) <= _MINUTE_JITTER
    if not whole or step < 2:
        return "s"
    if step % 60 == 0 and (3600 % step == 0 or step % 3600 == 0) and not in_minutes:
        return "s"
    if step <= 60 and low in (0, step) and np.mean(np.diff(stamps[:100_000]) == step) >= _EXACT:
        return "s"
    if high < _WEEK_MS and (step < _LONG_STEP_MS or in_minutes):
        return "ms"
    return "ns" if step >= 2e6 and high > 2.0**32 else "us"


def _day_of_1970(stamps: Array) -> float | None:
    """The number of 1970-01-01, where all stamps are numbers of days in one of the usual counts."""
    low, high = float(stamps.min()), float(stamps.max())
    return next((day for first, last, day in _DAY_NUMBERS if first <= low and high <= last), None)


def _are_seconds_in_days(stamps: Array) -> bool:
    """True where stamps of many decimals are whole seconds, up to an hour, apart as days: 1/144 is 10 min."""
    many = np.abs(stamps * 1e5 - np.round(stamps * 1e5)) > 0.01
    seconds: Array = (stamps - stamps[0]) * 86400.0
    near = np.abs(seconds - np.round(seconds)) <= _WHOLE_SECOND
    return float(many.mean()) >= 0.5 and float(near.mean()) >= 0.99 and 0.5 < _median_step(seconds) < 3601


_NEIGHBOURS = {"s": ("ms",), "ms": ("s", "us"), "us": ("ms", "ns"), "ns": ("us",)}


def is_epoch(stamps: Array, unit: str) -> bool:
    """True where numeric stamps count from 1970: the first one lies between 2001 and 2100."""
    scale = SECONDS_PER_UNIT[unit]
    return scale <= 1.0 and 1e9 <= float(stamps[0]) * scale < 4.2e9


def to_seconds(
    stamps: Array, column: TimeColumn, start: float | None = None, *, stated: bool = False
) -> tuple[Array, str]:
    """Seconds of the stamps, shape (n,), n >= 1, and a sentence that says how they were read.

    Calendar and epoch stamps count from the first sample; others, years among them, as the source counts them:
    their second 0 is `start`, in s since 1970, where that is known. Their unit may be `stated` by the file.
    """
    if column.kind == "calendar":
        first = date_text(float(stamps[0]) * 1e-6)
        return (stamps - stamps[0]) / 1e6, f"time counts from the first stamp, {first}"
    if column.kind == "clock":
        # A clock that jumps back by more than half a turn has wrapped.
        turn = column.turn_s
        turns = np.cumsum(np.diff(stamps, prepend=stamps[0]) < -0.5e6 * turn) if turn else np.zeros(len(stamps))
        seconds = (stamps - stamps[0]) / 1e6 + turn * turns
        clock = timedelta(microseconds=float(stamps[0]))
        what = "midnight" if turn == 86400.0 else "the hour"
        passed = f"; the clock passes {what} {times(int(turns[-1]))}" if turns[-1] else ""
        return seconds, f"time counts from the first stamp, {clock} on the clock{passed}"
    unit = column.unit or unit_by_magnitude(stamps)
    scale = SECONDS_PER_UNIT[unit]
    others = "" if stated or is_epoch(stamps, unit) else _otherwise(stamps, unit)
    said = f"read as {unit}"
    if not stated:
        said += f" (assumed from their size: {others or '--time-unit changes it'})"
    if unit == "year":
        return stamps * scale, f"stamps are {said}"
    day_of_1970 = _day_of_1970(stamps) if unit == "day" else None
    if day_of_1970 is not None:
        first = date_text((float(stamps[0]) - day_of_1970) * scale)
        # The last of their digits is 10 µs and more.
        since = ((stamps - stamps[0]) * scale).round(3)
        return since, f"stamps are {said}; time counts from {first}"
    if is_epoch(stamps, unit):
        first = date_text(float(stamps[0]) * scale)
        return _scaled(stamps - stamps[0], scale), f"stamps are {said} since 1970; time counts from {first}"
    counted = "" if start is None else f"; time counts from {date_text(start)}"
    said = f"stamps are {said}{counted}"
    return _scaled(stamps, scale), Assumption(said) if others else said


def _otherwise(stamps: Array, unit: str) -> str:
    """The rate in the unit and in the others that whole stamps may have: "0.5 Hz; 500 Hz with --time-unit us"."""
    step = _median_step(stamps[:100_000])
    if step < 2 or not bool(np.all(stamps[:1000] == np.floor(stamps[:1000]))):
        return ""
    rates = {other: sample_rate(step * SECONDS_PER_UNIT[other]) for other in ("s", "ms", "us", "ns")}
    others = [f"{rates[other]} with --time-unit {other}" for other in _NEIGHBOURS.get(unit, ())]
    return f"{rates[unit]}; {', '.join(others)}" if others else ""


def _scaled(stamps: Array, scale: float) -> Array:
    # Dividing by 1000 rounds 3 ms to the double nearest 0.003; multiplying by 0.001 may not.
    return stamps / round(1 / scale) if scale < 1 else stamps if scale == 1 else stamps * scale


def times(count: int) -> str:
    """`once`, `2 times`."""
    return "once" if count == 1 else f"{count} times"


def date_text(seconds: float) -> str:
    """The date and clock, UTC, of seconds since 1970."""
    try:
        return (_EPOCH + timedelta(seconds=seconds)).isoformat()
    except OverflowError:  # a zone can push a stamp of year 1 or 9999 beyond the calendar
        return f"{seconds:g} s from 1970"


def _median_step(stamps: Array) -> float:
    steps = np.diff(stamps)
    positive = steps[steps > 0]
    return float(np.median(positive)) if positive.size else 0.0


# Gaps in time as rows of missing samples.


_MAX_INSERTED_PER_ROW = 20
_ALWAYS_ALLOWED = 1_000_000


def missing_rows(time: Array, pauses: Indices, period: float) -> Array:
    """Samples that are missing in each pause, a float, shape (k,).

    Args:
        time: Time in s, shape (n,).
        pauses: Samples, from 0 and in rising order, after each of which samples are missing, shape (k,).
        period: Nominal sample period in s.
    """
    if not pauses.size:
        return np.zeros(0)
    # From the latest stamp so far: going forward again after a step back is not a gap.
    latest = np.maximum.accumulate(time)
    return np.maximum(np.rint((time[pauses + 1] - latest[pauses]) / period) - 1, 0.0)


def fill_gaps(time: Array, values: Array, period: float, pauses: Indices) -> tuple[Array, Array, int]:
    """Put rows of NaN into the pauses, evenly spaced in time.

    Args:
        time: Time in s, shape (n,).
        values: Samples, shape (n, channels).
        period: Nominal sample period in s.
        pauses: Samples, from 0 and in rising order, after each of which samples are missing.

    Returns:
        (time, values, rows that were inserted).

    Raises:
        BadSetting: the gaps are so long that nearly all rows would be missing ones.
    """
    more = missing_rows(time, pauses, period)
    total = float(more.sum())
    if total > max(_MAX_INSERTED_PER_ROW * len(time), _ALWAYS_ALLOWED):
        raise BadSetting(
            f'gaps must not be "missing" where that makes {total:.3g} rows of {len(time)} (use "dt", or a longer'
            " sample period)"
        )
    count = np.zeros(len(time), dtype=np.int64)
    count[pauses + 1] = more.astype(np.int64)
    place = np.arange(len(time)) + np.cumsum(count)
    size = len(time) + int(total)
    filled = np.full((size, values.shape[1]), np.nan)
    filled[place] = values
    return np.interp(np.arange(size), place, time), filled, int(total)


# Samples placed evenly in time, where stamps come in bursts or from a clock coarser than the sample period.


_BLOCK = 8
"""Usual deliveries in one block, whose samples are placed around their mean stamp."""


def place_evenly(time: Array, rate: SampleRate) -> Array:
    """Time of each sample, shape (n,): on a line through the stamps, which pauses interrupt.

    Where the true rate drifts, so that the line would miss the stamps by more than half a usual delivery, it bends:
    it goes through the mean stamp of each block of samples.
    """
    n = len(time)
    placed = rate.period * np.arange(n, dtype=np.float64)
    placed += level(time - placed, rate.runs)
    late = time - placed
    blocks = max(1, n // max(2, round(_BLOCK * rate.longest / rate.period)))
    edges = np.linspace(0, n, blocks + 1).astype(np.int64)
    means = np.add.reduceat(late, edges[:-1]) / np.diff(edges)
    if blocks > 1 and np.abs(means).max() > 0.5 * rate.longest:
        # Before the first middle and after the last one the line continues as between the nearest two.
        middles = np.concatenate(([0], (edges[1:] + edges[:-1] - 1) / 2, [n - 1]))
        ends = 1.5 * means[[0, -1]] - 0.5 * means[[1, -2]]
        placed += np.interp(np.arange(n), middles, np.concatenate((ends[:1], means, ends[1:])))
    if rate.stamps == "coarse":
        # A clock shows its last step: the samples of a second lie after it.
        placed += max(0.0, rate.longest - rate.period) / 2
    return np.maximum.accumulate(placed) if rate.steps.forward is rate.steps.all else placed


# What is said about the sampling of a recording: its rate, how sure it is, its pauses.


_STAMPS = {
    "even": "",
    "uneven": " from uneven stamps",
    "bursts": " from stamps that come in bursts",
    "coarse": " from stamps of a coarse clock",
}
_SURE = 1e-4
"""A standard error below this share of the rate is not reported."""
_UNSURE = 0.01
"""A rate by a coarse clock with a larger standard error is an assumption."""
_ALIKE = 0.02
"""Rates of the file and of the stamps that differ by more contradict each other."""


def with_words(timing: Timing, stated: float | None, gaps: Gaps, n: int) -> Timing:
    """The timing with its summary and its notes.

    Args:
        timing: The facts.
        stated: Sample period in s that the file states; None where it states none.
        gaps: How gaps are to be read.
        n: Samples, the missing ones left out.
    """
    notes = [*_about_stamps(timing), *_about_stated(timing, stated), *_about_pauses(timing, gaps, n)]
    return replace(timing, summary=_summary(timing), notes=tuple(notes))


def _summary(timing: Timing) -> str:
    if timing.period is None:
        return ""
    rate = sample_rate(timing.period)
    if timing.source == "option":
        return f"{rate} as requested"
    if timing.source == "file":
        return f"{rate} as stated in the file"
    return f"{rate}{_STAMPS[timing.stamps]}{_sure(timing)}"


def _sure(timing: Timing) -> str:
    error = timing.error
    return f", standard error {percent(error)}" if error is not None and error > _SURE else ""


def _about_stamps(timing: Timing) -> list[str]:
    if timing.stamps_period is None:
        return []
    rate = f"{sample_rate(timing.stamps_period)}{_sure(timing)}"
    if timing.stamps == "coarse":
        clock = f"the clock has a resolution of {duration(timing.resolution)}"
        said = f"{clock}: samples were placed evenly between its steps, {rate}"
        # Rows that were written twice look the same.
        return [Assumption(said) if timing.error is not None and timing.error > _UNSURE else said]
    if timing.stamps == "bursts":
        return [f"the stamps come in bursts: samples were placed evenly in time, {rate}"]
    if timing.error is None:
        period = f"{timing.stamps_period:.6g} s"
        return [f"the stamps show no steady rate: the sample period, {period}, is the median step"]
    return [f"the stamps are uneven, {rate}"] if timing.stamps == "uneven" else []


def _about_stated(timing: Timing, stated: float | None) -> list[str]:
    own = timing.stamps_period
    if stated is None or own is None or timing.source == "option":
        return []
    if timing.source == "file":
        return [f"the sample rate is the one that the file gives, {sample_rate(stated)}"]
    if abs(stated - own) <= _ALIKE * own:
        return []
    return [
        f"the file gives a sample rate of {sample_rate(stated)}, but its stamps give {sample_rate(own)}: the stamps"
        " were used; --rate chooses the other"
    ]


def _about_pauses(timing: Timing, gaps: Gaps, n: int) -> list[str]:
    if not timing.pauses:
        return []
    found = "a gap" if timing.pauses == 1 else f"{timing.pauses} gaps"
    said = f"time has {found}, first after sample {timing.first_pause}, the longest {timing.longest_pause:.6g} s"
    if gaps != "rows":
        return [said]
    rows = f"{count(timing.missing)} {'row' if timing.missing == 1 else 'rows'}"
    if timing.missing > n:
        return [
            f"{said}; read it with --gaps dt (elapsed time): --gaps missing would add {rows} of missing samples"
        ]
    return [f"{said}; read it with --gaps missing (adds {rows} of missing samples) or --gaps dt (elapsed time)"]


# From stamps to the time of the samples: wraps are undone, steps are judged, every decision is noted.


_COUNTERS = {2.0**16: "16-bit counter", 2.0**32: "32-bit counter (millis() or micros())"}


@dataclass(frozen=True)
class GivenPeriod:
    """Sample periods that are known besides the stamps, in s."""

    option: float | None = None
    """What the user chose; it outranks all others."""
    file: float | None = None
    """What the text of the file states."""


@dataclass(frozen=True)
class TimeAxis:
    """The time of all samples."""

    time: Array
    """Seconds, shape (n,)."""
    timing: Timing
    """The sample period, and how it was found."""
    pauses: Indices
    """Samples, from 0, after each of which samples are missing."""
    backward: int
    """Steps back in time."""
    notes: tuple[str, ...]
    """How the stamps were read and how even they are, each a sentence."""
    unit: str = ""
    """Unit of numeric stamps, as it was stated or assumed; "" for others."""


def read_time(
    stamps: Array,
    column: TimeColumn,
    unit: str | None = None,
    given: GivenPeriod | None = None,
    gaps: Gaps = "rows",
    start: float | None = None,
) -> TimeAxis:
    """Time of the stamps, shape (n,), n >= 1, all finite, in the unit of their column.

    Args:
        stamps: As the cells were parsed: µs since 1970 for calendar stamps, µs for clocks, else numbers.
        column: What they are.
        unit: Unit of numeric stamps that outranks the column's; None = the column's own.
        given: Sample periods that are known besides.
        gaps: How gaps in time are to be read: no advice is given where that was chosen.
        start: What second 0 of numeric stamps is, in s since 1970; None where that is not known.
    """
    given = given or GivenPeriod()
    notes, stated = list[str](), ""
    if column.kind == "number":
        stamps, notes = unwrap(stamps)
        stated = unit or column.unit
        column = replace(column, unit=stated or unit_by_magnitude(stamps))
    time, how = to_seconds(stamps, column, start, stated=column.kind != "number" or bool(stated))
    rate = find_rate(time)
    crowded = rate is not None and rate.stamps in ("coarse", "bursts")
    steps = np.diff(time) if rate is None else rate.steps.all
    backward = int(np.count_nonzero(steps < 0)) if steps.size and float(steps.min()) < 0 else 0
    notes += [how, *_about_order(time, steps, backward, repeated=not crowded)]
    if rate is None:
        return _without_rate(time, given, backward, notes)
    if (why := _no_time(rate)) is not None:
        axis = counted_time(len(time), given)
        return replace(axis, notes=(*notes, Assumption(f"{why}: the samples were counted"), *axis.notes))
    pauses = rate.pauses
    if crowded:
        time = place_evenly(time, rate)
    elif given.option is not None:
        pauses = np.flatnonzero(rate.steps.forward > GAP_PERIODS * given.option)
    timing = with_words(_timing(time, rate, pauses, given), given.file, gaps, len(time))
    return TimeAxis(time, timing, pauses, backward, (*notes, *timing.notes), _unit_words(column, stated))


def _unit_words(column: TimeColumn, stated: str) -> str:
    unit = f"{column.unit}s" if column.unit in ("day", "year") else column.unit
    return "" if column.kind != "number" else f"{unit}{'' if stated else ' (assumed)'}"


def _no_time(rate: SampleRate) -> str | None:
    """Why the stamps give no time: their steps are of all sizes, three powers of ten or more, or not of a time."""
    if not PERIODS[0] <= rate.period <= PERIODS[1]:
        return f"the stamps are {rate.period:.3g} s apart, which is not a time"
    positive = rate.steps.all[rate.steps.all > 0]
    if np.isfinite(rate.error) or positive.size < 20:
        return None
    counts = np.unique(np.floor(np.log10(positive)), return_counts=True)[1]
    if int(np.count_nonzero(counts >= 0.05 * positive.size)) <= 2:
        return None
    low, high = (duration(float(step)) for step in np.quantile(rate.steps.all, (0.1, 0.9)))
    return f"the stamps have no rate, as where only changes are logged (most steps lie between {low} and {high})"


def counted_time(n: int, given: GivenPeriod, offset: float = 0.0, start: float | None = None) -> TimeAxis:
    """Time of `n` samples without stamps: by the period that is given, else their numbers.

    Args:
        n: How many.
        given: Sample periods that are known.
        offset: Time of the first sample in s, where a period is given.
        start: When the first sample was taken, in s since 1970; None where that is not known.
    """
    period = given.option or given.file
    time = np.arange(n, dtype=np.float64)
    if period is not None:
        time = offset + time * period
    source: RateSource = "option" if given.option else "file" if given.file else "none"
    timing = with_words(Timing("none", source, period), given.file, "rows", n)
    notes: list[str] = []
    if period is not None and start is not None:
        notes = [f"time counts from {date_text(start)}"]
    return TimeAxis(time, timing, np.zeros(0, dtype=np.int64), 0, (*notes, *timing.notes))


def _without_rate(time: Array, given: GivenPeriod, backward: int, notes: list[str]) -> TimeAxis:
    """Time whose stamps never rise: all are one step of a coarse clock, unless it steps back."""
    axis = counted_time(len(time), given, float(time[0]))
    if given.file and len(time) > 1 and not backward:
        time = axis.time
    return replace(axis, time=time, backward=backward, notes=(*notes, *axis.notes))


def _timing(time: Array, rate: SampleRate, pauses: Indices, given: GivenPeriod) -> Timing:
    period, source = _chosen(rate, given)
    steps = time[pauses + 1] - time[pauses]
    return Timing(
        stamps=rate.stamps,
        source=source,
        period=period,
        error=rate.error / rate.period if np.isfinite(rate.error) else None,
        stamps_period=rate.period,
        pauses=int(pauses.size),
        missing=int(missing_rows(time, pauses, period).sum()),
        first_pause=int(pauses[0]) + 1 if pauses.size else 0,
        longest_pause=float(steps.max(initial=0.0)),
        resolution=rate.longest if rate.stamps == "coarse" else None,
    )


def _chosen(rate: SampleRate, given: GivenPeriod) -> tuple[float, RateSource]:
    """The period that is used, and its source."""
    if given.option is not None:
        return given.option, "option"
    if given.file is not None and _supports(rate, given.file):
        return given.file, "file"
    return rate.period, "stamps"


def _supports(rate: SampleRate, stated: float) -> bool:
    """True where the stamps leave the period open, and the one that the file states, in s, may be it.

    Where there is no rate at which they come steadily, the period lies between the median and the mean step: late
    rows and lost samples lengthen the mean, bursts shorten the median.
    """
    if np.isfinite(rate.error):
        off = abs(stated - rate.period)
        return rate.stamps in ("coarse", "bursts") and off <= max(_ALIKE * stated, 3 * rate.error)
    steps = rate.steps.all
    mean = float(steps[steps >= 0].mean())
    margin = max(_ALIKE * stated, rate.longest / len(steps))
    return min(rate.period, mean) - margin <= stated <= max(rate.period, mean) + margin


def unwrap(stamps: Array) -> tuple[Array, list[str]]:
    """Unwrap whole stamps that jump back by a counter's full range; return them and remarks about it.

    Only where the step over the wrap is an ordinary one: a device that restarts jumps back to 0 from
    anywhere, and stays a step back.
    """
    back = np.flatnonzero(stamps[1:] < stamps[:-1])
    if back.size == 0 or stamps.min() < 0 or not bool(np.all(stamps == np.floor(stamps))):
        return stamps, []
    steps = np.diff(stamps)
    forward = steps[steps > 0]
    usual = 50 * max(float(np.median(forward)), 1.0) if forward.size else 0.0
    for size, name in _COUNTERS.items():
        if stamps.max() >= size:
            continue
        over = steps[back] + size
        wraps = back[(over > 0) & (over <= min(usual, size / 4))]
        if wraps.size:
            turns = np.zeros(len(stamps))
            turns[wraps + 1] = 1
            said = f"the stamps wrap {times(wraps.size)}, like a {name}, and were unwrapped"
            return stamps + size * np.cumsum(turns), [said]
    return stamps, []


def _about_order(time: Array, steps: Array, backward: int, *, repeated: bool) -> list[str]:
    """Steps back, and, where `repeated`, stamps that come twice: at once, or again after a step back."""
    notes: list[str] = []
    if backward:
        first = int(np.argmax(steps < 0))
        said = f"time steps back {times(backward)}, first by {-float(steps[first]):.9g} s at sample {first + 2}"
        notes.append(Assumption(f"{said}: the order of the file was kept"))
    if repeated and steps.size and not float(steps.min()) > 0:
        twice = len(time) - int(np.unique(time).size)
        if twice:
            same = np.flatnonzero(steps == 0)
            where = f", first at sample {int(same[0]) + 2}" if same.size else ""
            notes.append(f"{twice} {'samples repeat' if twice > 1 else 'sample repeats'} an earlier stamp{where}")
    return notes
