"""The compiled search for spikes in many series, nothing else: those certain to have none need no spike-proof fit.

The tests are those of `robust.spikes`, one for one, for records whose readings do not repeat.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from kalscope.common.compiled import compiled
from kalscope.estimation.robust.kernels import judge_samples

Array = NDArray[np.float64]

SIGMAS, SIDE_SIGMAS, LONGEST, START_SIGMAS, WINDOW, NORMAL, EQUAL_SHARE = 4.0, 3.5, 5, 3.0, 11, 1.8, 0.2
NEAR, MOST, VERY_LIVELY, CROWDED, MIN_RUNS = 15, 25.0, 2.0, 0.1, 6
FALSE_ALARM = 1e-3
"""As in `robust.spikes`; a test checks that they are equal."""


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
    away = distances_from_median(samples)
    scale = NORMAL * np.median(away)
    if scale == 0.0:
        return bool(away.any())
    return beyond_chance(away / scale, START_SIGMAS) or beyond_chance(np.sqrt(unpredicted(z, steps, q, r)), SIGMAS)


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
        present = np.isfinite(z)
        samples = z[present]
        repeated[i] = repeats(samples)
        away = distances_from_median(samples)
        scale = NORMAL * np.median(away)
        if scale == 0.0 and away.any():
            scale = np.median(away[away > 0.0])
        k = 0
        for j in range(z.shape[0]):
            far[starts[i] + j] = present[j] and away[k] > START_SIGMAS * scale
            k += present[j]


@compiled()
def unpredicted_each(
    values: Array, steps: Array, starts: NDArray[np.int64], q: Array, r: Array, scores: Array
) -> None:
    """Write `unpredicted` of each series."""
    for i in range(q.shape[0]):
        here = slice(starts[i], starts[i + 1])
        scores[here] = unpredicted(values[here], steps[here] if len(steps) else steps, q[i], r[i])


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
def distances_from_median(samples: Array) -> Array:
    """|sample − median of the WINDOW around it|, shape (n,); the ends are continued with their last value."""
    n, half = samples.shape[0], WINDOW // 2
    window, away = np.empty(WINDOW), np.empty(n)
    for j in range(WINDOW):
        window[j] = samples[min(max(j - half, 0), n - 1)]
    window.sort()
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
    return away


@compiled(error_model="numpy")
def unpredicted(z: Array, steps: Array, q: float, r: float) -> Array:
    """e²/s of each sample that neither side predicts, by both sides together, shape (n,); 0 for all others."""
    n = z.shape[0]
    back = np.empty(steps.shape[0])
    for i in range(steps.shape[0]):
        back[i] = 1.0 if i == 0 else steps[n - i]
    v, s, refused = np.empty((2, n)), np.empty((2, n)), np.empty((2, n), np.bool_)
    turned = z[::-1].copy()
    gate = SIDE_SIGMAS**2
    judge_samples(z, steps, q, r, None, gate, start_of(z, steps, q, r), LONGEST, v[0], s[0], refused[0])
    judge_samples(turned, back, q, r, None, gate, start_of(turned, back, q, r), LONGEST, v[1], s[1], refused[1])
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
    squares, counted, kept = np.zeros(n), np.zeros(n, np.bool_), np.zeros(n, np.bool_)
    for i in range(n):
        j = n - 1 - i
        counted[i] = not (math.isnan(z[i]) or (refused[0, i] and refused[1, j]))
        if counted[i]:
            squares[i] = min(v[0, i] * v[0, i] / s[0, i], v[1, j] * v[1, j] / s[1, j], MOST)
    for i in range(n):
        lively = mean_near(squares, counted, i) if found[i] > 0.0 else 0.0
        kept[i] = found[i] > SIGMAS**2 * (lively if lively > VERY_LIVELY else 1.0)
    present, spikes = ~np.isnan(z), np.where(kept, 1.0, 0.0)
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
    at = np.flatnonzero(present)
    runs, before = 0, False
    for i in at:
        runs += kept[i] and not before
        before = kept[i]
    if runs >= MIN_RUNS:
        return
    first = 0
    while first < at.shape[0]:
        stop = first
        while stop < at.shape[0] and kept[at[stop]]:
            stop += 1
        if stop - first > 2:
            kept[at[first:stop]] = False
        first = max(stop, first + 1)


@compiled()
def start_of(z: Array, steps: Array, q: float, r: float) -> tuple[float, float]:
    """A level for the first sample, and its variance: the sample itself may be a spike."""
    near, count, first, last = np.empty(WINDOW), 0, 0, 0
    for i in range(z.shape[0]):
        if count < WINDOW and not math.isnan(z[i]):
            near[count] = z[i]
            first = i if count == 0 else first
            last = i
            count += 1
    span = steps[first + 1 : last + 1].sum() if steps.shape[0] else float(last - first)
    return float(np.median(near[:count])), r + q * span
