"""The spike-proof fit: fit, set aside what neither side predicts, fit again."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from kalscope.common.numbers import Array, Indices, Mask
from kalscope.common.progress import Progress
from kalscope.errors import BadSetting
from kalscope.estimation import kernels, verdict
from kalscope.estimation.noise import resolution_of
from kalscope.estimation.result import Estimate
from kalscope.filtering.filter import denoise, smooth
from kalscope.filtering.kernels import GATE_LIMIT
from kalscope.filtering.params import FilterParams
from kalscope.filtering.steady import steady_state

# Which samples of a record are spikes: those that neither the samples before nor those after them predict.
#
# A genuine step is predicted well from the samples after it, and so is a fast movement: both stay.


SIGMAS = 4.0
"""Standard deviations from what both sides together predict, beyond which a sample is set aside."""
NEAR = 15
"""Samples on either side of one that show how lively the signal is there."""
MOST = 25.0
"""Limit on the v²/s of one neighbour: a single missed spike does not make the signal lively."""
LIVELY = 1.5
"""Mean v²/s of the samples around one from which the signal counts as lively; of normal noise it is 1 or less."""
VERY_LIVELY, CROWDED = 2.0, 0.1
"""Mean v²/s around a sample, and share of the samples there, beyond which it takes SIGMAS times as much again:
what looks like several spikes may be movement."""
MIN_RUNS = 6
"""Number of runs of spikes, of any length, from which those of more than two samples are accepted."""
START_SIGMAS = 3.0
"""Distance from the centred median, in standard deviations of the noise, at which the search starts."""
WINDOW = 2 * GATE_LIMIT + 1
"""Samples of the centred median: spikes side by side are fewer than half of them."""
FALSE_ALARM = 1e-3
"""Share of records of normal noise in which a spike is found."""
NORMAL = 1.8
"""Standard deviation of white normal noise over the median of its distances from the centred median. It is not
1.48: a sample that is the median itself has the distance 0. Where the signal moves fast it is larger."""
EQUAL_SHARE = 0.2
"""Share of readings equal to the one before from which the record is called quantised."""


def unpredicted(z: Array, steps: Array, q: float, r: float, tau: float) -> Array:
    """e²/s of each sample that neither side predicts, by both sides together, shape (n,); 0 for all others.

    Where the samples around it are predicted badly too, the signal is lively there: it takes as many times more.

    Args:
        z: one channel, shape (n,), NaN where missing.
        steps: nominal sample periods before each sample; empty = 1 each.
        q: variance of the movement, unit².
        r: variance of the noise, unit².
        tau: momentum in sample periods, 0 for none.
    """
    return unpredicted_each(z, steps, np.array([0, len(z)]), np.array([q]), np.array([r]), tau)


def unpredicted_each(z: Array, steps: Array, starts: Indices, q: Array, r: Array, tau: float = 0.0) -> Array:
    """`unpredicted` of several records, one after the other; those whose q and r are both 0 have none.

    Args:
        z: all samples, shape (n,), NaN where missing.
        steps: nominal sample periods before each; empty = 1 each.
        starts: where each record begins, shape (k + 1,); the last is the end of all.
        q: variance of the movement of each, unit², shape (k,).
        r: variance of the noise of each.
        tau: momentum in sample periods, 0 for none.
    """
    scores, wanted = np.zeros(len(z)), q + r > 0.0
    v, s, refused = np.zeros((2, len(z))), np.ones((2, len(z))), np.zeros((2, len(z)), np.bool_)
    for i, backwards in enumerate((False, True)):
        kernels.refuse(
            z, steps, starts, q, r, tau or None, backwards, np.empty(WINDOW), wanted, v[i], s[i], refused[i]
        )
        if not wanted.any():
            return scores
    refused[0] &= refused[1]
    at = np.flatnonzero(refused[0])
    record = np.searchsorted(starts, at, side="right") - 1
    p = s[:, at] - r[record]
    with np.errstate(invalid="ignore"):
        least, most = p.min(axis=0), p.max(axis=0)
        share = np.where(least == most, 0.5, 1.0 / (1.0 + least / most))  # of the side that knows more
        first = np.where(p[0] == least, share, 1.0 - share)
        scores[at] = (first * v[0, at] + (1.0 - first) * v[1, at]) ** 2 / (r[record] + share * least)
    for k in np.unique(record[scores[at] > SIGMAS**2]).tolist():
        here = slice(int(starts[k]), int(starts[k + 1]))
        _clear_movement(scores[here], v[:, here], s[:, here], ~np.isnan(z[here]), refused[0, here])
    return scores


def _clear_movement(scores: Array, v: Array, s: Array, present: Mask, refused: Mask) -> None:
    """Set those of `scores` to 0 that may be movement: in a lively or crowded neighbourhood, or a lone pulse.

    `v` is overwritten: a copy would be a good part of the memory of an estimate.
    """
    v *= v
    v /= s
    squares, at = np.minimum(np.minimum(v[0], v[1], out=v[0]), MOST, out=v[0]), np.flatnonzero(refused)
    counted = present & ~refused
    squares[~counted] = 0.0
    lively = _mean_near(squares, counted, at)
    kept, some = np.zeros(len(scores), np.bool_), scores[at]
    kept[at] = some > SIGMAS**2 * np.where(lively > LIVELY, lively, 1.0)
    crowded = (lively > VERY_LIVELY) & (_mean_near(kept, present, at) > CROWDED)
    kept[at] &= ~crowded | (some > SIGMAS**4 * lively)
    scores[~kept] = 0.0
    starts, lengths = _runs(kept[present])
    if len(starts) < MIN_RUNS:  # a long run among few: the signal has moved, and come back
        for start, length in zip(starts, lengths, strict=True):
            if length > 2:
                scores[np.flatnonzero(present)[start : start + length]] = 0.0


def _mean_near(values: Array | Mask, counted: Mask, at: Indices) -> Array:
    """Mean of the values, 0 where not counted, within NEAR samples of each place; 0 where none is counted."""
    low, high = np.maximum(at - NEAR, 0), np.minimum(at + NEAR, len(values) - 1)

    def near(some: Array | Mask) -> Array:
        total = np.cumsum(some)
        return total[high] - np.where(low > 0, total[low - 1], 0)

    return near(values) / np.maximum(near(counted), 1)


def _median(values: Array) -> float:
    """What `np.median` gives, in a fifth of its time for a few values."""
    low, high = (len(values) - 1) // 2, len(values) // 2
    middle = np.partition(values, high)
    return 0.5 * float((middle[high] if low == high else middle[:high].max()) + middle[high])


def _runs(marked: Mask) -> tuple[Indices, Indices]:
    """Where each run of True begins, and how long it is."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], marked, [False]])))
    return edges[::2], edges[1::2] - edges[::2]


