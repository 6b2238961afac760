"""The sample period by the stamps: what the steps look like, the pauses, the jitter."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from kalscope.common.numbers import Array, Indices, Mask
from kalscope.common.text import percent, sample_rate
from kalscope.recording import Recording, Stamps

# Stretches of a recording without pauses: where they end, and the straight line through the stamps of each.


_Value = TypeVar("_Value", bound=np.generic)

_WINDOW_CELLS = 1 << 20
_MAX_LATE_ROWS = 1024
"""A delivery that is later than this many samples is a pause."""
_MIN_BLOCKS = 8
_BLOCKS = 32
"""The error of a rate is judged by how much it differs between this many parts of the recording."""


@dataclass(frozen=True)
class Stretches:
    """Runs of samples between pauses and steps back."""

    starts: Indices
    """First sample of each run, from 0, shape (runs,)."""
    sizes: Indices
    """Samples in each run, shape (runs,)."""

    def spread(self, values: NDArray[_Value]) -> NDArray[_Value]:
        """One value per run to one per sample, shape (n,)."""
        return np.repeat(values, self.sizes)


def split(n: int, ends: Indices) -> Stretches:
    """Stretches of `n` samples of which those at `ends`, in rising order, are each the last of one."""
    starts = np.concatenate(([0], ends + 1)).astype(np.int64)
    return Stretches(starts, np.diff(np.append(starts, n)))


def lasting_steps(time: Array, steps: Array, candidates: Indices, period: float, rows: int) -> Indices:
    """Those of the long steps that no later row makes up for, as a late delivery is made up for.

    The rows after a late delivery come faster than the samples were taken. After a pause all rows are later.

    Args:
        time: Stamps in s, shape (n,).
        steps: Length of each step in s, shape (n - 1,).
        candidates: Steps to be judged, from 0 and in rising order, shape (k,).
        period: Sample period in s.
        rows: How many rows hold a usual delivery; after a longer step as many as are due are looked at.
    """
    if not candidates.size:
        return candidates
    time = np.maximum.accumulate(time)  # a row that is out of order makes up for nothing
    # In all, no more rows are looked at than a few times those of the recording.
    most = max(rows, min(_MAX_LATE_ROWS, 16 * len(time) // candidates.size))
    due = np.clip(np.ceil(steps[candidates] / period) + 2, rows, most)
    # Steps of about the same length are judged together.
    groups = np.ceil(np.log2(due)).astype(np.int64)
    lasting = np.zeros(candidates.size, dtype=bool)
    for group in range(int(groups.min()), int(groups.max()) + 1):
        members = np.flatnonzero(groups == group)
        part = max(1, _WINDOW_CELLS >> group)
        for start in range(0, members.size, part):
            some = members[start : start + part]
            at = candidates[some, None]
            before, after = at - np.arange(rows), at + 1 + np.arange(1 << group)
            lasting[some] = _least(time, after, period) - _least(time, before, period) > 0.5 * (
                steps[candidates[some]] - period
            )
    return candidates[lasting]


def _least(time: Array, rows: Indices, period: float) -> Array:
    """How little the stamps are late in each line of `rows`, s, shape (lines,)."""
    rows = np.clip(rows, 0, len(time) - 1)
    return np.min(time[rows] - period * rows, axis=1)


def pooled_slope(time: Array, index: Indices, stretches: Stretches, usual_rows: float) -> float | None:
    """Seconds per sample: the slopes of the lines through the stamps of each stretch, weighed by length.

    Stretches shorter than a few times `usual_rows`, the rows of one delivery, weigh less still: their slope
    depends on where they begin. `index` is the number of each sample, shape (n,).
    """
    starts, sizes = stretches.starts, stretches.sizes.astype(np.float64)
    x = (index - stretches.spread(index[starts])).astype(np.float64)
    t = time - stretches.spread(time[starts])
    sum_x, sum_t = (np.add.reduceat(values, starts) for values in (x, t))
    t *= x
    together = np.add.reduceat(t, starts) - sum_x * sum_t / sizes
    x *= x
    spread = np.add.reduceat(x, starts) - sum_x * sum_x / sizes
    known = spread > 0
    if not known.any():
        return None
    slopes = together[known] / spread[known]
    length = np.sqrt(12.0 * spread[known] / sizes[known])
    weight = length**3 / (length**2 + (8.0 * usual_rows) ** 2)
    return float(np.sum(weight * slopes) / np.sum(weight))


def slope_error(time: Array, stretches: Stretches) -> float:
    """Standard error of the slope in s, by how much it differs between parts of the stretches; inf if unknown."""
    steps = int(stretches.sizes.sum()) - len(stretches.sizes)
    usual = float(np.median(stretches.spread(stretches.sizes)))
    rows = int(max(1, min(steps // _BLOCKS, usual // 3)))
    while True:
        parts = _block_steps(time, stretches, rows)
        if parts.size >= _MIN_BLOCKS or rows == 1:
            break
        rows = max(1, rows // 2)
    if parts.size < 2:
        return np.inf
    # Means of blocks of a random walk differ by 2/3 of what its end points do; a line through it loses 1.2.
    return float(np.sqrt(1.2 * 1.5 * np.var(parts, ddof=1) / (rows * steps)))


def _block_steps(time: Array, stretches: Stretches, rows: int) -> Array:
    """Steps between the mean stamps of blocks of `rows` samples that follow each other in a stretch."""
    local = np.arange(len(time)) - stretches.spread(stretches.starts)
    whole = stretches.spread(stretches.sizes // rows * rows)
    kept = np.flatnonzero(local < whole)
    first = kept[local[kept] % rows == 0]
    if not first.size:
        return np.zeros(0)
    origin = stretches.spread(time[stretches.starts])[kept]
    means = (time[kept] - origin).reshape(-1, rows).mean(axis=1)
    run = stretches.spread(np.arange(len(stretches.sizes)))[first]
    return np.diff(means)[np.diff(run) == 0]


# What the steps between stamps look like: a step per sample, a coarse clock, bursts, or samples that are lost.


GAP_PERIODS = 1.5 * (1 + 1e-6)
"""A step longer than this many sample periods may be a gap: at least one sample is missing. 3 ms is 1.5 × 2 ms."""

_SOME_STEPS = 200_000
"""Spread and resolution are judged on at most this many steps, evenly chosen."""
_EVEN = 0.01
"""Steps this close to each other, as a share of the median step, are even."""
_MIN_RECURRENCES = 5
"""Fewest long steps that show whether they come regularly."""
_REGULAR = 0.35
"""Eight of ten distances between long steps are this close, as a share of their median, where they are regular."""
_MAX_BURST_ROWS = 64
"""More rows than this, evenly stamped between two long steps, are not a burst but a logger that pauses."""
_MAX_BURST_STEP = 0.1
"""Rows that come slower than this, s, do not come in a burst."""
_GRID_TICKS = 10
"""A step of at least this many clock ticks shows whether longer ones are its multiples."""
_MIN_REPEATS = 0.15
"""Least share of stamps that repeat the one before where the clock is coarse even if they come irregularly."""
_FEW_REPEATS = 0.03
"""Fewer than this are samples that were written twice."""


@dataclass(frozen=True)
class Steps:
    """The steps between stamps, in s, and their most used statistics."""

    all: Array
    """Each step, shape (n - 1,)."""
    forward: Array
    """Each step from the latest stamp so far: going forward again after a step back is not a gap."""
    median: float
    """Median positive step, to 9 digits."""
    low: float
    """The 5th percentile."""
    high: float
    """The 95th percentile."""

    @property
    def even(self) -> bool:
        """True where nine of ten steps are alike."""
        return self.high - self.low <= _EVEN * self.median


def steps_of(time: Array) -> Steps | None:
    """The steps of `time`, shape (n,); None where none is positive."""
    steps = np.diff(time)
    median = median_step(steps.copy())
    if median is None:
        return None
    forward = steps
    if float(steps.min()) < 0:
        forward = time[1:] - np.maximum.accumulate(time)[:-1]
    some = np.sort(_some(steps))
    low, high = (float(some[round(share * (some.size - 1))]) for share in (0.05, 0.95))
    return Steps(steps, forward, median, low, high)


def median_step(steps: Array) -> float | None:
    """Median positive step in s; None where none is positive. Reorders `steps`."""
    positive = steps if steps.size and float(steps.min()) > 0 else steps[steps > 0]
    if positive.size == 0:
        return None
    # The stamps were decimal text: 0.02 - 0.01 is 0.01 within 1e-9, not 0.010000000000000002.
    return float(f"{np.median(positive, overwrite_input=True):.9g}")


def is_coarse(steps: Steps) -> bool:
    """True where stamps repeat because the clock is coarser than the sample period: all its steps are alike."""
    positive = steps.all[steps.all > 0]
    repeats = np.flatnonzero(steps.all == 0)
    share = repeats.size / steps.all.size
    regular = share >= _FEW_REPEATS and repeats.size >= _MIN_RECURRENCES and _regular(np.diff(repeats))
    if share < _MIN_REPEATS and not regular:
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
    few_back = bool(np.count_nonzero(usual <= 0) <= 0.05 * usual.size)
    return few_back and _on_grid(usual[usual > 0], median)


def returns_to_grid(steps: Steps) -> bool:
    """True where most steps are alike and the others add up to them: single samples in between, or lost."""
    median = steps.median
    off = np.abs(steps.all - median) > _EVEN * median
    if np.count_nonzero(off) > 0.25 * off.size or median < 1.5 * _resolution(steps):
        return False
    edges = np.flatnonzero(np.diff(np.concatenate(([False], off, [False])).astype(np.int8)))
    starts, ends = edges[::2], edges[1::2]
    if not starts.size:
        return True
    total = np.concatenate(([0.0], np.cumsum(steps.all)))
    sums = (total[ends] - total[starts]) / median
    back = np.abs(sums - np.maximum(np.rint(sums), 1.0)) <= 2 * _EVEN
    return bool(np.count_nonzero(back) >= 0.9 * back.size)


def long_steps_recur(steps: Steps) -> bool:
    """True where long steps come so regularly that they show how rows are delivered, not that some are missing."""
    median = steps.median
    long = steps.forward > GAP_PERIODS * median
    where = np.flatnonzero(long)
    if where.size < _MIN_RECURRENCES:
        return False
    lengths, rows = steps.forward[where], np.diff(where)
    usual, fine = float(np.median(lengths)), median >= _GRID_TICKS * _resolution(steps)
    ordinary = np.where(steps.all > 2.5 * usual, median, np.maximum(steps.all, 0.0))
    if _made_up_for(ordinary, 4 * float(np.median(rows))):
        return not _sleeps(steps, long, rows, usual)
    if fine and _on_grid(lengths, median):
        return False  # lost samples of an even series
    # Of samples lost at random some are neighbours; of a coarse clock's steps hardly any is two samples too long.
    neighbours = where.size**2 / steps.all.size
    if not fine and neighbours >= 10 and np.count_nonzero(lengths > 2.5 * median) < 0.3 * neighbours:
        return True
    share = float(lengths.sum()) / float(steps.forward[steps.forward > 0].sum())
    recurs = _regular(rows) or (share > 0.5 and usual > 3 * median)
    return recurs and not _sleeps(steps, long, rows, usual)


def _sleeps(steps: Steps, long: Mask, rows: Indices, usual: float) -> bool:
    """True for a logger that records for a while, evenly, and then sleeps."""
    inner = np.sort(_some(steps.all[~long]))
    width = inner[round(0.95 * (inner.size - 1))] - inner[round(0.05 * (inner.size - 1))]
    slow = steps.median >= _MAX_BURST_STEP and usual >= 3 * steps.median
    return bool(width <= _EVEN * steps.median and (np.median(rows) > _MAX_BURST_ROWS or slow))


def _made_up_for(steps: Array, rows: float) -> bool:
    """True where a long step comes after short ones, as on a coarse clock: lost samples come at random."""
    size = int(max(8, min(rows, steps.size // 16)))
    sums = steps[: steps.size // size * size].reshape(-1, size).sum(axis=1)
    most = 0.3 if sums.size < 64 else 0.5
    return sums.size >= 16 and float(np.var(sums)) < most * size * float(np.var(steps))


def _regular(rows: Indices) -> bool:
    low, middle, high = np.quantile(rows, (0.1, 0.5, 0.9))
    return bool(high - low <= max(1.0, _REGULAR * middle))


def _on_grid(steps: Array, median: float) -> bool:
    """True where nearly all steps are multiples of the median one."""
    some = _some(steps) / median
    return bool(np.count_nonzero(np.abs(some - np.rint(some)) <= 0.15) >= 0.95 * some.size)


def _resolution(steps: Steps) -> float:
    """Least difference between two steps that differ: the step of the clock, or less."""
    unit = 1e-6 * steps.median
    between = np.diff(np.sort(np.append(np.rint(_some(steps.all) / unit), 0.0)))
    return float(np.min(between[between > 0], initial=np.inf)) * unit


def _some(steps: Array) -> Array:
    return steps[:: max(1, steps.size // _SOME_STEPS)]


# The sample period by the stamps, and the pauses: robust against jitter, bursts, coarse clocks and lost samples.
#
# A line through the stamps against the sample number is not bent by stamps that are late for a while: rows that
# come in bursts, and clocks that show whole seconds, have its slope. Pauses bend it, so a recording is split there.


_SANE = (1e-100, 1e100)
"""Steps and stamps in s whose squares are still numbers."""
_NO_PAUSES = np.zeros(0, dtype=np.int64)
_MIN_CHANGES = 3
"""Fewest changes of a coarse clock that show its rate."""
_STEADY = 0.1
"""Width of the middle half of the spacings of blocks, as a share of their median, where rows come steadily."""
_BURST_SHARE = 2 / 3
"""Where more of the time passes in steps longer than 1.5 periods, the rows come in bursts."""


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
    stretches: Stretches
    """The samples between pauses and steps back."""
    steps: Steps
    """The steps between the stamps."""
    longest: float
    """The longest usual step in s: that of a coarse clock, the time between two deliveries, or the period."""


@dataclass(frozen=True)
class _Guess:
    """A first guess that shows which steps are pauses."""

    stamps: Stamps
    period: float
    usual: float
    """The longest usual step in s."""
    shortest_pause: float
    """Longer steps may be pauses, s."""


def find_rate(time: Array) -> SampleRate | None:
    """Sample period and pauses of the stamps `time` in s, shape (n,); None where no step is positive."""
    steps = steps_of(time)
    if steps is None:
        return None
    median = steps.median
    if not (_SANE[0] < median and float(np.max(np.abs(time))) < _SANE[1]):
        return _unsteady(time, steps)
    if (modal := _modal(time, steps)) is not None:
        return SampleRate("uneven", modal, 0.0, _NO_PAUSES, split(len(time), _NO_PAUSES), steps, modal)
    recur = long_steps_recur(steps)
    if not recur and (_is_even(steps) or returns_to_grid(steps)):
        return _with_median(time, steps, "even" if steps.even else "uneven")
    guess = _guess(time, steps, recur=recur)
    if guess is None:
        return _unsteady(time, steps)
    return _fitted(time, steps, guess)


def _modal(time: Array, steps: Steps) -> float | None:
    """The usual step, where rows that wait and then come at once make up for each other; None elsewhere.

    Most steps are it, hardly any is near it, which would be jitter, and so many steps explain the whole span.
    """
    usual, span = steps.median, float(time[-1] - time[0]) / (len(time) - 1)
    if steps.even or abs(span - usual) > 0.05 * usual:
        return None
    off = np.abs(steps.all - usual)
    exact, near = (float(np.mean(off <= share * usual)) for share in (0.02, 0.5))
    if exact < 0.5 or near - exact > 0.05:
        return None
    return usual if float(np.mean(steps.all < 0.5 * usual)) > 0.02 else None


def _unsteady(time: Array, steps: Steps) -> SampleRate:
    """There is no scale at which the rows come steadily: the usual step is all that is known."""
    whole = split(len(time), _NO_PAUSES)
    return SampleRate("uneven", steps.median, math.inf, _NO_PAUSES, whole, steps, steps.median)


def _is_even(steps: Steps) -> bool:
    """Even, and the few steps that differ do not show that the true period is another one."""
    if not steps.even:
        return False
    usual = steps.all[(steps.all >= 0) & (steps.all <= GAP_PERIODS * steps.median)]
    return abs(float(usual.mean()) - steps.median) <= 0.005 * steps.median


def _with_median(time: Array, steps: Steps, stamps: Stamps) -> SampleRate:
    median = steps.median
    pauses = np.flatnonzero(steps.forward > GAP_PERIODS * median)
    pauses = lasting_steps(time, steps.all, pauses, median, 4)
    return SampleRate(stamps, median, 0.0, pauses, _stretches(steps, pauses, median), steps, median)


def _guess(time: Array, steps: Steps, *, recur: bool) -> _Guess | None:
    median = steps.median
    if is_coarse(steps):
        changes = np.flatnonzero(steps.all > 0)
        period = median * (changes.size - 1) / max(1, int(changes[-1] - changes[0])) if changes.size > 1 else median
        return _Guess("coarse", period, median, max(GAP_PERIODS * median, median + 2 * period))
    near = steps.all[np.abs(steps.all - median) <= 0.5 * median]
    jitter = float(np.std(near)) if near.size else 0.0
    single = _Guess("uneven", median, median, max(GAP_PERIODS * median, median + 5 * jitter))
    if not recur and one_sample_a_step(steps):
        return single
    scale = _steady_scale(time)
    if scale is None:
        return single if one_sample_a_step(steps, 0.5) else None
    period, rows = scale
    whole = steps.all[: steps.all.size // rows * rows].reshape(-1, rows)
    usual = max(float(np.median(whole.max(axis=1))), period)
    return _Guess("bursts", period, usual, 2.5 * usual)


def _steady_scale(time: Array) -> tuple[float, int] | None:
    """(period, rows): the fewest rows, a power of 2, whose mean stamps come steadily, and their spacing per row.

    Where none do, those that come most steadily, if they do so at all.
    """
    means, rows = time, 1
    best, least = None, 0.35
    while len(means) > 2 * _MIN_BLOCKS:
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
            if least <= _STEADY:
                break
    return best


def _fitted(time: Array, steps: Steps, guess: _Guess) -> SampleRate:
    """Refine the guess: find its pauses, then fit a line to the stamps of each stretch."""
    rows = max(4, math.ceil(2 * guess.usual / guess.period))
    candidates = np.flatnonzero(steps.forward > guess.shortest_pause)
    pauses = lasting_steps(time, steps.all, candidates, guess.period, rows)
    stretches = _stretches(steps, pauses, guess.usual)
    usual_rows = guess.usual / guess.period
    fitted = _slope_of_changes(time, steps, stretches) if guess.stamps == "coarse" else None
    error = slope_error(time, stretches)
    if fitted is not None:
        slope, error = fitted[0], min(fitted[1], error)
    else:
        slope = pooled_slope(time, np.arange(len(time)), stretches, usual_rows)
    if slope is None or slope <= 0:
        slope = guess.period
    if guess.stamps == "uneven" and abs(slope - steps.median) <= 3 * error:
        slope = steps.median  # the usual step agrees
    stamps = guess.stamps
    if stamps == "bursts" and not _in_bursts(steps, pauses, slope):
        stamps = "uneven"
    return SampleRate(stamps, float(f"{slope:.9g}"), error, pauses, stretches, steps, guess.usual)


def _stretches(steps: Steps, pauses: Indices, usual: float) -> Stretches:
    back = np.flatnonzero(steps.all < -2 * usual) if steps.forward is not steps.all else _NO_PAUSES
    return split(steps.all.size + 1, np.union1d(pauses, back))


def _slope_of_changes(time: Array, steps: Steps, stretches: Stretches) -> tuple[float, float] | None:
    """Seconds per sample and their standard error by the first rows of each new stamp; None where there are few.

    The row at which a coarse clock moves on is exact to a sample.
    """
    first = np.concatenate(([False], steps.all > 0))
    first[stretches.starts] = False  # after a pause a stamp may have begun before
    at = np.flatnonzero(first)
    if at.size < _MIN_CHANGES:
        return None
    run = stretches.spread(np.arange(len(stretches.sizes)))[at]
    slope = pooled_slope(time[at], at, split(at.size, np.flatnonzero(np.diff(run))), 0.0)
    same = np.diff(run) == 0
    if slope is None or not same.any():
        return None
    rows = np.diff(at)[same]
    late = np.diff(time[at])[same] - slope * rows
    return slope, math.sqrt(1.2 * (float(np.mean(late**2)) * late.size + slope**2)) / float(rows.sum())


def _in_bursts(steps: Steps, pauses: Indices, period: float) -> bool:
    usual = np.ones(steps.all.size, dtype=bool)
    usual[pauses] = False
    passing = steps.all[usual & (steps.all > 0)]
    return float(passing[passing > GAP_PERIODS * period].sum()) > _BURST_SHARE * float(passing.sum())


# How much the steps of a recording vary: its rate with that jitter, for the screen.


MIN_JITTER = 0.005
"""Steps that vary by a smaller share of the sample period are called even."""


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
    usual = len(steps) - timing.pauses  # the longest steps are the pauses
    if recording.gaps == "missing" or not 0 < usual < len(steps):  # rows were put into the pauses, or there is none
        usual = len(steps)
    return float(np.partition(steps, usual - 1)[:usual].std()) / period


def rate_words(period: float | None, jitter: float) -> str:
    """The rate of one sample every `period` s: "100 Hz", "13.4 Hz, steps ± 12 %", or that it is unknown."""
    if period is None:
        return "sample rate unknown"
    return sample_rate(period) + steps_words(jitter)


def steps_words(jitter: float) -> str:
    """What follows a rate: ", steps ± 12 %"; "" where the steps are even."""
    return f", steps ± {percent(jitter)}" if jitter >= MIN_JITTER else ""
