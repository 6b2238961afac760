"""A better q, r or momentum for a filter that does not fit its record, and what no q and r can remove.

λ is q/r, with momentum the variance of a step over r. The whole record is filtered again with λ changed by
factors from 1/1000 to 1000; where the best λ is not among them, with all λ that the record can distinguish. Four
corrections compete by their likelihood: q alone, r alone, both by one factor (which keeps the curve and corrects
its variance), or each by its own. The simplest one that a likelihood-ratio test does not reject is advised.
Structure that then remains in the residuals cannot be removed by q and r: the model, at this momentum, does not
describe the signal.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from kalscope.analysis.residuals import ALARM, SPIKE, Run, correlation, dot, low_frequency_share, normality
from kalscope.common.numbers import Array, Indices
from kalscope.common.progress import Progress
from kalscope.estimation.likelihood import Differences, differences
from kalscope.estimation.momentum import concentrated, momentum_of, moving_sums, search, step_variance
from kalscope.filtering.filter import filter_pieces
from kalscope.filtering.params import FilterParams

PARTS, PART = 4, 10_000
"""Stretches of a long record in which momentum is searched, and samples in each; the result is tested on all."""

MAX_SCALE = 1e150
"""Changes larger than this many √r count as this large: their squares must fit a double."""

LAG = 5.0
"""Samples of lag in the example of a filter that is chosen by its lag."""


@dataclass(frozen=True)
class Record:
    """All samples of one channel, without the filter's prior, its rejected samples and its spikes."""

    z: Array
    """Samples in units of √r (where r is 0, of the least that differs from it), shape (n,); NaN where missing."""
    dt: Array | None
    """Nominal sample periods before each, shape (n,); None = 1 each."""
    ratio: float
    """Step variance over r of the filter that made it; 0 or inf at the edges."""
    momentum: float
    """Of that filter, sample periods."""

    @staticmethod
    def of(run: Run, spikes: Indices) -> Record:
        """Invert the filter: z = x + (1 − k) v.

        Args:
            run: the filter over the channel.
            spikes: indices of those to leave out.
        """
        z = _undo(run)
        z[spikes] = math.nan
        step = run.q * variance_of_step(run.momentum)
        ratio = step / run.r if run.r > 1e-13 * step else math.inf
        ratio = ratio if ratio > 1e-24 else 0.0
        z /= math.sqrt(run.r if ratio < math.inf else step * math.exp(-HIGHEST) or 1.0)
        z[np.isinf(z)] = math.nan  # undone, a sample near the end of float64 may lie beyond it
        regular = run.dt is None or bool(np.all(np.abs(run.dt[1:] - 1.0) <= 1e-3))
        return Record(z, None if regular else run.dt, ratio, run.momentum)

    @property
    def moves(self) -> bool:
        """Whether z has two values that differ by more than the filter's rounding."""
        z = finite(self.z)
        return len(z) > 0 and float(np.ptp(z)) > 1e-13 * float(np.abs(z).max())

    @property
    def unchanged(self) -> float:
        """Share of the samples that equal the one before, as far as the filter's rounding lets it be seen."""
        d = np.abs(self.data.d)
        return float(np.mean(d <= 1e-9 * float(d.max()))) if len(d) else 0.0

    @cached_property
    def data(self) -> Differences:
        """The record as the likelihood takes it."""
        return differences(self.z, np.empty(0) if self.dt is None else self.dt)

    def sums(self, log_ratios: Array) -> tuple[Array, Array]:
        """Σ v²/s and Σ ln s of the whole record at each ln(step variance / r), r = 1, shapes of `log_ratios`."""
        ratios = np.exp(log_ratios) / variance_of_step(self.momentum)
        if self.momentum:
            ones = np.ones(len(ratios))
            chi2, logdet = moving_sums(self.data, ratios, ones, self.momentum * ones)
        else:
            chi2, logdet = self.data.sums(ratios)
        return chi2 * min(self.data.scale, MAX_SCALE) ** 2, logdet

    def residuals(self, log_ratio: float, momentum: float) -> Array:
        """Standardised innovations at ln(step variance / r), size 1, shape (n,); NaN where none was scored."""
        e = np.empty(len(self.z))
        params = FilterParams(math.exp(log_ratio) / variance_of_step(momentum), 1.0, momentum=momentum)
        for first, piece in filter_pieces(self.z, params, self.dt):
            e[first : first + len(piece.x)] = piece.innovation / np.sqrt(piece.s)
        e[~np.isfinite(e)] = math.nan
        seen = finite(e)
        size = math.sqrt(float(np.einsum("i,i", seen, seen)) / max(len(seen), 1))
        return np.divide(e, size, out=e) if size > 0.0 else e