def far_from_median(z: Array) -> tuple[Mask, bool]:
    """The samples of z, shape (n,), far from the centred median; whether there are more than by chance."""
    present = np.isfinite(z)
    far, distances = np.zeros(len(z), dtype=bool), _from_median(z[present])
    far[present] = distances > START_SIGMAS
    return far, beyond_chance(distances, START_SIGMAS)


def _from_median(samples: Array) -> Array:
    """Distances of finite samples from the centred median, in standard deviations of the noise they show."""
    distances = np.empty(len(samples))
    kernels.median_distances(samples, WINDOW, distances)
    scale = NORMAL * _median(distances)
    if scale == 0.0 and distances.any():
        scale = _median(distances[distances > 0.0])
    return distances / scale if scale > 0.0 else distances


def beyond_chance(distances: Array, least: float) -> bool:
    """Whether more distances, in standard deviations, exceed `least` than by chance, or one exceeds it by far."""
    n, largest = len(distances), float(distances.max(initial=0.0))
    expected = n * math.erfc(least / math.sqrt(2.0))
    far = n * math.erfc(largest / math.sqrt(2.0)) < FALSE_ALARM * (1.0 + 1e-9)
    return far or int(np.count_nonzero(distances > least)) > expected + 4.0 * math.sqrt(expected) + 2.0


