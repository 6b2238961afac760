"""Two speeds from a record: both process noises and the share of spikes, where the evidence is clear.

The likelihood is that of the filter itself, so what is fitted is what a device runs. It is searched from several
starts, because steps, rests with walks and bursts lie far apart: the noise of the steps' rest is a millionth of r.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from kalscope.common.numbers import Array
from kalscope.common.text import number, percent
from kalscope.estimation.noise import noise_scale
from kalscope.estimation.result import Estimate
from kalscope.filtering.filter import FilterResult, KalmanFilter, empty_rows
from kalscope.filtering.params import FilterParams, one_record

SEARCHED = 8_000
"""Samples in the middle of a record that are enough for the search; the evidence is that of all."""

MIN_R = 1e-200
"""Least variance to begin with, unit²; the largest is 1/MIN_R."""

NONE = 1e-3
"""A share of spikes up to here is none: else a step that the fit has not seen passes for many spikes in a row."""

_LEAST = np.log([1e-5, 1e-6, 1e-4, 1e-5])
_MOST = np.log([1e2, 1e6, 0.1, 1e3])
"""Limits of what is searched: ln(q/r), ln(r over that of one speed), ln(spikes), ln(fast q/r)."""

ROUNDED = 0.02
"""What the log-likelihood must gain more a sample where all of r is rounding: between two steps of the sensor the
readings stand still, which looks like a rest (0.007 in simulations)."""

SURE = 2.0
"""Standard errors by which the errors of prediction must be smaller."""

NOT_CLEAR = "Two speeds do not explain it clearly better, so there is one."

_STARTS = ((0.1, 5.0), (1e-2, 10.0), (1e-7, 10.0))
"""q at rest and while moving, over that of one speed."""


@dataclass(frozen=True)
class TwoSpeeds:
    """The most likely filter with two speeds, against one speed with the same hypothesis of spikes."""

    params: FilterParams
    """With `fast`."""
    loglik: float
    """Its log-likelihood, of all samples."""
    one_loglik: float
    """That of the most likely one with fast = 1."""
    samples: int
    """Readings that these are of."""
    better: float
    """Mean by which the prediction errors of two speeds are smaller, in its standard errors: where the noise level
    changes, the likelihood rises, but no prediction becomes better."""

    gain: float
    """Share by which the mean size of the prediction errors is smaller."""
    rounding: float
    """Share of r that is rounding."""

    def is_clear(self, loglik: float = -math.inf) -> bool:
        """Whether two speeds are likelier than one, and than a filter of this `loglik`, by enough.

        The margin is larger than that of one parameter: the search tries many factors (prototype: no false choice).
        """
        margin = 1.5 * math.log(max(self.samples, 1)) + 3.0 + ROUNDED * self.rounding * self.samples
        return self.loglik - max(self.one_loglik, loglik) > margin and self.better > SURE


def fit_two_speeds(z: Array, steps: Array, one: FilterParams, least_r: float = 0.0) -> TwoSpeeds:
    """Search two speeds over checked samples z, shape (n,), from the fit `one`; `steps` empty = regular.

    `least_r` is the variance of rounding: below it a filter would follow each step of the sensor.
    """
    first, rows = max(0, (len(z) - SEARCHED) // 2), z.reshape(-1, 1)
    part, periods = rows[first : first + SEARCHED], steps[first : first + SEARCHED]

    def params_at(at: Array) -> FilterParams:
        limited = np.clip(at, _LEAST[: len(at)], _MOST[: len(at)])
        ratio, size, spikes, *moving = np.exp(limited).tolist()
        r, spikes = max(size * float(one.r), least_r), spikes if spikes > NONE else 0.0
        return FilterParams(ratio * r, r, fast=max(moving[0] / ratio, 1.0) if moving else 1.0, spikes=spikes)

    from scipy.optimize import minimize

    def search(begin: Any, evaluations: int) -> tuple[float, list[float]]:
        options: Any = {"maxfev": evaluations, "xatol": 0.02, "fatol": 0.02}
        end = minimize(
            lambda at: -float(_run(part, periods, params_at(at)).loglik),
            begin,
            method="Nelder-Mead",
            options=options,
        )
        return float(end.fun), end.x.tolist()

    ratio = math.log(max(one.ratio, 1e-9))
    spikes = _LEAST[2], math.log(0.01)
    alone = [search(np.array([ratio, 0.0, share]), 60) for share in spikes]
    begins = [
        np.array([ratio + math.log(less), 0.0, share, ratio + math.log(more)])
        for less, more in _STARTS
        for share in spikes
    ]
    best = search(min(search(begin, 60) for begin in begins)[1], 200)
    alone = search(min(*alone, search(best[1][:3], 60))[1], 120)
    params = params_at(np.array(best[1]))
    two, single = (_run(rows, steps, one) for one in (params, params_at(np.array(alone[1]))))
    return TwoSpeeds(
        params,
        float(two.loglik),
        float(single.loglik),
        int(two.m),
        *_better(single, two),
        rounding=least_r / float(params.r),
    )


def clear_two_speeds(best: Estimate | None, z: Array, steps: Array) -> TwoSpeeds | None:
    """Two speeds of checked samples z, shape (n,), where they are clearly likelier than the best fit of one speed.

    Momentum is a rival only where that fit scores all samples. Where it has no noise the search begins at q = r.
    """
    if best is None:
        return None
    q, r = float(best.q), float(best.r)
    q, r = (q, r) if min(q, r) > MIN_R else (noise_scale(z), noise_scale(z))
    if not MIN_R < min(q, r) <= max(q, r) < 1.0 / MIN_R:
        return None
    found = fit_two_speeds(z, steps, FilterParams(q, r), float(best.resolution) ** 2 / 12.0)
    rival = best.loglik if best.momentum and best.outliers is None else -math.inf
    if not found.is_clear(rival):
        return None
    if best.params is not None:  # both without the spikes, which may be larger than those of the hypothesis
        rows = (z if best.outliers is None else np.where(best.outliers, np.nan, z)).reshape(-1, 1)
        fit, two = (_run(rows, steps, params) for params in (best.params, found.params))
        if _better(fit, two)[0] <= SURE:
            return None
    return found


def with_two_speeds(one: Estimate, z: ArrayLike, dt: ArrayLike | None) -> Estimate:
    """The estimate with two speeds where the record z, shape (n,), shows them clearly; else itself, which says so.

    Its intervals are open: they are not found for two speeds.
    """
    found = clear_two_speeds(one, *one_record(z, dt))
    if found is None:
        return replace(one, message=f"{one.message} {NOT_CLEAR}")
    params = found.params
    spikes = f", {percent(params.spikes)} spikes" if params.spikes else ""
    rest, moving, r = (number(each, 4) for each in (params.q, params.moving.q, float(params.r)))
    text = (
        f"The signal rests and moves: q = {rest} at rest, {moving} while it moves; r = {r}{spikes}. "
        f"Log-likelihood {number(found.loglik - found.one_loglik, 4)} above that of one speed."
    )
    return Estimate(
        q=params.q,
        r=params.r,
        loglik=found.loglik,
        verdict="ok",
        message=text,
        params=params,
        outliers=one.outliers,
        outlier_share=one.outlier_share,
        resolution=one.resolution,
    )


def _better(one: FilterResult, two: FilterResult) -> tuple[float, float]:
    """Mean by which the prediction errors of the second are smaller, in its standard errors, and as a share."""
    before, after = np.abs(one.innovation), np.abs(two.innovation)
    scored = np.isfinite(before) & np.isfinite(after)
    gain, size = (before - after)[scored], float(before[scored].mean()) if scored.any() else 0.0
    spread = float(gain.std()) / math.sqrt(len(gain)) if len(gain) else 0.0
    return (float(gain.mean()) / spread if spread else 0.0, float(gain.mean()) / size if size else 0.0)


def _run(rows: Array, steps: Array, params: FilterParams) -> FilterResult:
    return KalmanFilter(params).take(rows, steps, empty_rows(params, len(rows)))
