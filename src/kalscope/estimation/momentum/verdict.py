"""An Estimate with momentum: intervals, a verdict and words."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

from kalscope.common.progress import Progress
from kalscope.common.text import decibels, number, percent
from kalscope.estimation.likelihood.profile import Differences
from kalscope.estimation.likelihood.search import DROP
from kalscope.estimation.momentum.choice import Choice, choose
from kalscope.estimation.momentum.fit import MomentumFit
from kalscope.estimation.momentum.free import fit_around
from kalscope.estimation.momentum.given import fit_at
from kalscope.estimation.momentum.search import search
from kalscope.estimation.result import USABLE, Estimate
from kalscope.estimation.verdict import words as verdict_words
from kalscope.estimation.verdict.conclude import MIN_VARIANCE
from kalscope.filtering.params import MAX_VARIANCE, FilterParams
from kalscope.filtering.steady_state import SteadyState, steady_state


def with_momentum(data: Differences, plain: Estimate, progress: Progress) -> Estimate:
    """The estimate of one channel with momentum, or `plain` where the record does not need it.

    Args:
        data: the record.
        plain: its estimate without momentum.
        progress: receives progress reports.
    """
    if plain.verdict == "bad_unit":
        return plain
    top = search(data, progress.part(0.0, 0.4))
    choice = choose(data, plain, top, progress.part(0.4, 0.8))
    if not choice.chosen:
        kept = replace(plain, message=f"{plain.message} {_kept(choice)}", prediction_gain=_prediction_gain(choice))
        if plain.verdict != "ok" or choice.gain <= 2.0 * DROP:
            return kept
        return _either(kept, conclude(fit_around(data, top, progress.part(0.8, 1.0)), ""))
    found = fit_around(data, top, progress.part(0.8, 1.0))
    return replace(conclude(found, _reason(found, choice)), prediction_gain=_prediction_gain(choice))


def with_given_momentum(data: Differences, tau: float, progress: Progress) -> Estimate:
    """The estimate of one channel with a momentum above 0, in sample periods."""
    return conclude(fit_at(data, tau, progress), f"The momentum of {number(tau)} samples was given.")


def _either(plain: Estimate, moving: Estimate) -> Estimate:
    """`plain` with intervals that hold whether or not the signal has momentum.

    Where the likelihood excludes τ = 0 and the choice keeps it, either model may be the true one, and the 95 %
    interval of each holds the truth if it is: their union does in both cases.
    """
    names = ("ratio_interval", "gain_interval", "lag_interval", "momentum_interval")
    ends = {name: [float(end) for one in (plain, moving) for end in getattr(one, name)] for name in names}
    spans: dict[str, Any] = {name: (min(four), max(four)) for name, four in ends.items()}
    short, long = (number(float(end)) for end in moving.lag_interval)
    high = float(moving.momentum_interval[1])
    upto = f"up to {number(high)} samples" if high < math.inf else "of any length"
    also = f"The 95 % intervals also hold for a momentum {upto}, which allows lags from {short} to {long} samples."
    return replace(plain, message=f"{plain.message} {also}", **spans)


def _prediction_gain(choice: Choice) -> float:
    return 0.0 if math.isnan(choice.error) else 1.0 - choice.error


def _kept(choice: Choice) -> str:
    """Why the simpler model stays; whether it describes the record is for `analysis.judge` to say."""
    if choice.needed == math.inf:
        return "The record is too short to tell whether the signal has momentum."
    if choice.gain <= 2.0 * DROP:
        return "No momentum: it would not fit better."
    if math.isnan(choice.error):
        return "No momentum: it raises the likelihood, but not by enough to be sure."
    less = 1.0 - choice.error
    said = f"only {percent(less)} less" if less > 0.0 else f"{percent(-less)} more"
    return f"No momentum: with it the error on unseen samples would be {said}, so it is not used."


def _reason(found: MomentumFit, choice: Choice) -> str:
    """Why momentum is taken, and what it costs."""
    low, high = found.tau_interval
    less = 1.0 - choice.error
    share = percent(less) if less < 0.99 else "over 99 %"
    span = f"{number(low)} to {number(high)}" if high < math.inf else f"{number(low)} or more"
    return (
        f"The signal keeps its direction for about {number(found.tau)} samples ({span}). With this momentum the "
        f"error of predicting unseen samples is {share} smaller than with the five lines."
        f"{_cost(found)}"
    )


def _cost(found: MomentumFit) -> str:
    """What the filter costs, where there is one."""
    if found.q == 0.0 or found.r == 0.0:
        return ""
    overshoot = float(_settled(found.q / found.r, found.tau).overshoot)
    step = f" and an overshoot of {percent(overshoot)} on a step" if overshoot > 0.0 else ""
    return f" It costs a second state on the board{step}."


def conclude(found: MomentumFit, reason: str) -> Estimate:
    """The Estimate of a fit; `reason` is the sentence on where the momentum comes from."""
    if not all(MIN_VARIANCE < size <= MAX_VARIANCE for size in (found.q, found.r) if size > 0.0):
        verdict, message = "bad_unit", verdict_words.BAD_UNIT
    else:
        verdict = "no_noise" if found.r == 0.0 else "no_movement" if found.q == 0.0 else "ok"
        message = f"{_words(verdict, found)} {reason}"
    ratios = [ratio for ratio, _ in found.region]
    settled = [_settled(ratio, tau) for ratio, tau in found.region]
    gains, lags = [float(one.gain) for one in settled], [float(one.lag_samples) for one in settled]
    usable = verdict in USABLE
    return Estimate(
        method="ml",
        q=found.q,
        r=found.r,
        ratio=found.q / found.r if found.r > 0.0 else math.inf,
        loglik=found.loglik,
        ratio_interval=(min(ratios), max(ratios)),
        gain_interval=(min(gains), max(gains)),
        lag_interval=(min(lags), max(lags)),
        q_se=found.q_se,
        r_se=found.r_se,
        verdict=verdict,
        message=message,
        params=FilterParams(q=found.q, r=found.r, momentum=found.tau) if usable else None,
        momentum=found.tau,
        momentum_interval=found.tau_interval,
    )


def _words(verdict: str, found: MomentumFit) -> str:
    if verdict == "no_noise":
        return (
            "No noise can be identified at this sample rate, also with momentum: every change looks like real "
            f"movement, and the most likely filter (r = 0) would pass the signal unchanged. {verdict_words.INSTEAD}"
        )
    if verdict == "no_movement":
        return verdict_words.no_movement(0.0)
    steady = _settled(found.q / found.r, found.tau)
    overshoot = steady.overshoot
    beyond = f", goes {percent(overshoot)} beyond a step and" if overshoot > 0.0 else " and"
    return (
        f"Noise and movement can be separated. The filter settles at gain {number(steady.gain)}: it lags a "
        f"ramp by {number(steady.lag_samples)} samples{beyond} reduces white noise by "
        f"{decibels(steady.noise_reduction_db)}."
    )


def _settled(ratio: float, tau: float) -> SteadyState:
    if ratio == math.inf:
        return steady_state(FilterParams(q=1.0, r=0.0, momentum=tau))
    return steady_state(FilterParams(q=ratio, r=1.0, momentum=tau))
