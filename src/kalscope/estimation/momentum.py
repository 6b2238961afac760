"""Maximum likelihood of q, r and τ, and whether a record needs momentum."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import ArrayLike

from kalscope.common.numbers import Array
from kalscope.common.progress import Progress
from kalscope.common.text import number, percent
from kalscope.errors import BadSetting
from kalscope.estimation import kernels
from kalscope.estimation import verdict as verdict_words
from kalscope.estimation.climb import (
    FINE,
    FINE_STEPS,
    MIN_MOMENTUM,
    NORMAL,
    Function,
    Local,
    Top,
    climb,
    interval_end,
    step_variance,
)
from kalscope.estimation.likelihood import (
    DEFAULT_LOG_RATIOS,
    DROP,
    MAX_LOG_RATIO,
    Differences,
    Peak,
    Profile,
    differences,
    find_peak,
    fit_near,
    grid_for,
    loglik_of,
    logs_near,
    relative_errors,
)
from kalscope.estimation.result import Estimate, MomentumFit
from kalscope.estimation.verdict import MIN_VARIANCE
from kalscope.filtering.filter import kalman_filter
from kalscope.filtering.params import MAX_MOMENTUM, MAX_VARIANCE, FilterParams, one_record
from kalscope.filtering.steady import SteadyState, steady_state

# The likelihood of q, r and τ, the scale concentrated out: over ln of the step variance by r, and over ln τ.
#
# As in `likelihood.search_records` the first sample sets the exact diffuse start and is not scored, so the values
# compare with those of the random walk. The pair is measured by the variance of one step of the signal over that of
# the noise: on that scale the likelihood of every τ has its maximum near the same place, where q/r would run away
# as τ².


def moving_sums(data: Differences, q: Array, r: Array, tau: Array) -> tuple[Array, Array]:
    """Σv²/s (in scale²) and Σln s for each triple, shape (k,); those of one τ should be adjacent."""
    k = len(q)
    q, r, tau = (np.concatenate([part, np.full(-k % kernels.MOMENTUM_LANES, part[-1])]) for part in (q, r, tau))
    chi2, logdet = np.empty_like(q), np.empty_like(q)
    kernels.scan_lanes(data.d, data.gap, q, r, tau, chi2, logdet)
    return chi2[:k], logdet[:k]


def concentrated(data: Differences, log_moves: Array, tau: Array) -> tuple[Array, Array]:
    """Log-likelihood of each ln(variance of one step / r), ∓inf allowed, and its best scale, in scale²."""
    q, r = pairs(log_moves, tau)
    chi2, logdet = moving_sums(data, q, r, tau)
    loglik = data.from_sums(chi2, logdet)
    # Without noise two samples at one instant, s = 0, contradict each other.
    return np.where(np.isnan(loglik), -math.inf, loglik), chi2 / data.m


def pairs(log_moves: Array, tau: Array) -> Array:
    """Q and r up to their scale, for each ln(variance of one step / r); exact at ∓inf."""
    with np.errstate(over="ignore"):
        q, r = 1.0 / (1.0 + np.exp(-log_moves)) / step_variances(tau), 1.0 / (1.0 + np.exp(log_moves))
    return np.stack([q, r])


def ratio_of(log_moves: float, tau: float) -> float:
    """q/r of ln(variance of one step / r), 0 … inf."""
    return math.exp(log_moves) / step_variance(tau) if log_moves < 700.0 else math.inf


def step_variances(tau: Array) -> Array:
    """Variance of one step of the signal for q = 1, shape of `tau`."""
    values = tau.tolist()
    known = {value: step_variance(value) for value in set(values)}  # many lanes have one τ
    return np.array([known[value] for value in values])


# The likelihood over λ = q/r for a given momentum.


SPACING = float(DEFAULT_LOG_RATIOS[1] - DEFAULT_LOG_RATIOS[0])
"""Of the values of ln λ."""


def likelihood_profile(
    z: ArrayLike, log_ratios: ArrayLike | None = None, dt: ArrayLike | None = None, momentum: float = 0.0
) -> Profile:
    """Scan the likelihood of one channel over λ, exact diffuse start, in a single pass over the data.

    Args:
        z: measurements, shape (n,), at least two of them finite; NaN is a missing sample.
        log_ratios: ln λ, shape (k,), ascending, within ±300; None = 121 values from −24 to 24, with momentum
            as many more above as its steps are smaller.
        dt: nominal sample periods before each sample, shape (n,), ≥ 0; None = 1 each.
        momentum: τ in nominal sample periods, 0 … 1e5.

    Raises:
        BadSetting: z is not one channel, holds inf or fewer than two finite samples; log_ratios do not ascend or
            exceed ±300; dt does not fit z; momentum is out of its range.
    """
    tau = float(FilterParams(q=1.0, r=1.0, momentum=momentum).momentum)
    step = step_variance(tau)
    data = differences(*one_record(z, dt))
    grid = default_log_ratios(step) if log_ratios is None else np.asarray(log_ratios, dtype=np.float64)
    if grid.ndim != 1 or len(grid) < 2 or not np.all(np.diff(grid) > 0) or not np.abs(grid).max() <= MAX_LOG_RATIO:
        raise BadSetting(f"log_ratios must be two or more ascending numbers within ±300 (got {log_ratios})")
    if data.m < 1:
        raise BadSetting("z must hold at least two finite samples (got fewer)")
    chi2, logdet = _sums(data, grid, tau, step) if tau else data.sums(np.exp(grid))
    loglik = data.from_sums(chi2, logdet)
    with np.errstate(over="ignore", under="ignore"):
        chi2 = chi2 * data.scale * data.scale
    return Profile(grid, loglik, chi2 / data.m, chi2, logdet, data.m, step)


def default_log_ratios(step: float) -> Array:
    """Ln λ from lags far beyond any record to no filtering; a step of the signal has the variance q·`step`."""
    more = math.ceil(-math.log(step) / SPACING)
    return np.concatenate([DEFAULT_LOG_RATIOS, DEFAULT_LOG_RATIOS[-1] + SPACING * np.arange(1.0, more + 1.0)])


def _sums(data: Differences, grid: Array, tau: float, step: float) -> tuple[Array, Array]:
    """Σv²/f (in scale²) and Σln f with r = 1, computed with variances near 1 and scaled to that."""
    r = 1.0 / (1.0 + np.exp(grid + math.log(step)))
    q = 1.0 / (np.exp(-grid) + step)
    chi2, logdet = moving_sums(data, q, r, np.full(len(grid), tau))
    return chi2 * r, logdet - data.m * np.log(r)


# The maximum of the likelihood over q, r and τ: a coarse table, then the climb from its highest places.
#
# The table is of a part of a long record: only its places are used, and the whole record decides between them.


HIGHEST = 24.0
"""Largest finite ln(step variance / r) searched: no noise, as far as a double can tell."""

_PLACES = 16
"""Momenta of the table: steps of 0.92 in ln τ."""
_TABLE_STEP = 1.6
"""Step of the table in ln(step variance / r)."""
_STRETCHES, _STRETCH = 8, 512
"""Stretches of a long record, and samples of each, that the table is made of."""
_PLATEAU = 8.0
"""ln(step variance / r) from which the noise of a part of the record is too little to show where it is."""
_MAX_PEAKS = 3
"""Local maxima of the table to examine."""
_NEAR = 0.1
"""Rise of a step of the climb from each of them, below which only the highest is climbed on from."""
_FAR_BELOW = 20.0
"""Loss of log-likelihood without noise beyond which no other τ near is tried."""
_SEEN = 1e-3
"""Rise of the last step towards the best ratio of one τ; the step itself is added, and what is left is far less."""
_FAR_FROM_EDGE = 9.2
"""ln of samples times (r / step variance)², about the loss by r = 0, from which that is not tried."""

_NODES = 0.02 * chebyshev.chebpts1(4)
"""Points along each coordinate whose cubic polynomial stands for the likelihood near a place."""
_DERIVATIVES = np.linalg.inv(np.vander(_NODES, increasing=True))[:3] * np.array([[1.0], [1.0], [2.0]])
"""From the heights there to height, slope and curvature in the middle."""
_LOW = np.array([math.log(MIN_MOMENTUM), -math.inf])
_HIGH = np.array([math.log(MAX_MOMENTUM), HIGHEST])
"""Bounds of ln τ and ln(step variance / r)."""


def momentum_of(log_tau: float) -> float:
    """τ of ln τ, not rounded beyond what the filter takes."""
    return min(math.exp(log_tau), MAX_MOMENTUM)


def _likelihood(
    data: Differences, progress: Progress, log_tau: float | None = None, log_moves: float | None = None
) -> Function:
    """The log-likelihood over (ln τ, ln(step variance / r)), or over one of the two where the other is given."""

    def function(at: Array) -> Local:
        progress(0.0, "likelihood around the best momentum")
        taus = np.exp(at[0] + _NODES if log_tau is None else np.array([log_tau]))
        moves = at[-1] + _NODES if log_moves is None else np.array([log_moves])
        h, _ = concentrated(data, np.tile(moves, len(taus)), np.repeat(taus, len(moves)))
        h = h.reshape(len(taus), len(moves))
        if not np.isfinite(h).all():
            return -math.inf, np.zeros(len(at)), lambda: np.zeros((len(at), len(at)))
        h = h if log_tau is not None else _DERIVATIVES @ h
        h = h if log_moves is not None else h @ _DERIVATIVES.T
        if len(at) == 1:
            _, slope, bend = h.ravel()
            return float(h[0, 0]), np.array([slope]), lambda: np.array([[bend]])
        bends = np.array([[h[2, 0], h[1, 1]], [h[1, 1], h[0, 2]]])
        return float(h[0, 0]), np.array([h[1, 0], h[0, 1]]), lambda: bends

    return function


def search(data: Differences, progress: Progress) -> Top:
    """The highest place, (ln τ, ln(step variance / r)), over all τ and all ratios; ln inf for r = 0."""
    log_taus = np.linspace(math.log(MIN_MOMENTUM), math.log(MAX_MOMENTUM), _PLACES)
    progress(0.0, "likelihood over all momenta")
    rows = [ratios_for(data.m, log_tau) for log_tau in log_taus.tolist()]
    taus = np.exp(np.repeat(log_taus, [len(row) for row in rows]))
    part, progress = _part_of(data), progress.part(0.5, 0.5)
    table, _ = concentrated(part, np.concatenate(rows), taus)
    starts = _starts(log_taus, rows, np.split(table, np.cumsum([len(row) for row in rows])[:-1]))
    nearer = [climb(_likelihood(part, progress), start, _LOW, _HIGH, _NEAR).at.round(1) for start in starts]
    function = _likelihood(data, progress)
    starts = [start for at in np.unique(nearer, axis=0) for start in _seen(data, at, progress, _PLATEAU)]
    near = max((climb(function, start, _LOW, _HIGH, _NEAR) for start in starts), key=lambda one: one.height)
    return _or_without_noise(data, climb(function, near.at, _LOW, _HIGH), progress)


def search_near(data: Differences, start: Top, progress: Progress) -> Top:
    """The highest place near that of almost the same record."""
    progress = progress.part(0.5, 0.5)
    function = _likelihood(data, progress)
    tops = [climb(function, at, _LOW, _HIGH, FINE) for at in _seen(data, start.at, progress)]
    return _or_without_noise(data, max(tops, key=lambda one: one.height), progress)


def _seen(data: Differences, at: Array, progress: Progress, plateau: float = HIGHEST) -> list[Array]:
    """Where the climb from a place begins: from the plateau without noise no way to another top can be seen."""
    if at[1] < plateau:
        return [at]
    progress(0.0, "likelihood over all ratios")
    row, starts = ratios_for(data.m, float(at[0])), [np.array([at[0], HIGHEST])]
    heights, _ = concentrated(data, row, np.full(len(row), math.exp(at[0])))
    before, here, after = heights[:-2], heights[1:-1], heights[2:]
    with np.errstate(invalid="ignore"):  # between two places the likelihood is little higher than this
        worth = (here >= before) & (here > after) & (3.0 * here - before - after >= heights[-1])
    if worth.any():
        starts.append(np.array([at[0], row[1 + int(np.argmax(np.where(worth, here, -math.inf)))]]))
    return starts


def _or_without_noise(data: Differences, inner: Top, progress: Progress) -> Top:
    """The best τ near that of a top where r = 0, or the top if that is better."""
    log_tau, log_moves = inner.at.tolist()
    if math.log(data.m) - 2.0 * log_moves > _FAR_FROM_EDGE:
        return inner
    if concentrated(data, np.full(1, math.inf), np.full(1, math.exp(log_tau)))[0][0] < inner.height - _FAR_BELOW:
        return inner
    edge = climb(_likelihood(data, progress, log_moves=math.inf), np.array([log_tau]), _LOW[:1], _HIGH[:1])
    slack = 1e-9 + 1e-12 * abs(inner.height)  # an inner maximum must exceed the rounding of the sums
    if not edge.height >= inner.height - slack:
        return inner
    return Top(np.append(edge.at, math.inf), edge.height, np.pad(edge.curvature, (0, 1)), _LOW, _HIGH)


def _part_of(data: Differences, stretches: int = _STRETCHES, length: int = _STRETCH) -> Differences:
    """Stretches of a long record, spread over all of it: it shows both what is near and what is far."""
    if data.m <= 1.5 * stretches * length:
        return data
    firsts = np.linspace(0, data.m + 1 - length, stretches).astype(int).tolist()
    return data.parts((first, first + length) for first in firsts)


def ratios_for(m: int, log_tau: float) -> Array:
    """The ln(step variance / r) of the table at one τ: from a lag beyond m samples to no noise."""
    log_m = math.log(m)
    lowest = -2.0 * log_m - max(log_tau, 0.0) if log_tau < log_m else -4.0 * log_m + log_tau
    return np.arange(HIGHEST, min(lowest, 0.0) - 4.0, -_TABLE_STEP)[::-1]


def _starts(log_taus: Array, rows: list[Array], heights: list[Array]) -> list[Array]:
    """The highest places of the table that top their row and the rows beside it."""
    best = [int(np.argmax(row)) for row in heights]
    tops = [-math.inf, *(float(row[at]) for row, at in zip(heights, best, strict=True)), -math.inf]
    peaks = [i for i in range(len(rows)) if tops[i] <= tops[i + 1] >= tops[i + 2]]
    peaks = sorted(peaks, key=lambda i: -tops[i + 1])[:_MAX_PEAKS]
    return [np.array([log_taus[i], rows[i][best[i]]]) for i in peaks]


# Maximum likelihood of q and r, or of q alone, where the momentum is given: one search, as without momentum.


def _peak(data: Differences, tau: float, progress: Progress, r: float | None = None) -> Peak:
    """The maximum over ln(step variance / r) of one τ > 0, with the best r or the one given, in scale²."""

    def loglik(log_moves: Array) -> Array:
        taus = np.full(len(log_moves), tau)
        if r is None:
            return concentrated(data, log_moves, taus)[0]
        sums = moving_sums(data, np.exp(log_moves) / step_variance(tau), np.ones(len(taus)), taus)
        return loglik_of(data.m, data.scale, *sums, r)

    if r is None:
        return find_peak(loglik, grid_for(data.m), float(loglik(np.array([math.inf]))[0]), progress)
    # a step can hardly vary by more than the largest squared difference (at most 1 in this scale)
    return find_peak(loglik, grid_for(data.m, max(24.0, 4.0 - math.log(r))), -math.inf, progress)


def fit_at(data: Differences, tau: float, progress: Progress) -> MomentumFit:
    """The best q and r of one τ > 0."""
    peak = _peak(data, tau, progress)
    near = logs_near(np.array([peak.log_ratio]))[0]
    q, r = pairs(near, np.full(3, tau)) * concentrated(data, near, np.full(3, tau))[1] * data.scale * data.scale
    shape = r if r.all() else np.ones(3)  # without noise the errors do not depend on it
    place, curvature = np.array([peak.log_ratio]), np.array([peak.curvature])
    (q_error,), (r_error,) = relative_errors(place, curvature, shape[None], data.m)
    errors = [value[0] * error if value[0] > 0.0 else math.inf for value, error in ((q, q_error), (r, r_error))]
    return _fit_of(peak, tau, float(q[0]), float(r[0]), *map(float, errors))


def fit_movement(data: Differences, tau: float, r: float, progress: Progress) -> MomentumFit:
    """The best q of one τ > 0 where r, unit², is known."""
    peak = _peak(data, tau, progress, r / data.scale / data.scale)
    q = ratio_of(peak.log_ratio, tau) * r
    return _fit_of(peak, tau, q, r, q / math.sqrt(-peak.curvature) if peak.curvature < 0.0 else math.inf, 0.0)


def _fit_of(peak: Peak, tau: float, q: float, r: float, q_se: float, r_se: float) -> MomentumFit:
    low, high = ((ratio_of(end, tau), tau) for end in peak.interval)
    return MomentumFit(q, r, tau, peak.loglik, q_se, r_se, (tau, tau), (low, high))


# The momenta that a record allows: where the profile of the likelihood over τ falls below the 95 % mark.


def momentum_end(data: Differences, top: Top, side: float, progress: Progress) -> tuple[float, float, bool]:
    """The lower (`side` −1) or the upper (1) end of the 95 % interval of τ.

    Returns:
        τ, the best ln(step variance / r) there, and whether the likelihood falls below the mark, or τ is the border
        of what is searched.
    """
    progress = progress.part(0.5, 0.5)

    def profile(log_tau: float, rest: Array) -> tuple[float, Array]:
        function = _likelihood(data, progress, log_tau)
        starts = _seen(data, np.append(log_tau, rest), progress)
        tops = [climb(function, start[1:], _LOW[1:], _HIGH[1:], _SEEN, FINE_STEPS) for start in starts]
        best = max(tops, key=lambda one: one.height)
        return best.height, best.at

    end, rest, crossed = interval_end(top, profile, 0, side)
    tau, log_moves = momentum_of(end), float(rest[0])
    if log_moves > _PLATEAU:
        inner, edge = concentrated(data, np.array([log_moves, math.inf]), np.full(2, tau))[0].tolist()
        log_moves = math.inf if edge >= inner - 1e-9 else log_moves
    return tau, log_moves, crossed


# Maximum likelihood of q, r and τ together, with standard errors and the interval of τ.


def fit_around(data: Differences, top: Top, progress: Progress) -> MomentumFit:
    """The fit at the highest place of the likelihood, and how well the record determines it.

    Of the τ longer than the record only the shortest that the record allows is taken: the record cannot show how
    much longer the signal keeps its direction.
    """
    ends = [momentum_end(data, top, side, progress.part(0.3 + 0.3 * side, 0.6)) for side in (-1.0, 1.0)]
    (low, _, below), (high, _, above) = ends
    tau = momentum_of(float(top.at[0]))
    there = fit_at(data, tau, progress.part(0.6, 0.8))
    shortest = max(data.span, low)
    if tau > shortest:
        there = fit_at(data, shortest, progress.part(0.8, 1.0))
    else:
        qs, rs = zip(*(params_at(data, end, log_moves) for end, log_moves, _ in ends), strict=True)
        there = replace(there, q_se=widened(there.q, there.q_se, qs), r_se=widened(there.r, there.r_se, rs))
    border = [(ratio_of(log_moves, end), end) for end, log_moves, _ in ends]
    border += [_farthest(there, end) for end in border]
    return replace(
        there,
        tau_interval=(low if below else 0.0, high if above else math.inf),
        region=(*there.region, *border),
    )


def _farthest(there: MomentumFit, end: tuple[float, float]) -> tuple[float, float]:
    """The pair (q/r, τ) of the largest change of q/r towards one end of the interval of τ.

    The border is an ellipse in the logarithms: it goes beyond q/r at the end of τ, and beyond that of the known τ.
    """
    edges = (there.region[0][0], there.r and there.q / there.r, there.region[1][0], end[0])
    if not (min(edges) > 0.0 and max(edges) < math.inf):
        return end
    low, middle, high, moved = map(math.log, edges)
    shift, known = moved - middle, (high if moved > middle else low) - middle
    size = math.hypot(shift, known) or 1.0
    share = abs(shift) / size
    return math.exp(middle + math.copysign(size, shift)), there.tau * (end[1] / there.tau) ** share


def params_at(data: Differences, tau: float, log_moves: float) -> tuple[float, float]:
    """The pair, unit², of a place of the likelihood."""
    place = np.array([log_moves]), np.array([tau])
    (q,), (r,) = pairs(*place) * concentrated(data, *place)[1] * data.scale * data.scale
    return float(q), float(r)


def widened(value: float, error: float, ends: Sequence[float]) -> float:
    """Standard error of a variance where τ is not known either; inf at an edge.

    The curvature at the top would be too small: a record that is a few τ long and by chance shows a short τ shows a
    small q too. So the limits are combined, on the scale of the logarithm: those where τ is known, and what the
    variance is at both ends of the interval of τ (Zou & Donner 2008, Statistics in Medicine 27, 1693-1702).

    Args:
        value: the variance at the top.
        error: its standard error where τ is known.
        ends: the best variances at the ends of the interval of τ.
    """
    low, high = min(*ends, value), max(*ends, value)
    if not low > 0.0:
        return math.inf
    known = NORMAL * error / value
    both = math.hypot(math.log(value / low), known) + math.hypot(math.log(high / value), known)
    return value * both / (2.0 * NORMAL)


# Whether a record needs momentum: by its likelihood, and by how well it predicts samples that it has not seen.
#
# Both must agree, else the simpler model stays. A few jumps of a long record can raise the likelihood although the
# prediction of all the rest gets worse; and a slightly better prediction of a short record can be chance.


MIN_GAIN = 12.0
"""Twice the log-likelihood that momentum must add: 2 for its parameter by Akaike's criterion, 10 for safety."""
SHORT_RECORD = 5000.0
"""This over the number of samples is added to it: a short record has few changes of direction, if any."""
MIN_LESS = 0.005
"""By which fraction the one-step error on unseen samples must be smaller with momentum than without."""
FOLDS = 5
"""Parts of the record, each of which is predicted by fits to all the others."""
MIN_SAMPLES = 60
"""Samples of the record, so that each part holds a dozen."""
_UNSEEN_STRETCHES, _UNSEEN_STRETCH = 16, 8192
"""Stretches of a long record, and samples of each, that are predicted: enough to tell MIN_LESS."""
_BLOCKS = 2
"""Stretches of each part. All count alike: a sensor may lie still in one of them, and be shaken in another."""


