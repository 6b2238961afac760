"""`estimate_many`: q and r of many series in one compiled call, and the table that it gives."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kalscope.common.numbers import Array, Indices, Mask, ShortRepr
from kalscope.estimation import kernels
from kalscope.estimation.climb import NORMAL
from kalscope.estimation.fit import (
    estimate,
    may_be_below_resolution,
    shows_steps,
)
from kalscope.estimation.likelihood import MAX_LOG_RATIO, Records, search_records, take_apart
from kalscope.estimation.result import USABLE, Estimate
from kalscope.estimation.spikes import (
    MAX_FITS,
    checked_robust,
    far_from_median,
    more_than_chance,
    repeats,
    suspect_each,
    unpredicted,
)
from kalscope.estimation.verdict import MIN_VARIANCE, lag_of
from kalscope.filtering.params import MAX_VARIANCE

# EstimateTable: what was found in each of many series, one array a quantity.


VERDICTS = (
    "ok", "flat", "no_noise", "no_movement", "too_few", "constant", "bad_unit", "infinite", "bad_steps",
    "below_resolution", "only_spikes", "too_many_outliers",
)  # fmt: skip
"""Every verdict by its code: those of `Estimate`, and "infinite" (a sample is inf) and "bad_steps" (a step is
negative or not finite), for which `estimate` raises an error."""

_USABLE_CODES = [VERDICTS.index(name) for name in USABLE]


@dataclass(frozen=True, repr=False)
class EstimateTable(ShortRepr):
    """What was found in k series, arrays of shape (k,). No number is NaN; see `Estimate`."""

    q: Array
    """Process-noise variance per nominal sample period, unit², ≥ 0; 0 where nothing could be fitted."""
    r: Array
    """Measurement-noise variance, unit², ≥ 0."""
    q_interval: tuple[Array, Array]
    """The q that the record allows, 95 %, from 0 where it does not exclude it, unit²; 0 and inf without any fit."""
    r_interval: tuple[Array, Array]
    """The r that the record allows, 95 %, from 0 where it does not exclude it, unit²; 0 and inf without any fit."""
    code: NDArray[np.uint8]
    """The verdict as its place in VERDICTS."""
    spikes: NDArray[np.int64]
    """Samples set aside as spikes; 0 where the spike-proof fit was not used."""
    gate: Array
    """The gate that goes with the pair, standard deviations of the innovation; inf = none."""
    set_aside: NDArray[np.int64]
    """Samples set aside in all series, as indices into the concatenated series, ascending, shape (Σ spikes,)."""

    def __len__(self) -> int:
        return len(self.q)

    @property
    def ratio(self) -> Array:
        """λ = q/r, 0 … inf; 0 where both are 0."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(self.q > 0.0, self.q / self.r, 0.0)

    @property
    def verdict(self) -> NDArray[np.str_]:
        """The verdicts as words."""
        return np.array(VERDICTS)[self.code]

    @property
    def usable(self) -> Mask:
        """Where q and r are both above 0: a filter can be made of them."""
        return np.isin(self.code, _USABLE_CODES)

    @property
    def lag_samples(self) -> Array:
        """Lag on a ramp without momentum, samples, 0 … inf."""
        return lag_of(self.ratio)


# Many series in one piece of memory: what every compiled loop over a fleet takes.


_MAX_ROWS = 20_000
"""Series of one search: their tables of likelihoods take some 10 MB."""


