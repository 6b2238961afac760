"""One filter for a whole fleet: the pooled likelihood, what each device loses, which one differs."""

from __future__ import annotations

import math
from dataclasses import dataclass
from statistics import NormalDist
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike

from kalscope.common.numbers import Array, Indices, Mask, above_zero
from kalscope.common.progress import Progress
from kalscope.errors import BadSetting
from kalscope.estimation import kernels
from kalscope.estimation.climb import NORMAL
from kalscope.estimation.fit import estimate
from kalscope.estimation.likelihood import DEFAULT_LOG_RATIOS, Peak, Records, find_peak, take_apart
from kalscope.estimation.many import SEARCHED, Series, fitted_ratios
from kalscope.estimation.result import Estimate
from kalscope.estimation.verdict import exp, gain_of, lag_of
from kalscope.filtering.filter import kalman_filter
from kalscope.filtering.params import MAX_VARIANCE, FilterParams
from kalscope.filtering.steady import steady_state

# One filter for a whole fleet, by the sum of its likelihoods: what each batch adds, and the maximum.


M_LOG_R, LOG_R, LOGDET, SLOPES = range(4)
"""The rows of sums at each ln λ: Σ m ln r̂, Σ ln r̂ with the best r̂ = χ²/m of each device, ΣΣln f, and the
sum of the squares of each device's slope of the log-likelihood with its best r̂, 0 at the ends."""

_ORDER = 15
"""Order of the spline through the points of the grid."""


@dataclass(frozen=True)
class Pool:
    """Sums over the devices of a batch, or of a fleet: `a + b` is the pool of both.

    Sums of floating-point numbers depend on their order in the last digit: add parts in one order (that of their
    names) for the same result after every restart.
    """

    sums: Array
    """Σ m ln r̂, Σ ln r̂, ΣΣln f and Σ(slope)² at each of the 121 ln λ of DEFAULT_LOG_RATIOS, at
    λ = 0 and at λ = ∞ (where q̂ replaces r̂), shape (4, 123)."""
    devices: int
    """Series that count: those that can be fitted."""
    innovations: int
    """Their scored innovations."""

    def __add__(self, other: Pool) -> Pool:
        return Pool(self.sums + other.sums, self.devices + other.devices, self.innovations + other.innovations)

    @staticmethod
    def empty() -> Pool:
        """The pool of no device: where a sum of pools begins."""
        return Pool(np.zeros((4, len(DEFAULT_LOG_RATIOS) + 2)), 0, 0)

    def loglik(self, log_ratios: Array) -> Array:
        """The summed log-likelihood at each ln λ, ∓inf allowed, with the best r of each device."""
        terms = self.innovations * (math.log(2.0 * math.pi) + 1.0)
        return self._between(-0.5 * (terms + self.sums[M_LOG_R] + self.sums[LOGDET]), log_ratios)

    def noise(self, log_ratio: float) -> float:
        """The geometric mean of the best r of the devices at ln λ, unit²; that of q at inf."""
        level = self.sums[LOG_R] / self.devices
        level[:-2] += np.logaddexp(0.0, DEFAULT_LOG_RATIOS)  # ln r(1 + λ) is level at both ends
        size = float(self._between(level, np.array([log_ratio]))[0])
        return math.exp(size - (np.logaddexp(0.0, log_ratio) if math.isfinite(log_ratio) else 0.0))

    def slopes(self, log_ratio: float) -> float:
        """The sum over the devices of their squared slopes of the log-likelihood by ln λ, each with its best r."""
        return max(float(self._between(self.sums[SLOPES], np.array([log_ratio]))[0]), 0.0)

    def _between(self, row: Array, log_ratios: Array) -> Array:
        """A row that is level at both ends at each ln λ; beyond the grid its end is kept."""
        from scipy.interpolate import make_interp_spline

        grid = DEFAULT_LOG_RATIOS
        beyond = (grid[1] - grid[0]) * np.arange(1, _ORDER + 1)
        ends = row[-2], row[-1] if np.isfinite(row[-1]) else row[-3]
        places = np.concatenate([grid[0] - beyond[::-1], grid, grid[-1] + beyond])
        longer = np.concatenate([np.full(_ORDER, ends[0]), row[:-2], np.full(_ORDER, ends[1])])
        spline = cast("Any", make_interp_spline(places, longer - ends[0], _ORDER))
        inner: Array = np.asarray(spline(np.clip(log_ratios, grid[0], grid[-1])), dtype=np.float64) + ends[0]
        return np.where(np.isneginf(log_ratios), row[-2], np.where(np.isposinf(log_ratios), row[-1], inner))


