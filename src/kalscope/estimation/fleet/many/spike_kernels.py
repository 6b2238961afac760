"""The compiled look for spikes in many series, nothing else: those that surely have none need no spike-proof fit.

The tests are those of `robust.spikes`, without what only clears a sample of the suspicion (a lively or crowded
neighbourhood): a series that passes here passes there.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from kalscope.common.compiled import compiled
from kalscope.estimation.robust.kernels import judge_samples

Array = NDArray[np.float64]

SIGMAS, SIDE_SIGMAS, LONGEST, START_SIGMAS, WINDOW, NORMAL, EQUAL_SHARE = 4.0, 3.5, 5, 3.0, 11, 1.8, 0.2
FALSE_ALARM = 1e-3
"""As in `robust.spikes`; a test holds them equal."""


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
    """Write whether each series with q and r, unit², may have spikes; those with neither have not."""
    for i in range(q.shape[0]):
        here = slice(starts[i], ends[i])
        suspect[i] = q[i] + r[i] > 0.0 and is_suspect(
            values[here], steps[here] if len(steps) else steps, q[i], r[i]
        )


@compiled()
def is_suspect(z: Array, steps: Array, q: float, r: float) -> bool:
    """Whether one series may have spikes."""
    samples = z[np.isfinite(z)]
    equal = 0
    for i in range(1, samples.shape[0]):
        equal += samples[i] == samples[i - 1]
    if equal > EQUAL_SHARE * (samples.shape[0] - 1):  # steps of the readings count too
        return True
    away = distances_from_median(samples)
    scale = NORMAL * np.median(away)
    if scale == 0.0:
        return bool(away.any())
    return beyond_chance(away / scale, START_SIGMAS) or beyond_chance(scores(z, steps, q, r), SIGMAS)


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
def scores(z: Array, steps: Array, q: float, r: float) -> Array:
    """Distance of each finite sample from what both sides predict, where neither side alone does, else 0."""
    n = z.shape[0]
    back = np.empty(steps.shape[0])
    for i in range(steps.shape[0]):
        back[i] = 1.0 if i == 0 else steps[n - i]
    v, s, refused = np.empty((2, n)), np.empty((2, n)), np.empty((2, n), np.bool_)
    turned = z[::-1].copy()
    gate = SIDE_SIGMAS**2
    judge_samples(z, steps, q, r, 0.0, gate, start_of(z, steps, q, r), LONGEST, v[0], s[0], refused[0])
    judge_samples(turned, back, q, r, 0.0, gate, start_of(turned, back, q, r), LONGEST, v[1], s[1], refused[1])
    out, count = np.zeros(n), 0
    for i in range(n):
        if math.isnan(z[i]):
            continue
        j = n - 1 - i
        if refused[0, i] and refused[1, j]:
            p, other = s[0, i] - r, s[1, j] - r
            least, most = min(p, other), max(p, other)
            share = 0.5 if least == most else 1.0 / (1.0 + least / most)  # of the side that knows more
            first = share if p == least else 1.0 - share
            score = (first * v[0, i] + (1.0 - first) * v[1, j]) ** 2 / (r + share * least)
            out[count] = math.sqrt(score) if score > SIGMAS**2 else 0.0
        count += 1
    return out[:count]


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
