"""`estimate_many`: q and r of many series in one compiled call, and the table that it gives."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kalscope.common.numbers import Array, Indices, Mask, ShortRepr
from kalscope.common.progress import Progress
from kalscope.errors import BadSetting
from kalscope.estimation import kernels
from kalscope.estimation.climb import NORMAL
from kalscope.estimation.fit import (
    MAX_FACTOR,
    checked_momentum,
    estimate,
    estimate_fixed_r,
    estimate_fixed_ratio,
    may_be_below_resolution,
    shows_steps,
)
from kalscope.estimation.likelihood import MAX_LOG_RATIO, Records, search_records, take_apart
from kalscope.estimation.methods import ratios_near, relative_errors
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
from kalscope.estimation.verdict import MIN_VARIANCE, gain_of, lag_of
from kalscope.filtering.params import MAX_VARIANCE, samples_of

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
    """q, r and the related results of k series, arrays of shape (k,). No number is NaN; see `Estimate`."""

    q: Array
    """Process-noise variance per nominal sample period, unit², ≥ 0; 0 where nothing could be fitted."""
    r: Array
    """Measurement-noise variance, unit², ≥ 0."""
    q_se: Array
    """Standard error of q, unit²; inf at an edge or where there is none."""
    r_se: Array
    """Standard error of r, unit²; inf at an edge."""
    loglik: Array
    """Log-likelihood at (q, r), exact diffuse start; 0 where nothing could be fitted."""
    ratio_interval: tuple[Array, Array]
    """The λ = q/r that the record allows: profile-likelihood 95 %, ends 0 … inf."""
    q_interval: tuple[Array, Array]
    """The q that the record allows, 95 %, from 0 where it does not exclude it, unit²; 0 and inf without any fit."""
    r_interval: tuple[Array, Array]
    """The r that the record allows, 95 %, from 0 where it does not exclude it, unit²; 0 and inf without any fit."""
    code: NDArray[np.uint8]
    """The verdict as its place in VERDICTS."""
    samples: NDArray[np.int64]
    """Finite samples; repeated lines of one time and value count once. 0 for "infinite" and "bad_steps"."""
    momentum: Array
    """Momentum τ, nominal sample periods; 0 = none."""
    momentum_interval: tuple[Array, Array]
    """The τ that the record allows, where it was searched."""
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
    def gain(self) -> Array:
        """Steady gain without momentum, 0 … 1."""
        return gain_of(self.ratio)

    @property
    def lag_samples(self) -> Array:
        """Lag on a ramp without momentum, samples, 0 … inf."""
        return lag_of(self.ratio)

    @property
    def gain_interval(self) -> tuple[Array, Array]:
        """The steady gains that the record allows, without momentum."""
        return gain_of(self.ratio_interval[0]), gain_of(self.ratio_interval[1])

    @property
    def lag_interval(self) -> tuple[Array, Array]:
        """The lags that the record allows, without momentum, samples, the short one first."""
        return lag_of(self.ratio_interval[1]), lag_of(self.ratio_interval[0])


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


def series_of(
    series: Series | ArrayLike | Sequence[ArrayLike], dt: ArrayLike | Sequence[ArrayLike] | None
) -> Series:
    """The series as one piece of memory.

    Args:
        series: a list of 1-D arrays of any lengths, a 2-D array with one series a row, or a Series.
        dt: the steps, shaped like the series; None = 1 each, or those of the Series.

    Raises:
        BadSetting: a series is not 1-D or holds no numbers; the steps have other shapes; an array of complex
            numbers.
    """
    if isinstance(series, Series):
        if dt is not None:
            raise BadSetting("dt must be None beside a Series, which holds its steps (got both)")
        _check(series)
        return Series(*map(_writeable, (series.values, series.starts, series.steps)))
    values, starts = _joined(series, "series")
    if dt is None:
        return Series(_writeable(values), starts, np.empty(0))
    steps, others = _joined(dt, "dt")
    if not np.array_equal(starts, others):
        raise BadSetting("dt must have one value per sample of each series (got other lengths)")
    return Series(_writeable(values), starts, _writeable(steps))


def _writeable(array: Any) -> Any:
    """The array, or a copy of a read-only one (an Arrow buffer), for which the loops would be compiled again."""
    return array if array.flags.writeable else array.copy()


def above_zero_each(name: str, value: ArrayLike | None, count: int, missing: bool = False) -> Array | None:
    """One number above 0 each, shape (count,), of one for all or one each, NaN if `missing`; None for None."""
    if value is None:
        return None
    try:
        array: Array = np.array(np.broadcast_to(np.asarray(value, dtype=np.float64), (count,)))
    except (TypeError, ValueError):
        raise BadSetting(f"{name} must be one number, or {count}, one each (got {value})") from None
    if np.any(~((array > 0.0) & (array <= MAX_VARIANCE)) & ~(missing & np.isnan(array))):
        raise BadSetting(f"{name} must be finite and above 0 (got {array.min():g} to {array.max():g})")
    return array


def _joined(series: ArrayLike | Sequence[ArrayLike], name: str) -> tuple[Array, NDArray[np.int64]]:
    if isinstance(series, np.ndarray) and cast("Array", series).dtype != object:
        array = samples_of(cast("Array", series))
        if array.ndim != 2:
            raise BadSetting(
                f"{name} must be a list of 1-D arrays or a 2-D array, one series a row (got shape {array.shape})"
            )
        return np.ascontiguousarray(array).ravel(), np.arange(len(array) + 1, dtype=np.int64) * array.shape[1]
    if not isinstance(series, Iterable):
        raise BadSetting(f"{name} must be a list of 1-D arrays or a 2-D array (got {series})")
    rows = [samples_of(one) for one in cast("Sequence[ArrayLike]", series)]
    wrong = next((i for i, row in enumerate(rows) if row.ndim != 1), None)
    if wrong is not None:
        raise BadSetting(f"{name} must be 1-D each (got shape {rows[wrong].shape} at index {wrong})")
    starts = np.zeros(len(rows) + 1, dtype=np.int64)
    np.cumsum([len(row) for row in rows], out=starts[1:])
    return (np.concatenate(rows) if rows else np.empty(0)), starts


def _check(series: Series) -> None:
    """What the compiled loops rely on: they would read beyond the end of the memory."""
    values, starts, steps = series.values, series.starts, series.steps
    if values.dtype != np.float64 or values.ndim != 1 or not values.flags.c_contiguous:
        raise BadSetting("values of a Series must be one contiguous array of float64")
    if starts.dtype != np.int64 or starts.ndim != 1 or len(starts) < 1 or starts[0] < 0:
        raise BadSetting("starts of a Series must be int64, from 0 on (got something else)")
    if np.any(np.diff(starts) < 0) or starts[-1] > len(values):
        raise BadSetting(f"starts of a Series must rise up to at most {len(values)}, its samples (got others)")
    if len(steps) and (steps.dtype != np.float64 or steps.shape != values.shape or not steps.flags.c_contiguous):
        raise BadSetting("steps of a Series must be empty or one float64 a sample (got something else)")


# Which series that look spiky have no spikes after all: the loop of `spikes.spike_proof`, for many series at once.
#
# A signal that moves far more than the noise looks spiky to the centred median. Each round fits all such series in
# one compiled call, so that only those with true spikes are left to the fit of a single one.


Fit = Callable[[Series, Indices], tuple[Array, Array, Mask]]
"""q, r and whether they can be trusted of some series, which are at these places among those given."""


def spike_free(many: Series, fit: Fit) -> Mask:
    """Whether `estimate` would return the plain fit of each series, shape (series,). False where it is not sure.

    Args:
        many: the series that look spiky, and can be fitted, in memory of their own.
        fit: how.
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
        q, r, good = fit(Series(np.where(now, np.nan, some.values), some.starts, some.steps), np.array(active))
        for k in np.flatnonzero(good):
            i = active[k]
            z, before = pieces[i][0], outliers[i]
            scores = unpredicted(*pieces[i], q[k], r[k], 0.0)
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

