"""The time of the samples: the unit of the stamps, the sample period, pauses, wraps, coarse clocks and gaps."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta

import numpy as np

from kalscope.common.numbers import PERIODS, Array, Indices
from kalscope.common.text import count, duration, percent, sample_rate
from kalscope.errors import BadSetting
from kalscope.recording import Assumption, Gaps, RateSource, Recording, Stamps, Timing
from kalscope.sources.grammar.cells import SECONDS_PER_UNIT
from kalscope.sources.grammar.timestamps import TimeColumn, find_epoch, times, unwrap

# What the steps between stamps look like: a step per sample, a coarse clock, bursts, or samples that are lost.


GAP_PERIODS = 1.5 * (1 + 1e-6)
"""A step longer than this many sample periods may be a gap: at least one sample is missing. 3 ms is 1.5 × 2 ms."""
_MIN_RECURRENCES = 5
"""Fewest long steps that show whether they come regularly."""


@dataclass(frozen=True)
class Steps:
    """The steps between stamps, in s, and their most used statistics."""

    all: Array
    """Each step, shape (n - 1,)."""
    forward: Array
    """Each step from the latest stamp so far: going forward again after a step back is not a gap."""
    median: float
    """Median positive step, to 9 digits."""
    even: bool
    """True where nine of ten steps are alike."""


def steps_of(time: Array) -> Steps | None:
    """The steps of `time`, shape (n,); None where none is positive."""
    steps = np.diff(time)
    positive = steps if steps.size and float(steps.min()) > 0 else steps[steps > 0]
    if positive.size == 0:
        return None
    # The stamps were decimal text: 0.02 - 0.01 is 0.01 within 1e-9, not 0.010000000000000002.
    median = float(f"{np.median(positive):.9g}")
    forward = steps
    if float(steps.min()) < 0:
        forward = time[1:] - np.maximum.accumulate(time)[:-1]
    some = np.sort(_some(steps))
    low, high = (float(some[round(share * (some.size - 1))]) for share in (0.05, 0.95))
    return Steps(steps, forward, median, high - low <= 0.01 * median)


def is_coarse(steps: Steps) -> bool:
    """True where stamps repeat because the clock is coarser than the sample period: all its steps are alike."""
    positive = steps.all[steps.all > 0]
    repeats = np.flatnonzero(steps.all == 0)
    share = repeats.size / steps.all.size
    # Fewer are samples that were written twice.
    regular = share >= 0.03 and repeats.size >= _MIN_RECURRENCES and _regular(np.diff(repeats))
    if share < 0.15 and not regular:
        return False
    tick = steps.median
    alike = np.count_nonzero(np.abs(positive - tick) <= 0.25 * tick)
    longer = np.count_nonzero(positive > 1.25 * tick)
    # Where each step of the clock holds many samples, a short record has few steps, and pauses are many among them.
    pauses = (0.15 if regular and share >= 0.7 else 0.05) * positive.size + (6 if share >= 0.8 else 2)
    return bool(alike >= (0.6 if share >= 0.8 else 0.8) * positive.size and longer <= pauses)


def one_sample_a_step(steps: Steps, share: float = 0.8) -> bool:
    """True where a share of the steps is near the median one, or all are its multiples: samples were lost."""
    median, usual = steps.median, steps.all
    near = np.count_nonzero((usual >= 0.5 * median) & (usual <= GAP_PERIODS * median))
    if near >= share * usual.size:
        return True
    multiples = _some(usual[usual > 0]) / median
    few_back = bool(np.count_nonzero(usual <= 0) <= 0.05 * usual.size)
    return few_back and bool(np.mean(np.abs(multiples - np.rint(multiples)) <= 0.15) >= 0.95)


def long_steps_recur(steps: Steps) -> bool:
    """True where long steps come so regularly that they show how rows are delivered, not that some are missing."""
    where = np.flatnonzero(steps.forward > GAP_PERIODS * steps.median)
    if where.size < _MIN_RECURRENCES:
        return False
    rows = np.diff(where)
    # Many rows between two long steps, or slow ones, are no burst: the logger pauses.
    sleeps = steps.median >= 0.1 and float(np.median(steps.forward[where])) >= 3 * steps.median
    return _regular(rows) and float(np.median(rows)) <= 64 and not sleeps


def _regular(rows: Indices) -> bool:
    """True where eight of ten distances are about alike."""
    low, middle, high = np.quantile(rows, (0.1, 0.5, 0.9))
    return bool(high - low <= max(1.0, 0.35 * middle))


def _some(steps: Array) -> Array:
    return steps[:: max(1, steps.size // 200_000)]


# Pauses: long steps that no later row makes up for. Without them one line goes through all stamps.


def lasting_steps(time: Array, steps: Array, candidates: Indices, period: float, rows: int) -> Indices:
    """Those of the long steps that no later row makes up for, as a late delivery is made up for.

    The rows after a late delivery come faster than the samples were taken. After a pause all rows are later: also
    the one by which as many rows have come as were due.

    Args:
        time: Stamps in s, shape (n,).
        steps: Length of each step in s, shape (n - 1,).
        candidates: Steps to be judged, from 0 and in rising order, shape (k,).
        period: Sample period in s.
        rows: How many rows hold a usual delivery: at least so many are waited for, and 1024 at most.
    """
    time = np.maximum.accumulate(time)  # a row that is out of order makes up for nothing
    due = np.clip(np.ceil(steps[candidates] / period) + 2, rows, max(rows, 1024)).astype(np.int64)
    last = np.minimum(candidates + 1 + due, len(time) - 1)
    late = time[last] - time[candidates] - period * (last - candidates)
    return candidates[late > 0.5 * (steps[candidates] - period)]


# The sample period: robust against jitter, bursts, coarse clocks, pauses and lost samples.
#
# A line through the stamps against the sample number is not bent by stamps that are late for a while: rows that
# come in bursts, and clocks that show whole seconds, have its slope. After a pause it goes on at another level.


_NO_PAUSES = np.zeros(0, dtype=np.int64)
_ON_GRID = 0.02
"""Steps and stamps that miss the even grid by this share of the usual step are on it."""


@dataclass(frozen=True)
class SampleRate:
    """What the stamps say about the sampling."""

    stamps: Stamps
    """Their pattern."""
    period: float
    """Sample period in s."""
    error: float
    """Standard error of the period in s; 0 for even stamps, inf where it is not known."""
    pauses: Indices
    """Samples, from 0, after each of which samples are missing."""
    steps: Steps
    """The steps between the stamps."""
    longest: float
    """The longest usual step in s: that of a coarse clock, the time between two deliveries, or the period."""
    runs: Indices
    """How many pauses and steps back are before each sample, shape (n,)."""


_Guess = tuple[Stamps, float, float, float]
"""A first guess that shows which steps are pauses: the pattern, the period, the longest usual step and the shortest
that may be a pause, s."""


def find_rate(time: Array) -> SampleRate | None:
    """Sample period and pauses of the stamps `time` in s, shape (n,); None where no step is positive."""
    steps = steps_of(time)
    if steps is None:
        return None
    # There may be no scale at which the rows come steadily: the usual step is all that is known.
    runs = np.zeros(len(time), dtype=np.int64)
    unsteady = SampleRate("uneven", steps.median, math.inf, _NO_PAUSES, steps, steps.median, runs)
    if not PERIODS[0] <= steps.median <= PERIODS[1]:
        return unsteady
    if not is_coarse(steps) and _is_modal(time, steps):
        return replace(unsteady, error=0.0)
    guess = _guess(time, steps)
    return unsteady if guess is None else _fitted(time, steps, guess)


def _is_modal(time: Array, steps: Steps) -> bool:
    """True where most steps are alike and a few short ones make up for longer ones, or lie between the others.

    So many usual steps explain the span, and hardly any is near the usual one, which would be jitter. Only where
    rows lie between those of an even grid that is full are there more of them.
    """
    usual, slots = steps.median, float(time[-1] - time[0]) / steps.median
    mean = slots / steps.all.size
    if steps.even or mean > 1.05:
        return False
    off = np.abs(steps.all - usual)
    exact, near = (float(np.mean(off <= share * usual)) for share in (_ON_GRID, 0.5))
    if exact < 0.5 or mean >= 0.98:
        return exact >= 0.5 and near - exact <= 0.1 and bool(np.mean(steps.all < 0.5 * usual) > 0.02)
    rows = (time - time[0]) / usual
    on_grid = np.count_nonzero(np.abs(rows - np.rint(rows)) <= _ON_GRID)
    return steps.forward is steps.all and bool(on_grid >= 0.95 * slots)


def _guess(time: Array, steps: Steps) -> _Guess | None:
    median, recur = steps.median, long_steps_recur(steps)
    if steps.even and not recur:
        usual = steps.all[(steps.all >= 0) & (steps.all <= GAP_PERIODS * median)]
        # The few steps that differ may show that the true period is another one.
        if abs(float(usual.mean()) - median) <= 0.005 * median:
            return "even", median, median, GAP_PERIODS * median
    if is_coarse(steps):
        changes = np.flatnonzero(steps.all > 0)
        period = median * (changes.size - 1) / max(1, int(changes[-1] - changes[0])) if changes.size > 1 else median
        return "coarse", period, median, max(GAP_PERIODS * median, median + 2 * period)
    near = steps.all[np.abs(steps.all - median) <= 0.5 * median]
    jitter = float(np.std(near)) if near.size else 0.0
    single: _Guess = ("uneven", median, median, max(GAP_PERIODS * median, median + 5 * jitter))
    if not recur and one_sample_a_step(steps):
        return single
    scale = _steady_scale(time)
    if scale is None:
        return single if one_sample_a_step(steps, 0.5) else None
    period, rows = scale
    whole = steps.all[: steps.all.size // rows * rows].reshape(-1, rows)
    usual = max(float(np.median(whole.max(axis=1))), period)
    return "bursts", period, usual, 2.5 * usual


def _steady_scale(time: Array) -> tuple[float, int] | None:
    """(period, rows): the fewest rows, a power of 2, whose mean stamps come steadily, and their spacing per row.

    Where none do, those that come most steadily, if they do so at all.
    """
    means, rows = time, 1
    best, least = None, 0.35
    while len(means) > 16:
        half = len(means) // 2
        means, rows = (means[0 : 2 * half : 2] + means[1 : 2 * half : 2]) / 2, 2 * rows
        spacing = np.diff(means) / rows
        low, middle, high = np.quantile(spacing, (0.25, 0.5, 0.75))
        if middle <= 0 or high - low >= least * middle:
            continue
        long = spacing > GAP_PERIODS * middle
        pauses = np.count_nonzero(np.diff(long.astype(np.int8)) == 1) + int(long[0])
        few = pauses < 5 or float(spacing[long].sum()) <= 0.5 * float(spacing[spacing > 0].sum())
        near = np.count_nonzero(np.abs(spacing - middle) <= 0.5 * middle)
        if few and near >= 0.75 * spacing.size:
            best, least = (float(middle), rows), float((high - low) / middle)
            if least <= 0.1:
                break
    return best


def _fitted(time: Array, steps: Steps, guess: _Guess) -> SampleRate:
    """Refine the guess: take its pauses and the steps back out, then fit a line to the stamps."""
    stamps, period, usual, shortest_pause = guess
    candidates = np.flatnonzero(steps.forward > shortest_pause)
    pauses = lasting_steps(time, steps.all, candidates, period, max(4, math.ceil(2 * usual / period)))
    back = np.flatnonzero(steps.all < -2 * usual) if steps.forward is not steps.all else _NO_PAUSES
    runs = np.zeros(len(time), dtype=np.int64)
    runs[pauses + 1] = 1
    runs[back + 1] = 1
    runs = np.cumsum(runs)
    if stamps == "even":
        return SampleRate("even", period, 0.0, pauses, steps, usual, runs)
    # The row at which a coarse clock moves on is exact to a sample; after a pause it may have moved before.
    moves = steps.all > 0
    moves[pauses] = False
    x = np.flatnonzero(moves) + 1 if stamps == "coarse" else np.arange(len(time))
    x = x if x.size > 3 else np.arange(len(time))
    slope, late = _line(x, time[x], runs[x])
    error = _slope_error(late)
    if x.size < len(time):
        late = np.diff(late)[np.diff(runs[x]) == 0]
        error = math.sqrt(1.2 * (float(late @ late) + slope**2)) / float(x[-1] - x[0])
    if not 0 < slope <= shortest_pause:  # a damaged stamp bends the line beyond all that lies between pauses
        slope, error = period, math.inf
    if stamps == "uneven" and abs(slope - steps.median) <= 3 * error:
        slope = steps.median  # the usual step agrees
    if stamps == "bursts":
        passing = np.delete(steps.all, pauses).clip(0.0)
        in_bursts = passing[passing > GAP_PERIODS * slope].sum() > 2 / 3 * passing.sum()
        stamps = "bursts" if in_bursts else "uneven"
    return SampleRate(stamps, float(f"{slope:.9g}"), error, pauses, steps, usual, runs)


def level(values: Array, runs: Indices) -> Array:
    """The mean of the run of each value, shape (n,)."""
    starts = np.flatnonzero(np.diff(runs, prepend=-1))
    sizes = np.diff(np.append(starts, len(runs)))
    origin = values[starts]
    means = origin + np.add.reduceat(values - np.repeat(origin, sizes), starts) / sizes
    return np.repeat(means, sizes)


def _line(x: Indices, time: Array, runs: Indices) -> tuple[float, Array]:
    """The common slope of the lines through the stamps of each run, and how late each stamp is."""
    number, time = (values - level(values, runs) for values in (x.astype(np.float64), time))
    spread = float(number @ number)
    slope = float(number @ time) / spread if spread else 0.0
    return slope, time - slope * number


def _slope_error(late: Array) -> float:
    """Standard error of the slope in s, by how much it differs between parts of the recording; inf if unknown."""
    steps = len(late) - 1
    rows = max(1, steps // 32)
    parts = np.diff(late[: len(late) // rows * rows].reshape(-1, rows).mean(axis=1))
    # Means of blocks of a random walk differ by 2/3 of what its end points do; a line through it loses 1.2.
    return math.sqrt(1.2 * 1.5 * float(np.var(parts, ddof=1)) / (rows * steps))


# How much the steps of a recording vary: its rate with that jitter, for the screen.


def jitter_of(recording: Recording) -> float:
    """Standard deviation of the steps as a share of the sample period, pauses left out; 0 where they are even.

    It reads every stamp, so call it once per recording. Only uneven stamps have a jitter: bursts and coarse clocks
    were placed evenly, and a rate that the user chose has none.
    """
    period, timing = recording.sample_period, recording.report.timing
    if period is None or timing is None or timing.stamps != "uneven" or timing.source == "option":
        return 0.0
    steps = np.diff(recording.time)
    steps = steps[steps > 0.0]
    # The longest steps are the pauses; with gaps as missing rows there is none.
    usual = max(1, len(steps) - (0 if recording.gaps == "missing" else timing.pauses))
    return float(np.partition(steps, usual - 1)[:usual].std()) / period


def rate_words(period: float | None, jitter: float) -> str:
    """The rate of one sample every `period` s: "100 Hz", "13.4 Hz, steps ± 12 %", or that it is unknown."""
    if period is None:
        return "sample rate unknown"
    return sample_rate(period) + steps_words(jitter)


def steps_words(jitter: float) -> str:
    """What follows a rate: ", steps ± 12 %"; "" where the steps are even to half a percent."""
    return f", steps ± {percent(jitter)}" if jitter >= 0.005 else ""


# Seconds from the stamps of a column, their unit by magnitude, and the nominal period.


def unit_by_magnitude(stamps: Array, *, printed: bool = False) -> str:  # noqa: PLR0911 (one for each rule)
    """Unit of numeric stamps that name none: those that count from a date by their size, others by their step.

    Whole numbers are milliseconds, as of `millis()`: their steps vary, repeat, or do not start at 0. They are
    seconds where they count from 0 in equal steps of 2, 5, 10, 15 or 30 and are not `printed` beside labels, and
    where their steps are whole minutes that divide an hour, or hours; microseconds where milliseconds would mean
    weeks, or minutes between two samples.
    Fractions are seconds, or days that lie whole seconds apart (45123.506944444, or 0.506944444 of a day).
    """
    low, high = float(stamps.min()), float(stamps.max())
    step, epoch = _median_step(stamps[:100_000]), find_epoch(stamps)
    # The head is checked first: most stamps with fractions show them there.
    whole = all(bool(np.all(part == np.floor(part))) for part in (stamps[:1000], stamps))
    # Whole seconds that step by thousands but not by minutes are a counter of µs.
    if epoch is not None and not (epoch[0] == "s" and whole and step >= 1000 and step % 60 != 0):
        return epoch[0]
    if not whole and _are_seconds_in_days(stamps):
        return "day"
    in_minutes = abs(step - 60_000 * round(step / 60_000)) <= 100
    if not whole or step < 2:
        return "s"
    if step % 60 == 0 and (3600 % step == 0 or step % 3600 == 0) and not in_minutes:
        return "s"
    few = np.diff(stamps[:100_000]) == step
    is_exact = np.count_nonzero(few) >= 0.95 * len(few)
    if step in (2, 3, 5, 10, 15, 30, 60) and not printed and low in (0, step) and is_exact:
        return "s"
    if high < 5e8 and (step < 100_000 or in_minutes):  # 6 days, 100 s
        return "ms"
    return "ns" if step >= 2e6 and high > 2.0**32 else "us"


def _unit_by_period(stamps: Array, period: float | None) -> str:
    """The unit in which even steps are the sample period, s, that the file states; "" where none is."""
    ways = ((unit, _median_step(stamps) * SECONDS_PER_UNIT[unit]) for unit in _NEIGHBOURS if period)
    return next((unit for unit, step in ways if abs(step - (period or 0.0)) <= 1e-6 * step), "")


def _are_seconds_in_days(stamps: Array) -> bool:
    """True where stamps are whole seconds, up to an hour, apart as days: 1/144 is 10 min.

    A multiple of 27 s is a day number of few decimals, as seconds have as well: 1/1600, 1/128.
    """
    some = stamps[:1000]
    seconds: Array = (some - some[0]) * 86400.0
    whole: Array = seconds.round()
    near = float((np.abs(seconds - whole) <= 0.02).mean())  # days of seven or more decimals
    return near >= 0.99 and float((whole % 27 != 0).mean()) >= 0.5 and 0.5 < _median_step(seconds) < 3601


_NEIGHBOURS = {"s": ("ms",), "ms": ("s", "us"), "us": ("ms", "ns"), "ns": ("us",)}


def to_seconds(
    stamps: Array, column: TimeColumn, start: float | None = None, *, stated: bool = False
) -> tuple[Array, str]:
    """Seconds of the stamps, shape (n,), n >= 1, and a sentence that says how they were read.

    Calendar and epoch stamps count from the first sample; others, years among them, as the source counts them:
    their second 0 is `start`, in s since 1970, where that is known. Their unit may be `stated` by the file.
    """
    first = float(stamps[0])
    if column.kind != "number":
        on_clock = f"{timedelta(microseconds=first)} on the clock"
        said = date_text(first * 1e-6) if column.kind == "calendar" else on_clock
        return (stamps - first) / 1e6, f"time counts from the first stamp, {said}"
    unit = column.unit or unit_by_magnitude(stamps)
    scale, others, epoch = SECONDS_PER_UNIT[unit], "", find_epoch(stamps, unit)
    said = f"stamps are read as {unit}"
    if not stated:
        others = "" if epoch else _otherwise(stamps, unit)
        said += f" (assumed from their size: {others or '--time-unit changes it'})"
    if epoch is not None:
        said += f"; time counts from {date_text((first - epoch[1]) * scale)}"
        stamps = stamps - first
    elif start is not None:
        said += f"; time counts from {date_text(start)}"
    # Dividing by 1000 rounds 3 ms to the double nearest 0.003; multiplying by 0.001 may not.
    seconds: Array = stamps / round(1 / scale) if scale < 1 else stamps * scale
    if unit == "day":
        seconds = seconds.round(3)  # the last of their digits is 10 µs and more
    return seconds, Assumption(said) if others else said


def _otherwise(stamps: Array, unit: str) -> str:
    """The rate in the unit and in the others that whole stamps may have: "0.5 Hz; 500 Hz with --time-unit us"."""
    step = _median_step(stamps[:100_000])
    if step < 2 or unit not in _NEIGHBOURS or np.any(stamps[:1000] % 1):
        return ""
    rates = {other: sample_rate(step * SECONDS_PER_UNIT[other]) for other in (unit, *_NEIGHBOURS[unit])}
    others = [f"{rates[other]} with --time-unit {other}" for other in _NEIGHBOURS[unit]]
    return f"{rates[unit]}; {', '.join(others)}"


def date_text(seconds: float) -> str:
    """The date and clock, UTC, of seconds since 1970."""
    try:
        return (datetime(1970, 1, 1, tzinfo=UTC) + timedelta(seconds=seconds)).isoformat()
    except OverflowError:  # a zone can push a stamp of year 1 or 9999 beyond the calendar
        return f"{seconds:g} s from 1970"


def _median_step(stamps: Array) -> float:
    steps = np.diff(stamps)
    positive = steps[steps > 0]
    return float(np.median(positive)) if positive.size else 0.0


# Gaps in time as rows of missing samples.


def missing_rows(time: Array, pauses: Indices, period: float) -> Array:
    """Samples that are missing in each pause, a float, shape (k,).

    Args:
        time: Time in s, shape (n,).
        pauses: Samples, from 0 and in rising order, after each of which samples are missing, shape (k,).
        period: Nominal sample period in s.
    """
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
    if total > max(20 * len(time), 1_000_000):
        made = f"{total:.3g} rows of {len(time)}"
        raise BadSetting(
            f'gaps must not be "missing" where that makes {made} (use "dt", or a longer sample period)'
        )
    where = np.repeat(pauses + 1, more.astype(np.int64))
    time, values = np.insert(time, where, np.nan), np.insert(values, where, np.nan, axis=0)
    known = np.flatnonzero(~np.isnan(time))
    return np.interp(np.arange(len(time)), known, time[known]), values, int(total)


# Samples placed evenly in time, where stamps come in bursts or from a clock coarser than the sample period.


def place_evenly(time: Array, rate: SampleRate) -> Array:
    """Time of each sample, shape (n,): on a line through the stamps, which pauses interrupt.

    Where the true rate drifts, so that the line would miss the stamps by more than half a usual delivery, it bends:
    it goes through the mean stamp of each block of eight usual deliveries.
    """
    n = len(time)
    placed = rate.period * np.arange(n, dtype=np.float64)
    placed += level(time - placed, rate.runs)
    late = time - placed
    blocks = max(1, n // max(2, round(8 * rate.longest / rate.period)))
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


_STAMPS = {"uneven": "uneven stamps", "bursts": "stamps that come in bursts", "coarse": "stamps of a coarse clock"}
_SOURCES = {"option": " as requested", "file": " as stated in the file"}
_UNSURE = 0.01
"""A rate by a coarse clock with a larger standard error is an assumption."""
_ALIKE = 0.02
"""Rates of the file and of the stamps that differ by more contradict each other."""


def _about_stamps(rate: SampleRate, sure: str) -> list[str]:
    said = f"{sample_rate(rate.period)}{sure}"
    if rate.stamps == "coarse":
        clock = f"the clock has a resolution of {duration(rate.longest)}"
        said = f"{clock}: samples were placed evenly between its steps, {said}"
        # Rows that were written twice look the same.
        return [Assumption(said) if _UNSURE * rate.period < rate.error < math.inf else said]
    if rate.stamps == "bursts":
        return [f"the stamps come in bursts: samples were placed evenly in time, {said}"]
    if rate.stamps == "uneven" and np.isfinite(rate.error):
        said = f"the stamps are uneven, {said}"
        return [Assumption(said) if rate.error > _UNSURE * rate.period else said]
    unsteady = f"the stamps show no steady rate: the sample period, {duration(rate.period)}, is the median step"
    return [Assumption(unsteady)] if rate.stamps == "uneven" else []


def _about_pauses(time: Array, pauses: Indices, period: float, gaps: Gaps) -> list[str]:
    if not pauses.size:
        return []
    found = "a gap" if pauses.size == 1 else f"{pauses.size} gaps"
    longest = float((time[pauses + 1] - time[pauses]).max())
    said = f"time has {found}, first after sample {int(pauses[0]) + 1}, the longest {duration(longest)}"
    missing = int(missing_rows(time, pauses, period).sum())
    rows = f"{count(missing)} {'row' if missing == 1 else 'rows'}"
    advice = f"--gaps missing (adds {rows} of missing samples) or --gaps dt (elapsed time)"
    if missing > len(time):
        advice = f"--gaps dt (elapsed time): --gaps missing would add {rows} of missing samples"
    return [f"{said}; read it with {advice}" if gaps == "rows" else said]


# From stamps to the time of the samples: wraps are undone, steps are judged, every decision is noted.


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
    stated, unit_words = True, ""
    stamps, wrapped = unwrap(stamps, column)
    if column.kind == "number":
        stated = bool(unit or column.unit)
        unit = unit or column.unit or _unit_by_period(stamps, given.file)
        column = replace(column, unit=unit or unit_by_magnitude(stamps, printed=column.printed))
        unit_words = column.unit + "s" * (column.unit in ("day", "year")) + " (assumed)" * (not stated)
    time, how = to_seconds(stamps, column, start, stated=stated)
    rate = find_rate(time)
    crowded = rate is not None and rate.stamps in ("coarse", "bursts")
    steps = np.diff(time) if rate is None else rate.steps.all
    backward = int(np.count_nonzero(steps < 0)) if steps.size and float(steps.min()) < 0 else 0
    notes = [Assumption(wrapped), how] if wrapped else [how]
    notes += _about_order(time, steps, backward, repeated=not crowded)
    if rate is None:  # all stamps are one step of a coarse clock, or they step back
        axis = counted_time(len(time), given)
        time = time[0] + axis.time if given.file and len(time) > 1 and not backward else time
        return replace(axis, time=time, backward=backward, notes=(*notes, *axis.notes))
    if (why := _no_time(rate)) is not None:
        axis = counted_time(len(time), given)
        return replace(axis, notes=(*notes, Assumption(f"{why}: the samples were counted"), *axis.notes))
    pauses = rate.pauses
    if crowded:
        time = place_evenly(time, rate)
    elif given.option is not None:
        pauses = np.flatnonzero(rate.steps.forward > GAP_PERIODS * given.option)
    timing, about = _timing(rate, pauses, given)
    about += _about_pauses(time, pauses, timing.period or rate.period, gaps)
    return TimeAxis(time, timing, pauses, backward, (*notes, *about), unit_words)


def _no_time(rate: SampleRate) -> str | None:
    """Why the stamps give no time: their steps are of all sizes, three powers of ten or more, or not of a time."""
    if not PERIODS[0] <= rate.period <= PERIODS[1]:
        return f"the stamps are {rate.period:.3g} s apart, which is not a time"
    positive = rate.steps.all[rate.steps.all > 0]
    if positive.size < 20:
        return None
    low, high = (duration(float(step)) for step in np.quantile(rate.steps.all, (0.1, 0.9)))
    said = f"the stamps have no rate, as where only changes are logged (most steps lie between {low} and {high})"
    if np.isfinite(rate.error):
        may_be = rate.stamps in ("uneven", "bursts")
        return said if may_be and _are_independent(np.delete(rate.steps.all, rate.pauses)) else None
    counts = np.unique(np.floor(np.log10(positive)), return_counts=True)[1]
    if int(np.count_nonzero(counts >= 0.05 * positive.size)) <= 2:
        return None
    return said


def _are_independent(steps: Array) -> bool:
    """True where steps of many sizes add up as independent ones do: no later row makes up for a long one.

    Of a steady sampling whose rows come late, k steps together miss their mean by no more than one alone does.
    """
    k, spread, usual = min(64, steps.size // 4), float(steps.std()), float(np.median(steps))
    if np.mean(np.abs(steps - usual) <= 0.1 * usual) >= 0.5:
        return False
    sums = np.convolve(steps, np.ones(k), "valid")
    return spread > 0.45 * float(steps.mean()) and float(sums.std()) > 0.55 * math.sqrt(k) * spread


def counted_time(n: int, given: GivenPeriod, start: float | None = None) -> TimeAxis:
    """Time of `n` samples without stamps: by the period that is given, else their numbers.

    Args:
        n: How many.
        given: Sample periods that are known.
        start: When the first sample was taken, in s since 1970; None where that is not known.
    """
    period = given.option or given.file
    time = np.arange(n, dtype=np.float64)
    if period is not None:
        time *= period
    source: RateSource = "option" if given.option else "file" if given.file else "none"
    timing = Timing("none", source, period, summary=sample_rate(period) + _SOURCES[source] if period else "")
    notes = [f"time counts from {date_text(start)}"] if period and start is not None else []
    return TimeAxis(time, timing, np.zeros(0, dtype=np.int64), 0, tuple(notes))


def _timing(rate: SampleRate, pauses: Indices, given: GivenPeriod) -> tuple[Timing, list[str]]:
    """The sample period, and how it was found."""
    own, error = rate.period, rate.error / rate.period if np.isfinite(rate.error) else None
    sure = f", standard error {percent(error)}" if error and error > 1e-4 else ""
    notes, period, source = _about_stamps(rate, sure), own, "stamps"
    if given.option is not None:
        period, source = given.option, "option"
    elif given.file is not None and _supports(rate, given.file):
        period, source = given.file, "file"
        notes.append(f"the sample rate is the one that the file gives, {sample_rate(period)}")
    elif given.file is not None and abs(given.file - own) > _ALIKE * own:
        notes.append(
            f"the file gives a sample rate of {sample_rate(given.file)}, but its stamps give {sample_rate(own)}:"
            " the stamps were used; --rate chooses the other"
        )
    found = f" from {_STAMPS[rate.stamps]}{sure}" if rate.stamps in _STAMPS else sure
    how = _SOURCES.get(source, found)
    summary = sample_rate(period) + how
    return Timing(rate.stamps, source, period, error, own, int(pauses.size), summary), notes


def _supports(rate: SampleRate, stated: float) -> bool:
    """True where the stamps leave the period open, and the one that the file states, in s, may be it.

    It lies between the median and the mean step where the stamps come at no steady rate: late rows and lost samples
    lengthen the mean, bursts shorten the median.
    """
    if rate.stamps in ("even", "uneven") and np.isfinite(rate.error):
        return False
    steps, is_known = rate.steps.all, np.isfinite(rate.error)
    low, high = sorted((rate.period, rate.period if is_known else float(steps[steps >= 0].mean())))
    margin = max(_ALIKE * stated, 3 * rate.error if is_known else rate.longest / len(steps))
    return low - margin <= stated <= high + margin


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