def _better_prediction(data: Differences, plain: Estimate, top: Top, progress: Progress) -> float | None:
    """By which fraction the one-step error on unseen samples is smaller with momentum; None where none can tell.

    Args:
        data: the record.
        plain: the best random walk.
        top: the best place of the likelihood with momentum.
        progress: receives progress reports.
    """
    seen = _part_of(data, _UNSEEN_STRETCHES, _UNSEEN_STRETCH)
    stretch = data.m + 1 if seen is data else _UNSEEN_STRETCH
    data, z = seen, np.concatenate([[0.0], np.cumsum(seen.d)])
    ends = np.linspace(0.0, len(z), FOLDS + 1).astype(int).tolist()
    ratios: list[Array] = [np.empty(0)]
    for i, part in enumerate(itertools.pairwise(ends)):
        others = data.parts([(0, part[0]), (part[1], len(z))])
        if others.d.any():
            now = progress.part(i / FOLDS, (i + 1) / FOLDS)
            pair = fit_near(others, float(plain.ratio), now.part(0.0, 0.2))
            log_tau, log_moves = search_near(others, top, now.part(0.2, 0.9)).at.tolist()
            now(0.9, "prediction of unseen samples")
            tau = momentum_of(log_tau)
            (q,), (r,) = pairs(np.array([log_moves]), np.array([tau])).tolist()  # the scale changes no prediction
            walk = _squares(z, data.gap, FilterParams(q=pair.q, r=pair.r), part, stretch)
            moving = _squares(z, data.gap, FilterParams(q=q, r=r, momentum=tau), part, stretch)
            still = (walk == 0.0) | (moving == 0.0)
            ratios.append(np.sqrt(moving[~still] / walk[~still]))
    logs = np.log(np.concatenate(ratios))
    return 1.0 - float(np.exp(logs.mean())) if len(logs) else None


