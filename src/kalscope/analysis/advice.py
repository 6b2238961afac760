"""How to correct a filter that does not fit its record: factors for q and r, and plain sentences.

The record is filtered again with λ changed by factors from 1/1000 to 1000. Four corrections compete by their
likelihood: q alone, r alone, both by one factor (which keeps the curve and corrects its variance), or each by
its own. The simplest one that a likelihood-ratio test does not reject is advised. Structure that is then left
in the residuals cannot be removed by q and r: the model does not describe the signal.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kalscope.analysis.residual_tests import correlation, dot, low_frequency_share, variance_change
from kalscope.common.array import Array
from kalscope.common.text import number, percent
from kalscope.filtering.batch import kalman_filter
from kalscope.filtering.params import FilterParams

Indices = NDArray[np.int64]

ALARM = 0.01
"""p-value below which a test reports a misfit."""

LR_LIMIT = (6.635 / 2.0, 9.210 / 2.0)
"""Gain in log-likelihood that is significant at 1 %, for one and for two parameters: ½ χ²(0.99)."""

MIN_FACTOR = 1.5
"""Smaller factors are not worth a change, however significant they are in a long record."""

MIN_SHARE = 0.04
"""Share of the residuals' variance that must be predictable before a misfit of the model is reported."""

MIN_SAMPLES = 20
"""Scored innovations needed for a judgement."""

MAX_OUTLIERS = 0.03
"""Share of the samples up to which spikes are outliers; more of them belong to the signal."""

STRETCHES, STRETCH = 4, 5_000
"""Number and length in samples of the evenly spread stretches in which a long record is filtered again."""

LOG_FACTORS = np.linspace(-math.log(1000.0), math.log(1000.0), 29)
"""Logarithms of the factors for λ; the middle one is 0."""

GRID_STEP = float(LOG_FACTORS[1] - LOG_FACTORS[0])


@dataclass(frozen=True)
class Record:
    """One channel as input for a filter with other q and r: without prior, rejected samples and spikes."""

    stretches: tuple[tuple[Array, Array | None], ...]
    """z in units of √r (√q where r is 0), shape (n,), NaN where missing; dt as `kalman_filter` takes it."""
    ratio: float
    """λ of the filter that made it; 0 or inf at the edges."""
    thinned: bool
    """Whether spikes were left out."""

    @property
    def moves(self) -> bool:
        """Whether z has two different values."""
        z = np.concatenate([z[np.isfinite(z)] for z, _ in self.stretches])
        return len(z) > 0 and bool(np.any(z != z[0]))

    @staticmethod
    def of(columns: tuple[Array, ...], scored: Indices, spikes: Indices) -> Record:
        """Invert the filter: z = x + (1 − k) v, r = (1 − k) s, q·dt = k s − p before.

        Args:
            columns: x, p, k, innovation and s of one channel, shape (n,) each.
            scored: indices of the scored samples, at least one.
            spikes: indices of those to leave out.
        """
        _, _, k, _, s = columns
        last = scored[-1]
        r = float(s[last] - k[last] * s[last])
        r = r if r > 1e-13 * s[last] else 0.0
        n = len(k)
        starts = [0] if n <= STRETCHES * STRETCH else np.linspace(0, n - STRETCH, STRETCHES).astype(int)
        length = n if len(starts) == 1 else STRETCH
        parts = [_undo(tuple(c[a : a + length] for c in columns), spikes - a) for a in starts]
        steps = np.concatenate([part[1] for part in parts])
        steps = steps[steps > 0.0]
        q = float(np.median(steps)) if len(steps) else 0.0
        regular = not len(steps) or np.all(np.abs(steps - q) <= 1e-3 * q)
        unit = math.sqrt(r or q or float(s[last]))
        ratio = math.inf if r == 0.0 else q / r
        return Record(tuple((z / unit, None if regular else dt / q) for z, dt in parts), ratio, len(spikes) > 0)


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
    """Standardised innovations of the best fit, NaN between stretches; None where none was found."""


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
    """The simplest change of q and r that the record does not reject; on at most 20,000 samples."""
    edge = not 1e-12 < record.ratio < 1e12
    log_ratios = 2.0 * LOG_FACTORS if edge else LOG_FACTORS + math.log(record.ratio)
    logdet, chi2, m = np.array([refilter(record, math.exp(v), 1.0)[:3] for v in log_ratios]).T
    m = m[0]
    if m < MIN_SAMPLES:
        return Correction()
    if chi2.min() <= 0.0:  # constant, or its changes are too small beside q and r for a double
        return Correction(1e-3, 1e-3) if record.moves else Correction()
    _, at = _peak(-0.5 * (logdet + m * np.log(chi2)))
    best = math.exp(log_ratios[0] + at * (log_ratios[1] - log_ratios[0]))
    best_logdet, best_chi2, _, e = refilter(record, best, 1.0)
    scale = best_chi2 / m
    beyond_grid = at in (0.0, len(chi2) - 1.0) and 1e-6 < best < 100.0
    e = None if beyond_grid else e / math.sqrt(scale)
    if record.thinned and not 1e-3 < scale < 1e3:  # without its spikes it is constant
        return Correction()
    free = -0.5 * (best_logdet + m * math.log(scale) + m)
    if edge:
        now = refilter(record, *((0.0, 1.0) if record.ratio < 1.0 else (1.0, 0.0)))
        fits = now[1] > 0.0 and free <= -0.5 * (now[0] + m * math.log(now[1] / m) + m) + LR_LIMIT[0]
        return Correction(instead_of_edge=None if fits else best, e=e)
    middle = len(LOG_FACTORS) // 2
    if free <= -0.5 * (logdet[middle] + chi2[middle]) + LR_LIMIT[1]:
        return Correction(e=e)
    likelihood, q_factor, r_factor = _one_factor(logdet, chi2, m)
    if free > likelihood + LR_LIMIT[0]:
        q_factor, r_factor = best / record.ratio * scale, scale
    return Correction(*(min(max(float(f), 1e-3), 1e3) for f in (q_factor, r_factor)), e=e)


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