def pool_of(many: Series) -> Pool:
    """The pool of some devices, one compiled call. Series that cannot be fitted do not count.

    Source: Durbin & Koopman (2012), section 2.10, for the likelihood; independent devices add.
    """
    pool = Pool.empty()
    for first, stop in many.parts(SEARCHED):
        starts = many.starts[first : stop + 1]
        data, _, _, defects = take_apart(many.values, many.steps, starts[:-1], starts[1:])
        data = data.only(np.flatnonzero(defects == kernels.GOOD))
        rows = np.flatnonzero((data.scale > 1e-145) & (data.scale < 1e145))  # their squares fit a double
        if len(rows):
            pool = pool + _pool_of(data, rows)
    return pool


def _pool_of(data: Records, rows: Indices) -> Pool:
    """The pool of some records."""
    grid, m = DEFAULT_LOG_RATIOS, data.m[rows, None]
    chi2, logdet = data.sums(rows, np.exp(np.tile(np.append(grid, -math.inf), (len(rows), 1))))
    walk = data.random_walk
    with np.errstate(divide="ignore"):
        log_r = np.log(np.column_stack([chi2, walk[0][rows]]) / m) + 2.0 * np.log(data.scale[rows, None])
    logdet = np.column_stack([logdet, walk[1][rows]])
    change = m * (log_r[:, 2:-2] - log_r[:, :-4]) + logdet[:, 2:-2] - logdet[:, :-4]
    slopes = np.zeros_like(log_r)
    slopes[:, 1:-3] = -0.5 * change / (grid[2:] - grid[:-2])
    return Pool(np.stack([m * log_r, log_r, logdet, slopes * slopes]).sum(axis=1), len(rows), int(m.sum()))


def fit_pool(pool: Pool) -> Estimate:
    """The most likely λ for all devices of a fleet, every device with its r, concentrated out.

    Args:
        pool: of the fleet, the sum of the pools of its batches.

    Returns:
        q and r with the geometric mean of the r that suit the devices best; verdict "ok", "no_noise", "no_movement"
        or "flat". `ratio_interval` has the λ that another fleet of such devices may have as its best one, 95 %:
        profile likelihood, wider where the devices differ. It is narrow for a large fleet, and does not show how
        far its devices differ: see `outliers`.

    Raises:
        BadSetting: no device counts.
    """
    _refuse_empty(pool)
    at_infinity = float(pool.loglik(np.array([math.inf]))[0])
    peak = find_peak(pool.loglik, DEFAULT_LOG_RATIOS[::2], at_infinity, Progress())
    low, high = (exp(end) for end in _interval(pool, peak, at_infinity))
    verdicts = {-math.inf: "no_movement", math.inf: "no_noise"}
    verdict = verdicts.get(peak.log_ratio, "flat" if (low, high) == (0.0, math.inf) else "ok")
    return _pooled(pool, peak.log_ratio, peak.loglik, (low, high), verdict)


def _pooled(pool: Pool, at: float, loglik: float, interval: tuple[float, float], verdict: str) -> Estimate:
    """The filter of ln λ `at`; without parameters where q or r is 0."""
    noise = pool.noise(at)
    q, r = (noise, 0.0) if at == math.inf else (exp(at) * noise, noise)
    params = FilterParams(q=q, r=r) if q > 0.0 and r > 0.0 else None
    return Estimate(q=q, r=r, loglik=loglik, verdict=verdict, message="", params=params, ratio_interval=interval)


def _interval(pool: Pool, peak: Peak, at_infinity: float) -> tuple[float, float]:
    """The interval of ln λ, which accounts for how much the devices differ.

    The slopes of the devices at the top scatter by the curvature where all share λ, by more where they do not; the
    likelihood is flattened by that factor.

    Source: Kent (1982), Biometrika 69, 19, for the likelihood ratio of a model that is not quite true.
    """
    if not (math.isfinite(peak.log_ratio) and peak.curvature < 0.0):
        return peak.interval
    factor = pool.slopes(peak.log_ratio) / -peak.curvature
    if factor <= 1.0:
        return peak.interval

    def flattened(at: Array) -> Array:
        return pool.loglik(at) / factor

    return find_peak(flattened, DEFAULT_LOG_RATIOS[::2], at_infinity / factor, Progress()).interval


def pool_at(pool: Pool, ratio: float) -> Estimate:
    """The filter of a given λ (of `ratio_for` a lag, say) for all devices of a fleet, with the r that fits it best.

    Args:
        pool: of the fleet.
        ratio: λ = q/r, > 0.

    Returns:
        As `fit_pool`, with the verdict "given".

    Raises:
        BadSetting: no device counts; ratio is not above 0.
    """
    _refuse_empty(pool)
    at = math.log(above_zero("ratio", ratio, MAX_VARIANCE))
    return _pooled(pool, at, float(pool.loglik(np.array([at]))[0]), fit_pool(pool).ratio_interval, "given")


