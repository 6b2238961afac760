"""The verdicts in words: what was found in a record, what it means, and what to do instead."""

from __future__ import annotations

import math

from kalscope.common.text import decibels, number, percent, trimmed
from kalscope.filtering.params import FilterParams
from kalscope.filtering.steady_state import steady_state

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

NOT_CONVERGED = "EM had not converged when it reached its limit of passes: use the maximum-likelihood pair instead."
"""EM reached its limit of passes."""

MIN_SAMPLES = 8
"""Finite samples that an estimate needs."""


def too_few(n: int) -> str:
    """Fewer than MIN_SAMPLES finite samples."""
    return (
        f"Too few readings ({n}): at least {MIN_SAMPLES} are needed to separate noise from movement. Record longer."
    )


def constant(n: int) -> str:
    """All finite samples are equal."""
    return (
        f"All {n} readings are equal: they show neither noise nor movement. The sensor's resolution may be "
        "coarser than its noise, or it is stuck. Record while it moves, or take the noise from the data sheet."
    )


def no_noise(gains: tuple[float, float]) -> str:
    """For r → 0: the likelihood is highest for a filter that passes everything."""
    return (
        "No noise can be identified at this sample rate: every change looks like real movement, and the most "
        "likely filter (r = 0) would pass the signal unchanged. Usual reasons: the sensor smooths or rounds its "
        "output, or the signal changes more from sample to sample than the noise does. "
        f"The record allows gains from {number(gains[0], 2)} to {number(gains[1], 2)}. {INSTEAD}"
    )


def no_movement(lag_low: float) -> str:
    """For q → 0: a constant plus noise explains the record best."""
    allowed = f"a lag of {number(lag_low)} samples or more" if lag_low > 0.0 else "any lag"
    return (
        "No movement can be identified: a constant plus noise of variance r explains this record best. With "
        "q = 0 the filter would stop following after a while. "
        f"The record allows {allowed}. Instead: record longer or while the signal moves, or keep this r and "
        "choose the lag or the cut-off that you can accept."
    )


def blind(kind: str, low: float, high: float) -> str:
    """This method found no `kind` ("noise" or "movement"), but the likelihood excludes that there is none."""
    return (
        f"This method finds no {kind} here, but that says more about the method than about the record: by the "
        f"likelihood the record allows only q/r from {number(low)} to {number(high)}. "
        "Use the maximum-likelihood pair."
    )


def ok(gain: float, lag: tuple[float, float], interval: tuple[float, float]) -> str:
    """Both variances are found; `lag` and `interval` are the ends of the 95 % intervals of lag and ratio."""
    reduction = 10.0 * math.log10((2.0 - gain) / gain)
    text = (
        f"Noise and movement can be separated. The filter settles at gain {number(gain)}: it lags a ramp by "
        f"{number((1.0 - gain) / gain)} samples and reduces white noise by {decibels(reduction)}. "
        f"The record allows lags from {number(lag[0])} to {number(lag[1])} samples."
    )
    if math.isinf(interval[1]):
        text += " The record does not exclude r = 0: check r against a still stretch or the data sheet."
    elif interval[0] == 0.0:
        text += " The record does not exclude q = 0: record longer to be sure of q."
    return text


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
    steady = steady_state(params)
    overshoot = steady.overshoot
    beyond = f", goes {percent(overshoot)} beyond a step and" if overshoot > 0.0 else " and"
    return (
        f"{below_step(step)} r = {number(float(params.r))} is the variance of rounding, Δ²/12: the readings carry "
        f"that much at least. With it the most likely filter settles at gain {number(steady.gain)}: it lags "
        f"a ramp by {number(steady.lag_samples)} samples{beyond} reduces white noise by "
        f"{decibels(steady.noise_reduction_db)}. A finer range of the sensor, or one digit more, shows more."
    )


def rounding_share(step: float, share: float) -> str:
    """Rounding to steps of `step` is this share of r."""
    return f"Rounding to steps of {trimmed(step, 4)} is {percent(min(share, 1.0))} of r."


def rounding_floor(step: float) -> str:
    """No noise is found, but readings in steps carry some."""
    return f"Rounding to steps of {trimmed(step, 4)} alone adds a variance of {number(step * step / 12.0)}."
