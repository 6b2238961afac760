"""From what the user knows or wants to q, r and momentum, for `kalscope tune` and the dashboard alike.

A target (lag, cut-off, noise reduction, gain) fixes λ = q/r; knowledge of the noise (a still stretch, a data sheet,
a number) fixes r; what is left is estimated from the record.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from kalscope.common.numbers import Array, above_zero
from kalscope.common.progress import Progress
from kalscope.common.text import (
    count,
    frequency,
    gate_text,
    goal_delay,
    lag_in_full,
    lag_text,
    number,
    percent,
    plural,
    trimmed,
)
from kalscope.errors import BadSetting
from kalscope.estimation.fit import (
    checked_momentum,
    estimate,
    estimate_fixed_r,
    estimate_fixed_ratio,
    params_for_specification,
)
from kalscope.estimation.hum import behind_notch, notch_for
from kalscope.estimation.noise import is_even_ramp, noise_from_datasheet, noise_from_still, noise_scale
from kalscope.estimation.result import Estimate
from kalscope.estimation.settings import (
    Cost,
    code_in,
    cost_curve,
    expected_error,
    movement_lost,
    movement_of,
    noise_left,
    params_at,
    with_gate_and_start,
    with_matching_r,
)
from kalscope.estimation.still import MIN_SAMPLES, find_still_stretch
from kalscope.filtering.classic import Chain
from kalscope.filtering.params import MAX_VARIANCE, FilterParams, one_record
from kalscope.filtering.steady import ratio_for, steady_state

BEST_FIT = "maximum likelihood"
"""How the best fit was found, in the words of the tuning file."""

TARGETS = ("lag_s", "lag_samples", "cutoff_hz", "noise_reduction_db", "gain")
"""What can fix λ, as `ratio_for` names it."""

MIN_LAG = 0.01
"""Samples: a filter with less lag behind a ramp takes nearly all of each sample, K above 0.99."""

MIN_SLOWEST = 1000
"""Samples of lag that a goal may have in any record: a live one has only begun."""

HARDLY = 0.8
"""Share of the noise from which a filter hardly filters: its curve looks like the raw one."""

SLOW = 0.01
"""q/r where the record shows no movement, so that any slow filter fits: a lag of 9.5 samples; with q = 0 the filter
would stop following. The advice of Ma'arif et al. (2019), section 4."""


@dataclass(frozen=True)
class Noise:
    """What is known about the measurement noise: nothing, or one of r, sigma, density and still."""

    r: float | None = None
    """The variance itself, unit²."""
    sigma: float | None = None
    """One standard deviation from a data sheet, unit."""
    density: float | None = None
    """Noise density from a data sheet, unit/√Hz; needs the bandwidth."""
    bandwidth_hz: float | None = None
    """Bandwidth that goes with the density, Hz."""
    still: tuple[int, int] | Literal["auto"] | None = None
    """First sample of a still stretch and one past its last; "auto" = the one that the record shows."""

    def resolve(self, z: Array, dt: Array | None = None) -> tuple[float, str] | None:
        """The variance in unit² and a sentence on its origin; None where nothing is known."""
        given = [name for name in ("r", "sigma", "density", "still") if getattr(self, name) is not None]
        if len(given) > 1:
            raise BadSetting(f"the noise must come from one source (got {', '.join(given)})")
        if self.bandwidth_hz is not None and self.density is None:
            raise BadSetting(f"bandwidth_hz needs density (got {' and '.join(['bandwidth_hz', *given])})")
        if self.still is not None:
            stretch = find_still_stretch(z, dt) if self.still == "auto" else self.still
            if stretch is None:
                raise BadSetting(
                    f"the record must show a still stretch, {MIN_SAMPLES} samples or more of noise alone "
                    "(got none): give its limits, or r from the data sheet"
                )
            noise = noise_from_still(z[slice(*stretch)])
            where = f", samples {count(stretch[0])} to {count(stretch[1] - 1)}" if self.still == "auto" else ""
            return noise.r, f"r is the variance of the still stretch{where}. {noise.message}"
        if self.r is not None:
            return above_zero("r", self.r, MAX_VARIANCE), "r as given."
        if self.sigma is not None or self.density is not None:
            r = noise_from_datasheet(sigma=self.sigma, density=self.density, bandwidth_hz=self.bandwidth_hz)
            return r, f"r = {number(r, 4)} from the data sheet."
        return None

    @property
    def origin(self) -> str:
        """The origin of r, as in "r from a still stretch"; for the tuning file."""
        if self.still is not None:
            return "from a still stretch"
        return "as given" if self.r is not None else "from the data sheet"


