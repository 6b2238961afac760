"""q, r and momentum from a record by maximum likelihood, or from what is known: a lag, q, r or their ratio."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from kalscope.common.numbers import Array, above_zero
from kalscope.common.progress import Progress
from kalscope.errors import BadSetting
from kalscope.estimation import verdict
from kalscope.estimation.likelihood import Differences, Peak, differences, fit_maximum_likelihood, search_records
from kalscope.estimation.momentum import conclude as conclude_momentum
from kalscope.estimation.momentum import fit_movement, with_given_momentum, with_momentum
from kalscope.estimation.noise import resolution_of
from kalscope.estimation.result import Estimate, Pair
from kalscope.estimation.spikes import Fit, checked_robust, spike_proof
from kalscope.estimation.two_speeds import with_two_speeds
from kalscope.estimation.verdict import NOWHERE, channel_fit, conclude, exp, fit_record, note_on_differences
from kalscope.filtering.params import MAX_MOMENTUM, MAX_VARIANCE, MIN_MOMENTUM, FilterParams
from kalscope.filtering.steady import momentum_for_overshoot, ratio_for

# `estimate`: q, r and momentum from a record by maximum likelihood.


def estimate(
    z: ArrayLike,
    dt: ArrayLike | None = None,
    progress: Callable[[float, str], None] | None = None,
    cancelled: Callable[[], bool] | None = None,
    momentum: float | Literal["auto"] = "auto",
    robust: bool | Literal["auto"] = "auto",
    two_speeds: bool = False,
    *,
    r: float | None = None,
    ratio: float | None = None,
) -> Estimate:
    """Find q, r and momentum in a record, with intervals and a verdict in words.

    Args:
        z: measurements, shape (n,); NaN is a missing sample.
        dt: nominal sample periods before each sample, shape (n,), ≥ 0; None = 1 each.
        progress: called with the fraction done and a few words; None = not reported.
        cancelled: whether to stop; None = never.
        momentum: τ in nominal sample periods, 0 … 1e5; 0 = none, the five lines. "auto" = find it, and take it
            where both the likelihood and the prediction of unseen samples favour it.
        robust: whether spikes, samples that neither those before nor those after predict, are set aside before the
            fit: True always, False never, "auto" where there are any.
        two_speeds: whether a filter with two speeds is used, calm at rest and quick while the signal moves, where
            the record shows them clearly: by 1.5 ln n + 3 in log-likelihood, and by its prediction errors.
        r: the variance of the measurement noise where it is known, unit², > 0: only q is estimated, no momentum.
        ratio: λ = q/r where it is chosen, > 0: only r is estimated, no momentum.

    Returns:
        An Estimate; its `params` are None where the record gives no usable pair, and its `message` says why.

    Raises:
        BadSetting: z holds inf or has another shape; dt does not fit z; momentum is out of its range; robust is
            something else.
        Cancelled: `cancelled()` was true.

    Source: Durbin & Koopman (2012), section 2.10.
    """
    tau = checked_momentum(momentum)
    if r is not None or ratio is not None:
        if (r is not None and ratio is not None) or tau:
            raise BadSetting(
                f"r or ratio must be given alone, without momentum (got r = {r}, ratio = {ratio}, "
                f"momentum = {momentum!r})"
            )
        return (
            estimate_fixed_r(z, r, dt, robust)
            if r is not None
            else estimate_fixed_ratio(z, ratio or 0.0, dt, robust)
        )

    def walk(data: Differences, progress: Progress) -> Estimate:
        peak = search_records(data.records, progress=progress).one()
        pair = replace(fit_maximum_likelihood(data, peak), note=note_on_differences(data))
        return conclude("ml", data, pair, peak)

    def channel(tau: float | None) -> Fit:
        def fit(data: Differences, progress: Progress) -> Estimate:
            if tau:
                return with_given_momentum(data, tau, progress)
            if tau == 0.0:
                return walk(data, progress)
            return with_momentum(data, walk(data, progress.part(0.0, 0.1)), progress.part(0.1, 1.0))

        return above_rounding(channel_fit("ml", fit))

    full = channel(tau)
    whole = spike_proof(full, channel if tau is None else lambda _: full, checked_robust(robust))
    if not two_speeds:
        return fit_record(z, dt, Progress(progress, cancelled), whole)
    shown = Progress(progress, cancelled)
    one = with_two_speeds(fit_record(z, dt, shown.part(0.0, 0.4), whole), z, dt)
    shown(1.0, "two speeds")
    return one


def checked_momentum(momentum: float | Literal["auto"]) -> float | None:
    """τ in sample periods, as the filter will take it; None = to be found.

    Raises:
        BadSetting: it is out of its range.
    """
    if isinstance(momentum, str) and momentum == "auto":
        return None
    try:
        tau = float(momentum)
    except (TypeError, ValueError):
        tau = math.nan
    if not 0.0 <= tau <= MAX_MOMENTUM:
        raise BadSetting(f'momentum must be "auto" or sample periods from 0 to 1e5 (got {momentum!r})')
    return tau if tau >= MIN_MOMENTUM else 0.0


# q and r from what is known: a lag or a cut-off, one of the two, or the rounding of the readings.


MAX_FACTOR = 1e100
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
    one = channel_fit("fixed_r", lambda data, progress: conclude("fixed_r", data, *_fit_q(data, noise, progress)))
    return fit_record(z, dt, Progress(), spike_proof(one, lambda _: one, checked_robust(robust)))


def _fit_q(data: Differences, r: float, progress: Progress) -> tuple[Pair, Peak]:
    """The most likely q of one channel where r, unit², is known."""
    scaled = r / data.scale / data.scale
    if not MAX_FACTOR**-1 < scaled < MAX_FACTOR:
        return Pair(0.0, 0.0, math.inf, math.inf, verdict="bad_unit", text=verdict.OTHER_UNIT), NOWHERE
    peak = search_records(data.records, np.array([scaled]), progress).one()
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

    def fit(data: Differences, progress: Progress) -> Estimate:
        r = float(data.sums(np.array([chosen]))[0][0]) / data.m
        r_se = r * math.sqrt(2.0 / data.m)
        peak = search_records(data.records, progress=progress).one()
        low, high = peak.interval
        text = verdict.chosen_ratio(exp(low), exp(high), chosen)
        return conclude("fixed_ratio", data, Pair(chosen * r, r, chosen * r_se, r_se, text=text), peak)

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
            share = f" {verdict.rounding_share(step, floor / r)}" if r < step * step else ""
            return replace(one, message=f"{one.message}{share}")
        data = differences(z, steps)
        if shows_steps(np.count_nonzero(data.d), data.m) and _largest_noise(one, data) <= step * step:
            return _at_floor(one, data, progress.part(0.9, 1.0))
        return replace(one, message=f"{one.message} {verdict.rounding_floor(step)}")

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
    refit = _with_noise(one, data, floor, progress)
    refit = one if refit.q == 0.0 else refit
    params = FilterParams(q=refit.q, r=floor, momentum=float(one.momentum))
    return replace(
        refit,
        r=floor,
        r_se=0.0,
        verdict="below_resolution",
        message=verdict.below_resolution(float(one.resolution), params),
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
    refit = fit_movement(data, tau, r, progress.part(0.0, 0.4))
    low, high = (
        fit_movement(data, end, r, progress.part(start, start + 0.3)) if 0.0 < end < math.inf else refit
        for end, start in zip(map(float, one.momentum_interval), (0.4, 0.7), strict=True)
    )
    border = tuple((end.q / r, end.tau) for end in (low, high))
    return conclude_momentum(replace(refit, region=(*refit.region, *border)), "")


def shows_steps(changes: Any, m: Any) -> Any:
    """Whether many readings repeat, and enough do not; elementwise."""
    return (changes >= _MIN_CHANGES) & (changes <= _MAX_CHANGING * m)


def _largest_noise(one: Estimate, data: Differences) -> float:
    """The largest r that the record allows, unit²; without momentum that of the smallest λ."""
    if float(one.momentum) == 0.0:
        chi2, _ = data.sums(np.array([float(one.ratio_interval[0])]))
        return float(chi2[0]) / data.m * data.scale * data.scale
    return float(one.r) + 2.0 * float(one.r_se) if math.isfinite(float(one.r_se)) else 0.0