@dataclass(frozen=True)
class Series:
    """k series of different lengths, one after the other."""

    values: Array
    """All samples, shape (total,), NaN where missing."""
    starts: NDArray[np.int64]
    """Where each series begins, shape (k + 1,); the last is the end of all."""
    steps: Array
    """Nominal sample periods before each sample, shape (total,); empty = 1 each."""

    def __len__(self) -> int:
        return len(self.starts) - 1

    def one(self, index: int) -> tuple[Array, Array]:
        """The samples and the steps of one series, views."""
        here = slice(int(self.starts[index]), int(self.starts[index + 1]))
        return self.values[here], self.steps[here] if len(self.steps) else self.steps

    def between(self, first: int, stop: int) -> Series:
        """The series from `first` to before `stop`, in the same memory."""
        return Series(self.values, self.starts[first : stop + 1], self.steps)

    def some(self, rows: Indices) -> Series:
        """Some of the series, in memory of their own."""
        pieces = [self.one(int(i)) for i in rows]
        starts = np.cumsum([0, *(len(values) for values, _ in pieces)], dtype=np.int64)
        values, steps = (np.concatenate([np.empty(0), *column]) for column in zip(*pieces, strict=True))
        return Series(values, starts, steps)

    def parts(self, samples: int) -> Iterator[tuple[int, int]]:
        """First and one past the last of stretches of about that many samples, at least one series each."""
        first = 0
        while first < len(self):
            end = int(np.searchsorted(self.starts, int(self.starts[first]) + samples, side="right")) - 1
            stop = min(max(end, first + 1), first + _MAX_ROWS, len(self))
            yield first, stop
            first = stop


def series_of(rows: Iterable[ArrayLike], dt: Iterable[ArrayLike] | None = None) -> Series:
    """Arrays of any lengths, and their steps, as one piece of memory."""
    values, steps = ([np.asarray(one, dtype=np.float64) for one in given] for given in (rows, dt or ()))
    starts = np.cumsum([0, *map(len, values)], dtype=np.int64)
    return Series(np.concatenate([np.empty(0), *values]), starts, np.concatenate([np.empty(0), *steps]))


# Which series that look spiky have no spikes after all: the loop of `spikes.spike_proof`, for many series at once.
#
# A signal that moves far more than the noise looks spiky to the centred median. Each round fits all such series in
# one compiled call, so that only those with true spikes are left to the fit of a single one.


def spike_free(many: Series) -> Mask:
    """Whether `estimate` would return the plain fit of each series, shape (series,). False where it is not sure.

    `many` are the series that look spiky, and can be fitted, in memory of their own.
    """
    pieces = [many.one(i) for i in range(len(many))]
    outliers, seen = [far_from_median(z)[0] for z, _ in pieces], [set[bytes]() for _ in pieces]
    free, last = np.zeros(len(many), np.bool_), np.zeros(len(many), np.bool_)
    active = [i for i, (z, _) in enumerate(pieces) if not repeats(z)]
    for _ in range(MAX_FITS + 1):
        if not active:
            break
        some, going = many.some(np.array(active)), list[int]()
        now = np.concatenate([outliers[i] for i in active])
        fitted, codes, stepped = fit_plain(
            replace(some, values=np.where(now, np.nan, some.values)), some.starts[1:]
        )
        for k in np.flatnonzero((codes <= NO_MOVEMENT) & ~stepped):
            i = active[k]
            z, before = pieces[i][0], outliers[i]
            scores = unpredicted(*pieces[i], fitted[Q, k], fitted[R, k], 0.0)
            after = scores > 0.0
            if last[i] or np.array_equal(before, after):
                free[i] = not more_than_chance(np.where(before, scores, 0.0), z)
                continue
            if after.tobytes() in seen[i]:  # a few doubtful samples come and go: they stay in
                last[i], after = True, before & after
            seen[i].add(before.tobytes())
            outliers[i] = after
            going.append(i)
        active = going
    return free


# The fit without momentum and without a search for spikes, of many series at once.


EQUAL = 1e-6
"""Relative difference between the q/r of two fits that are the same."""

_AT_ONCE, SEARCHED = 4_000_000, 500_000
"""Samples between two reports of progress, a fraction of a second, and of one search, which stay in the cache."""

OK, FLAT, NO_NOISE, NO_MOVEMENT, TOO_FEW, CONSTANT, BAD_UNIT, HOLDS_INF, BAD_STEPS = range(9)
_OF_DEFECT = np.array([OK, TOO_FEW, CONSTANT, HOLDS_INF, BAD_STEPS], np.uint8)
"""Verdicts by their places in VERDICTS, and those of the defects of `kernels.take_apart`."""

Q, R, Q_LOW, Q_HIGH, R_LOW, R_HIGH, SPIKES, GATE = range(8)
"""The rows of numbers."""
_NOTHING = np.zeros((8, 1))
_NOTHING[[Q_HIGH, R_HIGH, GATE]] = math.inf
"""Those of a series that cannot be fitted."""


