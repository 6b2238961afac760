"""The compiled loops of the spike-proof fit, nothing else: which samples neither the past nor the future predicts.

One run of the filter over a record, in which the samples beyond the gate change nothing. A spike, or a few side by
side, is refused, and the sample after it is predicted well again. Where more than LONGEST adjacent samples are
refused, the signal has moved: the filter starts again at the first of them, and they count as predicted.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from kalscope.common.compiled import compiled
from kalscope.filtering.kernels import GATE_LIMIT, MISSING, REJECTED, START, step, transition

Array = NDArray[np.float64]

SIGMAS = 4.0
"""Standard deviations from what both sides together predict, beyond which a sample is set aside."""
SIDE_SIGMAS = 3.5
"""Standard deviations from what either side alone predicts: the sample must be beyond that on both."""
LONGEST = GATE_LIMIT
"""Spikes side by side that are recognised, as many as the gate rejects in a row; more of them are a movement."""
AT_END = 2
"""Adjacent spikes that are recognised at either end of the record."""
NEAR = 15
"""Samples on either side of one that show how lively the signal is there."""
MOST = 25.0
"""Limit on the v²/s of one neighbour: a single missed spike does not make the signal lively."""
VERY_LIVELY, CROWDED = 2.0, 0.1
"""Mean v²/s around a sample, and share of the samples there, beyond which it takes SIGMAS times as much again:
what looks like several spikes may be movement."""
MIN_RUNS = 6
"""Number of runs of spikes, of any length, from which those of more than two samples are accepted."""
LIVELY = 1.5
"""Mean v²/s of the samples around one from which the signal counts as lively; of normal noise it is 1 or less."""
START_SIGMAS = 3.0
"""Distance from the centred median, in standard deviations of the noise, at which the search starts."""
WINDOW = 2 * LONGEST + 1
"""Samples of the centred median: spikes side by side are fewer than half of them."""
FALSE_ALARM = 1e-3
"""Share of records of normal noise in which a spike is found."""
NORMAL = 1.8
"""Standard deviation of white normal noise over the median of its distances from the centred median. It is not
1.48: a sample that is the median itself has the distance 0. Where the signal moves fast it is larger."""
EQUAL_SHARE = 0.2
"""Share of readings equal to the one before from which the record is called quantised."""


@compiled()
def judge_samples(
    z: Array,
    dt: Array,
    q: float,
    r: float,
    tau: float | None,
    start: tuple[float, float],
    error: Array,
    variance: Array,
    refused: NDArray[np.bool_],
) -> None:
    """Write v and s of each sample, and whether it is refused; LONGEST may be refused side by side.

    `z` holds NaN where missing, `dt` may be empty, `tau` None is the filter without momentum, and `start` the level
    before the first sample and its variance. Samples refused before one is taken have no past to be predicted from:
    s = inf. More than AT_END rejected samples at the end may be a step, and count as predicted.
    """
    n, regular = z.shape[0], dt.shape[0] == 0
    last = 1.0
    over = transition(last, q, tau)
    w = 0.0
    if tau is not None:
        w = 0.5 * q / tau
    state = (start[0], 0.0, start[1], 0.0, w)
    first = run = taken = i = 0
    while i < n:
        if not regular and dt[i] != last:
            last = dt[i]
            over = transition(last, q, tau)
        state, _, _, v, s, done = step(z[i], over, r, SIDE_SIGMAS**2, state, 0, tau)
        refused[i] = done == REJECTED
        if done == REJECTED:
            first = i if run == 0 else first
            run += 1
        elif done != MISSING:
            run = 0
            taken += 1
        if done != START:
            error[i], variance[i] = 0.0 if done == MISSING else v, math.inf if refused[i] and taken == 0 else s
        if run > LONGEST:
            refused[first : i + 1] = False
            state, run, i = (math.nan, 0.0, math.inf, 0.0, w), 0, first
            continue
        i += 1
    if run > AT_END:
        refused[first:] = False


@compiled()
def suspect_each(
    values: Array,
    steps: Array,
    starts: NDArray[np.int64],
    ends: NDArray[np.int64],
    q: Array,
    r: Array,
    suspect: NDArray[np.bool_],
) -> None:
    """Write whether each series with q and r, unit², may have spikes; those whose q and r are both 0 do not."""
    for i in range(q.shape[0]):
        here = slice(starts[i], ends[i])
        suspect[i] = q[i] + r[i] > 0.0 and is_suspect(
            values[here], steps[here] if len(steps) else steps, q[i], r[i]
        )


@compiled()
def is_suspect(z: Array, steps: Array, q: float, r: float) -> bool:
    """Whether one series may have spikes."""
    samples = z[np.isfinite(z)]
    if repeats(samples):
        return True
    away, scale = distances_from_median(samples)
    if scale == 0.0:
        return bool(away.any())
    return beyond_chance(away / scale, START_SIGMAS) or beyond_chance(
        np.sqrt(unpredicted(z, steps, q, r, None)), SIGMAS
    )


@compiled()
def repeats(samples: Array) -> bool:
    """Whether so many readings equal the one before that steps of the readings count too."""
    equal = 0
    for i in range(1, samples.shape[0]):
        equal += samples[i] == samples[i - 1]
    return equal > EQUAL_SHARE * (samples.shape[0] - 1)


@compiled()
def far_each(values: Array, starts: NDArray[np.int64], far: NDArray[np.bool_], repeated: NDArray[np.bool_]) -> None:
    """Write which samples of each series are far from the centred median, and whether its readings repeat."""
    for i in range(repeated.shape[0]):
        z = values[starts[i] : starts[i + 1]]
        samples = z[np.isfinite(z)]
        repeated[i] = repeats(samples)
        away, scale = distances_from_median(samples)
        if scale == 0.0 and away.any():
            scale = np.median(away[away > 0.0])
        k = 0
        for j in range(z.shape[0]):
            present = not math.isnan(z[j])
            far[starts[i] + j] = present and away[k] > START_SIGMAS * scale
            k += present


@compiled()
def unpredicted_each(
    values: Array, steps: Array, starts: NDArray[np.int64], q: Array, r: Array, scores: Array
) -> None:
    """Write `unpredicted` of each series."""
    for i in range(q.shape[0]):
        here = slice(starts[i], starts[i + 1])
        scores[here] = unpredicted(values[here], steps[here] if len(steps) else steps, q[i], r[i], None)


@compiled()
def beyond_chance(distances: Array, least: float) -> bool:
    """Whether more distances, in standard deviations, exceed `least` than by chance, or one exceeds it by far."""
    n = distances.shape[0]
    expected = n * math.erfc(least / math.sqrt(2.0))
    many, largest = 0, 0.0
    for distance in distances:
        many += distance > least
        largest = max(largest, distance)
    far = n * math.erfc(largest / math.sqrt(2.0)) < FALSE_ALARM * (1.0 + 1e-9)
    return far or many > expected + 4.0 * math.sqrt(expected) + 2.0


@compiled()
def distances_from_median(samples: Array) -> tuple[Array, float]:
    """|sample − median of the WINDOW around it|, shape (n,), and the noise that they show.

    The ends are continued with their last value.
    """
    n, half = samples.shape[0], WINDOW // 2
    window, away = np.empty(WINDOW), np.empty(n)
    for j in range(WINDOW):
        insert(window, j, samples[min(max(j - half, 0), n - 1)])
    for i in range(n):
        away[i] = abs(samples[i] - window[half])
        leaving, coming = samples[max(i - half, 0)], samples[min(i + half + 1, n - 1)]
        j = 0
        while window[j] != leaving:
            j += 1
        while j < WINDOW - 1 and window[j + 1] < coming:
            window[j] = window[j + 1]
            j += 1
        while j > 0 and window[j - 1] > coming:
            window[j] = window[j - 1]
            j -= 1
        window[j] = coming
    return away, NORMAL * np.median(away)


@compiled(error_model="numpy")
def unpredicted(z: Array, steps: Array, q: float, r: float, tau: float | None) -> Array:
    """e²/s of each sample that neither side predicts, by both sides together, shape (n,); 0 for all others."""
    n = z.shape[0]
    back = np.empty(steps.shape[0])
    for i in range(steps.shape[0]):
        back[i] = 1.0 if i == 0 else steps[n - i]
    v, s, refused = np.empty((2, n)), np.empty((2, n)), np.empty((2, n), np.bool_)
    turned = np.empty(n)
    for i in range(n):
        turned[i] = z[n - 1 - i]
    judge_samples(z, steps, q, r, tau, start_of(z, steps, q, r), v[0], s[0], refused[0])
    judge_samples(turned, back, q, r, tau, start_of(turned, back, q, r), v[1], s[1], refused[1])
    found, any_found = np.zeros(n), False
    for i in range(n):
        j = n - 1 - i
        if not math.isnan(z[i]) and refused[0, i] and refused[1, j]:
            p, other = s[0, i] - r, s[1, j] - r
            least, most = min(p, other), max(p, other)
            share = 0.5 if least == most else 1.0 / (1.0 + least / most)  # of the side that knows more
            first = share if p == least else 1.0 - share
            found[i] = (first * v[0, i] + (1.0 - first) * v[1, j]) ** 2 / (r + share * least)
            any_found = any_found or found[i] > SIGMAS**2
    if any_found:
        clear_lively(z, v, s, refused, found)
    return found


@compiled(error_model="numpy")
def clear_lively(z: Array, v: Array, s: Array, refused: NDArray[np.bool_], found: Array) -> None:
    """Set what may be movement to 0 in `found`: in a lively or crowded neighbourhood, or a lone pulse."""
    n = z.shape[0]
    squares, spikes, counted = np.zeros(n), np.zeros(n), np.zeros(n, np.bool_)
    present, kept = np.zeros(n, np.bool_), np.zeros(n, np.bool_)
    for i in range(n):
        j = n - 1 - i
        counted[i] = not (math.isnan(z[i]) or (refused[0, i] and refused[1, j]))
        if counted[i]:
            squares[i] = min(v[0, i] * v[0, i] / s[0, i], v[1, j] * v[1, j] / s[1, j], MOST)
    for i in range(n):
        lively = mean_near(squares, counted, i) if found[i] > 0.0 else 0.0
        kept[i] = found[i] > SIGMAS**2 * (lively if lively > LIVELY else 1.0)
    for i in range(n):
        spikes[i], present[i] = 1.0 if kept[i] else 0.0, not math.isnan(z[i])
    for i in range(n):
        if kept[i]:
            lively = mean_near(squares, counted, i)
            if lively > VERY_LIVELY and mean_near(spikes, present, i) > CROWDED:
                kept[i] = found[i] > SIGMAS**4 * lively
    clear_pulses(present, kept)
    for i in range(n):
        if not kept[i]:
            found[i] = 0.0


@compiled()
def mean_near(values: Array, counted: NDArray[np.bool_], at: int) -> float:
    """Mean of the values that count within NEAR samples of one; 0 where there are none."""
    total, count = 0.0, 0
    for i in range(max(at - NEAR, 0), min(at + NEAR + 1, values.shape[0])):
        if counted[i]:
            total += values[i]
            count += 1
    return total / max(count, 1)


@compiled()
def clear_pulses(present: NDArray[np.bool_], kept: NDArray[np.bool_]) -> None:
    """Drop the runs of more than two samples where there are few runs: the signal has moved, and come back."""
    runs, before = 0, False
    for i in range(kept.shape[0]):
        if present[i]:
            runs += kept[i] and not before
            before = kept[i]
    if runs >= MIN_RUNS:
        return
    first = length = 0
    for i in range(kept.shape[0] + 1):
        if i < kept.shape[0] and (kept[i] or not present[i]):
            first = i if length == 0 else first
            length += kept[i]
            continue
        if length > 2:
            for j in range(first, i):
                kept[j] = False
        length = 0


@compiled()
def start_of(z: Array, steps: Array, q: float, r: float) -> tuple[float, float]:
    """A level for the first sample, and its variance: the sample itself may be a spike."""
    near, count, first, last = np.empty(WINDOW), 0, 0, 0
    for i in range(z.shape[0]):
        if count < WINDOW and not math.isnan(z[i]):
            insert(near, count, z[i])
            first = i if count == 0 else first
            last = i
            count += 1
    span = float(last - first)
    if steps.shape[0]:
        span = 0.0
        for i in range(first + 1, last + 1):
            span += steps[i]
    return 0.5 * (near[(count - 1) // 2] + near[count // 2]), r + q * span


@compiled()
def insert(values: Array, count: int, value: float) -> None:
    """Put a value into its place among the first `count`, which rise; to sort takes seconds to compile."""
    i = count
    while i > 0 and values[i - 1] > value:
        values[i] = values[i - 1]
        i -= 1
    values[i] = value