Q, R, Q_SE, R_SE, LOGLIK, LOW, HIGH, Q_LOW, Q_HIGH, R_LOW, R_HIGH, TAU, TAU_LOW, TAU_HIGH, SPIKES, GATE = range(16)
"""The rows of numbers."""
_NOTHING = np.zeros((16, 1))
_NOTHING[[Q_SE, R_SE, HIGH, Q_HIGH, R_HIGH, GATE]] = math.inf
"""Those of a series that cannot be fitted."""


@dataclass(frozen=True)
class Known:
    """What is known of each series, shape (k,): r in unit², or λ = q/r, or nothing."""

    r: Array | None = None
    ratio: Array | None = None

    @property
    def any(self) -> bool:
        """Whether something is known."""
        return self.r is not None or self.ratio is not None

    def some(self, rows: Indices | slice) -> Known:
        """That of some of the series."""
        return Known(None if self.r is None else self.r[rows], None if self.ratio is None else self.ratio[rows])


NOTHING = Known()


def fit_plain(
    many: Series, stops: NDArray[np.int64], known: Known = NOTHING
) -> tuple[Array, NDArray[np.uint8], Indices, Mask]:
    """Fit each series up to one of `stops`, indices into the values, shape (series,).

    Returns:
        The rows of numbers, shape (16, series); the verdicts as places in VERDICTS; the finite samples; whether
        readings repeat.
    """
    numbers, codes = np.tile(_NOTHING, len(many)), np.empty(len(many), np.uint8)
    samples, stepped = np.empty(len(many), np.intp), np.empty(len(many), np.bool_)
    for first, stop in many.parts(SEARCHED):
        here = slice(first, stop)
        data, samples[here], changes, defects = take_apart(
            many.values, many.steps, many.starts[first:stop], stops[here]
        )
        codes[here] = _OF_DEFECT[defects]
        chosen = np.flatnonzero(defects == kernels.GOOD)
        if len(chosen):
            rows = first + chosen
            numbers[:TAU, rows], codes[rows] = _fit(data.only(chosen), known.some(rows))
        stepped[here] = shows_steps(changes, samples[here] - 1) & (codes[here] <= NO_NOISE)
    return numbers, codes, samples, stepped


