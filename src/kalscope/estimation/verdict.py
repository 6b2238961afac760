"""From a pair of numbers to an Estimate: units, intervals, the verdict and its words."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from kalscope.common.numbers import Array
from kalscope.common.progress import Progress
from kalscope.common.text import correlation, decibels, number, percent, plural, trimmed
from kalscope.common.text import count as whole
from kalscope.estimation.kernels import MIN_SAMPLES
from kalscope.estimation.likelihood import Differences, Peak, differences, loglik_of
from kalscope.estimation.result import USABLE, Estimate, Pair
from kalscope.filtering.params import MAX_VARIANCE, FilterParams, one_record
from kalscope.filtering.steady import SteadyState, steady_state

# The verdicts in words: what was found in a record, what it means, and what to do instead.


INSTEAD = (
    "Instead: take r from a still stretch or the data sheet, or choose the lag or the cut-off that you can accept."
)

BAD_UNIT = "The variances of these readings are outside 1e-300 to 1e300. Choose a unit in which they are near 1."
"""The variances leave 1e-300 … 1e300."""

OTHER_UNIT = "The given r is far too large or too small for these readings: give a variance, in their unit squared."
"""A given r is far too large or too small for the readings."""

FLAT = (
    "Noise and movement cannot be separated: every ratio q/r explains the record almost as well as this one. "
    "Treat the pair as a guess. Record longer, or take r from a still stretch or the data sheet."
)
"""Every λ from 0 to ∞ explains the record almost equally well."""


def no_movement(lag_low: float) -> str:
    """For q → 0: a constant plus noise explains the record best."""
    allowed = f"a lag of {number(lag_low)} samples or more" if lag_low > 0.0 else "any lag"
    return (
        "No movement can be identified: a constant plus noise of variance r explains this record best. With "
        "q = 0 the filter would stop following after a while. "
        f"The record allows {allowed}. Instead: record longer or while the signal moves, or keep this r and "
        "choose the lag or the cut-off that you can accept."
    )


def chosen_ratio(low: float, high: float, ratio: float) -> str:
    """λ was given; the record allows `low` to `high`."""
    fits = "which the record allows" if low <= ratio <= high else "which the record contradicts"
    return (
        f"q/r = {number(ratio)} was chosen, {fits} ({number(low)} to {number(high)}); r is the variance that fits "
        "the record best with it."
    )


def below_step(step: float, unit: str = "") -> str:
    """The noise is smaller than the step of the readings; `unit` is theirs, where it is known."""
    apart = " × " if unit[:1].isdigit() else " "  # not 1 1/64 g
    return f"The sensor rounds to {trimmed(step, 4)}{apart if unit else ''}{unit}; the noise is smaller than that."


def below_resolution(step: float, params: FilterParams) -> str:
    """The fit found less noise than rounding adds; `params` have that of rounding."""
    return (
        f"{below_step(step)} r = {number(float(params.r))} is the variance of rounding, Δ²/12: the readings carry "
        f"that much at least. {settles('With it the most likely filter', steady_state(params))} A finer range of "
        "the sensor, or one digit more, shows more."
    )


def settles(which: str, steady: SteadyState) -> str:
    """How a filter follows, and what it does to noise."""
    beyond = f", goes {percent(steady.overshoot)} beyond a step and" if steady.overshoot > 0.0 else " and"
    return (
        f"{which} settles at gain {number(steady.gain)}: it lags a ramp by {number(steady.lag_samples)} samples"
        f"{beyond} reduces white noise by {decibels(steady.noise_reduction_db)}."
    )


def rounding_share(step: float, share: float) -> str:
    """Rounding to steps of `step` is this share of r."""
    return f"Rounding to steps of {trimmed(step, 4)} is {percent(min(share, 1.0))} of r."


def rounding_floor(step: float) -> str:
    """No noise is found, but readings in steps carry some."""
    return f"Rounding to steps of {trimmed(step, 4)} alone adds a variance of {number(step * step / 12.0)}."


# What the spike-proof fit says.


def set_aside(count: int, present: int, plain: Estimate, gate: float | None) -> str:
    """How many samples were set aside, what the answer would be with them, and what the gate does.

    Args:
        count: samples set aside.
        present: samples that are not missing.
        plain: the estimate from all of them.
        gate: the gate of the filter, in standard deviations; None for none.
    """
    if not count:
        return "No sample was set aside: each is predicted by the samples before it or by those after it."
    them, were, what = ("it", "It was", "is a spike") if count == 1 else ("them", "They were", "are spikes")
    text = (
        f"{whole(count)} of {whole(present)} samples {what} ({percent(count / present)}): neither the samples "
        f"before nor those after predict {them}. {were} set aside; with {them} {_pair_of(plain)}."
    )
    if gate is not None:
        text += f" The filter gets a gate of {trimmed(gate)} σ, which ignores such samples."
    return f"{text} If they belong to the signal, switch the spike-proof fit off."


def _pair_of(plain: Estimate) -> str:
    """What the fit to all samples finds."""
    if plain.verdict == "no_noise":
        return "no noise could be identified"
    if plain.verdict == "no_movement":
        return f"r would be {number(float(plain.r))}, and no movement could be identified"
    if plain.verdict not in USABLE:
        return "no pair could be found"
    momentum = f" and the momentum {plural(plain.momentum, 'sample')}" if plain.momentum else ""
    return f"q would be {number(float(plain.q))}, r {number(float(plain.r))}{momentum}"


def only_spikes(params: FilterParams) -> str:
    """The record shows no noise apart from its spikes; `params` have the largest r that it allows."""
    return (
        "Apart from the spikes, no noise can be identified: every other change looks like movement. "
        f"r = {number(float(params.r))} is the largest that the record allows (95 %), so the gate removes the "
        f"spikes and nearly everything else passes: it settles at gain {number(steady_state(params).gain)}."
    )


def kept(count: int) -> str:
    """Without the spikes no noise is left, and a gate would do more harm than good."""
    what, them, they = ("sample looks like a spike", "it", "it stays")
    if count > 1:
        what, them, they = ("samples look like spikes", "them", "they stay")
    return (
        f"{whole(count)} {what}, but without {them} no noise could be identified, and a gate would reject movement "
        f"too: {they} in the fit."
    )


def too_many(count: int, present: int) -> str:
    """More than a fifth of the samples would have to be set aside."""
    return (
        f"{whole(count)} of {whole(present)} samples ({percent(count / present)}) are predicted neither by the "
        "samples before nor by those after them: too many for spikes, so no pair is given. Check the wiring, the "
        "supply and the decoding of the sensor, or take a stretch without them. If they belong to the signal, "
        "switch the spike-proof fit off, or choose the lag or the cut-off that you can accept."
    )


# From a pair of numbers to an Estimate: units, intervals, verdict and message; the same for every method.


NOWHERE = Peak(-math.inf, 0.0, 0.0, (-math.inf, math.inf))
"""The peak of a record without information."""

MIN_VARIANCE = 1e-300
"""Smallest variance accepted, unit²; smaller ones lose digits."""


def fit_record(
    z: ArrayLike, dt: ArrayLike | None, progress: Progress, fit: Callable[[Array, Array, Progress], Estimate]
) -> Estimate:
    """Check z and dt, and `fit` them."""
    fitted = fit(*one_record(z, dt), progress)
    progress(1.0, "done")
    return fitted


def channel_fit(
    method: str, fit: Callable[[Differences, Progress], Estimate]
) -> Callable[[Array, Array, Progress], Estimate]:
    """The fit of one channel, for `fit_record`: `fit` it if there is enough to fit."""

    def whole(column: Array, steps: Array, progress: Progress) -> Estimate:
        data = differences(column, steps)
        if len(data.gap):  # repeated lines of the same time and value add nothing, yet would prove r = 0
            new = (data.gap > 0.0) | (data.d != 0.0)
            data = data if new.all() else Differences(data.d[new], data.gap[new], data.scale)
        n = min(data.m + 1, int(np.isfinite(column).sum()))
        if n < MIN_SAMPLES:
            text = f"at least {MIN_SAMPLES} are needed to separate noise from movement. Record longer."
            return _estimate(method, "too_few", f"Too few readings ({n}): {text}")
        if not data.d.any():
            text = (
                "they show neither noise nor movement. The sensor's resolution may be coarser than its noise, or "
                "it is stuck. Record while it moves, or take the noise from the data sheet."
            )
            return _estimate(method, "constant", f"All {n} readings are equal: {text}")
        return fit(data, progress)

    return whole


def conclude(method: str, data: Differences, pair: Pair, peak: Peak) -> Estimate:
    """The Estimate of one channel from a method's pair and the peak of the likelihood."""
    with np.errstate(over="ignore", under="ignore"):
        numbers = np.array([pair.q, pair.r, pair.q_se, pair.r_se]) * data.scale * data.scale
    sizes = [size for size, scaled in zip(numbers.tolist(), (pair.q, pair.r), strict=False) if scaled > 0.0]
    if not all(MIN_VARIANCE < size <= MAX_VARIANCE for size in sizes):
        return _estimate(method, "bad_unit", BAD_UNIT)
    verdict, message = _judge(pair, peak)
    message = f"{pair.text or message} {pair.note}".rstrip()
    return _estimate(method, verdict, message, peak, _loglik(data, pair), *numbers.tolist())