def fit_plain(many: Series, stops: NDArray[np.int64]) -> tuple[Array, NDArray[np.uint8], Mask]:
    """Fit each series up to one of `stops`, indices into the values, shape (series,).

    Returns:
        The rows of numbers, shape (8, series); the verdicts as places in VERDICTS; whether readings repeat.
    """
    numbers, codes = np.tile(_NOTHING, len(many)), np.empty(len(many), np.uint8)
    stepped = np.empty(len(many), np.bool_)
    for first, stop in many.parts(SEARCHED):
        here = slice(first, stop)
        data, samples, changes, defects = take_apart(many.values, many.steps, many.starts[first:stop], stops[here])
        codes[here] = _OF_DEFECT[defects]
        chosen = np.flatnonzero(defects == kernels.GOOD)
        if len(chosen):
            rows = first + chosen
            numbers[:SPIKES, rows], codes[rows] = _fit(data.only(chosen))
        stepped[here] = shows_steps(changes, samples - 1) & (codes[here] <= NO_NOISE)
    return numbers, codes, stepped


def _fit(data: Records) -> tuple[Array, NDArray[np.uint8]]:
    """The rows of numbers of records that can be fitted, and their codes."""
    m, everyone = data.m, np.arange(len(data.scale))
    fits = np.ones(len(m), np.bool_)
    with np.errstate(all="ignore"):
        peaks = search_records(data)
        place = peaks.log_ratio
        ends = np.stack([place, peaks.low, peaks.high], axis=1)
        chi2, _ = data.sums(everyone, np.exp(np.minimum(ends, MAX_LOG_RATIO)))
        sizes = chi2 / m[:, None]
        walk, q_walk = np.isposinf(place), data.without_noise()[1]
        r = np.where(walk, 0.0, sizes[:, 0])
        q = np.where(walk, q_walk, np.exp(place) * r)
        low, high = np.exp(peaks.low), np.exp(peaks.high)
        alone = np.sqrt(2.0 / m)
        least = np.where(np.isinf(high), 0.0, sizes[:, 2])
        q_ends = low * sizes[:, 1], np.where(np.isinf(high), q_walk, high * least)
        values = ((q, q_ends[0], -1.0), (q, q_ends[1], 1.0), (r, least, -1.0), (r, sizes[:, 1], 1.0))
        intervals = [_apart(value, end, side * NORMAL * alone) for value, end, side in values]
        numbers = np.stack([q, r, *intervals]) * data.scale * data.scale
        for value, size in ((q, numbers[Q]), (r, numbers[R])):
            fits &= (value == 0.0) | ((size > MIN_VARIANCE) & (size <= MAX_VARIANCE))
    flat = np.isneginf(peaks.low) & np.isposinf(peaks.high)
    codes = np.select([~fits, r == 0.0, q == 0.0, flat], [BAD_UNIT, NO_NOISE, NO_MOVEMENT, FLAT], OK)
    return np.where(fits, numbers, _NOTHING[:SPIKES]), codes.astype(np.uint8)


def _apart(value: Array, end: Array, wide: Array) -> Array:
    """One end of an interval: of the shape it is `end`, of the size it lies `wide` (in ln, signed) from `value`.

    The two combine on the scale of the logarithm (Zou & Donner 2008, Statistics in Medicine 27, 1693-1702).
    """
    both = value * np.exp(np.copysign(np.hypot(np.log(end / value), wide), wide))
    return np.where(end <= 0.0, 0.0, np.where(value <= 0.0, end * np.exp(wide), both))


def fitted_ratios(many: Series, stops: NDArray[np.int64]) -> Array:
    """The most likely λ of each series up to one of `stops`, 0 … inf; NaN without any."""
    numbers, codes, _ = fit_plain(many, stops)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(codes <= NO_MOVEMENT, numbers[Q] / numbers[R], math.nan)


