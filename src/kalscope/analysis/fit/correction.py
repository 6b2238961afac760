"""How to correct a filter that does not fit its record: factors for q and r.

λ is q/r, with momentum the variance of a step over r. The whole record is filtered again with λ changed by
factors from 1/1000 to 1000; where the best λ is not among them, with all λ that the record can distinguish. Four
corrections compete by their likelihood: q alone, r alone, both by one factor (which keeps the curve and corrects
its variance), or each by its own. The simplest one that a likelihood-ratio test does not reject is advised.
Structure that is then left in the residuals cannot be removed by q and r: the model, at this momentum, does not
describe the signal.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from kalscope.analysis.fit.record import Indices, Record, variance_of_step
from kalscope.analysis.residual_tests import dot
from kalscope.common.array import Array

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

FINE = np.linspace(-1.0, 1.0, 401)
"""Points between three steps at which a likelihood is interpolated."""


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
    """The record filtered with r = 1 at steps of ln λ, the filter's own among them."""

    log_ratios: Array
    """ln λ, ascending, shape (steps,)."""
    own: int
    """Index of the filter's own λ."""
    chi2: Array
    """Σ v²/s, shape (steps,)."""
    logdet: Array
    """Σ ln s, shape (steps,)."""
    m: float
    """Scored innovations."""

    @staticmethod
    def of(record: Record, log_ratios: Array, own: int = 0) -> Profile:
        """Filter the record at each ln λ."""
        return Profile(log_ratios, own, *record.sums(log_ratios), float(record.data.m))

    @property
    def is_constant(self) -> bool:
        """Whether the record does not move, or too little beside q and r for a double."""
        return bool(self.chi2.min() <= 0.0)

    @property
    def at(self) -> float:
        """Where the likelihood with the best r of each λ is highest, in steps."""
        return _peak(-0.5 * (self.logdet + self.m * np.log(self.chi2)))[1]

    @property
    def is_open(self) -> bool:
        """Whether that is the first or the last step, so that the best λ may lie beyond."""
        return self.at in (0.0, len(self.chi2) - 1.0)

    def present(self) -> float:
        """Log-likelihood of the filter as it is, without its constant."""
        return -0.5 * float(self.logdet[self.own] + self.chi2[self.own])

    def one_factor(self) -> tuple[float, float, float]:
        """Log-likelihood and the factors for q and r of the best correction with one free parameter.

        That of both wins where it is about as good as the others: it does not call the filter too slow or too fast.
        """
        both = float(self.chi2[self.own]) / self.m
        scaled = -0.5 * (float(self.logdet[self.own]) + self.m * math.log(both) + self.m)
        only_q, q_at = self._peak_with(r_moves=False)
        only_r, r_at = self._peak_with(r_moves=True)
        best = max((only_q, math.exp(q_at), 1.0), (only_r, 1.0, math.exp(-r_at)))
        return best if best[0] > scaled + TIE else (scaled, both, both)

    def _peak_with(self, *, r_moves: bool) -> tuple[float, float]:
        """The highest log-likelihood where r alone or q alone changes λ, and the change of ln λ there."""
        moves = self.log_ratios - self.log_ratios[self.own]
        i = int(np.argmax(self._with_moves(moves, np.log(self.chi2), self.logdet, r_moves=r_moves)))
        i = min(max(i, 1), len(moves) - 2)
        near = slice(i - 1, i + 2)
        fine = moves[i] + GRID_STEP * FINE
        curve = self._with_moves(
            fine, _between(np.log(self.chi2[near])), _between(self.logdet[near]), r_moves=r_moves
        )
        at = int(np.argmax(curve))
        return float(curve[at]), float(fine[at])

    def _with_moves(self, moves: Array, log_chi2: Array, logdet: Array, *, r_moves: bool) -> Array:
        """Log-likelihood at changes of ln λ; exp is limited where r is far too small for any likelihood."""
        if not r_moves:
            return -0.5 * (logdet + np.exp(log_chi2))
        return -0.5 * (logdet - self.m * moves + np.exp(np.minimum(log_chi2 + moves, 700.0)))

    def cut(self, q_factor: float, r_factor: float) -> tuple[float, float]:
        """Factors that go no farther than needed towards an end of the grid."""
        own = float(self.log_ratios[self.own])
        moved = own + math.log(q_factor / r_factor)
        least = min(own - math.log(MAX_FACTOR), math.log(PLAINLY[0]))
        most = max(own + math.log(MAX_FACTOR), math.log(PLAINLY[1]))
        if self.at == 0.0 and moved < least:
            return q_factor * math.exp(least - moved), r_factor
        if self.is_open and moved > most:
            return q_factor, r_factor * math.exp(moved - most)
        return q_factor, r_factor


def _find_scale(e: Array, spikes: Indices) -> Correction:
    """The one factor for q and r, which keeps the curve, that fits the residuals e without their spikes best."""
    calm = np.delete(e, spikes)
    m = len(calm)
    scale = dot(calm, calm) / max(m, 1)
    if not 0.0 < scale < math.inf or 0.5 * m * (scale - 1.0 - math.log(scale)) <= LR_LIMIT[0]:
        return Correction(e=e)
    return Correction(*_bounded(scale, scale), e=e)