def more_than_chance(scores: Array, z: Array) -> bool:
    """Whether the samples that neither side predicts are more, or farther away, than normal noise explains.

    Args:
        scores: of `unpredicted`.
        z: the record, shape (n,).
    """
    return bool(scores.any()) and beyond_chance(np.sqrt(scores[np.isfinite(z)]), SIGMAS)


def suspect_each(z: Array, steps: Array, starts: Indices, q: Array, r: Array) -> Mask:
    """Whether each record may hold spikes that a fit with its q and r did not set aside; as `unpredicted_each`."""
    scores, suspect = unpredicted_each(z, steps, starts, q, r), q + r > 0.0
    for k in np.flatnonzero(suspect).tolist():
        here = slice(int(starts[k]), int(starts[k + 1]))
        present = np.isfinite(z[here])
        samples = z[here] if present.all() else z[here][present]
        spiky = _repeat(samples) or beyond_chance(_from_median(samples), START_SIGMAS)
        suspect[k] = spiky or more_than_chance(scores[here], z[here])
    return suspect


def repeats(z: Array) -> bool:
    """Whether so many readings of z, shape (n,), equal the one before that steps of the readings count too."""
    return _repeat(z[np.isfinite(z)])


def _repeat(samples: Array) -> bool:
    return int(np.count_nonzero(samples[1:] == samples[:-1])) > EQUAL_SHARE * (len(samples) - 1)


def rounding_variance(z: Array) -> float:
    """Δ²/12 of a record of which many readings equal the one before, else 0: one step of Δ is not a spike."""
    return resolution_of(z[np.isfinite(z)]) ** 2 / 12.0 if repeats(z) else 0.0


# How much noise the rule itself removes: of good samples the largest few are set aside with the spikes.
#
# A sample is z = x + e with e of variance r, and both sides together predict it with an error v, z - prediction, of
# variance s = r + p/2, where p is that of one side. It is set aside where |v| > c √s. The part ρ v of e, ρ = r/s,
# is known from v, the rest is independent of it: with the share P = 2 Q(c) of the samples goes the share
#
#     I = ρ 2 (c φ(c) + Q(c)) + (1 - ρ) P
#
# of Σe², and the kept samples show the variance r (1 - I)/(1 - P). At c = 4 this is 0.999 r where x hardly moves,
# and nearer to r where it moves fast. The movement is the same for kept samples and others, so q needs no
# correction. It is scaled with r all the same, so that q/r stays as fitted: 0.1 % is far below its error.


def kept_variance(gain: float, sigmas: float) -> float:
    """Share of r that the kept samples show, (1 - I)/(1 - P).

    Args:
        gain: steady gain of the filter, p/(p + r), 0 … 1.
        sigmas: the threshold c.
    """
    gone = math.erfc(sigmas / math.sqrt(2.0))
    density = math.exp(-0.5 * sigmas * sigmas) / math.sqrt(2.0 * math.pi)
    known = (1.0 - gain) / (1.0 - 0.5 * gain)
    taken = known * (2.0 * sigmas * density + gone) + (1.0 - known) * gone
    return (1.0 - taken) / (1.0 - gone)


# Whether the filter should have a gate: only where it brings the filter nearer to the signal of this record.


def advised_gate(z: Array, steps: Array, params: FilterParams, outliers: Mask) -> float | None:
    """The gate in standard deviations of the innovation; None where the filter does better without.

    A gate keeps spikes out, but it also delays the response to a step. The signal is taken from the smoother, which
    does not get the spikes.

    Args:
        z: one channel, shape (n,), NaN where missing.
        steps: nominal sample periods before each sample; empty = 1 each.
        params: the filter.
        outliers: the samples set aside, shape (n,).
    """
    dt = steps if len(steps) else None
    signal = smooth(np.where(outliers, np.nan, z), params, dt).x
    errors: list[float] = []
    for one in (params, replace(params, gate=SIGMAS**2)):
        error = np.abs(denoise(z, one, dt) - signal)
        size = float(np.nanmax(error))
        errors.append(size * float(np.sqrt(np.nanmean((error / size) ** 2))) if size > 0.0 else 0.0)
    return SIGMAS if errors[1] < errors[0] else None