@dataclass(frozen=True)
class Request:
    """What the user wants and knows; what is left is estimated."""

    target: dict[str, float] = field(default_factory=dict[str, float])
    """At most one of TARGETS with its value, which fixes λ."""
    ratio: float | None = None
    """λ itself, such as 0.01; r is then estimated unless it is known."""
    noise: Noise = Noise()
    """What is known about r."""
    momentum: float | Literal["auto"] = "auto"
    """τ in sample periods, or "auto", as `estimate` takes it; with a target "auto" is that of the best fit where it
    leaves less error than none, and with a ratio or known noise it can only be 0."""
    overshoot: float | None = None
    """Share of a step that the target may cost; the momentum follows from both."""
    robust: bool | Literal["auto"] = "auto"
    """Whether spikes are set aside, as `estimate` takes it."""
    two_speeds: bool = False
    """Whether two speeds are used where the record shows them, as `estimate` takes it; only without a goal."""
    notch: float | Literal["auto"] | None = None
    """What a notch before the filter takes out, Hz; "auto" = the strongest narrow line; None = there is none."""
    setting: str = ""
    """Of an answer: "light", "medium" or "strong" where the record shows hardly any noise, "slow" where it shows no
    movement; "" where q and r were estimated or asked for."""

    @property
    def goal(self) -> str:
        """What was chosen and fixes λ, such as "a lag of 50 ms"; "" = nothing: λ is estimated."""
        if self.setting:
            return f"the {self.setting} setting"
        if self.target:
            return _target_text(*next(iter(self.target.items())), self.overshoot)
        return "" if self.ratio is None else f"q/r = {trimmed(self.ratio, 4)}"

    def checked_momentum(self) -> float | None:
        """τ, None = to be found.

        Raises:
            BadSetting: targets that contradict each other, are unknown or out of range; momentum above 0 with a
                ratio or known noise; an overshoot without a target or beside momentum.
        """
        targets = [*self.target, *([] if self.ratio is None else ["q/r"])]
        if len(targets) > 1:
            raise BadSetting(f"only one target for λ may be given (got {' and '.join(targets)})")
        if targets and targets[0] not in (*TARGETS, "q/r"):
            raise BadSetting(f"target must be one of {', '.join(TARGETS)} (got {targets[0]!r})")
        if self.ratio is not None:
            above_zero("q/r", self.ratio, MAX_VARIANCE)
        tau = checked_momentum(self.momentum)
        if self.overshoot is not None and (self.momentum != "auto" or not self.target):
            got = "none" if not self.target else f"momentum = {self.momentum}"
            raise BadSetting(
                f"overshoot needs a target such as a lag, and no momentum, which follows from both (got {got})"
            )
        if self.two_speeds and (targets or tau or self.noise != Noise()):
            raise BadSetting("two speeds are found with q and r: leave out a goal, the noise and momentum")
        if tau and not self.target and (self.ratio is not None or self.noise != Noise()):
            raise BadSetting(
                'momentum must be "auto" or 0 with a ratio or known noise: it is estimated with q and r '
                f"(got {tau:g})"
            )
        return tau


@dataclass(frozen=True)
class FitResult:
    """The result of `find_parameters`."""

    params: FilterParams | None
    """What to use; None only of several sensors: `message` then says what to do instead."""
    how: str
    """How it was found, in a few words, for the tuning file."""
    message: str
    """What was found and what it means, in sentences."""
    estimate: Estimate | None = None
    """The estimate behind it, if any."""
    request: Request | None = None
    """The goal that it was chosen for; None where that is not known."""
    reason: str = "chosen"
    """Why this filter: "chosen" by the request, "best_fit", a setting of `Request`, or the verdict of an estimate
    without a filter, such as "constant" or "too_few": then the filter is harmless."""
    lost: float = 0.0
    """The share of the movement that the filter loses, as `movement_lost` measures it; 0 where there is a goal."""
    costs: tuple[Cost, ...] = ()
    """What each lag leaves of the noise and loses of the movement; () where there is a goal, or no movement."""
    chain: Chain | None = None
    """The notch before the filter; None = there is none."""