def _refuse_empty(pool: Pool) -> None:
    if pool.devices == 0:
        raise BadSetting("the fleet must hold at least one series that can be fitted (got none)")


# What each device loses by a filter for all: its prediction errors on samples that no fit has seen.


LOG_RATIOS = np.linspace(-15.0, 7.0, 23)
"""ln λ at which the errors are kept, from a lag of 1,800 samples to none."""
LOG_RATIOS.setflags(write=False)


def held_out(many: Series, momentum: Mask | None = None) -> Array:
    """What each device would lose by any shared λ: prediction error over that of a filter of its own.

    The device's own filter is the most likely one for the first half of its samples; the errors of both, root mean
    squares of predicting the next sample, are those on the second half.

    Args:
        many: the devices.
        momentum: whose own filter may have momentum, shape (series,); None = none. Such a fit takes as long as in
            `estimate`.

    Returns:
        The ratio at each of LOG_RATIOS, shape (series, 23), above 1 where the device would do better alone; NaN
        where the first half cannot be fitted.
    """
    middles = (many.starts[:-1] + many.starts[1:]) // 2
    fitted = fitted_ratios(many, middles)
    errors = np.full((len(many), len(LOG_RATIOS) + 1), math.nan)
    for first, stop in many.parts(SEARCHED):
        starts = many.starts[first : stop + 1]
        known = np.diff(take_apart(many.values, many.steps, starts[:-1], middles[first:stop])[0].starts)
        data = take_apart(many.values, many.steps, starts[:-1], starts[1:])[0]
        since = np.where(np.isnan(fitted[first:stop]), np.diff(data.starts), known)
        # The largest λ passes the samples unchanged, as far as a double can tell.
        ratios = np.column_stack(
            [np.tile(np.exp(LOG_RATIOS), (stop - first, 1)), np.minimum(fitted[first:stop], 1e18)]
        )
        kernels.squares_since(data.d, data.gap, data.starts, since, ratios, errors[first:stop])
        errors[first:stop] *= data.scale[:, None]
    errors, fitted_error = errors[:, :-1], errors[:, -1].copy()
    for i in () if momentum is None else np.flatnonzero(momentum & np.isfinite(fitted_error)).tolist():
        fitted_error[i] = _error_with_momentum(*many.one(i), fitted_error[i])
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(fitted_error[:, None] > 0.0, errors / fitted_error[:, None], math.nan)


def _error_with_momentum(z: Array, steps: Array, otherwise: float) -> float:
    """The error on the second half of the filter fitted to the first half, which may have momentum."""
    half, dt = len(z) // 2, steps if len(steps) else None
    moving = estimate(z[:half], dt=None if dt is None else dt[:half], momentum="auto", robust=False)
    if moving.params is None or not float(moving.momentum) > 0.0:
        return otherwise
    seen = kalman_filter(z, moving.params, dt).innovation[half:]
    return math.sqrt(float(np.nanmean(seen**2)))


def held_out_at(growth: ArrayLike, ratio: float) -> Array:
    """The ratio of errors at one λ, shape (k,), by a cubic spline through those of `held_out`.

    Between those points it is good to 0.1 %; beyond them the nearest one is used.

    Args:
        growth: of `held_out`, shape (k, 23), also as float32.
        ratio: λ that all share, > 0.
    """
    from scipy.interpolate import CubicSpline

    growth = np.asarray(growth, dtype=np.float64)
    place = min(max(math.log(ratio), LOG_RATIOS[0]), LOG_RATIOS[-1])
    judged = np.isfinite(growth).all(axis=1) & (growth > 0.0).all(axis=1)
    out = np.full(len(growth), math.nan)
    if judged.any():
        out[judged] = np.exp(CubicSpline(LOG_RATIOS, np.log(growth[judged]), axis=1)(place))
    return out


def share_served(growth: ArrayLike, within: float = 0.1) -> float:
    """Share of the judged devices whose prediction error grows by at most `within`, 0 … 1; 1 where none is judged.

    Args:
        growth: by which share the error grows, shape (k,); NaN where not judged.
        within: allowed growth, 0.1 = 10 %.
    """
    shares = np.asarray(growth, dtype=np.float64)
    judged = shares[np.isfinite(shares)]
    return float(np.mean(judged <= within)) if len(judged) else 1.0


LOG_RATIO, MOMENTUM, GROWTH = range(3)
"""Columns of what a fit stores: ln λ and momentum of the device's own filter; from GROWTH on `held_out`."""
WIDTH = GROWTH + len(LOG_RATIOS)
"""How many there are."""


@dataclass(frozen=True)
class Losses:
    """What k devices lose by a shared filter, arrays of shape (k,), NaN where not known; below 0 they gain."""

    lag_samples: Array
    """By how many samples it lags a ramp more than the device's own filter."""
    noise_db: Array
    """How much more white noise it leaves than the device's own filter, dB."""
    error: Array
    """By which share its error of predicting the next sample, on the second half of the samples, is larger than
    that of the filter that suits the first half best."""