# The loop of the spike-proof fit: fit, set aside what neither side predicts, fit again until nothing changes.


Fit = Callable[[Array, Array, Progress], Estimate]
"""The fit of one channel: samples, shape (n,), NaN where missing; steps, empty = 1 each."""

MAX_SHARE = 0.2
"""Share of the samples set aside beyond which no pair is given: that much is not a few spikes."""
MAX_FITS = 20
"""Rounds of the loop, at most."""
STRETCHES, STRETCH = 16, 8192
"""Of a record twice as long the rounds fit these stretches, spread over it, and only the last fit is of all."""
FEW_MOVES = 1e-4
"""Share of the samples of such a record that may still be set aside or taken back at the end."""
_NOTHING_TO_JUDGE = ("too_few", "constant", "bad_unit")


def checked_robust(robust: Any) -> bool | None:
    """True = always, False = never, None = where spikes are found; BadSetting of what `estimate` does not take."""
    if isinstance(robust, str) and robust == "auto":
        return None
    if not isinstance(robust, bool):
        raise BadSetting(f'robust must be "auto", True or False (got {robust!r})')
    return robust


def spike_proof(full: Fit, with_momentum: Callable[[float], Fit], always: bool | None) -> Fit:
    """A fit that sets spikes aside.

    Args:
        full: the fit as asked for.
        with_momentum: the same with a momentum that is given, for the steps in between; may return `full`.
        always: False = `full` itself; None = its numbers, bit for bit, unless there are spikes that can be
            distinguished from movement. They cannot where no noise is left without them and a gate does more harm
            than good.
    """
    if always is False:
        return full

    def fit(z: Array, steps: Array, progress: Progress) -> Estimate:
        part = part_of(z)
        plain = full(part, steps, progress.part(0.0, 0.3))
        if plain.verdict in _NOTHING_TO_JUDGE and part is not z:
            part, plain = z, full(z, steps, progress.part(0.0, 0.3))
        if plain.verdict in _NOTHING_TO_JUDGE:
            return plain

        def unchanged() -> Estimate:
            return plain if part is z else full(z, steps, progress)

        far, looks_spiky = far_from_median(z)
        if always is None and not (looks_spiky or more_than_chance(_scores(z, steps, plain), z)):
            return unchanged()
        one, outliers, scores = _settle(z, part, steps, plain, full, with_momentum, far, progress.part(0.3, 0.95))
        if always is None and not more_than_chance(np.where(outliers, scores, 0.0), z):
            return unchanged()
        answer = _conclude(z, steps, plain, one, outliers)
        if always is None and answer.verdict == "no_noise" and plain.params is not None:
            same = unchanged()
            return replace(same, message=f"{same.message} {verdict.kept(int(outliers.sum()))}")
        return answer

    return fit


def part_of(z: Array) -> Array:
    """The record, shape (n,), with only its STRETCHES where it is long; the others are missing."""
    if len(z) < 2 * STRETCHES * STRETCH:
        return z
    part = np.full(len(z), np.nan)
    for first in np.linspace(0, len(z) - STRETCH, STRETCHES).astype(int).tolist():
        part[first : first + STRETCH] = z[first : first + STRETCH]
    return part