def find_parameters(
    z: Array,
    request: Request | None = None,
    *,
    dt: Array | None = None,
    sample_period: float | None = None,
    progress: Callable[[float, str], None] | None = None,
    cancelled: Callable[[], bool] | None = None,
) -> FitResult:
    """Find q, r and momentum of one channel: the one function that decides which filter a record gets.

    Without a goal that is the best fit. Where this hardly filters it is the medium of three settings, and where the
    record shows no movement or is too short, a harmless filter: `reason` says which, `message` why.

    Args:
        z: measurements, shape (n,); NaN is a missing sample.
        request: what the user wants and knows; None = nothing.
        dt: nominal sample periods before each sample, shape (n,); None = 1 each.
        sample_period: nominal sample period in s, for a target in s or Hz.
        progress: called with the fraction done and a few words.
        cancelled: whether to stop.

    Raises:
        BadSetting: the request contradicts itself, or is out of range or reach.
        Cancelled: `cancelled()` was true.
    """
    request = replace(request or Request(), setting="")  # of an earlier answer
    if request.notch is not None:
        return _behind_notch(z, request, request.notch, dt, sample_period, progress, cancelled)
    tau, known = request.checked_momentum(), request.noise.resolve(z, dt)
    if not request.goal:
        if known is None:
            begun = _fitted(z, dt, request, progress, cancelled)
        else:
            one = estimate_fixed_r(z, known[0], dt, request.robust)
            how = f"r {request.noise.origin}, q by maximum likelihood"
            begun = FitResult(one.params, how, known[1], one, request)
        return _answer(z, dt, sample_period, begun)
    origin = f", r {request.noise.origin}" if known else ""
    if request.ratio is not None:
        result = _at_ratio(z, dt, request, request.ratio, known)
    else:
        at_target = partial(
            params_for_specification,
            **request.target,
            sample_period=sample_period,
            overshoot=request.overshoot,
        )
        params, text = at_target(known[0] if known else 1.0, momentum=tau or 0.0), known[1] if known else ""
        if not known:
            one = estimate(z, dt, Progress(progress, cancelled), robust=request.robust)
            if tau is None and request.overshoot is None:
                params = _with_less_error(params, at_target, z, dt, one)
            params, text = _with_noise(params, z, dt, one)
        keeps = f" with a momentum of {plural(params.momentum, 'sample')}" if params.momentum else ""
        text = f"q/r = {number(params.ratio, 4)}{keeps} has {request.goal}. {text}"
        result = FitResult(params, f"{request.goal}{origin}", text, request=request)
    if result.params is not None:
        _check_lag(result.params, len(z), sample_period)
    return result


def _behind_notch(
    z: Array,
    request: Request,
    hertz: float | Literal["auto"],
    dt: Array | None,
    sample_period: float | None,
    progress: Callable[[float, str], None] | None,
    cancelled: Callable[[], bool] | None,
) -> FitResult:
    """The answer for what a notch passes."""
    if request.two_speeds:
        raise BadSetting("two speeds run without a notch: leave out one of them")
    notch, text = notch_for(z, dt, hertz, sample_period)
    request = replace(request, notch=None)
    rest = request if notch is None else _less_lag(request, notch.lag, sample_period)
    behind = z if notch is None else behind_notch(z, notch)
    found = find_parameters(
        behind, rest, dt=dt, sample_period=sample_period, progress=progress, cancelled=cancelled
    )
    if notch is not None and rest.target != request.target:
        text = f"{text} Its lag of {lag_text(notch.lag, sample_period)} is part of the goal."
        found = replace(found, how=found.how.replace(rest.goal, request.goal), request=request)
    chain = None if notch is None else Chain(notch=notch)
    return replace(found, message=f"{text} {found.message}", chain=chain)


def _less_lag(request: Request, lag: float, sample_period: float | None) -> Request:
    """The request of what comes after a filter of this lag in samples.

    Raises:
        BadSetting: the target is a lag that leaves nothing for it.
    """
    ((name, value),) = request.target.items() or [("", 0.0)]
    if name not in ("lag_s", "lag_samples"):
        return request
    unit = sample_period or 1.0 if name == "lag_s" else 1.0
    if value < (lag + MIN_LAG) * unit:
        least, got = lag_text(lag + MIN_LAG, sample_period), request.goal
        raise BadSetting(f"the lag must be {least} or more, as the notch has nearly that much (got {got})")
    return replace(request, target={name: value - lag * unit})


