"""The sample period by the stamps: what the steps look like, the pauses, the jitter."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from kalscope.common.numbers import Array, Indices
from kalscope.common.text import percent, sample_rate
from kalscope.recording import Recording, Stamps

# What the steps between stamps look like: a step per sample, a coarse clock, bursts, or samples that are lost.


GAP_PERIODS = 1.5 * (1 + 1e-6)
"""A step longer than this many sample periods may be a gap: at least one sample is missing. 3 ms is 1.5 × 2 ms."""

_SOME_STEPS = 200_000
"""Spread is judged on at most this many steps, evenly chosen."""
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
    return Steps(steps, forward, median, low, high)


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
    multiples = _some(usual[usual > 0]) / median
    few_back = bool(np.count_nonzero(usual <= 0) <= 0.05 * usual.size)
    return few_back and bool(np.mean(np.abs(multiples - np.rint(multiples)) <= 0.15) >= 0.95)


def long_steps_recur(steps: Steps) -> bool:
    """True where long steps come so regularly that they show how rows are delivered, not that some are missing."""
    where = np.flatnonzero(steps.forward > GAP_PERIODS * steps.median)
    if where.size < _MIN_RECURRENCES:
        return False
    rows = np.diff(where)
    sleeps = steps.median >= _MAX_BURST_STEP and float(np.median(steps.forward[where])) >= 3 * steps.median
    return _regular(rows) and float(np.median(rows)) <= _MAX_BURST_ROWS and not sleeps


def _regular(rows: Indices) -> bool:
    low, middle, high = np.quantile(rows, (0.1, 0.5, 0.9))
    return bool(high - low <= max(1.0, _REGULAR * middle))


def _some(steps: Array) -> Array:
    return steps[:: max(1, steps.size // _SOME_STEPS)]


# Pauses: long steps that no later row makes up for. Without them one line goes through all stamps.


_WINDOW_CELLS = 1 << 20
_MAX_LATE_ROWS = 1024
"""A delivery that is later than this many samples is a pause."""


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
    excess = np.zeros(candidates.size)
    time = np.maximum.accumulate(time)  # a row that is out of order makes up for nothing
    # In all, no more rows are looked at than a few times those of the recording.
    most = max(rows, min(_MAX_LATE_ROWS, 16 * len(time) // candidates.size))
    due = np.clip(np.ceil(steps[candidates] / period) + 2, rows, most)
    # Steps of about the same length are judged together.
    groups = np.ceil(np.log2(due)).astype(np.int64)
    for group in range(int(groups.min()), int(groups.max()) + 1):
        members, window = np.flatnonzero(groups == group), np.arange(1 << group)
        for some in np.array_split(members, 1 + members.size * window.size // _WINDOW_CELLS):
            at = candidates[some, None]
            before, after = at - np.arange(rows), at + 1 + window
            excess[some] = _least(time, after, period) - _least(time, before, period)
    return candidates[excess > 0.5 * (steps[candidates] - period)]


def _least(time: Array, rows: Indices, period: float) -> Array:
    """How little the stamps are late in each line of `rows`, s, shape (lines,)."""
    rows = np.clip(rows, 0, len(time) - 1)
    return np.min(time[rows] - period * rows, axis=1)


# The sample period: robust against jitter, bursts, coarse clocks, pauses and lost samples.
#
# A line through the stamps against the sample number is not bent by stamps that are late for a while: rows that
# come in bursts, and clocks that show whole seconds, have its slope. After a pause it goes on at another level.


_SANE = (1e-100, 1e100)
"""Steps and stamps in s whose squares are still numbers."""
_NO_PAUSES = np.zeros(0, dtype=np.int64)
_MIN_CHANGES = 3
"""Fewest changes of a coarse clock that show its rate."""
_MIN_BLOCKS, _BLOCKS = 8, 32
"""The error of a rate is judged by how much it differs between parts of the recording."""
_STEADY = 0.1
"""Width of the middle half of the spacings of blocks, as a share of their median, where rows come steadily."""
_BURST_SHARE = 2 / 3
"""Where more of the time passes in steps longer than 1.5 periods, the rows come in bursts."""
_NEARLY = 0.1
"""Where the mean step is so close to the usual one, as a share, rows between the others explain the difference."""


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
    """Sample period and pauses of the stamps `time` in s, shape (n,); None where no step is positive.

    The period never exceeds the mean step by more than a tenth: so many rows may come between even ones.
    """
    steps = steps_of(time)
    if steps is None:
        return None
    median, none = steps.median, np.zeros(len(time), dtype=np.int64)
    # There may be no scale at which the rows come steadily: the usual step is all that is known.
    unsteady = SampleRate("uneven", median, math.inf, _NO_PAUSES, steps, median, none)
    if not (_SANE[0] < median and float(np.max(np.abs(time))) < _SANE[1]):
        return unsteady
    if not is_coarse(steps) and _is_modal(time, steps):
        return SampleRate("uneven", median, 0.0, _NO_PAUSES, steps, median, none)
    recur = long_steps_recur(steps)
    if not recur and _is_even(steps):
        return _fitted(time, steps, _Guess("even", median, median, GAP_PERIODS * median))
    guess = _guess(time, steps, recur=recur)
    return unsteady if guess is None else _fitted(time, steps, guess)


def _is_modal(time: Array, steps: Steps) -> bool:
    """True where most steps are alike and a few short ones make up for longer ones, or lie between the others.

    Most steps are the usual one, hardly any is near it, which would be jitter, and so many steps explain the span.
    """
    usual, mean = steps.median, float(time[-1] - time[0]) / (len(time) - 1)
    if steps.even or not (1 - _NEARLY) * usual <= mean <= 1.05 * usual:
        return False
    off = np.abs(steps.all - usual)
    exact, near = (float(np.mean(off <= share * usual)) for share in (0.02, 0.5))
    return exact >= 0.5 and near - exact <= 0.1 and float(np.mean(steps.all < 0.5 * usual)) > 0.02


def _is_even(steps: Steps) -> bool:
    """Even, and the few steps that differ do not show that the true period is another one."""
    if not steps.even:
        return False
    usual = steps.all[(steps.all >= 0) & (steps.all <= GAP_PERIODS * steps.median)]
    return abs(float(usual.mean()) - steps.median) <= 0.005 * steps.median


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
    """Refine the guess: take its pauses and the steps back out, then fit a line to the stamps."""
    rows = max(4, math.ceil(2 * guess.usual / guess.period))
    candidates = np.flatnonzero(steps.forward > guess.shortest_pause)
    pauses = lasting_steps(time, steps.all, candidates, guess.period, rows)
    back = np.flatnonzero(steps.all < -2 * guess.usual) if steps.forward is not steps.all else _NO_PAUSES
    runs = np.zeros(len(time), dtype=np.int64)
    runs[pauses + 1] = 1
    runs[back + 1] = 1
    runs = np.cumsum(runs)
    if guess.stamps == "even":
        return SampleRate("even", guess.period, 0.0, pauses, steps, guess.usual, runs)
    stamps, (slope, late) = guess.stamps, _line(np.arange(len(time)), time, runs)
    error = _slope_error(late)
    # The row at which a coarse clock moves on is exact to a sample; after a pause it may have moved before.
    moves = steps.all > 0
    moves[pauses] = False
    changes = np.flatnonzero(moves) + 1
    if stamps == "coarse" and changes.size > _MIN_CHANGES:
        slope, late = _line(changes, time[changes], runs[changes])
        late = np.diff(late)[np.diff(runs[changes]) == 0]
        spread = math.sqrt(1.2 * (float(late @ late) + slope**2))
        error = min(error, spread / max(1.0, float(changes[-1] - changes[0])))
    if not 0 < slope <= guess.shortest_pause:  # a damaged stamp bends the line beyond all that lies between pauses
        slope, error = guess.period, math.inf
    if stamps == "uneven" and abs(slope - steps.median) <= 3 * error:
        slope = steps.median  # the usual step agrees
    if stamps == "bursts" and not _in_bursts(steps, pauses, slope):
        stamps = "uneven"
    return SampleRate(stamps, float(f"{slope:.9g}"), error, pauses, steps, guess.usual, runs)


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
    rows = max(1, steps // _BLOCKS)
    parts = np.diff(late[: len(late) // rows * rows].reshape(-1, rows).mean(axis=1))
    if parts.size < 2:
        return math.inf
    # Means of blocks of a random walk differ by 2/3 of what its end points do; a line through it loses 1.2.
    return math.sqrt(1.2 * 1.5 * float(np.var(parts, ddof=1)) / (rows * steps))


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
