"""A better q, r or momentum for a filter that does not fit its record, and what no q and r can remove.

λ is q/r, with momentum the variance of a step over r. The whole record is filtered again with all λ that it can
distinguish. Two corrections compete by their likelihood: both by one factor (which keeps the curve and corrects its
variance), or each by its own. The simplest one that a likelihood-ratio test does not reject is advised. Structure
that then remains in the residuals cannot be removed by q and r: the model, at this momentum, does not describe the
signal.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from kalscope.analysis.residuals import ALARM, SPIKE, Run, correlation, dot, low_frequency_share
from kalscope.common.numbers import Array, Indices
from kalscope.estimation.likelihood import Differences, differences
from kalscope.estimation.momentum import moving_sums, step_variance
from kalscope.filtering.filter import filter_pieces
from kalscope.filtering.params import FilterParams

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

MIN_FACTOR = 1.5
"""Smaller factors are not worth a change, however significant they are in a long record."""

MIN_SAMPLES = 20
"""Scored innovations needed for a judgement."""

GRID_STEP = 2.0 * math.log(1000.0) / 28.0
"""Step of ln λ."""

NEAR, MAX_STEPS = 14, 2000
"""Steps to either side that are tried first, factors from 1/1000 to 1000; and at most."""

CLEARLY_INSIDE = math.log(1e-5), math.log(100.0)
"""ln λ within which these alone show where the best λ lies."""

LOWEST, HIGHEST = math.log(1e-6), math.log(1e6)
"""ln λ between which any record can distinguish two filters; a long one also distinguishes smaller λ."""

MAX_FACTOR, PLAINLY = 1e3, (1e-4, 100.0)
"""Where the best λ lies at an end of the grid, any beyond fits as well: the change of λ is limited to this factor,
or to the λ at which a filter is clearly at that end."""

MAX_CHANGE = 1e12
"""Largest factor of a correction."""


@dataclass(frozen=True)
class Correction:
    """Factors for q and r, and the residuals that are left with them."""

    q_factor: float = 1.0
    """Multiply q by it, 1e-12 … 1e12; 1 = keep."""
    r_factor: float = 1.0
    """Multiply r by it, 1e-12 … 1e12; 1 = keep."""
    leaves_edge: bool = False
    """Whether another q/r fits clearly better than the filter's q = 0 or r = 0."""
    e: Array | None = None
    """Standardised innovations of the best fit, shape (n,), NaN where none; None where no fit was found."""


def find_correction(record: Record) -> Correction:
    """The simplest change of q and r that the record does not reject, at the filter's momentum."""
    m = record.data.m
    if m < MIN_SAMPLES:
        return Correction()
    edges = {0.0: _lowest(record), math.inf: HIGHEST}
    present = edges[record.ratio] if record.ratio in edges else math.log(record.ratio)
    near = CLEARLY_INSIDE[0] < present < CLEARLY_INSIDE[1]
    here, log_ratios, chi2, logdet = _scan(record, present, NEAR if near else MAX_STEPS)
    if near and int(_heights(chi2, logdet, m).argmax()) in (0, len(chi2) - 1):
        here, log_ratios, chi2, logdet = _scan(record, present, MAX_STEPS)
    if not np.isfinite(chi2).all() or not chi2.all():  # it does not move, or too little beside q and r for a double
        return Correction(1e-3, 1e-3) if record.moves else Correction()
    heights = _heights(chi2, logdet, m)
    at = int(heights.argmax())
    is_open = at in (0, len(heights) - 1)  # the best λ may lie beyond
    log_best = float(log_ratios[at]) + (0.0 if is_open else GRID_STEP * _top(*heights[at - 1 : at + 2].tolist()))
    chi2_best, logdet_best = record.sums(np.array([log_best]))
    free, scaled = float(_heights(chi2_best, logdet_best, m)[0]), float(heights[here])
    loglik = -0.5 * float(logdet[here] + chi2[here])
    scale, both, ratio = float(chi2_best[0]) / m, float(chi2[here]) / m, math.exp(log_best - present)
    rest = record.residuals(log_best, record.momentum)
    is_edge, moves_inwards = record.ratio in edges, (ratio > 1.0) == (record.ratio == 0.0)
    if is_edge and moves_inwards and free > scaled + LR_LIMIT[0]:
        return Correction(leaves_edge=True, e=rest)
    if (scaled if is_edge else free) <= loglik + LR_LIMIT[0 if is_edge else 1]:
        return Correction(e=rest)
    if is_edge or free <= scaled + LR_LIMIT[0]:
        return Correction(*_bounded(both, both), e=rest)
    least = min(present - math.log(MAX_FACTOR), math.log(PLAINLY[0]))
    most = max(present + math.log(MAX_FACTOR), math.log(PLAINLY[1]))
    beyond = log_best - min(max(log_best, least), most) if is_open else 0.0
    q_factor, r_factor = scale * ratio * math.exp(max(-beyond, 0.0)), scale * math.exp(max(beyond, 0.0))
    return Correction(*_bounded(q_factor, r_factor), e=rest)


