"""From a pair of numbers to an Estimate: units, intervals, verdict and message; the same for every method."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from kalscope.common.array import Array
from kalscope.common.progress import Progress
from kalscope.estimation.likelihood.profile import Differences, differences
from kalscope.estimation.likelihood.search import Peak
from kalscope.estimation.methods.pair import Pair
from kalscope.estimation.result import USABLE, Estimate
from kalscope.estimation.verdict import words
from kalscope.filtering.arrays import one_record
from kalscope.filtering.params import MAX_VARIANCE, FilterParams

NOWHERE = Peak(-math.inf, 0.0, 0.0, (-math.inf, math.inf))
"""The peak of a record without information."""

MIN_VARIANCE = 1e-300
"""Smallest variance accepted, unit²; smaller ones lose digits."""


def fit_record(
    z: ArrayLike, dt: ArrayLike | None, progress: Progress, fit: Callable[[Array, Array, Progress], Estimate]
) -> Estimate:
    """Check z and dt, and `fit` them."""
    found = fit(*one_record(z, dt), progress)
    progress(1.0, "done")
    return found


def channel_fit(
    method: str,
    fit: Callable[[Differences, Progress], Estimate],
) -> Callable[[Array, Array, Progress], Estimate]:
    """The fit of one channel, for `fit_record`: `fit` it if it passes the precheck."""

    def whole(column: Array, steps: Array, progress: Progress) -> Estimate:
        data = _informative(differences(column, steps))
        verdict, message = _precheck(data, min(data.m + 1, int(np.isfinite(column).sum())))
        if verdict:
            return _estimate(method, NOWHERE, 0.0, (0.0, 0.0), (math.inf, math.inf), verdict, message)
        return fit(data, progress)

    return whole


def conclude(method: str, data: Differences, pair: Pair, peak: Peak) -> Estimate:
    """The Estimate of one channel from a method's pair and the peak of the likelihood."""
    with np.errstate(over="ignore", under="ignore"):
        numbers = np.array([pair.q, pair.r, pair.q_se, pair.r_se]) * data.scale * data.scale
    q, r, q_se, r_se = numbers.tolist()
    verdict = pair.verdict or _judge(pair, peak)
    sizes = [size for size, found in ((q, pair.q), (r, pair.r)) if found > 0.0]
    if not all(MIN_VARIANCE < size <= MAX_VARIANCE for size in sizes):
        return _estimate(method, NOWHERE, 0.0, (0.0, 0.0), (math.inf, math.inf), "bad_unit", words.BAD_UNIT)
    message = pair.text or _message(verdict, pair, peak)
    if pair.note:
        message = f"{message} {pair.note}"
    return _estimate(method, peak, _loglik(data, pair), (q, r), (q_se, r_se), verdict, message)


def gain_of(ratio: float) -> float:
    """Steady gain of λ = 0 … inf: 2/(1 + √(1 + 4/λ)), Durbin & Koopman (2012), section 2.11."""
    return 0.0 if ratio == 0.0 else 2.0 / (1.0 + math.hypot(1.0, 2.0 / math.sqrt(ratio)))


def lag_of(ratio: float) -> float:
    """Lag on a ramp in samples for λ = 0 … inf, (1 − K)/K without cancellation."""
    if ratio == 0.0:
        return math.inf
    half = 2.0 / math.sqrt(ratio)
    return 0.5 * half * (half / (math.hypot(1.0, half) + 1.0))


def _informative(data: Differences) -> Differences:
    """Without repeated lines of the same time and value: they add nothing, yet would prove r = 0."""
    if len(data.gap) == 0:
        return data
    new = (data.gap > 0.0) | (data.d != 0.0)
    return data if new.all() else Differences(data.d[new], data.gap[new], data.scale)


def _precheck(data: Differences, n: int) -> tuple[str, str]:
    if n < words.MIN_SAMPLES:
        return "too_few", words.too_few(n)
    if not data.d.any():
        return "constant", words.constant(n)
    return "", ""


def _judge(pair: Pair, peak: Peak) -> str:
    if pair.r == 0.0:
        return "no_noise"
    if pair.q == 0.0:
        return "no_movement"
    return "flat" if peak.interval == (-math.inf, math.inf) else "ok"


def _message(verdict: str, pair: Pair, peak: Peak) -> str:
    low, high = (exp(end) for end in peak.interval)
    if verdict == "no_noise":
        seen = high < math.inf
        return words.blind("noise", low, high) if seen else words.no_noise((gain_of(low), gain_of(high)))
    if verdict == "no_movement":
        return words.blind("movement", low, high) if low > 0.0 else words.no_movement(lag_of(high))
    if verdict == "flat":
        return words.FLAT
    if verdict == "not_converged":
        return words.NOT_CONVERGED
    return words.ok(gain_of(pair.q / pair.r), (lag_of(high), lag_of(low)), (low, high))


def _loglik(data: Differences, pair: Pair) -> float:
    """Log-likelihood at the pair itself; 0 where there is none."""
    if pair.q == 0.0 and pair.r == 0.0:
        return 0.0
    if pair.r == 0.0:
        gap = data.gap if len(data.gap) else np.ones(data.m)
        if np.any(gap == 0.0):
            return -math.inf  # two different samples at one instant cannot both be exact
        chi2, logdet, unit = float(np.sum(data.d**2 / gap)), float(np.log(gap).sum()), pair.q
    else:
        (chi2,), (logdet,) = data.sums(np.array([pair.q / pair.r]))
        unit = pair.r
    log_unit = math.log(unit) + 2.0 * math.log(data.scale)
    return float(-0.5 * (data.m * (math.log(2.0 * math.pi) + log_unit) + logdet + chi2 / unit))


def _estimate(
    method: str,
    peak: Peak,
    loglik: float,
    pair: tuple[float, float],
    errors: tuple[float, float],
    verdict: str,
    message: str,
) -> Estimate:
    (q, r), (low, high) = pair, (exp(end) for end in peak.interval)
    return Estimate(
        method=method,
        q=q,
        r=r,
        ratio=q / r if r > 0.0 else (math.inf if q > 0.0 else 0.0),
        loglik=loglik,
        ratio_interval=(low, high),
        gain_interval=(gain_of(low), gain_of(high)),
        lag_interval=(lag_of(high), lag_of(low)),
        q_se=errors[0],
        r_se=errors[1],
        verdict=verdict,
        message=message,
        params=FilterParams(q=q, r=r) if verdict in USABLE else None,
    )


def exp(log_ratio: float) -> float:
    """λ of ln λ, inf beyond a double."""
    return math.exp(log_ratio) if log_ratio < 700.0 else math.inf