def _fit(data: Records, known: Known) -> tuple[Array, NDArray[np.uint8]]:
    """The rows of numbers of records that can be fitted, and their codes."""
    m, everyone = data.m, np.arange(len(data.scale))
    noise, fits = None, np.ones(len(m), np.bool_)
    with np.errstate(all="ignore"):
        unit = data.scale * data.scale
        if known.r is not None:
            noise = known.r / data.scale / data.scale
            fits = (noise > 1.0 / MAX_FACTOR) & (noise < MAX_FACTOR)
            noise = np.where(fits, noise, 1.0)
        peaks = search_records(data, noise)
        place = peaks.log_ratio if known.ratio is None else np.log(known.ratio)
        ends = np.exp(np.minimum(np.stack([peaks.low, peaks.high], axis=1), MAX_LOG_RATIO))
        chi2, logdet = data.sums(everyone, np.concatenate([ratios_near(place), ends], axis=1))
        sizes = chi2 / m[:, None]
        loglik = data.logliks(everyone, chi2[:, :1], logdet[:, :1], noise)[:, 0]
        walk, (at_infinity, q_walk) = np.isposinf(place), data.without_noise()
        r = np.where(walk, 0.0, sizes[:, 0] if noise is None else noise)
        q = np.where(walk, q_walk, np.exp(place) * r)
        low, high = np.exp(peaks.low), np.exp(peaks.high)
        alone = np.sqrt(2.0 / m)
        if noise is not None:
            q_error, r_error = np.where(peaks.curvature < 0.0, 1.0 / np.sqrt(-peaks.curvature), math.inf), 0.0 * m
            intervals = [low * noise, high * noise, noise, noise]
        elif known.ratio is not None:
            q_error = r_error = alone
            intervals = [value * np.exp(side * NORMAL * alone) for value in (q, r) for side in (-1.0, 1.0)]
        else:
            q_error, r_error = relative_errors(place, peaks.curvature, chi2[:, :3], m)
            least = np.where(np.isinf(high), 0.0, sizes[:, 4])
            q_ends = low * sizes[:, 3], np.where(np.isinf(high), q_walk, high * least)
            values = ((q, q_ends[0], -1.0), (q, q_ends[1], 1.0), (r, least, -1.0), (r, sizes[:, 3], 1.0))
            intervals = [_apart(value, end, side * NORMAL * alone) for value, end, side in values]
        errors = [np.where(value > 0.0, value * error, math.inf) for value, error in ((q, q_error), (r, r_error))]
        sizes = np.stack([q, r, *errors, *intervals]) * unit
        for value, size in ((q, sizes[0]), (r, sizes[1])):
            fits &= (value == 0.0) | ((size > MIN_VARIANCE) & (size <= MAX_VARIANCE))
    numbers = np.stack([*sizes[:4], np.where(walk, at_infinity, loglik), low, high, *sizes[4:]])
    flat = np.isneginf(peaks.low) & np.isposinf(peaks.high)
    codes = np.select([~fits, r == 0.0, q == 0.0, flat], [BAD_UNIT, NO_NOISE, NO_MOVEMENT, FLAT], OK)
    return np.where(fits, numbers, _NOTHING[:TAU]), codes.astype(np.uint8)