def find_correction(record: Record, e: Array, spikes: Indices) -> Correction:
    """The simplest change of q and r that the record does not reject, at the filter's momentum.

    Args:
        record: what the filter was given.
        e: the standardised residuals of the filter, scored ones only.
        spikes: those among them that are set aside.
    """
    if record.data.m < MIN_SAMPLES:
        return Correction()
    if record.ratio == 0.0 or math.isinf(record.ratio):
        return _from_edge(record, _find_scale(e, spikes))
    profile = _profile(record)
    if profile.is_constant:
        return Correction(1e-3, 1e-3) if record.moves else Correction()
    log_best, free, scale = _best(record, profile)
    left = record.residuals(log_best, record.momentum)
    if free <= profile.present() + LR_LIMIT[1]:
        return Correction(e=left)
    likelihood, q_factor, r_factor = profile.one_factor()
    if free > likelihood + LR_LIMIT[0]:
        q_factor, r_factor = math.exp(log_best) / record.ratio * scale, scale
    return Correction(*_bounded(*profile.cut(q_factor, r_factor)), e=left)


def _profile(record: Record) -> Profile:
    """The steps near the filter's own λ, or all where the best one is not among them."""
    own = math.log(record.ratio)
    near = Profile.of(record, own + GRID_STEP * np.arange(-NEAR, NEAR + 1.0), NEAR)
    inside = CLEARLY_INSIDE[0] < own < CLEARLY_INSIDE[1]
    if near.is_constant or (inside and not near.is_open):
        return near
    below = max(NEAR, math.ceil((own - _lowest(record)) / GRID_STEP))
    above = max(NEAR, math.ceil((HIGHEST - own) / GRID_STEP))
    return Profile.of(record, own + GRID_STEP * np.arange(-below, above + 1.0), below)


def _lowest(record: Record) -> float:
    """The least ln λ that differs from q = 0 in the record: its movement is then a tenth of the noise of a mean.

    Steps that keep their direction for τ samples move as far as those of a τ times larger variance.
    """
    m = record.data.m
    return min(LOWEST, -math.log(100.0) - 2.0 * math.log(m) - math.log(min(max(record.momentum, 1.0), m)))


def _best(record: Record, profile: Profile) -> tuple[float, float, float]:
    """The best ln λ, its log-likelihood without the constant, and its best r over that of the filter."""
    log_best = float(profile.log_ratios[0]) + profile.at * GRID_STEP
    chi2, logdet = (float(part[0]) for part in record.sums(np.array([log_best])))
    scale = chi2 / profile.m
    return log_best, -0.5 * (logdet + profile.m * math.log(scale) + profile.m), scale


def _from_edge(record: Record, scale: Correction) -> Correction:
    """What to do about q = 0 or r = 0: another λ where that fits better, else at most one factor."""
    lowest = _lowest(record)
    profile = Profile.of(record, np.arange(lowest, HIGHEST + GRID_STEP, GRID_STEP))
    if profile.is_constant:
        return Correction(1e-3, 1e-3) if record.moves else Correction()
    log_best, free, size = _best(record, profile)
    left = record.residuals(log_best, record.momentum)
    if free > _at_edge(record, profile.m) + LR_LIMIT[0]:
        factor = size if record.ratio == 0.0 else size * math.exp(log_best)  # in the unit of the record
        ratio = math.exp(log_best) / variance_of_step(record.momentum)
        return Correction(instead_of_edge=ratio, edge_factor=_bounded(factor)[0], e=left)
    return Correction(scale.q_factor, scale.r_factor, e=left)


def _at_edge(record: Record, m: float) -> float:
    """Log-likelihood at q = 0 or r = 0, whichever the filter has, without its constant; −inf where impossible."""
    if record.ratio < 1.0:
        chi2, logdet = (float(part[0]) for part in record.sums(np.array([-math.inf])))
        return -0.5 * (logdet + m * math.log(chi2 / m) + m) if chi2 > 0.0 else -math.inf
    return record.without_noise() + 0.5 * m * math.log(2.0 * math.pi)


def _bounded(*factors: float) -> tuple[float, ...]:
    """Factors that fit a double together with any realistic q and r."""
    return tuple(min(max(factor, 1.0 / MAX_CHANGE), MAX_CHANGE) for factor in factors)


def _peak(curve: Array) -> tuple[float, float]:
    """Largest value of a curve of equal steps and where it lies, by the parabola through three points."""
    i = int(np.argmax(curve))
    if i in (0, len(curve) - 1):
        return float(curve[i]), float(i)
    before, top, after = (float(curve[j]) for j in (i - 1, i, i + 1))
    bend = before - 2.0 * top + after
    shift = 0.5 * (before - after) / bend if bend < 0.0 else 0.0
    return top - 0.25 * (before - after) * shift, i + shift


def _between(three: Array) -> Array:
    """A smooth curve through three steps, read at `FINE`; shape of `FINE`."""
    before, middle, after = (float(value) for value in three)
    return middle + 0.5 * (after - before) * FINE + 0.5 * (after - 2.0 * middle + before) * FINE * FINE