def noise_sentence(correction: Correction) -> str | None:
    """How to change q and r, in words; None where no change is worth it."""
    q, r = correction.q_factor, correction.r_factor
    q_off, r_off, ratio_off = (abs(math.log(f)) >= math.log(MIN_FACTOR) for f in (q, r, q / r))
    if q_off and r_off and not ratio_off:
        size = "small" if r > 1.0 else "large"
        return f"q and r are both too {size} by about {_times(r)}: this changes the band, not the curve"
    if not (q_off or r_off):
        return None
    pace = "too slow" if q > r else "too fast"
    change_q, change_r = ("raise" if f > 1.0 else "lower" for f in (q, r))
    if q_off and r_off:
        both = f"{pace}: {change_q} q about {_times(q)} and {change_r} r about {_times(r)}"
        if change_q != change_r:
            return both
        return f"{both}, so that q/r becomes about {_times(max(q / r, r / q))} {'larger' if q > r else 'smaller'}"
    if q_off:
        return f"{pace}: {change_q} q about {_times(q)}"
    band = "narrow" if r > 1.0 else "wide"
    return f"the band is too {band} and the filter {pace}: {change_r} r about {_times(r)}"


def edge_sentence(correction: Correction, ratio: float) -> str | None:
    """What to use instead of q = 0 or r = 0; None where that fits, or neither is 0."""
    best = correction.instead_of_edge
    if best is None:
        return None
    if ratio < 1.0:
        what = "q = 0" if ratio == 0.0 else "so small a q"
        return f"{what} cannot follow this signal: q about {number(best, 1)} × r fits best"
    what = "r = 0" if math.isinf(ratio) else "so small an r"
    return f"{what} lets all noise through: r about {number(1.0 / best, 1)} × q fits best"


def structure_sentence(e: Array, lags: int, momentum: bool) -> str | None:
    """What is left in the residuals e of the best fit, with momentum of the filter itself; None if nothing is."""
    scored = e[np.isfinite(e)]
    share, _, p = low_frequency_share(scored)
    ask = "; estimate q, r and momentum if you have not" if momentum else ""
    if p < ALARM and share >= MIN_SHARE:
        left = f"low frequencies hold {percent(share)} of the residual power"
        return f"{left}: the signal has a trend the model lacks{ask}"
    left = correlation(e, lags, fitted=True)
    if left.p < ALARM and left.q >= MIN_SHARE * len(scored):
        if momentum:
            return f"residuals are correlated: the filter is too slow or too fast, or the signal has hum{ask}"
        return (
            "residuals stay correlated for any q and r: the signal has hum, trend or coloured noise that a "
            "random walk cannot describe"
        )
    return None