def gain_of(ratio: Any) -> Any:
    """Steady gain of each λ = 0 … inf: 2/(1 + √(1 + 4/λ)), Durbin & Koopman (2012), section 2.11."""
    with np.errstate(divide="ignore"):
        return 2.0 / (1.0 + np.hypot(1.0, 2.0 / np.sqrt(ratio)))


def lag_of(ratio: Any) -> Any:
    """Lag on a ramp in samples of each λ = 0 … inf, (1 − K)/K without cancellation."""
    with np.errstate(divide="ignore"):
        half = 2.0 / np.sqrt(ratio)
    return 0.5 * half * np.tanh(0.5 * np.arcsinh(half))


def _judge(pair: Pair, peak: Peak) -> tuple[str, str]:
    """The verdict, that of the method or by the numbers, and the words for it."""
    low, high = (exp(end) for end in peak.interval)
    verdict, message = "flat", FLAT
    if pair.r == 0.0:
        verdict = "no_noise"
        message = (
            "No noise can be identified at this sample rate: every change looks like real movement, and the most "
            "likely filter (r = 0) would pass the signal unchanged. Usual reasons: the sensor smooths or rounds "
            "its output, or the signal changes more from sample to sample than the noise does. "
            f"The record allows gains from {number(gain_of(low), 2)} to {number(gain_of(high), 2)}. {INSTEAD}"
        )
    elif pair.q == 0.0:
        verdict, message = "no_movement", no_movement(lag_of(high))
    elif peak.interval != (-math.inf, math.inf):
        steady = steady_state(FilterParams(q=pair.q / pair.r, r=1.0))
        verdict = "ok"
        message = (
            f"Noise and movement can be separated. {settles('The filter', steady)} "
            f"The record allows lags from {number(lag_of(high))} to {number(lag_of(low))} samples."
        )
        if math.isinf(high):
            message += " The record does not exclude r = 0: check r against a still stretch or the data sheet."
        elif low == 0.0:
            message += " The record does not exclude q = 0: record longer to be sure of q."
    return pair.verdict or verdict, message