def _apart(value: Array, end: Array, wide: Array) -> Array:
    """One end of an interval: of the shape it is `end`, of the size it lies `wide` (in ln, signed) from `value`.

    The two combine on the scale of the logarithm (Zou & Donner 2008, Statistics in Medicine 27, 1693-1702).
    """
    both = value * np.exp(np.copysign(np.hypot(np.log(end / value), wide), wide))
    return np.where(end <= 0.0, 0.0, np.where(value <= 0.0, end * np.exp(wide), both))


def fitted_ratios(many: Series, stops: NDArray[np.int64]) -> Array:
    """The most likely λ of each series up to one of `stops`, 0 … inf; NaN without any."""
    numbers, codes, _, _ = fit_plain(many, stops)
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
    q, r = np.array([one.q]), np.array([one.r])
    if one.momentum > 0.0 or not (one.q > 0.0 and one.r > 0.0):
        return wald
    known = {"fixed_r": Known(r=r), "fixed_ratio": Known(ratio=q / r)}.get(one.method, NOTHING)
    used = z if one.outliers is None else np.where(one.outliers, np.nan, z)
    many = Series(np.array(used, dtype=np.float64), np.array([0, len(z)]), steps)
    numbers, (code,), _, _ = fit_plain(many, many.starts[1:], known)
    fitted = numbers[:, 0]
    if code not in (OK, FLAT) or abs(fitted[Q] / fitted[R] / one.ratio - 1.0) > EQUAL:
        return wald
    # The spike-proof fit corrects r for the good samples that its rule removes.
    factor = 1.0 if one.method == "fixed_r" else one.r / fitted[R]
    low, high, r_low, r_high = (factor * fitted[Q_LOW:TAU]).tolist()
    return low, high, r_low, r_high


def _around(value: float, error: float) -> tuple[float, float]:
    """The 95 % interval of a variance from its standard error, on the scale of the logarithm."""
    if not (value > 0.0 and math.isfinite(error)):
        return 0.0, math.inf
    factor = math.exp(min(NORMAL * error / value, 700.0))
    return value / factor, value * factor


# `estimate_many`: q and r of many series in one compiled call, without Python code per series.


