"""Tests of standardised innovations e: if the model holds they are independent draws from N(0, 1).

Pure functions of e; none of them raises or returns NaN for finite e. Formulas: Durbin & Koopman (2012),
section 2.12; Commandeur & Koopman (2007), section 8.5; Bar-Shalom et al. (2001), section 5.4.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from kalscope.common.array import Array

SPIKE = 4.0
"""Size, in local standard deviations, beyond which a residual counts as a spike: 63 in a million by chance."""

MIN_PAIRS = 10
"""Pairs of samples that a lag needs for a correlation."""

MIN_BLOCK = 4
"""Samples in the shortest block whose mean counts as low-frequency."""


def dot(a: Array, b: Array) -> float:
    """Σ a b without BLAS, whose threads wait for each other: 0.1 ms became 200 ms on a busy machine."""
    return float(np.einsum("i,i", a, b))


@dataclass(frozen=True)
class Correlation:
    """Autocorrelation of e with the gaps left out: only pairs with both samples scored count."""

    r: Array
    """r_1 … r_h, shape (h,); 0 at a lag that has too few pairs."""
    bound: float
    """95 % bound on |r_1| of white noise, 1.96/√N where nothing is missing."""
    q: float
    """Ljung-Box statistic over the h lags."""
    p: float
    """Probability of a q this large if e is white."""


def correlation(e: Array, lags: int, fitted: bool = False) -> Correlation:
    """Autocorrelation at lags 1 … `lags` and the Ljung-Box test of it.

    r_k is the sum over the n_k pairs, scaled up to the N − k pairs of a record without gaps, and
    Q = N (N + 2) Σ r_k² n_k / (N − k)², which is Ljung & Box (1978) where nothing is missing.

    Args:
        e: standardised innovations in the order of time, shape (n,), NaN where none was scored.
        lags: h ≥ 1.
        fitted: λ was estimated from this record: one degree of freedom fewer.
    """
    from scipy.special import chdtrc

    seen = np.isfinite(e)
    n = int(np.count_nonzero(seen))
    r = np.zeros(lags)
    first_pairs, q, used = 0, 0.0, 0
    if n > 1:
        first, last = np.argmax(seen), len(e) - np.argmax(seen[::-1])
        e, seen = e[first:last], seen[first:last]
        whole = n == len(e)
        d = e - (e.mean() if whole else e[seen].mean())
        d[~seen] = 0.0
        total = dot(d, d)
        for k in range(1, min(lags, n - 1) + 1):
            pairs = n - k if whole else int(np.count_nonzero(seen[k:] & seen[:-k]))
            first_pairs = pairs if k == 1 else first_pairs
            if pairs >= MIN_PAIRS and total > 0.0:
                share = dot(d[k:], d[:-k]) / total
                r[k - 1] = share * (n - k) / pairs
                q += n * (n + 2.0) * share**2 / pairs
                used += 1
    p = float(chdtrc(max(used - fitted, 1), q)) if used else 1.0
    return Correlation(r, 1.96 / math.sqrt(first_pairs + 1.0), float(q), p)


def nis_band(n: int) -> tuple[float, float]:
    """95 % band of the mean of n values e², [χ²_n(0.025)/n, χ²_n(0.975)/n]."""
    from scipy.special import chdtri

    return float(chdtri(n, 0.975)) / n, float(chdtri(n, 0.025)) / n


def variance_change(e: Array) -> tuple[float, float]:
    """H(h) = Σ e² of the last third / Σ e² of the first, and its two-sided p value from F(h, h).

    Args:
        e: scored residuals only, shape (N,); h = N/3 rounded. H is kept within 1e-12 … 1e12.
    """
    from scipy.special import fdtr, fdtrc

    h = round(len(e) / 3)
    early, late = dot(e[:h], e[:h]), dot(e[len(e) - h :], e[len(e) - h :])
    if early == late:
        return 1.0, 1.0
    ratio = 1e12 if early == 0.0 else min(max(late / early, 1e-12), 1e12)
    return ratio, float(min(1.0, 2.0 * min(fdtr(h, h, ratio), fdtrc(h, h, ratio))))


def normality(e: Array) -> tuple[float, float, float, float]:
    """Skewness S, excess kurtosis K, N (S²/6 + K²/24) and its p value from χ²₂ (Bowman & Shenton 1975)."""
    d = e - e.mean()
    largest = max(float(d.max()), -float(d.min()))
    if largest == 0.0:
        return 0.0, 0.0, 0.0, 1.0
    d /= largest  # fourth powers must neither overflow nor vanish
    d2 = d * d
    variance = float(d2.mean())
    skewness = dot(d2, d) / len(e) / variance**1.5
    excess = dot(d2, d2) / len(e) / variance**2 - 3.0
    statistic = len(e) * (skewness**2 / 6.0 + excess**2 / 24.0)
    return skewness, excess, statistic, math.exp(-0.5 * statistic)


def low_frequency_share(e: Array) -> tuple[float, int, float]:
    """Whether low frequencies are left: do means of blocks scatter more than those of white noise?

    One-way analysis of variance about 0 for blocks of 4, 8, 16 … samples; the block length with the smallest
    p value answers, and p is multiplied by the number of lengths tried (Bonferroni).

    Args:
        e: scored residuals only, shape (N,).

    Returns:
        Share of the variance of e between blocks, beyond that of white noise, 0 … 1; the
        block length in samples; p.
    """
    from scipy.special import fdtrc

    best, tried, length, means = (0.0, 0, 1.0), 0, 1, e
    while True:
        pairs = len(means) // 2
        means = 0.5 * (means[: 2 * pairs : 2] + means[1 : 2 * pairs : 2])
        length *= 2
        blocks = len(means)
        if blocks < 4:
            break
        if length < MIN_BLOCK:
            continue
        tried += 1
        used = blocks * length
        total = dot(e[:used], e[:used])
        within = total - length * dot(means, means)
        if not 0.0 < within < total:
            continue
        noise = within / (used - blocks)
        p = float(fdtrc(blocks, used - blocks, (total - within) / blocks / noise))
        share = max(0.0, 1.0 - noise / (total / used))
        best = min(best, (share, length, p), key=lambda found: (found[2], -found[0]))
    return best[0], best[1], min(1.0, best[2] * max(tried, 1))


def spike_limits(e: Array) -> Array:
    """Size beyond which each residual is a spike, shape (N,): `SPIKE` local standard deviations.

    The scale is 1.4826 · median |e| in up to 16 stretches of at least 500 samples, so that neither a
    wrong r nor a slow change of the noise makes spikes.
    """
    limits = np.abs(e)
    for part in np.array_split(limits, min(max(len(e) // 500, 1), 16)):
        scale = 1.4826 * float(np.median(part)) if len(part) else 0.0
        rms = math.sqrt(dot(part, part) / max(len(part), 1))
        if scale <= 0.01 * rms:  # most of it is constant, or nearly
            scale = rms
        part.fill(SPIKE * scale or math.inf)
    return limits


def spike_chance(count: int, n: int) -> tuple[float, float]:
    """Expected spikes among n residuals of N(0, 1), and the probability of `count` or more (Poisson)."""
    from scipy.special import ndtr, pdtrc

    expected = 2.0 * n * float(ndtr(-SPIKE))
    return expected, float(pdtrc(count - 1, expected)) if count > 0 else 1.0