def loss_inputs(device_ratio: Array, device_momentum: Array, growth: Array) -> Array:
    """What the fits of k devices store, shape (k, WIDTH).

    Args:
        device_ratio: λ of each device's own filter, > 0, shape (k,).
        device_momentum: its momentum, sample periods, 0 = none.
        growth: of `held_out`, shape (k, 23).
    """
    return np.column_stack([np.log(device_ratio), device_momentum, growth])


def losses_of(inputs: Array, params: FilterParams) -> Losses:
    """What each device loses by a filter.

    Args:
        inputs: of `loss_inputs`, shape (k, WIDTH); NaN where not known.
        params: the filter that all share, q and r above 0. With momentum the errors are not known.
    """
    ratio, tau = params.q / float(params.r), params.momentum
    shared = steady_state(params)
    device_lag, device_reduction = _settled(inputs)
    error = np.full(len(inputs), math.nan) if tau > 0.0 else held_out_at(inputs[:, GROWTH:], ratio) - 1.0
    return Losses(shared.lag_samples - device_lag, device_reduction - shared.noise_reduction_db, error)


def _settled(inputs: Array) -> tuple[Array, Array]:
    """Lag in samples and noise reduction in dB of each device's own filter."""
    ratio, tau = np.exp(inputs[:, LOG_RATIO]), inputs[:, MOMENTUM]
    gain, lag = gain_of(ratio), lag_of(ratio)
    reduction = 10.0 * np.log10((2.0 - gain) / gain)
    for i in np.flatnonzero((tau > 0.0) & np.isfinite(ratio)).tolist():
        fitted = steady_state(FilterParams(float(ratio[i]), 1.0, momentum=float(tau[i])))
        lag[i], reduction[i] = fitted.lag_samples, fitted.noise_reduction_db
    return lag, reduction


# Devices compared: which lie apart from the others.


_MAD = NormalDist().inv_cdf(0.75)
"""Median distance from the median of a normal distribution, standard deviations: 0.6745."""

MIN_DEVICES = 8
"""Minimum number of devices whose spread can be judged."""


@dataclass(frozen=True)
class Outliers:
    """How far each of k devices lies from the others in one quantity."""

    z: Array
    """Distance from the fleet's middle in standard deviations, shape (k,); NaN where the device has no value."""
    devices: Indices
    """Those beyond the threshold, farthest first."""
    threshold: float
    """|z| beyond which a device is named."""
    expected: float
    """How many devices of a fleet without any unlike one lie beyond it by chance, if they scatter normally."""
    middle: float
    """Median of the fleet."""
    spread: float
    """Standard deviation of the fleet by the median distance from the median, without that of the estimates."""


def outliers(values: Array, interval: tuple[Array, Array], expected: float) -> Outliers:
    """The devices whose value is unlike that of the others.

    Args:
        values: one a device, on a scale on which they scatter normally (ln r, ln q, ln of the rate), finite, shape
            (k,); NaN for a device without one.
        interval: the 95 % interval of each, two arrays of shape (k,), ends may be infinite: a short recording
            scatters more.
        expected: devices that may be named by chance in the whole fleet, above 0, at most one in twenty: 0.05 names
            one in one fleet of twenty.

    Source: Iglewicz & Hoaglin (1993), How to detect and handle outliers, for the robust z.
    """
    given = ~np.isnan(values)
    count = int(given.sum())
    if count < MIN_DEVICES:
        return Outliers(np.full(len(values), math.nan), np.empty(0, np.intp), math.inf, 0.0, math.nan, math.nan)
    threshold = -NormalDist().inv_cdf(0.5 * expected / count)
    middle = float(np.median(values[given]))
    whole = float(np.median(np.abs(values[given] - middle))) / _MAD
    sides: Array = np.stack([values - interval[0], interval[1] - values]) / NORMAL
    down: Array = sides[0]
    up: Array = sides[1]
    errors: Array = np.where(np.isinf(sides[::-1]), sides, 0.5 * (down + up)).min(axis=0)[given]
    errors = errors[np.isfinite(errors)]
    usual = float(np.median(errors)) if len(errors) else 0.0
    spread = math.sqrt(max(whole * whole - usual * usual, 0.0))
    with np.errstate(divide="ignore", invalid="ignore"):
        # the side of the interval that faces the middle counts
        sizes = np.hypot(spread, np.where(values < middle, up, down))
        z = np.where(values == middle, 0.0, (values - middle) / sizes)
    beyond = np.flatnonzero(np.abs(z) > threshold)
    order = np.argsort(-np.abs(z[beyond]), kind="stable")
    return Outliers(z, beyond[order], threshold, expected, middle, spread)