def estimate_many(
    series: Series | ArrayLike | Sequence[ArrayLike],
    dt: ArrayLike | Sequence[ArrayLike] | None = None,
    *,
    momentum: float | Literal["auto"] = 0.0,
    robust: bool | Literal["auto"] = "auto",
    r: ArrayLike | None = None,
    ratio: ArrayLike | None = None,
    progress: Callable[[float, str], None] | None = None,
    cancelled: Callable[[], bool] | None = None,
) -> EstimateTable:
    """Find q and r by maximum likelihood in many series: the numbers of `estimate`, thousands of series a second.

    A series that cannot be fitted is a row with its verdict, never an error. Without momentum, the default, the
    table holds what `estimate(z, momentum=0)` finds. With it, or where a series has spikes (which the compiled call
    detects), a series takes as long as in `estimate`.

    Args:
        series: a list of 1-D arrays of any lengths, a 2-D array with one series a row, or a Series (all samples in
            one array, such as the buffer of an Arrow list column); NaN is a missing sample.
        dt: nominal sample periods before each sample, ≥ 0, shaped like `series`; None = 1 each.
        momentum: τ in nominal sample periods or "auto", as in `estimate`.
        robust: whether spikes are set aside, as in `estimate`.
        r: measurement-noise variance where it is known, unit², > 0, one or shape (series,): as `estimate_fixed_r`.
        ratio: λ = q/r where it is chosen, > 0, one or shape (series,): as `estimate_fixed_ratio`.
        progress: called with the fraction done and a few words; None = not reported.
        cancelled: whether to stop; None = never.

    Returns:
        An EstimateTable, arrays of shape (series,).

    Raises:
        BadSetting: the series or dt have another shape; momentum, robust, r or ratio is out of range, or r and
            ratio are both given, or one of them with momentum.
        Cancelled: `cancelled()` was true.

    Source: as `estimate`.
    """
    many = series_of(series, dt)
    k, tau, always = len(many), checked_momentum(momentum), checked_robust(robust)
    known = Known(above_zero_each("r", r, k), above_zero_each("ratio", ratio, k))
    if known.r is not None and known.ratio is not None:
        raise BadSetting("r and ratio must not both be given: together they leave nothing to find (got both)")
    if known.any and tau != 0.0:
        raise BadSetting(f"momentum must be 0 where r or ratio is given (got {momentum!r})")
    report, set_aside = Progress(progress, cancelled), [np.empty(0, np.intp)]
    numbers, codes, samples = np.empty((16, k)), np.empty(k, np.uint8), np.empty(k, np.intp)
    report(0.0, "fit")
    together = tau == 0.0 and always is not True
    for first, stop in many.parts(_AT_ONCE if together else 1):
        here, some = slice(first, stop), many.between(first, stop)
        numbers[:, here], codes[here], samples[here], again = fit_plain(some, some.starts[1:], known.some(here))
        if not together:
            again = codes[here] < TOO_FEW
        elif always is None:
            again |= _spiky(some, numbers[:, here], again, known.some(here))
        elif known.any:
            again[:] = False
        for i in (first + np.flatnonzero(again)).tolist():
            z, steps = many.one(i)
            if together and always is False and not may_be_below_resolution(z, float(numbers[R, i])):
                continue
            one = _alone(z, steps, known.some(slice(i, i + 1)), momentum, robust)
            numbers[:, i], codes[i] = _row(one, z, steps), VERDICTS.index(one.verdict)
            set_aside += [int(many.starts[i]) + rows for rows in one.spikes]
        report(stop / max(k, 1), "fit")
    q, r_found, q_se, r_se, loglik, low, high, q_low, q_high, r_low, r_high, *rest = numbers
    taus, tau_low, tau_high, spikes, gate = rest
    return EstimateTable(
        q, r_found, q_se, r_se, loglik, (low, high), (q_low, q_high), (r_low, r_high), codes, samples,
        taus, (tau_low, tau_high), spikes.astype(np.intp), gate, np.concatenate(set_aside),
    )  # fmt: skip


def _alone(z: Array, steps: Array, known: Known, momentum: Any, robust: Any) -> Estimate:
    """The estimate of one series."""
    dt = steps if len(steps) else None
    if known.r is not None:
        return estimate_fixed_r(z, float(known.r[0]), dt, robust)
    if known.ratio is not None:
        return estimate_fixed_ratio(z, float(known.ratio[0]), dt, robust)
    return estimate(z, dt=dt, momentum=momentum, robust=robust)


def _row(one: Estimate, z: Array, steps: Array) -> tuple[float, ...]:
    """The numbers of one series."""
    spikes, gate = sum(map(len, one.spikes)), math.inf if one.gate is None else one.gate
    ends = (*one.ratio_interval, *pair_intervals(one, z, steps))
    return one.q, one.r, one.q_se, one.r_se, one.loglik, *ends, one.momentum, *one.momentum_interval, spikes, gate


def _spiky(many: Series, numbers: Array, stepped: Mask, known: Known) -> Mask:
    """Which series may have spikes that `estimate` would set aside; False where readings repeat."""
    suspect = np.empty(len(many), np.bool_)
    for first, stop in many.parts(SEARCHED):
        part, pairs = slice(int(many.starts[first]), int(many.starts[stop])), numbers[:, first:stop]
        starts, steps = many.starts[first : stop + 1] - part.start, many.steps[part]
        suspect[first:stop] = suspect_each(many.values[part], steps, starts, pairs[Q], pairs[R])
    chosen = np.flatnonzero(suspect & ~stepped)

    def fit(some: Series, at: Indices) -> tuple[Array, Array, Mask]:
        fitted, codes, _, repeats = fit_plain(some, some.starts[1:], known.some(chosen[at]))
        return fitted[Q], fitted[R], (codes <= NO_MOVEMENT) & ~repeats

    if len(chosen):
        suspect[chosen] = ~spike_free(many.some(chosen), fit)
    return suspect