def _settle(
    z: Array,
    part: Array,
    steps: Array,
    plain: Estimate,
    full: Fit,
    with_momentum: Callable[[float], Fit],
    outliers: Mask,
    progress: Progress,
) -> tuple[Estimate, Mask, Array]:
    """Fit and set aside in turn. The full fit has the last word: momentum is better found without spikes.

    Returns:
        The fit to the samples that are left, those set aside, and its scores, of `unpredicted`.
    """
    seen: list[bytes] = []
    tau, start = float(plain.momentum), outliers
    few = 0 if part is z else int(FEW_MOVES * len(z))
    fit = with_momentum(tau)
    for count in range(MAX_FITS):
        progress.step(count, "samples that neither side predicts")
        fitted = np.where(outliers, np.nan, z if fit is full else part)
        one = fit(fitted, steps, progress.part(1.0 - 0.8**count, 1.0 - 0.8 ** (count + 1)))
        if one.verdict in _NOTHING_TO_JUDGE:
            return one, outliers, np.where(outliers, math.inf, 0.0)
        scores = _scores(z, steps, one)
        next_outliers = scores > 0.0
        if np.count_nonzero(next_outliers != outliers) <= few:
            if fit is full:
                return one, outliers, scores
            fit = full
            continue
        if next_outliers.tobytes() in seen:  # a few doubtful samples come and go: they stay in
            outliers = outliers & next_outliers
            break
        seen.append(outliers.tobytes())
        outliers = next_outliers
        if float(one.momentum) != tau:  # another model: from the start
            tau, outliers, seen = float(one.momentum), start | outliers, []
        fit = with_momentum(tau)
    one = full(np.where(outliers, np.nan, z), steps, progress)
    return one, outliers, _scores(z, steps, one)


def _scores(z: Array, steps: Array, one: Estimate) -> Array:
    r = float(one.r) + rounding_variance(z)
    return unpredicted(z, steps, float(one.q), r, float(one.momentum))


def _conclude(z: Array, steps: Array, plain: Estimate, one: Estimate, outliers: Mask) -> Estimate:
    """The estimate with all that is known about the samples set aside."""
    count, present = int(outliers.sum()), int(np.isfinite(z).sum())
    one = replace(
        one,
        outliers=outliers,
        outlier_share=count / present,
        plain_q=plain.q,
        plain_r=plain.r,
        plain_momentum=plain.momentum,
    )
    if count > MAX_SHARE * present:
        text = verdict.too_many(count, present)
        return replace(one, verdict="too_many_outliers", message=text, params=None)
    gate = None
    if count:
        one, gate = _with_gate(z, steps, one, outliers)
    message = f"{verdict.set_aside(count, present, plain, gate)} {one.message}".strip()
    return replace(one, message=message)


def _with_gate(z: Array, steps: Array, one: Estimate, outliers: Mask) -> tuple[Estimate, float | None]:
    """The estimate with a gate in its parameters, and the gate in σ; None where the filter does better without."""
    some = _only_spikes(one) if one.verdict == "no_noise" else _untruncated(one)
    if some.params is None:
        return some, None
    gate = advised_gate(z, steps, some.params, outliers)
    if gate is None:
        return (one if some.verdict == "only_spikes" else some), None
    return replace(some, params=replace(some.params, gate=gate * gate)), gate


def _only_spikes(one: Estimate) -> Estimate:
    """The estimate of a record whose only noise is spikes, with the largest r that it allows: a pair to gate."""
    least = float(one.ratio_interval[0])
    if least <= 0.0:
        return one
    q, r = float(one.q), float(one.q) / least
    params = FilterParams(q=q, r=r, momentum=float(one.momentum))
    return replace(one, r=r, verdict="only_spikes", message=verdict.only_spikes(params), params=params)


def _untruncated(one: Estimate) -> Estimate:
    """With the noise of the good samples that the rule set aside too; q/r, and all that follows from it, stays."""
    if one.params is None:
        return one
    shown = kept_variance(steady_state(one.params).gain, SIGMAS)
    q, r = float(one.q) / shown, float(one.r) / shown
    return replace(
        one,
        q=q,
        r=r,
        q_se=float(one.q_se) / shown,
        r_se=float(one.r_se) / shown,
        params=replace(one.params, q=q, r=r),
    )