def _at_ratio(
    z: Array, dt: Array | None, request: Request, ratio: float, known: tuple[float, str] | None
) -> FitResult:
    """The filter of a chosen λ, with the known r or the most likely one."""
    if known:
        text = f"q = {ratio:g} · r. {known[1]}"
        how = f"q/r = {ratio:g}, r {request.noise.origin}"
        return FitResult(FilterParams(q=ratio * known[0], r=known[0]), how, text, request=request)
    one = estimate_fixed_ratio(z, ratio, dt, request.robust)
    params = one.params or FilterParams(q=ratio * (r := noise_scale(z)), r=r)
    return FitResult(params, f"q/r = {ratio:g}, r by maximum likelihood", one.message, one, request)


def starting_params(z: ArrayLike, dt: ArrayLike | None = None) -> FilterParams:
    """The filter to begin with, of `find_parameters`: usable for every record z, shape (n,), NaN where missing.

    Args:
        z: measurements, shape (n,).
        dt: nominal sample periods before each sample, shape (n,); None = 1 each.

    Raises:
        BadSetting: z holds inf or has another shape; dt does not fit z.
    """
    samples, steps = one_record(z, dt)
    params = find_parameters(samples, dt=None if dt is None else steps).params
    assert params is not None
    return params


def proposed_lag(costs: Iterable[Cost], present: FilterParams) -> float:
    """The lag in samples to propose as a goal: of the medium setting, and never slower than the present filter."""
    lags = [one.lag_samples for one in costs if one.name == "medium"]
    return min([*lags, steady_state(present).lag_samples])


def _fitted(
    z: Array,
    dt: Array | None,
    request: Request,
    progress: Callable[[float, str], None] | None,
    cancelled: Callable[[], bool] | None,
) -> FitResult:
    """The estimate; a code for a missing reading is left out of it."""
    code = code_in(z) if request.robust == "auto" else None
    coded, note = z == code, ""
    kept = z if code is None else np.where(coded, np.nan, z)
    one = estimate(kept, dt, progress, cancelled, request.momentum, request.robust, request.two_speeds)
    if code is not None:
        one = replace(one, outliers=coded if one.outliers is None else one.outliers | coded)
        note = f"{code:.6g} came {count(int(coded.sum()))} times, far from the rest, and is left out of the fit."
    return FitResult(one.params, BEST_FIT, note, one, request)


def _answer(z: Array, dt: Array | None, period: float | None, begun: FitResult) -> FitResult:
    """The filter of an estimate, and why: the best fit, a setting, or a harmless filter."""
    one, request = begun.estimate, begun.request
    assert one is not None
    assert request is not None
    movement = movement_of(z, dt, one)
    costs = cost_curve(movement, dt)
    pair, medium = one.params, next((each for each in costs if each.name == "medium"), None)
    if pair is None and one.verdict == "too_many_outliers" and one.q > 0.0 and one.r > 0.0:
        pair = FilterParams(q=one.q, r=one.r, momentum=float(one.momentum))
    given = request.noise != Noise()
    decided = given or request.momentum != "auto" or request.two_speeds
    r = float(one.r) if one.r > 0.0 else noise_scale(z)
    if pair is not None and (decided or pair.gate is not None or noise_left(pair) < HARDLY):
        reason, params, text = "best_fit", pair, one.message
    elif medium is not None and not given:
        kept = z if one.outliers is None else np.where(one.outliers, np.nan, z)
        reason, params, text = "medium", params_at(medium.lag_samples, kept, dt), _setting_text(costs, period)
    elif one.verdict == "no_movement":
        reason, params, text = "slow", FilterParams(q=SLOW * r, r=r), _SLOW_TEXT.format(number(r, 4))
    else:
        reason, params = one.verdict, FilterParams(q=r, r=r)
        text = f"{one.message} Until then q = r: the filter follows within a sample."
    name = reason if reason in ("medium", "slow") else ""
    how = f"the {name} setting, q/r = {number(params.ratio, 4)}" if name else begun.how
    before = params.gate
    if params.fast is None:  # else a spike is a hypothesis of its own
        params = with_gate_and_start(z, dt, params, one, movement)
    if params.gate != before:
        used = f"A gate of {gate_text(params.gate)} leaves less error here, and is used."
        text = f"{text} {used if params.gate else 'No gate is used: it would delay or keep out movement.'}"
    return replace(
        begun,
        params=params,
        how=how if name or reason == "best_fit" else f"no fit ({one.verdict.replace('_', ' ')}), q = r",
        message=f"{begun.message} {text}".strip(),
        request=replace(request, setting=name),
        reason=reason,
        lost=movement_lost(movement, replace(params, p0=None, x0=None), dt),
        costs=costs,
    )