def variance_sentence(e: Array) -> str | None:
    """Whether the noise of the residuals e changes by more than one r can fit, in words; None where it does not."""
    scored = e[np.isfinite(e)]
    ratio, p = variance_change(scored)
    if p < ALARM and not 1.0 / MIN_FACTOR < ratio < MIN_FACTOR:
        size = number(ratio, 2)
        return f"the noise changes: its variance at the end is {size} × that at the start, one r cannot fit"
    return None


def spike_sentence(spikes: int, n: int) -> str:
    """What to do about more isolated spikes among n samples than expected by chance."""
    if spikes > MAX_OUTLIERS * n:
        return f"spikes: {spikes} beyond 4 σ are too many for outliers: the noise or the signal comes in bursts"
    return f"spikes: {spikes} beyond 4 σ: switch the outlier gate on"


def jump_sentence(jumps: int) -> str:
    """What to know about more steps that stay than expected by chance."""
    return f"jumps: {jumps} beyond 4 σ that stay: the signal itself steps, an outlier gate would delay it"


def _undo(columns: tuple[Array, ...], spikes: Indices) -> tuple[Array, Array]:
    """Samples and q·dt of one stretch from its x, p, k, innovation, s; NaN at the spikes (indices into it)."""
    x, p, k, v, s = columns
    with np.errstate(invalid="ignore"):
        z = np.where(np.isnan(v), np.where(k > 0.0, x, math.nan), x + (1.0 - k) * v)
        z[(k == 0.0) & (p > 0.0)] = math.nan
        predicted = np.where(k > 0.0, k * s, p)
        steps = predicted[1:] - p[:-1]
        known = np.isfinite(steps) & (steps > 1e-12 * predicted[1:])
    z[spikes[(spikes >= 0) & (spikes < len(z))]] = math.nan
    return z, np.r_[0.0, np.where(known, steps, 0.0)]


def refilter(record: Record, q: float, r: float, momentum: float = 0.0) -> tuple[float, float, int, Array]:
    """Σ ln s, Σ v²/s, their number m, and e with a NaN between stretches, at these parameters."""
    loglik = chi2 = 0.0
    m = 0
    e: list[Array] = []
    for z, dt in record.stretches:
        result = kalman_filter(z, FilterParams(q, r, momentum=momentum), dt)
        part = result.innovation / np.sqrt(result.s)
        part[np.isnan(result.innovation)] = math.nan
        seen = part[np.isfinite(part)]
        chi2 += dot(seen, seen)
        loglik += float(result.loglik)
        m += len(seen)
        e += [part, np.array([math.nan])]
    return -2.0 * loglik - m * math.log(2.0 * math.pi) - chi2, chi2, m, np.concatenate(e)


def _peak(curve: Array) -> tuple[float, float]:
    """Largest value of a curve of equal steps and where it lies, by the parabola through three points."""
    i = int(np.argmax(curve))
    if i in (0, len(curve) - 1):
        return float(curve[i]), float(i)
    before, top, after = (float(curve[j]) for j in (i - 1, i, i + 1))
    bend = before - 2.0 * top + after
    shift = 0.5 * (before - after) / bend if bend < 0.0 else 0.0
    return top - 0.25 * (before - after) * shift, i + shift


def _times(factor: float) -> str:
    """A factor in words: "1.6 ×", "4 ×", "1000 × or more"; of a decrease, the divisor."""
    size = factor if factor > 1.0 else 1.0 / factor
    if size >= 900.0:
        return "1000 × or more"
    return f"{number(size, 2 if size < 3.0 else 1)} ×"


def as_sentences(said: str) -> str:
    """Advice as sentences, each with a capital and a full stop; symbols stay as they are."""
    said = re.sub(r"(^|\. )([a-z])(?=[a-z])", lambda m: m[1] + m[2].upper(), said)
    return said if said.endswith(".") else f"{said}."
