"""The verdicts in words: what was found in a record, what it means to a maker, and what to do instead."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from kalscope.common.text import decibels, number

if TYPE_CHECKING:
    from kalscope.estimation.likelihood.profile import Differences

INSTEAD = (
    "Instead: take r from a still stretch or the data sheet, or choose the lag or the cut-off that you can accept."
)

MIN_SAMPLES = 8
"""Finite samples below which no pair is looked for."""

_STEPS_SHARE = 0.2
"""Share of unchanged readings from which on the record is called quantised."""


def too_few(n: int) -> str:
    """Fewer finite samples than the least."""
    return f"Too few readings ({n}): at least {MIN_SAMPLES} are needed to tell noise from movement. Record longer."


def constant(n: int) -> str:
    """All finite samples are equal."""
    return (
        f"All {n} readings are the same: neither noise nor movement shows. The sensor's steps may be coarser than "
        "its noise, or it is stuck. Record while it moves, or take the noise from the data sheet."
    )


def bad_unit() -> str:
    """The variances leave 1e-300 … 1e300."""
    return (
        "The variances of these readings do not fit a computer's numbers (1e-300 to 1e300). Scale them: choose a "
        "unit in which they lie near 1."
    )


def other_unit() -> str:
    """A given r is out of all proportion to the readings."""
    return "The given r is out of all proportion to these readings: give a variance, in the square of their unit."


def no_noise(data: Differences, gains: tuple[float, float]) -> str:
    """No r: the likelihood rises all the way to a filter that does nothing."""
    unchanged = float(np.mean(data.d == 0.0))
    steps = (
        f" In {unchanged:.0%} of the steps the reading does not change at all, so it is coarsely quantised."
        if unchanged > _STEPS_SHARE
        else ""
    )
    return (
        "The sensor shows no noise at this rate that this model can see: each change is taken for real movement, "
        f"and the most likely filter (r = 0) would pass the signal through unchanged.{steps} Usual reasons: the "
        "sensor smooths or rounds by itself, or the signal moves more from sample to sample than the noise does. "
        f"The record allows gains from {number(gains[0], 2)} to {number(gains[1], 2)}. {INSTEAD}"
    )


def no_movement(lag_low: float) -> str:
    """No q: a constant under noise explains the record best."""
    allowed = f"a lag of {number(lag_low)} samples or more" if lag_low > 0.0 else "any lag"
    return (
        "No movement can be told from noise in this stretch: a constant under noise of variance r explains it "
        "best. The r found here is good; q = 0 is not an answer, for such a filter stops following after a while. "
        f"The record allows {allowed}. Instead: record longer or while the signal moves, or keep this r and "
        "choose the lag or the cut-off that you can accept."
    )


def blind(kind: str, low: float, high: float) -> str:
    """This method found none of `kind`, "noise" or "movement"; the likelihood excludes that there is none."""
    return (
        f"This method finds no {kind} here, but that says more about the method than about the record: by its "
        f"likelihood the record allows only q/r from {number(low)} to {number(high)}. "
        "Take the maximum-likelihood pair."
    )


def flat() -> str:
    """Every λ from 0 to ∞ explains the record nearly as well."""
    return (
        "The record cannot tell noise from movement: every ratio q/r explains it nearly as well as this one. Take "
        "the pair as a guess. Record longer, or take r from a still stretch or the data sheet."
    )


def ok(gain: float, lag: tuple[float, float], interval: tuple[float, float]) -> str:
    """Both variances are found; `lag` and `interval` are the ends of the 95 % intervals of lag and ratio."""
    reduction = 10.0 * math.log10((2.0 - gain) / gain)
    text = (
        f"Noise and movement can be told apart. The filter settles at gain {number(gain)}: it trails a ramp by "
        f"{number((1.0 - gain) / gain)} samples and takes {decibels(reduction)} off white noise. "
        f"The record allows lags from {number(lag[0])} to {number(lag[1])} samples."
    )
    if math.isinf(interval[1]):
        text += " No noise at all is not excluded: check r against a still stretch or the data sheet."
    elif interval[0] == 0.0:
        text += " No movement at all is not excluded: record longer to be sure of q."
    return text


def unsettled() -> str:
    """EM used up its passes."""
    return "EM was still on its way when its passes were used up: trust the maximum-likelihood pair instead."


def chosen_ratio(low: float, high: float, ratio: float) -> str:
    """λ was given; `low` and `high` are what the record would allow."""
    fits = "which the record allows" if low <= ratio <= high else "which the record contradicts"
    return (
        f"q/r = {number(ratio)} was chosen, {fits} ({number(low)} to {number(high)}); r is the variance that fits "
        "the record best with it."
    )