def note_on_differences(data: Differences) -> str:
    """How the differences of neighbouring samples contradict the model; "" where they do not."""
    m = data.m
    g0, g1, g2 = _products(data)
    if m < 20 or g0 == 0.0:
        return ""
    r1, r2 = g1 / g0, g2 / g0
    if r1 > 3.0 / math.sqrt(m):
        return (
            f"Successive changes have the same sign (correlation {correlation(r1)}; a random walk plus noise has 0 "
            "or less): the signal moves smoothly, or the sensor already smooths it."
        )
    if r1 < -0.5 - 3.0 / math.sqrt(m):
        return f"Successive changes alternate (correlation {correlation(r1)}, below −0.5): an oscillation or hum."
    if abs(r2) > 4.0 * math.sqrt((1.0 + 2.0 * r1**2) / m) + 0.02:
        return (
            f"Changes two samples apart are correlated ({correlation(r2)}): a trend, an oscillation or slow noise."
        )
    return ""


def _products(data: Differences) -> list[float]:
    """Mean products of differences 0, 1 and 2 apart, scale²."""
    d, m = data.d, data.m  # BLAS would start threads for it
    return [float(np.einsum("i,i", d[j:], d[: m - j])) / (m - j) if j < m else 0.0 for j in range(3)]


def _loglik(data: Differences, pair: Pair) -> float:
    """Log-likelihood at the pair itself; 0 where there is none."""
    if pair.q == 0.0 and pair.r == 0.0:
        return 0.0
    sums = data.sums(np.array([pair.q / pair.r])) if pair.r > 0.0 else data.records.random_walk[:2]
    return float(loglik_of(data.m, data.scale, *sums, pair.r or pair.q)[0])


def _estimate(
    method: str, verdict: str, message: str, peak: Peak = NOWHERE, loglik: float = 0.0, *pair: float
) -> Estimate:
    """An estimate of `pair`: q, r and their standard errors, or nothing."""
    low, high = (exp(end) for end in peak.interval)
    q, r, q_se, r_se = pair or (0.0, 0.0, math.inf, math.inf)
    return Estimate(
        method=method, q=q, r=r, q_se=q_se, r_se=r_se, loglik=loglik, verdict=verdict, message=message,
        ratio_interval=(low, high),
        gain_interval=(float(gain_of(low)), float(gain_of(high))),
        lag_interval=(float(lag_of(high)), float(lag_of(low))),
        params=FilterParams(q=q, r=r) if verdict in USABLE else None,
    )  # fmt: skip


def exp(log_ratio: float) -> float:
    """λ of ln λ, inf beyond a double."""
    return math.exp(log_ratio) if log_ratio < 700.0 else math.inf