def pair_intervals(one: Estimate, z: Array, steps: Array) -> tuple[float, float, float, float]:
    """The 95 % intervals of q and r of one series, as `estimate_many` finds them: by the profile of the likelihood.

    With momentum, or where r is not that of the likelihood (below the resolution, only spikes), they follow from
    the standard errors.

    Args:
        one: its estimate, of one channel.
        z: the series, shape (n,).
        steps: nominal sample periods before each sample, shape (n,); empty = 1 each.

    Returns:
        Least and largest q, least and largest r, unit²; 0 and inf where nothing is excluded.
    """
    wald = (*_around(one.q, one.q_se), *_around(one.r, one.r_se))
    if one.method == "fixed_r" and one.q > 0.0:
        low, high = one.ratio_interval
        return one.r * low, one.r * high, one.r, one.r
    if one.method != "ml" or one.momentum > 0.0 or not (one.q > 0.0 and one.r > 0.0):
        return wald
    used = z if one.outliers is None else np.where(one.outliers, np.nan, z)
    many = Series(np.array(used, dtype=np.float64), np.array([0, len(z)]), steps)
    numbers, (code,), _ = fit_plain(many, many.starts[1:])
    fitted = numbers[:, 0]
    if code not in (OK, FLAT) or abs(fitted[Q] / fitted[R] / one.ratio - 1.0) > EQUAL:
        return wald
    # The spike-proof fit corrects r for the good samples that its rule removes.
    low, high, r_low, r_high = (one.r / fitted[R] * fitted[Q_LOW:SPIKES]).tolist()
    return low, high, r_low, r_high


def _around(value: float, error: float) -> tuple[float, float]:
    """The 95 % interval of a variance from its standard error, on the scale of the logarithm."""
    if not (value > 0.0 and math.isfinite(error)):
        return 0.0, math.inf
    factor = math.exp(min(NORMAL * error / value, 700.0))
    return value / factor, value * factor


# `estimate_many`: q and r of many series in one compiled call, without Python code per series.


def estimate_many(many: Series, robust: bool | Literal["auto"] = "auto") -> EstimateTable:
    """Find q and r by maximum likelihood in many series: `estimate(z, momentum=0)`, thousands of series a second.

    A series that cannot be fitted is a row with its verdict, never an error. One that has spikes, which the
    compiled call detects, takes as long as in `estimate`.

    Args:
        many: the series, in memory that may be written, or the loops would be compiled once more.
        robust: whether spikes are set aside, as in `estimate`.
    """
    always, set_aside = checked_robust(robust), [np.empty(0, np.intp)]
    numbers, codes = np.empty((len(_NOTHING), len(many))), np.empty(len(many), np.uint8)
    for first, stop in many.parts(_AT_ONCE):
        here, some = slice(first, stop), many.between(first, stop)
        numbers[:, here], codes[here], again = fit_plain(some, some.starts[1:])
        if always is None:
            again |= _spiky(some, numbers[:, here], again)
        elif always:
            again = codes[here] < TOO_FEW
        for i in (first + np.flatnonzero(again)).tolist():
            z, steps = many.one(i)
            if always is False and not may_be_below_resolution(z, float(numbers[R, i])):
                continue
            one = estimate(z, dt=steps if len(steps) else None, momentum=0.0, robust=robust)
            gate = math.inf if one.gate is None else one.gate
            numbers[:, i] = one.q, one.r, *pair_intervals(one, z, steps), sum(map(len, one.spikes)), gate
            codes[i] = VERDICTS.index(one.verdict)
            set_aside += [int(many.starts[i]) + rows for rows in one.spikes]
    q, r, q_low, q_high, r_low, r_high, spikes, gate = numbers
    intervals = (q_low, q_high), (r_low, r_high)
    return EstimateTable(q, r, *intervals, codes, spikes.astype(np.intp), gate, np.concatenate(set_aside))


def _spiky(many: Series, numbers: Array, stepped: Mask) -> Mask:
    """Which series may have spikes that `estimate` would set aside; False where readings repeat."""
    suspect = np.empty(len(many), np.bool_)
    for first, stop in many.parts(SEARCHED):
        part, pairs = slice(int(many.starts[first]), int(many.starts[stop])), numbers[:, first:stop]
        starts, steps = many.starts[first : stop + 1] - part.start, many.steps[part]
        suspect[first:stop] = suspect_each(many.values[part], steps, starts, pairs[Q], pairs[R])
    chosen = np.flatnonzero(suspect & ~stepped)
    if len(chosen):
        suspect[chosen] = ~spike_free(many.some(chosen))
    return suspect