def _scan(record: Record, present: float, farthest: int) -> tuple[int, Array, Array, Array]:
    """The record filtered with r = 1 at up to `farthest` steps to either side of a ln λ.

    Returns:
        The place of that ln λ; and shape (places,) each: ln λ, ascending, Σ v²/s and Σ ln s.
    """
    room = (present - _lowest(record), HIGHEST - present)
    here, above = (min(max(NEAR, math.ceil(span / GRID_STEP)), farthest) for span in room)
    log_ratios: Array = present + GRID_STEP * np.arange(-here, above + 1.0)
    return here, log_ratios, *record.sums(log_ratios)


def _heights(chi2: Array, logdet: Array, m: int) -> Array:
    """Log-likelihood of each λ with the best r of it, without its constant."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return -0.5 * (logdet + m * np.log(chi2 / m) + m)


def _top(before: float, highest: float, after: float) -> float:
    """Where the parabola through three neighbouring heights is highest, in steps from the middle one."""
    bend = before - 2.0 * highest + after
    return 0.5 * (before - after) / bend if bend < 0.0 else 0.0


def _lowest(record: Record) -> float:
    """The least ln λ that differs from q = 0 in the record: its movement is then a tenth of the noise of a mean.

    Steps that keep their direction for τ samples move as far as those of a τ times larger variance.
    """
    m = record.data.m
    return min(LOWEST, -math.log(100.0) - 2.0 * math.log(m) - math.log(min(max(record.momentum, 1.0), m)))


def _bounded(q_factor: float, r_factor: float) -> tuple[float, float]:
    """Factors that fit a double together with any realistic q and r."""
    low, high = 1.0 / MAX_CHANGE, MAX_CHANGE
    return min(max(q_factor, low), high), min(max(r_factor, low), high)


MIN_SHARE = 0.04
"""Share of the residuals' variance that must be predictable before a misfit of the model is reported."""

MAX_PARTS, MIN_PART = 8, 50
"""Parts of the record whose variances are compared, and the residuals that each of them needs."""

MIN_CHANGE = 2.0
"""Ratio of the largest to the least of these variances that is worth reporting."""


def find_structure(e: Array, lags: int) -> float | None:
    """Whether the residuals e, shape (n,), NaN where not scored, are correlated; None where they are white.

    Returns:
        Share of their power that low frequencies hold, beyond that of white noise; 0 = they are only correlated.
    """
    e = calmed(e)
    share, p = low_frequency_share(finite(e))
    if p < ALARM and share >= MIN_SHARE:
        return share
    remaining = correlation(e, lags, fitted=True)
    return 0.0 if remaining.p < ALARM and remaining.q >= MIN_SHARE * np.count_nonzero(np.isfinite(e)) else None


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


def calmed(e: Array) -> Array:
    """The residuals with those beyond 4 σ (1.4826 · median) clipped there: a few must not outweigh all others."""
    sizes = np.abs(finite(e))
    size = math.sqrt(dot(sizes, sizes) / max(len(sizes), 1))
    scale = 1.4826 * float(np.median(sizes, overwrite_input=True)) if len(sizes) else 0.0
    if scale <= 0.01 * size:  # most of it is constant, or nearly
        return e
    return np.clip(e, -SPIKE * scale, SPIKE * scale)