_SLOW_TEXT = (
    "This record shows no movement: noise of variance {} around a constant explains it, so any slow filter fits. "
    "q = r/100 is used, a lag of 9.5 samples. Record while the signal moves, or choose the lag that you can accept."
)


def _setting_text(costs: tuple[Cost, ...], period: float | None) -> str:
    """Why the medium setting is used, and what each of the three does."""
    named = [one for one in costs if one.name]
    each = ", ".join(f"{one.name} {cost_text(one, period)}" for one in named)
    slow = next(one for one in named if one.name == "medium")
    hertz = steady_state(FilterParams(q=ratio_for(lag_samples=slow.lag_samples), r=1.0), period or 1.0).cutoff_hz
    faster = f" It keeps movement slower than {frequency(hertz)}." if period and hertz and hertz > 0.0 else ""
    return (
        "At this sample rate the readings show hardly any noise that a filter could remove without losing "
        f"movement. The medium setting is used.{faster} Choose by what it costs: {each}."
    )


def cost_text(one: Cost, period: float | None) -> str:
    """What a lag costs: "12 ms leaves 48 % of the noise and loses 10 % of the movement"."""
    return (
        f"{lag_text(one.lag_samples, period)} leaves {percent(one.noise_left)} of the noise and loses "
        f"{percent(one.movement_lost)} of the movement"
    )


def _check_lag(params: FilterParams, samples: int, sample_period: float | None = None) -> None:
    """BadSetting where the filter is slower than the record, or too fast to change a sample."""
    if params.q == 0.0:
        raise BadSetting("the target must leave q above 0: ask for less smoothing (got q = 0)")
    lag, slowest = steady_state(params).lag_samples, max(samples, MIN_SLOWEST)
    if not MIN_LAG <= lag <= slowest:
        raise BadSetting(
            "the goal must be a filter that is not slower than the record and changes it, with a lag from "
            f"{lag_in_full(MIN_LAG, sample_period)} to {lag_in_full(slowest, sample_period)} (got a lag of "
            f"{lag_text(lag, sample_period)})"
        )


def _with_less_error(
    params: FilterParams, at_target: Callable[..., FilterParams], z: Array, dt: Array | None, one: Estimate
) -> FilterParams:
    """The filter of r = 1, or the one with the momentum of the best fit that meets the same target.

    Momentum helps while the lag is near that of the best fit. With more lag the filter goes too far at every turn.
    """
    if one.momentum > 0.0 and one.r > 0.0:
        movement, r = movement_of(z, dt, one), float(one.r)
        with suppress(BadSetting):  # not every target can be met with it
            _check_lag(moving := at_target(1.0, momentum=float(one.momentum)), len(z))
            return min(params, moving, key=lambda each: expected_error(movement, each, r, dt))
    return params


def _with_noise(params: FilterParams, z: Array, dt: Array | None, one: Estimate) -> tuple[FilterParams, str]:
    """The filter of r = 1 with an r of this record, and where that is from: its best fit, or its errors."""
    band = "it sets the width of the band, not the curve."
    if one.r > 0.0:  # valid at the edge q = 0 too
        spikes = sum(map(len, one.spikes))
        gate = (
            f" {plural(spikes, 'spike')} set aside for it. A goal sets no outlier gate, because with a chosen "
            "filter it could refuse movement."
        )
        scaled = replace(params, q=params.q * one.r, r=float(one.r))
        return scaled, f"r by maximum likelihood; {band}{gate if spikes else ''}"
    if shows_no_noise(z):
        r = noise_scale(z)
        text = f"r = {number(r, 4)} is only a placeholder, because the record shows no noise; {band}"
        return replace(params, q=params.q * r, r=r), text
    return with_matching_r(
        params, z, dt
    ), f"r is that of the errors of this filter, because the fit finds none; {band}"


def shows_no_noise(z: Array) -> bool:
    """Whether the samples z, shape (n,), show no noise: fewer than three, all equal, or an even ramp."""
    finite = z[np.isfinite(z)]
    return len(finite) < 3 or is_even_ramp(finite)


def _target_text(name: str, value: float, overshoot: float | None) -> str:
    words = {
        "lag_s": f"a lag of {goal_delay(value)}",
        "lag_samples": f"a lag of {value:.4g} samples",
        "cutoff_hz": f"a −3 dB cut-off at {value:.4g} Hz",
        "noise_reduction_db": f"{value:.4g} dB less noise",
        "gain": f"the gain {value:.4g}",
    }[name]
    return f"{words} and {100.0 * overshoot:.4g} % overshoot" if overshoot else words