def _squares(z: Array, gap: Array, params: FilterParams, part: tuple[int, int], stretch: int) -> Array:
    """Mean squared one-step error of each block of a part; of each stretch without the first sample."""
    dt = np.append(1.0, gap[: part[1] - 1]) if len(gap) else None
    squares = kalman_filter(z[: part[1]], params, dt).innovation[part[0] :] ** 2
    squares = squares[np.arange(*part) % stretch > 0]
    return np.array([float(np.mean(block)) for block in np.array_split(squares, _BLOCKS)])


# An Estimate with momentum: intervals, a verdict and words.


def with_momentum(data: Differences, plain: Estimate, progress: Progress) -> Estimate:
    """The estimate of one channel with momentum, or `plain` where the record does not need it.

    Args:
        data: the record.
        plain: its estimate without momentum.
        progress: receives progress reports.
    """
    if plain.verdict == "bad_unit":
        return plain
    top = search(data, progress.part(0.0, 0.4))
    gain, count, less = 2.0 * (top.height - float(plain.loglik)), data.m + 1, None
    if count >= MIN_SAMPLES and gain > MIN_GAIN + SHORT_RECORD / count:
        less = _better_prediction(data, plain, top, progress.part(0.4, 0.8))
    if less is not None and less >= MIN_LESS:
        fit = fit_around(data, top, progress.part(0.8, 1.0))
        return replace(conclude(fit, _reason(fit, less)), prediction_gain=less)
    if count < MIN_SAMPLES:
        why = "The record is too short to tell whether the signal has momentum."
    elif gain <= 2.0 * DROP:
        why = "No momentum: it would not fit better."
    elif less is None:
        why = "No momentum: it raises the likelihood, but not by enough to be sure."
    else:
        change = f"only {percent(less)} less" if less > 0.0 else f"{percent(-less)} more"
        why = f"No momentum: with it the error on unseen samples would be {change}, so it is not used."
    kept = replace(plain, message=f"{plain.message} {why}", prediction_gain=less or 0.0)
    if plain.verdict != "ok" or gain <= 2.0 * DROP:
        return kept
    return _either(kept, conclude(fit_around(data, top, progress.part(0.8, 1.0)), ""))


