"""From what the user knows or wants to q, r and momentum, for `kalscope tune` and the dashboard alike.

A target (lag, cut-off, noise reduction, gain) fixes λ = q/r; knowledge of the noise (a still stretch, a data sheet,
a number) fixes r; what is left is estimated from the record.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from kalscope.common.numbers import Array, above_zero
from kalscope.common.progress import Progress
from kalscope.common.text import count, goal_delay, lag_in_full, lag_text, number, plural, trimmed
from kalscope.errors import BadSetting
from kalscope.estimation.fit import (
    checked_momentum,
    estimate,
    estimate_fixed_r,
    estimate_fixed_ratio,
    params_for_specification,
)
from kalscope.estimation.methods import METHODS
from kalscope.estimation.noise import is_even_ramp, noise_from_datasheet, noise_from_still, starting_params
from kalscope.estimation.result import Estimate
from kalscope.estimation.still import MIN_SAMPLES, find_still_stretch
from kalscope.filtering.params import MAX_VARIANCE, FilterParams
from kalscope.filtering.steady import steady_state

TARGETS = ("lag_s", "lag_samples", "cutoff_hz", "noise_reduction_db", "gain")
"""What can fix λ, as `ratio_for` names it."""

MIN_LAG = 0.01
"""Samples: a filter with less lag behind a ramp takes nearly all of each sample, K above 0.99."""

MIN_SLOWEST = 1000
"""Samples of lag that a goal may have in any record: a live one has only begun."""


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

    method: str = "ml"
    """Method of `estimate`, used where neither a target nor the noise is given."""
    target: dict[str, float] = field(default_factory=dict[str, float])
    """At most one of TARGETS with its value, which fixes λ."""
    ratio: float | None = None
    """λ itself, such as 0.01; r is then estimated unless it is known."""
    noise: Noise = Noise()
    """What is known about r."""
    momentum: float | Literal["auto"] = "auto"
    """τ in sample periods, or "auto", as `estimate` takes it; "auto" is 0 with a target, and with a ratio or known
    noise it can only be 0."""
    overshoot: float | None = None
    """Share of a step that the target may cost; the momentum follows from both."""
    robust: bool | Literal["auto"] = "auto"
    """Whether spikes are set aside, as `estimate` takes it."""

    @property
    def goal(self) -> str:
        """What was chosen and fixes λ, such as "a lag of 50 ms"; "" = nothing: λ is estimated."""
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
        if self.method not in METHODS:
            raise BadSetting(f"method must be one of {', '.join(METHODS)} (got {self.method!r})")
        if len(targets) > 1:
            raise BadSetting(f"only one target for λ may be given (got {' and '.join(targets)})")
        if targets and targets[0] not in (*TARGETS, "q/r"):
            raise BadSetting(f"target must be one of {', '.join(TARGETS)} (got {targets[0]!r})")
        if self.ratio is not None:
            above_zero("q/r", self.ratio, MAX_VARIANCE)
        tau = checked_momentum(self.momentum, self.method)
        if self.overshoot is not None and (self.momentum != "auto" or not self.target):
            got = "none" if not self.target else f"momentum = {self.momentum}"
            raise BadSetting(
                f"overshoot needs a target such as a lag, and no momentum, which follows from both (got {got})"
            )
        if tau and not self.target and (self.ratio is not None or self.noise != Noise()):
            raise BadSetting(
                'momentum must be "auto" or 0 with a ratio or known noise: it is estimated with q and r '
                f"(got {tau:g})"
            )
        return tau


@dataclass(frozen=True)
class FitResult:
    """The result of `find_parameters`, with or without parameters."""

    params: FilterParams | None
    """What to use; None where there is none: `message` then says what to do instead."""
    how: str
    """How it was found, in a few words, for the tuning file."""
    message: str
    """What was found and what it means, in sentences."""
    estimate: Estimate | None = None
    """The estimate behind it, if any."""
    request: Request | None = None
    """The goal that it was chosen for; None where that is not known."""


def find_parameters(
    z: Array,
    request: Request | None = None,
    *,
    dt: Array | None = None,
    sample_period: float | None = None,
    progress: Callable[[float, str], None] | None = None,
    cancelled: Callable[[], bool] | None = None,
) -> FitResult:
    """Find q, r and momentum of one channel.

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
    request = request or Request()
    tau, known, ratio = request.checked_momentum(), request.noise.resolve(z, dt), request.ratio
    if not request.goal:
        if known is not None:
            return _fit_q(z, dt, *known, request)
        answer = estimate(z, request.method, dt, progress, cancelled, request.momentum, request.robust)
        return FitResult(answer.params, METHODS[request.method], answer.message, answer, request)
    origin = f", r {request.noise.origin}" if known else ""
    if ratio is None:
        r, text = known or _noise_for_target(z, dt, request, Progress(progress, cancelled))
        params = params_for_specification(
            r, **request.target, sample_period=sample_period, momentum=tau or 0.0, overshoot=request.overshoot
        )
        keeps = f" with a momentum of {plural(params.momentum, 'sample')}" if params.momentum else ""
        text = f"q/r = {number(params.ratio, 4)}{keeps} has {request.goal}. {text}"
        result = FitResult(params, f"{request.goal}{origin}", text, request=request)
    elif known:
        params, text = FilterParams(q=ratio * known[0], r=known[0]), f"q = {ratio:g} · r. {known[1]}"
        result = FitResult(params, f"q/r = {ratio:g}{origin}", text, request=request)
    else:
        answer = estimate_fixed_ratio(z, ratio, dt, request.robust)
        how = f"q/r = {ratio:g}, r by maximum likelihood"
        result = FitResult(answer.params, how, answer.message, answer, request)
    if result.params is not None:
        _check_lag(result.params, len(z), sample_period)
    return result


def _check_lag(params: FilterParams, samples: int, sample_period: float | None) -> None:
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


def _fit_q(z: Array, dt: Array | None, r: float, origin: str, request: Request) -> FitResult:
    """The pair where r is known; with a special message where that r explains all changes."""
    answer = estimate_fixed_r(z, r, dt, request.robust)
    message = answer.message
    if answer.verdict == "no_movement":
        message = (
            f"Noise of variance {number(r, 4)} explains all changes in this record, so q would be 0, and such a "
            "filter stops following after a while. Instead: check that r is not too large, record while the signal "
            "moves, or choose the lag or the cut-off that you can accept."
        )
    how = f"r {request.noise.origin}, q by maximum likelihood"
    return FitResult(answer.params, how, f"{origin} {message}", answer, request)


def _noise_for_target(z: Array, dt: Array | None, request: Request, progress: Progress) -> tuple[float, str]:
    """A value for r and its origin where only λ is given: that of the likelihood, or var(Δz)/2."""
    band = "it sets the width of the band, not the curve."
    answer = estimate(z, "ml", dt, progress, momentum=0.0, robust=request.robust)
    if answer.r > 0.0:  # valid at the edge q = 0 too
        spikes = sum(map(len, answer.spikes))
        gate = (
            f" {plural(spikes, 'spike')} set aside for it. A goal sets no outlier gate, because with a chosen "
            "filter it could refuse movement."
        )
        return answer.r, f"r by maximum likelihood; {band}{gate if spikes else ''}"
    r = float(starting_params(z).r)
    if shows_no_noise(z):
        return r, f"r = {number(r, 4)} is only a placeholder, because the record shows no noise; {band}"
    return r, f"r = var(Δz)/2, because the record allows no better estimate; {band}"


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