def variance_of_step(momentum: float) -> float:
    """Variance of one step of the signal for q = 1."""
    return step_variance(momentum) if momentum else 1.0


def lost_by_lag(record: Record) -> float:
    """What a filter with a lag of `LAG` samples and no momentum loses of the signal, in units of the noise r.

    Its innovation is white on a signal that it can follow; on one that it cannot, neighbouring innovations share
    their error, whose size is the mean of their products. Above 1 a raw reading is nearer the truth than the
    filtered one.
    """
    gain = 1.0 / (1.0 + LAG)
    errors = np.empty(len(record.z))
    for first, piece in filter_pieces(record.z, FilterParams(gain * gain / (1.0 - gain), 1.0), record.dt):
        errors[first : first + len(piece.x)] = piece.innovation
    products = finite(errors[1:] * errors[:-1])
    return float(products.mean()) if len(products) else 0.0  # none where every second reading is missing


def finite(values: Array) -> Array:
    """Those of the values that are finite; the array itself where all are."""
    there = np.isfinite(values)
    return values if there.all() else values[there]


def _undo(run: Run) -> Array:
    """The samples, from x, p, k and the innovation; NaN where missing or rejected."""
    z = np.empty(run.n)
    for first, (x, p, k, v, _) in run.pieces():
        with np.errstate(invalid="ignore"):
            samples = np.where(np.isnan(v), np.where(k > 0.0, x, math.nan), x + (1.0 - k) * v)
        samples[(k == 0.0) & (p > 0.0)] = math.nan
        z[first : first + len(x)] = samples
    return z


LR_LIMIT = (6.635 / 2.0, 9.210 / 2.0)
"""Gain in log-likelihood that is significant at 1 %, for one and for two parameters: ½ χ²(0.99)."""

TIE = 0.1
"""Gain in log-likelihood below which two corrections are equally good."""

MIN_FACTOR = 1.5
"""Smaller factors are not worth a change, however significant they are in a long record."""

MIN_SAMPLES = 20
"""Scored innovations needed for a judgement."""

GRID_STEP = 2.0 * math.log(1000.0) / 28.0
"""Step of ln λ."""

NEAR = 14
"""Steps to either side that are tried first: factors from 1/1000 to 1000."""

LOWEST, HIGHEST = math.log(1e-6), math.log(1e6)
"""ln λ between which any record can distinguish two filters; a long one also distinguishes smaller λ."""

CLEARLY_INSIDE = math.log(1e-5), math.log(100.0)
"""ln λ within which the near steps alone show where the best λ lies."""

MAX_FACTOR, PLAINLY = 1e3, (1e-4, 100.0)
"""Where the best λ lies at an end of the grid, any beyond fits as well: the change of λ is limited to this factor,
or to the λ at which a filter is clearly at that end."""

MAX_CHANGE = 1e12
"""Largest factor of a correction."""

BETWEEN = np.linspace(0.0, 1.0, 200, endpoint=False)
"""Where a likelihood is read between two steps, in steps."""


@dataclass(frozen=True)
class Correction:
    """Factors for q and r, and the residuals that are left with them."""

    q_factor: float = 1.0
    """Multiply q by it, 1e-12 … 1e12; 1 = keep."""
    r_factor: float = 1.0
    """Multiply r by it, 1e-12 … 1e12; 1 = keep."""
    instead_of_edge: float | None = None
    """q/r that fits far better than the filter's q = 0 or r = 0; None where neither is 0, or where that fits."""
    edge_factor: float = 1.0
    """Multiply by it the variance that is not 0, together with `instead_of_edge`."""
    e: Array | None = None
    """Standardised innovations of the best fit, shape (n,), NaN where none; None where no fit was found."""

    @property
    def worth_it(self) -> bool:
        """Whether a factor is large enough for a change."""
        return any(abs(math.log(factor)) >= math.log(MIN_FACTOR) for factor in (self.q_factor, self.r_factor))