def with_given_momentum(data: Differences, tau: float, progress: Progress) -> Estimate:
    """The estimate of one channel with a momentum above 0, in sample periods."""
    return conclude(fit_at(data, tau, progress), f"The momentum of {number(tau)} samples was given.")


def _either(plain: Estimate, moving: Estimate) -> Estimate:
    """`plain` with intervals that hold whether or not the signal has momentum.

    Where the likelihood excludes τ = 0 and the choice keeps it, either model may be the true one, and the 95 %
    interval of each holds the truth if it is: their union does in both cases.
    """
    names = ("ratio_interval", "gain_interval", "lag_interval", "momentum_interval")
    ends = {name: [float(end) for one in (plain, moving) for end in getattr(one, name)] for name in names}
    spans: dict[str, Any] = {name: (min(four), max(four)) for name, four in ends.items()}
    short, long = (number(float(end)) for end in moving.lag_interval)
    high = float(moving.momentum_interval[1])
    upto = f"up to {number(high)} samples" if high < math.inf else "of any length"
    also = f"The 95 % intervals also hold for a momentum {upto}, which allows lags from {short} to {long} samples."
    return replace(plain, message=f"{plain.message} {also}", **spans)


def _reason(fit: MomentumFit, less: float) -> str:
    """Why momentum is taken, and what it costs; the error on unseen samples is smaller by `less`."""
    low, high = fit.tau_interval
    span = f"{number(low)} to {number(high)}" if high < math.inf else f"{number(low)} or more"
    text = (
        f"The signal keeps its direction for about {number(fit.tau)} samples ({span}). With this momentum the "
        f"error of predicting unseen samples is {percent(less) if less < 0.99 else 'over 99 %'} smaller than "
        "without."
    )
    if fit.q == 0.0 or fit.r == 0.0:
        return text
    overshoot = _settled(fit.q / fit.r, fit.tau).overshoot
    step = f" and an overshoot of {percent(overshoot)} on a step" if overshoot > 0.0 else ""
    return f"{text} It costs a second state on the board{step}."


