"""How to correct a filter that does not fit its record: factors for q and r.

The whole record is filtered again with λ changed by factors from 1/1000 to 1000. Four corrections compete by their
likelihood: q alone, r alone, both by one factor (which keeps the curve and corrects its variance), or each by
its own. The simplest one that a likelihood-ratio test does not reject is advised. Structure that is then left
in the residuals cannot be removed by q and r: the model does not describe the signal.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from kalscope.analysis.fit.record import Indices, Record
from kalscope.analysis.residual_tests import dot
from kalscope.common.array import Array

LR_LIMIT = (6.635 / 2.0, 9.210 / 2.0)
"""Gain in log-likelihood that is significant at 1 %, for one and for two parameters: ½ χ²(0.99)."""

MIN_FACTOR = 1.5
"""Smaller factors are not worth a change, however significant they are in a long record."""

MIN_SAMPLES = 20
"""Scored innovations needed for a judgement."""

LOG_FACTORS = np.linspace(-math.log(1000.0), math.log(1000.0), 29)
"""Logarithms of the factors for λ; the middle one is 0."""

GRID_STEP = float(LOG_FACTORS[1] - LOG_FACTORS[0])


@dataclass(frozen=True)
class Correction:
    """Factors for q and r, and the residuals that are left with them."""

    q_factor: float = 1.0
    """Multiply q by it, 0.001 … 1000; 1 = keep."""
    r_factor: float = 1.0
    """Multiply r by it, 0.001 … 1000; 1 = keep."""
    instead_of_edge: float | None = None
    """λ that fits far better than the filter's q = 0 or r = 0; None where neither is 0, or where that fits."""
    e: Array | None = None
    """Standardised innovations of the best fit, shape (n,), NaN where none; None where no fit was found."""

    @property
    def worth_it(self) -> bool:
        """Whether a factor is large enough for a change."""
        factors = (self.q_factor, self.r_factor, self.q_factor / self.r_factor)
        return any(abs(math.log(factor)) >= math.log(MIN_FACTOR) for factor in factors[:2])


def find_scale(e: Array, spikes: Indices) -> Correction:
    """The one factor for q and r, which keeps the curve, that fits the residuals e without their spikes best.

    For a filter with momentum: other corrections would need its momentum, which its output does not hold.
    """
    calm = np.delete(e, spikes)
    m = len(calm)
    scale = dot(calm, calm) / max(m, 1)
    if not 0.0 < scale < math.inf or 0.5 * m * (scale - 1.0 - math.log(scale)) <= LR_LIMIT[0]:
        return Correction(e=e)
    factor = min(max(scale, 1e-3), 1e3)
    return Correction(factor, factor, e=e)


def find_correction(record: Record) -> Correction:
    """The simplest change of q and r that the record does not reject."""
    edge = not 1e-12 < record.ratio < 1e12
    log_ratios = 2.0 * LOG_FACTORS if edge else LOG_FACTORS + math.log(record.ratio)
    m = float(record.data.m)
    if m < MIN_SAMPLES:
        return Correction()
    chi2, logdet = record.sums(log_ratios)
    if chi2.min() <= 0.0:  # constant, or its changes are too small beside q and r for a double
        return Correction(1e-3, 1e-3) if record.moves else Correction()
    _, at = _peak(-0.5 * (logdet + m * np.log(chi2)))
    log_best = float(log_ratios[0] + at * (log_ratios[1] - log_ratios[0]))
    best = math.exp(log_best)
    best_chi2, best_logdet = (float(part[0]) for part in record.sums(np.array([log_best])))
    scale = best_chi2 / m
    beyond_grid = at in (0.0, len(chi2) - 1.0) and 1e-6 < best < 100.0
    e = None if beyond_grid else record.residuals(best)
    if record.thinned and not 1e-3 < scale < 1e3:  # without its spikes it is constant
        return Correction()
    free = -0.5 * (best_logdet + m * math.log(scale) + m)
    if edge:
        fits = free <= _at_edge(record, m) + LR_LIMIT[0]
        return Correction(instead_of_edge=None if fits else best, e=e)
    middle = len(LOG_FACTORS) // 2
    if free <= -0.5 * (logdet[middle] + chi2[middle]) + LR_LIMIT[1]:
        return Correction(e=e)
    likelihood, q_factor, r_factor = _one_factor(logdet, chi2, m)
    if free > likelihood + LR_LIMIT[0]:
        q_factor, r_factor = best / record.ratio * scale, scale
    return Correction(*(min(max(float(f), 1e-3), 1e3) for f in (q_factor, r_factor)), e=e)


def _at_edge(record: Record, m: float) -> float:
    """Log-likelihood at q = 0 or r = 0, whichever the filter has, without its constant; −inf where impossible."""
    if record.ratio < 1.0:
        chi2, logdet = (float(part[0]) for part in record.sums(np.array([-math.inf])))
        return -0.5 * (logdet + m * math.log(chi2 / m) + m) if chi2 > 0.0 else -math.inf
    loglik, _ = record.data.random_walk()
    return loglik + 0.5 * m * math.log(2.0 * math.pi)


def _one_factor(logdet: Array, chi2: Array, m: float) -> tuple[float, float, float]:
    """Log-likelihood and the factors for q and r of the best correction with one free parameter."""
    middle = len(LOG_FACTORS) // 2
    only_q, q_at = _peak(-0.5 * (logdet + chi2))
    only_r, r_at = _peak(-0.5 * (logdet - m * LOG_FACTORS + chi2 * np.exp(LOG_FACTORS)))
    both = chi2[middle] / m
    return max(
        (only_q, math.exp((q_at - middle) * GRID_STEP), 1.0),
        (only_r, 1.0, math.exp((middle - r_at) * GRID_STEP)),
        (-0.5 * (logdet[middle] + m * math.log(both) + m), both, both),
    )


def _peak(curve: Array) -> tuple[float, float]:
    """Largest value of a curve of equal steps and where it lies, by the parabola through three points."""
    i = int(np.argmax(curve))
    if i in (0, len(curve) - 1):
        return float(curve[i]), float(i)
    before, top, after = (float(curve[j]) for j in (i - 1, i, i + 1))
    bend = before - 2.0 * top + after
    shift = 0.5 * (before - after) / bend if bend < 0.0 else 0.0
    return top - 0.25 * (before - after) * shift, i + shift
