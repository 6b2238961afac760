"""q and r from what is known: a lag or a cut-off, one of the two, or the rounding of the readings."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from kalscope.common.array import Array
from kalscope.common.checks import above_zero
from kalscope.common.progress import Progress
from kalscope.errors import BadSetting
from kalscope.estimation.likelihood.profile import Differences, differences
from kalscope.estimation.likelihood.search import Peak, find_peak, grid_for
from kalscope.estimation.methods import maximum_likelihood as ml
from kalscope.estimation.methods.pair import Pair
from kalscope.estimation.momentum.given import fit_movement
from kalscope.estimation.momentum.likelihood import Samples
from kalscope.estimation.momentum.verdict import conclude as conclude_momentum
from kalscope.estimation.result import Estimate
from kalscope.estimation.robust.fit import Fit, checked_robust, spike_proof
from kalscope.estimation.sensor.resolution import resolution_of
from kalscope.estimation.verdict import words
from kalscope.estimation.verdict.conclude import NOWHERE, channel_fit, conclude, exp, fit_record
from kalscope.filtering.momentum.specification import momentum_for_overshoot
from kalscope.filtering.params import MAX_VARIANCE, FilterParams
from kalscope.filtering.steady_state import ratio_for

_MAX_FACTOR = 1e100
"""A given r this many times above or below the largest squared step of the readings has another unit."""

_MAX_CHANGING = 0.8
"""Share of the readings that may differ from the one before where rounding hides the noise."""

_MIN_CHANGES = 3
"""Readings that must differ from the one before to show a step of the sensor, rather than a jump."""


def params_for_specification(
    r: float,
    *,
    gain: float | None = None,
    lag_samples: float | None = None,
    lag_s: float | None = None,
    cutoff_hz: float | None = None,
    noise_reduction_db: float | None = None,
    sample_period: float | None = None,
    momentum: float = 0.0,
    overshoot: float | None = None,
) -> FilterParams:
    """The filter that meets a target once settled: λ from `ratio_for`, then q = λ r.

    With an overshoot that is allowed too, the momentum follows from it: of all filters within the lag and the
    overshoot this one leaves the least noise; with a noise reduction in place of the lag it has the least lag.

    Args:
        r: measurement-noise variance, unit², > 0.
        gain: steady gain K; or one of
        lag_samples: largest lag behind a ramp, samples;
        lag_s: the same in s;
        cutoff_hz: −3 dB frequency;
        noise_reduction_db: white noise, in to out.
        sample_period: nominal sample period in s, for a target in s or Hz.
        momentum: τ of the filter in sample periods, 0 … 1e5.
        overshoot: how far the step response may go beyond the step, share of the step, about 0.2 at most; 0 is the
            filter without momentum. In place of `momentum`.

    Raises:
        BadSetting: r is not above 0, no target or several, a target out of range, or an overshoot that no momentum
            has with this target; the message says the largest.
    """

    def ratio_at(tau: float) -> float:
        return ratio_for(
            gain=gain,
            lag_samples=lag_samples,
            lag_s=lag_s,
            cutoff_hz=cutoff_hz,
            noise_reduction_db=noise_reduction_db,
            sample_period=sample_period,
            momentum=tau,
        )

    noise = above_zero("r", r, MAX_VARIANCE)
    if overshoot is not None:
        if momentum:
            raise BadSetting(f"overshoot must be given without momentum, which follows from it (got {momentum:g})")
        momentum = momentum_for_overshoot(overshoot, ratio_at)
    return FilterParams(q=ratio_at(momentum) * noise, r=noise, momentum=momentum)


def estimate_fixed_r(
    z: ArrayLike, r: float, dt: ArrayLike | None = None, robust: bool | Literal["auto"] = "auto"
) -> Estimate:
    """Find q by maximum likelihood where r is known (a still stretch, a data sheet); method "fixed_r".

    Args:
        z: measurements, shape (n,); NaN is a missing sample.
        r: measurement-noise variance, unit², > 0.
        dt: nominal sample periods before each sample, shape (n,), ≥ 0; None = 1 each.
        robust: whether spikes are set aside, as in `estimate`.

    Raises:
        BadSetting: r is not above 0; z holds inf or has another shape; dt does not fit z.
    """
    noise = above_zero("r", r, MAX_VARIANCE)
    one = channel_fit("fixed_r", lambda data, progress: _fit_q(data, noise, progress))
    return fit_record(z, dt, Progress(), spike_proof(one, lambda _: one, checked_robust(robust)))


def _fit_q(data: Differences, r: float, progress: Progress) -> tuple[Pair, Peak]:
    """The most likely q of one channel where r, unit², is known."""
    scaled = r / data.scale / data.scale
    if not _MAX_FACTOR**-1 < scaled < _MAX_FACTOR:
        return Pair(0.0, 0.0, math.inf, math.inf, verdict="bad_unit", text=words.OTHER_UNIT), NOWHERE
    constant = data.m * (math.log(2.0 * math.pi) + math.log(r))

    def loglik(log_ratios: Array) -> Array:
        chi2, logdet = data.sums(np.exp(log_ratios))
        return -0.5 * (constant + logdet + chi2 / scaled)

    # λ can hardly exceed the largest squared difference (at most 1 in this scale) over r
    peak = find_peak(loglik, grid_for(data.m, max(24.0, 4.0 - math.log(scaled))), -math.inf, progress)
    q = math.exp(peak.log_ratio) * scaled
    q_se = q / math.sqrt(-peak.curvature) if peak.curvature < 0.0 else math.inf
    return Pair(q, scaled, q_se, 0.0), peak


def estimate_fixed_ratio(
    z: ArrayLike, ratio: float = 0.01, dt: ArrayLike | None = None, robust: bool | Literal["auto"] = "auto"
) -> Estimate:
    """Find r by maximum likelihood where λ = q/r is chosen; method "fixed_ratio". r = Σv²/f / m.

    Args:
        z: measurements, shape (n,); NaN is a missing sample.
        ratio: λ = q/r, > 0; 0.01, r a hundred times q, is the advice of Ma'arif et al. (2019), section 4.
        dt: nominal sample periods before each sample, shape (n,), ≥ 0; None = 1 each.
        robust: whether spikes are set aside, as in `estimate`.

    Raises:
        BadSetting: ratio is not above 0; z holds inf or has another shape; dt does not fit z.
    """
    chosen = above_zero("ratio", ratio, MAX_VARIANCE)

    def fit(data: Differences, progress: Progress) -> tuple[Pair, Peak]:
        r = float(data.sums(np.array([chosen]))[0][0]) / data.m
        r_se = r * math.sqrt(2.0 / data.m)
        peak = ml.search(data, progress)
        low, high = peak.interval
        text = words.chosen_ratio(exp(low), exp(high), chosen)
        return Pair(chosen * r, r, chosen * r_se, r_se, text=text), peak

    one = channel_fit("fixed_ratio", fit)
    return fit_record(z, dt, Progress(), spike_proof(one, lambda _: one, checked_robust(robust)))


def above_rounding(fit: Fit) -> Fit:
    """The maximum-likelihood fit of one channel with r at least the variance that rounding adds.

    Readings in steps of Δ carry Δ²/12 at least. A fit that finds less takes the constant stretches between two
    steps for a signal without noise: then r is Δ²/12, q the most likely one with it, and the verdict
    "below_resolution". Where few readings repeat, the signal moves by more than a step: rounding is negligible.

    Source: Widrow (1956) for Δ²/12.
    """

    def whole(z: Array, steps: Array, progress: Progress) -> Estimate:
        one = fit(z, steps, progress.part(0.0, 0.9))
        step = _step_of(z[np.isfinite(z)])
        if step == 0.0 or one.verdict not in ("ok", "flat", "no_noise"):
            return one
        one = replace(one, resolution=step)
        floor, r = step * step / 12.0, float(one.r)
        if r >= floor:
            said = f" {words.rounding_share(step, floor / r)}" if r < step * step else ""
            return replace(one, message=f"{one.message}{said}")
        data = differences(z, steps)
        if _shows_steps(data) and _largest_noise(one, data) <= step * step:
            return _at_floor(one, data, progress.part(0.9, 1.0))
        return replace(one, message=f"{one.message} {words.rounding_floor(step)}")

    return whole


def may_be_below_resolution(z: Array, r: float) -> bool:
    """Whether rounding adds more than the r, unit², that was found in one channel, shape (n,)."""
    return r < _step_of(z[np.isfinite(z)]) ** 2 / 12.0


def _step_of(readings: Array) -> float:
    """The step of the readings; 0 of only two levels, which may be a switch, or one value and a stand-in for it."""
    if not len(readings):
        return 0.0
    between = (readings > readings.min()) & (readings < readings.max())
    return resolution_of(readings) if between.any() else 0.0


def _at_floor(one: Estimate, data: Differences, progress: Progress) -> Estimate:
    """The estimate with the r of rounding and the most likely q with it; with the q that it has where that is 0."""
    floor = float(one.resolution) ** 2 / 12.0
    found = _with_noise(one, data, floor, progress)
    found = one if found.q == 0.0 else found
    params = FilterParams(q=found.q, r=floor, momentum=float(one.momentum))
    return replace(
        found,
        r=floor,
        r_se=0.0,
        ratio=found.q / floor,
        verdict="below_resolution",
        message=words.below_resolution(float(one.resolution), params),
        params=params,
        loglik=one.loglik,
        momentum_interval=one.momentum_interval,
        prediction_gain=one.prediction_gain,
        resolution=one.resolution,
    )


def _with_noise(one: Estimate, data: Differences, r: float, progress: Progress) -> Estimate:
    """The most likely q with this r, unit², and the momentum of `one`; intervals over all of its momenta."""
    tau = float(one.momentum)
    if tau == 0.0:
        return conclude("ml", data, *_fit_q(data, r, progress))
    samples = Samples.of(data)
    found = fit_movement(samples, tau, r, progress.part(0.0, 0.4))
    low, high = (
        fit_movement(samples, end, r, progress.part(start, start + 0.3)) if 0.0 < end < math.inf else found
        for end, start in zip(map(float, one.momentum_interval), (0.4, 0.7), strict=True)
    )
    border = tuple((end.q / r, end.tau) for end in (low, high))
    return conclude_momentum(replace(found, region=(*found.region, *border)), "")


def _shows_steps(data: Differences) -> bool:
    """Whether many readings repeat, and enough do not."""
    return _MIN_CHANGES <= int(np.count_nonzero(data.d)) <= _MAX_CHANGING * data.m


def _largest_noise(one: Estimate, data: Differences) -> float:
    """The largest r that the record allows, unit²; without momentum that of the smallest λ."""
    if float(one.momentum) == 0.0:
        chi2, _ = data.sums(np.array([float(one.ratio_interval[0])]))
        return float(chi2[0]) / data.m * data.scale * data.scale
    return float(one.r) + 2.0 * float(one.r_se) if math.isfinite(float(one.r_se)) else 0.0