def conclude(fit: MomentumFit, reason: str) -> Estimate:
    """The Estimate of a fit; `reason` is the sentence on where the momentum comes from."""
    if not all(MIN_VARIANCE < size <= MAX_VARIANCE for size in (fit.q, fit.r) if size > 0.0):
        verdict, message = "bad_unit", verdict_words.BAD_UNIT
    elif fit.r == 0.0:
        verdict = "no_noise"
        message = (
            "No noise can be identified at this sample rate, also with momentum: every change looks like real "
            "movement, and the most likely filter (r = 0) would pass the signal unchanged. "
            f"{verdict_words.INSTEAD} {reason}"
        )
    elif fit.q == 0.0:
        verdict, message = "no_movement", f"{verdict_words.no_movement(0.0)} {reason}"
    else:
        verdict = "ok"
        message = (
            "Noise and movement can be separated. "
            f"{verdict_words.settles('The filter', _settled(fit.q / fit.r, fit.tau))} {reason}"
        )
    ratios = [ratio for ratio, _ in fit.region]
    settled = [_settled(ratio, tau) for ratio, tau in fit.region]
    gains, lags = [one.gain for one in settled], [one.lag_samples for one in settled]
    return Estimate(
        q=fit.q,
        r=fit.r,
        loglik=fit.loglik,
        ratio_interval=(min(ratios), max(ratios)),
        gain_interval=(min(gains), max(gains)),
        lag_interval=(min(lags), max(lags)),
        q_se=fit.q_se,
        r_se=fit.r_se,
        verdict=verdict,
        message=message,
        params=FilterParams(q=fit.q, r=fit.r, momentum=fit.tau) if verdict == "ok" else None,
        momentum=fit.tau,
        momentum_interval=fit.tau_interval,
    )


def _settled(ratio: float, tau: float) -> SteadyState:
    if ratio == math.inf:
        return steady_state(FilterParams(q=1.0, r=0.0, momentum=tau))
    return steady_state(FilterParams(q=ratio, r=1.0, momentum=tau))