@dataclass(frozen=True)
class Profile:
    """The record filtered with r = 1 at steps of ln λ, the filter's λ among them, and read between the steps."""

    present: float
    """ln λ of the filter."""
    moves: Array
    """ln λ less that, ascending, shape (places,)."""
    log_chi2: Array
    """ln Σ v²/s, shape (places,); −inf where the record does not move."""
    logdet: Array
    """Σ ln s, shape (places,)."""
    m: float
    """Scored innovations."""

    @staticmethod
    def of(record: Record, present: float, steps: Array) -> Profile:
        """Filter the record at each of these steps from ln λ of the filter."""
        chi2, logdet = record.sums(present + GRID_STEP * steps)
        with np.errstate(divide="ignore", invalid="ignore"):
            log_chi2 = _between(np.log(chi2))
        return Profile(present, GRID_STEP * _between(steps), log_chi2, _between(logdet), float(record.data.m))

    @property
    def is_constant(self) -> bool:
        """Whether the record does not move, or too little beside q and r for a double."""
        return not np.isfinite(self.log_chi2).all()

    @property
    def at(self) -> int:
        """The place of the highest likelihood with the best r of each λ."""
        return int(np.argmax(-self.logdet - self.m * self.log_chi2))

    @property
    def is_open(self) -> bool:
        """Whether that is the first or the last place, so that the best λ may lie beyond."""
        return self.at in (0, len(self.moves) - 1)

    def as_it_is(self) -> tuple[float, float, float]:
        """Log-likelihood of the filter without its constant; with q and r times one factor; and this factor."""
        here = int(np.argmin(np.abs(self.moves)))
        chi2 = math.exp(self.log_chi2[here])
        loglik, both = -0.5 * (float(self.logdet[here]) + chi2), chi2 / self.m
        return loglik, loglik + 0.5 * self.m * (both - 1.0 - math.log(both)), both

    def one_factor(self) -> tuple[float, float, float]:
        """Log-likelihood and the factors for q and r of the best correction with one free parameter.

        That of both wins where it is about as good as the others: it does not call the filter too slow or too fast.
        """
        _, scaled, both = self.as_it_is()
        only_q = -0.5 * (self.logdet + np.exp(self.log_chi2))
        # r alone moves λ the other way; exp is limited where r is far too small for any likelihood
        only_r = -0.5 * (self.logdet - self.m * self.moves + np.exp(np.minimum(self.log_chi2 + self.moves, 700.0)))
        i, j = int(only_q.argmax()), int(only_r.argmax())
        factor_q, factor_r = math.exp(self.moves[i]), math.exp(-self.moves[j])
        best = max((float(only_q[i]), factor_q, 1.0), (float(only_r[j]), 1.0, factor_r))
        return best if best[0] > scaled + TIE else (scaled, both, both)

    def cut(self, q_factor: float, r_factor: float) -> tuple[float, float]:
        """Factors that go no farther than needed towards an end of the grid."""
        moved = self.present + math.log(q_factor / r_factor)
        least = min(self.present - math.log(MAX_FACTOR), math.log(PLAINLY[0]))
        most = max(self.present + math.log(MAX_FACTOR), math.log(PLAINLY[1]))
        if self.at == 0 and moved < least:
            return q_factor * math.exp(least - moved), r_factor
        if self.is_open and moved > most:
            return q_factor, r_factor * math.exp(moved - most)
        return q_factor, r_factor


def _between(steps: Array) -> Array:
    """A smooth curve read at `BETWEEN` after each step: the parabolas around both neighbours, by their nearness."""
    a, b, c, d = (part[:, None] for part in (steps[:-3], steps[1:-2], steps[2:-1], steps[3:]))
    after, before = BETWEEN, BETWEEN - 1.0
    first = b + 0.5 * (c - a) * after + 0.5 * (a - 2.0 * b + c) * after * after
    second = c + 0.5 * (d - b) * before + 0.5 * (b - 2.0 * c + d) * before * before
    return np.concatenate([steps[:1], (second * after - first * before).ravel(), steps[-2:]])


