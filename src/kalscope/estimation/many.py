"""`estimate_many`: q and r of many series in one compiled call, and the table that it gives."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kalscope.common.numbers import Array, Mask
from kalscope.common.progress import Progress
from kalscope.errors import BadSetting
from kalscope.estimation import kernels, many_kernels
from kalscope.estimation.fit import (
    checked_momentum,
    estimate,
    estimate_fixed_r,
    estimate_fixed_ratio,
    may_be_below_resolution,
)
from kalscope.estimation.kernels import suspect_each
from kalscope.estimation.result import USABLE, Estimate
from kalscope.estimation.spikes import MAX_FITS, checked_robust, more_than_chance
from kalscope.filtering.params import MAX_VARIANCE, samples_of

# EstimateTable: what was found in each of many series, one array a quantity.


VERDICTS = (
    "ok", "flat", "no_noise", "no_movement", "too_few", "constant", "bad_unit", "infinite", "bad_steps",
    "below_resolution", "only_spikes", "too_many_outliers", "not_converged", "irregular",
)  # fmt: skip
"""Every verdict by its code: those of `Estimate`, and "infinite" (a sample is inf) and "bad_steps" (a step is
negative or not finite), for which `estimate` raises an error."""

_USABLE_CODES = [VERDICTS.index(name) for name in USABLE]


@dataclass(frozen=True)
class EstimateTable:
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
        return gains_of(self.ratio)

    @property
    def lag_samples(self) -> Array:
        """Lag on a ramp without momentum, samples, 0 … inf."""
        return lags_of(self.ratio)

    @property
    def gain_interval(self) -> tuple[Array, Array]:
        """The steady gains that the record allows, without momentum."""
        return gains_of(self.ratio_interval[0]), gains_of(self.ratio_interval[1])

    @property
    def lag_interval(self) -> tuple[Array, Array]:
        """The lags that the record allows, without momentum, samples, the short one first."""
        return lags_of(self.ratio_interval[1]), lags_of(self.ratio_interval[0])


def gains_of(ratio: Array) -> Array:
    """Steady gain of λ = 0 … inf: 2/(1 + √(1 + 4/λ))."""
    with np.errstate(divide="ignore"):
        return 2.0 / (1.0 + np.hypot(1.0, 2.0 / np.sqrt(ratio)))


def lags_of(ratio: Array) -> Array:
    """Lag on a ramp in samples of λ = 0 … inf, (1 − K)/K without cancellation."""
    with np.errstate(divide="ignore", invalid="ignore"):
        half = 2.0 / np.sqrt(ratio)
        return np.where(ratio > 0.0, 0.5 * half * (half / (np.hypot(1.0, half) + 1.0)), np.inf)


def reductions_of(ratio: Array) -> Array:
    """White noise in to out of λ = 0 … inf, dB: −10·log10(K/(2 − K))."""
    gain = gains_of(ratio)
    with np.errstate(divide="ignore"):
        return 10.0 * np.log10((2.0 - gain) / gain)


# Many series in one piece of memory: what every compiled loop over a fleet takes.


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

    def some(self, rows: NDArray[np.intp]) -> Series:
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
            stop = min(max(end, first + 1), len(self))
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


def above_zero_each(name: str, value: ArrayLike | None, count: int) -> Array:
    """One number above 0 a series, shape (count,), of one for all or one each; NaN each for None."""
    if value is None:
        return np.full(count, np.nan)
    try:
        array: Array = np.array(np.broadcast_to(np.asarray(value, dtype=np.float64), (count,)))
    except (TypeError, ValueError):
        raise BadSetting(f"{name} must be one number, or one a series, {count} (got something else)") from None
    if count and not (array.min() > 0.0 and array.max() <= MAX_VARIANCE):
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


# Which series that look spiky have no spikes after all: the loop of `robust.fit`, for many series at once.
#
# A signal that moves far more than the noise looks spiky to the centred median. Each round fits all such series in
# one compiled call, so that only those with true spikes are left to the fit of a single one.


Fit = Callable[[Series, NDArray[np.intp]], tuple[Array, Array, Mask]]
"""q, r and whether they can be trusted of some series, which are at these places among those given."""


def spike_free(many: Series, fit: Fit) -> Mask:
    """Whether `estimate` would return the plain fit of each series, shape (series,). False where it is not sure.

    Args:
        many: the series that look spiky, and can be fitted, in memory of their own.
        fit: how.
    """
    far, repeated = np.zeros(len(many.values), np.bool_), np.zeros(len(many), np.bool_)
    kernels.far_each(many.values, many.starts, far, repeated)
    free, seen = np.zeros(len(many), np.bool_), [set[bytes]() for _ in range(len(many))]
    active, away, last = np.flatnonzero(~repeated), far, np.zeros(len(many), np.bool_)
    for _ in range(MAX_FITS + 1):
        if not len(active):
            break
        some = many.some(active)
        now = np.concatenate([away[many.starts[i] : many.starts[i + 1]] for i in active])
        q, r, good = fit(Series(np.where(now, np.nan, some.values), some.starts, some.steps), active)
        scores = np.empty(len(some.values))
        kernels.unpredicted_each(some.values, some.steps, some.starts, q, r, scores)
        going = good.copy()
        for k in np.flatnonzero(good):
            i, here = int(active[k]), slice(int(some.starts[k]), int(some.starts[k + 1]))
            before, after = now[here], scores[here] > 0.0
            if last[i] or np.array_equal(before, after):
                free[i] = not more_than_chance(np.where(before, scores[here], 0.0), some.values[here])
                going[k] = False
                continue
            if after.tobytes() in seen[i]:  # a few doubtful samples come and go: they stay in
                last[i], after = True, before & after
            seen[i].add(before.tobytes())
            away[many.starts[i] : many.starts[i + 1]] = after
        active = active[going]
    return free


# The fit without momentum and without a search for spikes, of many series in one compiled call.


KINDS = {"ml": many_kernels.FREE, "fixed_r": many_kernels.KNOWN_R, "fixed_ratio": many_kernels.KNOWN_RATIO}
"""What each method of `Estimate` knows, as the kernels name it."""

EQUAL = 1e-6
"""Relative difference between the q/r of two fits that are the same."""


def fit_plain(
    many: Series, kind: int, known: Array, ends: NDArray[np.int64]
) -> tuple[Array, NDArray[np.uint8], NDArray[np.int64], Mask]:
    """Fit each series up to one of `ends`, indices into the values, shape (series,).

    Returns:
        The columns of numbers and the codes of the kernels, the finite samples, and whether readings repeat.
    """
    k = len(many)
    numbers, codes = np.empty((k, many_kernels.NUMBERS)), np.empty(k, np.uint8)
    samples, stepped = np.empty(k, np.int64), np.empty(k, np.bool_)
    many_kernels.fit_each(
        many.values, many.steps, many.starts[:-1], ends, kind, known, numbers, codes, samples, stepped
    )
    return numbers, codes, samples, stepped


def fitted_ratios(many: Series, ends: NDArray[np.int64]) -> Array:
    """The most likely λ of each series up to one of `ends`, 0 … inf; NaN without any."""
    numbers, codes, _, _ = fit_plain(many, many_kernels.FREE, np.empty(len(many)), ends)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(
            codes <= many_kernels.NO_MOVEMENT, numbers[:, many_kernels.Q] / numbers[:, many_kernels.R], math.nan
        )


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
    kind = KINDS.get(one.method)
    if kind is None or float(one.momentum) > 0.0 or not (float(one.q) > 0.0 and float(one.r) > 0.0):
        return wald
    used = z if one.outliers is None else np.where(one.outliers, np.nan, z)
    many = Series(np.array(used, dtype=np.float64), np.array([0, len(z)]), steps)
    known = np.array(
        [{many_kernels.KNOWN_R: one.r, many_kernels.KNOWN_RATIO: one.ratio}.get(kind, math.nan)], np.float64
    )
    (found,), (code,), _, _ = fit_plain(many, kind, known, many.starts[1:])
    if (
        code not in (many_kernels.OK, many_kernels.FLAT)
        or abs(found[many_kernels.Q] / found[many_kernels.R] / float(one.ratio) - 1.0) > EQUAL
    ):
        return wald
    # The spike-proof fit corrects r for the good samples that its rule removes.
    factor = 1.0 if kind == many_kernels.KNOWN_R else float(one.r) / found[many_kernels.R]
    low, high, r_low, r_high = (factor * found[many_kernels.Q_LOW :]).tolist()
    return low, high, r_low, r_high


def _around(value: float, error: float) -> tuple[float, float]:
    """The 95 % interval of a variance from its standard error, on the scale of the logarithm."""
    size, spread = value, error
    if not (size > 0.0 and math.isfinite(spread)):
        return 0.0, math.inf
    factor = math.exp(min(many_kernels.NORMAL * spread / size, 700.0))
    return size / factor, size * factor


# `estimate_many`: q and r of many series in one compiled call, without Python code per series.


_AT_ONCE = 4_000_000
"""Samples of one compiled call, a fraction of a second; progress and cancellation are handled between two."""


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
    asked = _Asked.of(len(many), momentum, robust, r, ratio)
    report = Progress(progress, cancelled)
    table = _Columns(len(many))
    report(0.0, "fit")
    compiled = asked.tau == 0.0 and asked.robust is not True
    for first, stop in many.parts(_AT_ONCE if compiled else 1):
        part = Series(many.values, many.starts[first : stop + 1], many.steps)
        table.fit(part, asked, slice(first, stop))
        again = range(first, stop) if not compiled else first + np.flatnonzero(table.again[first:stop])
        for i in again:
            if asked.kind == many_kernels.FREE or asked.robust is not False:
                table.refine(int(i), many, asked)
        report(stop / max(len(many), 1), "fit")
    return table.as_table()


@dataclass(frozen=True)
class _Asked:
    """What the caller asked for, checked."""

    tau: float | None
    """Momentum; None = to be found."""
    robust: bool | None
    """Whether spikes are set aside; None = where there are any."""
    kind: int
    """What is known, as the kernels name it."""
    known: Array
    """r or λ of each series, shape (k,)."""

    @staticmethod
    def of(count: int, momentum: Any, robust: Any, r: Any, ratio: Any) -> _Asked:
        if r is not None and ratio is not None:
            raise BadSetting("r and ratio must not both be given: together they leave nothing to find (got both)")
        tau = checked_momentum(momentum, "ml")
        kind = (
            many_kernels.KNOWN_R
            if r is not None
            else many_kernels.KNOWN_RATIO
            if ratio is not None
            else many_kernels.FREE
        )
        if kind != many_kernels.FREE and tau != 0.0:
            raise BadSetting(f"momentum must be 0 where r or ratio is given (got {momentum!r})")
        known = above_zero_each("r", r, count) if r is not None else above_zero_each("ratio", ratio, count)
        return _Asked(tau, checked_robust(robust), kind, known)

    def of_one(self, index: int, z: Array, dt: Array | None) -> Estimate:
        """The estimate of one series, as the library finds it for a single one."""
        robust = "auto" if self.robust is None else self.robust
        if self.kind == many_kernels.KNOWN_R:
            return estimate_fixed_r(z, float(self.known[index]), dt, robust)
        if self.kind == many_kernels.KNOWN_RATIO:
            return estimate_fixed_ratio(z, float(self.known[index]), dt, robust)
        return estimate(z, dt=dt, momentum="auto" if self.tau is None else self.tau, robust=robust)


class _Columns:
    """The table while it is filled."""

    def __init__(self, count: int) -> None:
        self.numbers = np.empty((count, many_kernels.NUMBERS))
        self.codes = np.empty(count, np.uint8)
        self.samples = np.empty(count, np.int64)
        self.again = np.empty(count, np.bool_)
        self.momentum = np.zeros((3, count))
        self.spikes = np.zeros(count, np.int64)
        self.gate = np.full(count, math.inf)
        self.set_aside: list[NDArray[np.int64]] = []

    def fit(self, many: Series, asked: _Asked, rows: slice) -> None:
        """Fit some series, in one compiled call."""
        found = fit_plain(many, asked.kind, asked.known[rows], many.starts[1:])
        self.numbers[rows], self.codes[rows], self.samples[rows], self.again[rows] = found
        if asked.robust is None:
            q, r = np.ascontiguousarray(self.numbers[rows, [many_kernels.Q, many_kernels.R]].T)
            suspect = np.empty(len(many), np.bool_)
            suspect_each(many.values, many.steps, many.starts[:-1], many.starts[1:], q, r, suspect)
            self._clear(many, asked, rows, suspect)
            self.again[rows] |= suspect

    def _clear(self, many: Series, asked: _Asked, rows: slice, suspect: Mask) -> None:
        """Unmark the suspect series that have no spikes after all."""
        chosen = np.flatnonzero(suspect & ~self.again[rows])
        if not len(chosen):
            return
        known = asked.known[rows][chosen]

        def fit(some: Series, at: NDArray[np.intp]) -> tuple[Array, Array, Mask]:
            numbers, codes, _, stepped = fit_plain(some, asked.kind, known[at], some.starts[1:])
            q, r = np.ascontiguousarray(numbers[:, [many_kernels.Q, many_kernels.R]].T)
            return q, r, (codes <= many_kernels.NO_MOVEMENT) & ~stepped

        suspect[chosen] = ~spike_free(many.some(chosen), fit)

    def refine(self, i: int, many: Series, asked: _Asked) -> None:
        """Fit one series as `estimate` does, unless nothing in it can be fitted or its numbers would stay."""
        if self.codes[i] in (
            many_kernels.HOLDS_INF,
            many_kernels.BAD_STEPS,
            many_kernels.TOO_FEW,
            many_kernels.CONSTANT,
        ):
            return
        (z, steps), start = many.one(i), int(many.starts[i])
        plain = asked.tau == 0.0 and asked.robust is False
        if plain and not may_be_below_resolution(z, float(self.numbers[i, many_kernels.R])):
            return
        one = asked.of_one(i, z, steps if len(steps) else None)
        ends = pair_intervals(one, z, steps)
        self.numbers[i] = (one.q, one.r, one.q_se, one.r_se, one.loglik, *one.ratio_interval, *ends)
        self.codes[i] = VERDICTS.index(str(one.verdict))
        self.momentum[:, i] = (one.momentum, *one.momentum_interval)
        if one.outliers is not None:
            away = np.flatnonzero(one.outliers)
            self.spikes[i] = len(away)
            self.set_aside.append(start + away)
        self.gate[i] = math.inf if one.gate is None else float(one.gate)

    def as_table(self) -> EstimateTable:
        q, r, q_se, r_se, loglik, *ends = np.ascontiguousarray(self.numbers.T)
        tau, tau_low, tau_high = self.momentum
        away = np.concatenate([np.empty(0, np.int64), *self.set_aside])
        return EstimateTable(
            q, r, q_se, r_se, loglik, (ends[0], ends[1]), (ends[2], ends[3]), (ends[4], ends[5]),
            self.codes, self.samples, tau, (tau_low, tau_high), self.spikes, self.gate, away,
        )  # fmt: skip