def find_correction(record: Record) -> Correction:
    """The simplest change of q and r that the record does not reject, at the filter's momentum."""
    if record.data.m < MIN_SAMPLES:
        return Correction()
    profile = _profile(record)
    if profile.is_constant:
        return Correction(1e-3, 1e-3) if record.moves else Correction()
    move = float(profile.moves[profile.at])
    log_best = profile.present + move
    chi2, logdet = (float(part[0]) for part in record.sums(np.array([log_best])))
    scale = chi2 / profile.m
    free = -0.5 * (logdet + profile.m * math.log(scale) + profile.m)
    rest = record.residuals(log_best, record.momentum)
    loglik, scaled, both = profile.as_it_is()
    if record.ratio in (0.0, math.inf):
        if free > scaled + LR_LIMIT[0] and (move > 0.0) == (record.ratio == 0.0):
            factor = scale if record.ratio == 0.0 else scale * math.exp(move)
            ratio = math.exp(log_best) / variance_of_step(record.momentum)
            return Correction(instead_of_edge=ratio, edge_factor=_bounded(factor)[0], e=rest)
        return Correction(*_bounded(both, both), e=rest) if scaled > loglik + LR_LIMIT[0] else Correction(e=rest)
    if free <= loglik + LR_LIMIT[1]:
        return Correction(e=rest)
    likelihood, q_factor, r_factor = profile.one_factor()
    if free > likelihood + LR_LIMIT[0]:
        q_factor, r_factor = math.exp(move) * scale, scale
    return Correction(*_bounded(*profile.cut(q_factor, r_factor)), e=rest)


def _profile(record: Record) -> Profile:
    """The steps near the filter's λ, or all where the best one is not among them."""
    edges = {0.0: _lowest(record), math.inf: HIGHEST}
    present = edges[record.ratio] if record.ratio in edges else math.log(record.ratio)
    near = Profile.of(record, present, np.arange(-NEAR, NEAR + 1.0))
    inside = CLEARLY_INSIDE[0] < present < CLEARLY_INSIDE[1]
    if near.is_constant or (inside and not near.is_open):
        return near
    below = max(NEAR, math.ceil((present - _lowest(record)) / GRID_STEP))
    above = max(NEAR, math.ceil((HIGHEST - present) / GRID_STEP))
    return Profile.of(record, present, np.arange(-below, above + 1.0))


def _lowest(record: Record) -> float:
    """The least ln λ that differs from q = 0 in the record: its movement is then a tenth of the noise of a mean.

    Steps that keep their direction for τ samples move as far as those of a τ times larger variance.
    """
    m = record.data.m
    return min(LOWEST, -math.log(100.0) - 2.0 * math.log(m) - math.log(min(max(record.momentum, 1.0), m)))


def _bounded(*factors: float) -> tuple[float, ...]:
    """Factors that fit a double together with any realistic q and r."""
    return tuple(min(max(factor, 1.0 / MAX_CHANGE), MAX_CHANGE) for factor in factors)


MIN_SHARE = 0.04
"""Share of the residuals' variance that must be predictable before a misfit of the model is reported."""

LOG_RATIOS = np.linspace(-16.0, 16.0, 65)
"""ln(q/r) at which the fit without momentum is searched: advice needs no precision."""

MIN_LOGLIK_GAIN = 6.0
"""Least gain in log-likelihood: the information criterion then wins by 10."""

MIN_GAIN_A_SAMPLE = 0.02
"""Least gain in log-likelihood a sample: 2 % of the error in predicting the next one."""

MAX_PARTS, MIN_PART = 8, 50
"""Parts of the record whose variances are compared, and the residuals that each of them needs."""

MIN_CHANGE = 2.0
"""Ratio of the largest to the least of these variances that is worth reporting."""


MAX_SKEWNESS, MIN_EXCESS = 0.7, -0.8
"""Residuals more skewed than this, or flatter (a sine has −1.5), are a mixture of several kinds."""


@dataclass(frozen=True)
class Structure:
    """Residuals that are not white."""

    low_share: float
    """Share of their power that low frequencies hold, beyond that of white noise; 0 = they are only correlated."""
    momentum: float = 0.0
    """Momentum that describes it or a part of it, sample periods; 0 = none does, or the filter has one."""
    whole: bool = False
    """Whether nothing is left with that momentum."""


def find_structure(e: Array, lags: int) -> Structure | None:
    """Low frequencies or correlation in the residuals e, shape (n,), NaN where not scored; None for neither."""
    e = calmed(e)
    share, p = low_frequency_share(finite(e))
    if p < ALARM and share >= MIN_SHARE:
        return Structure(share)
    left = correlation(e, lags, fitted=True)
    scored = np.count_nonzero(np.isfinite(e))
    return Structure(0.0) if left.p < ALARM and left.q >= MIN_SHARE * scored else None


def find_free(record: Record) -> tuple[tuple[float, float], tuple[float, float], float]:
    """The best fits to a record, whatever the momentum of its filter.

    Returns:
        ln(step variance / r) and momentum with momentum; the same without; and what momentum adds to the
        log-likelihood, below 0 where it fits worse.
    """
    searched = record.data
    if searched.m > PARTS * PART:
        firsts = np.linspace(0, searched.m + 1 - PART, PARTS).astype(int).tolist()
        searched = searched.parts((first, first + PART) for first in firsts)
    log_tau, log_moves = search(searched, Progress(None)).at.tolist()
    heights = np.append(record.data.concentrated(LOG_RATIOS), record.data.random_walk()[0])
    at = int(np.argmax(heights))
    log_ratio = float(LOG_RATIOS[min(at, len(LOG_RATIOS) - 1)])
    log_moves = min(log_moves, float(LOG_RATIOS[-1]))  # inf where r = 0 is likeliest
    height, _ = concentrated(record.data, np.array([log_moves]), np.array([momentum_of(log_tau)]))
    momentum = min(momentum_of(log_tau), float(record.data.m))  # the record cannot show how much longer it is
    return (log_moves, momentum), (log_ratio, 0.0), float(height[0]) - float(heights[at])


def find_change(e: Array) -> float:
    """Largest over least variance of the residuals among up to eight parts of the record; 1 where it is chance.

    The chance is that of the means of e² given how much e² scatters within the parts, so that heavy tails do not
    count as a change.
    """
    from scipy.special import chdtri

    calm = finite(calmed(e))
    count = min(MAX_PARTS, len(calm) // MIN_PART)
    if count < 2:
        return 1.0
    parts = np.array_split(calm, count)
    sizes = np.array([len(part) for part in parts])
    means = np.array([np.square(part).mean() for part in parts])
    scatter = float(np.mean([np.square(part).var() for part in parts]))
    spread = float(np.sum(sizes * (means - np.average(means, weights=sizes)) ** 2))
    if float(means.max()) < MIN_CHANGE * float(means.min()) or spread <= float(chdtri(count - 1, ALARM)) * scatter:
        return 1.0
    seen = np.array([(part**2).mean() for part in np.array_split(finite(e), count)])
    return float(seen.max()) / max(float(seen.min()), 1e-12 * float(seen.max()))


def find_shape(e: Array) -> tuple[float, float]:
    """Skewness and excess kurtosis of residuals, shape (N,), far from a normal distribution; else 0, 0.

    Long tails on both sides do not count: they are reported as spikes.
    """
    if len(e) < MIN_PART:
        return 0.0, 0.0
    skewness, excess, _, p = normality(e)
    return (skewness, excess) if p < ALARM and (abs(skewness) > MAX_SKEWNESS or excess < MIN_EXCESS) else (0.0, 0.0)


def calmed(e: Array) -> Array:
    """The residuals with those beyond 4 σ (1.4826 · median) clipped there: a few must not outweigh all others."""
    sizes = np.abs(finite(e))
    size = math.sqrt(dot(sizes, sizes) / max(len(sizes), 1))
    scale = 1.4826 * float(np.median(sizes, overwrite_input=True)) if len(sizes) else 0.0
    if scale <= 0.01 * size:  # most of it is constant, or nearly
        return e
    return np.clip(e, -SPIKE * scale, SPIKE * scale)
