"""From a target to the filter with momentum: the ratio at a given momentum, and the momentum of an overshoot."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Literal

from kalscope.errors import BadSetting
from kalscope.filtering.momentum.gains import Model
from kalscope.filtering.momentum.settled import overshoot_of
from kalscope.filtering.params import MAX_MOMENTUM

Target = Literal["gain", "lag", "noise", "cutoff"]

MIN_MOMENTUM = 1.0 / 500.0
"""The shortest that is searched for an overshoot: such a velocity is forgotten long before the next sample."""

MAX_LOGIT = 700.0
"""Gains are searched for where |ln K/(1 - K)| is smaller: beyond, K or 1 - K underflows a double."""
STEPS = 64
"""Bisections of an interval: more than a double has bits."""


def ratio_with_momentum(target: Target, value: float, momentum: float) -> float:
    """The ratio λ = q/r of the settled filter that meets a target at a given momentum.

    Args:
        target: what `value` is: the gain K, 0 < K < 1; the lag on a ramp in samples; the share of white noise that
            is left, below 1; or 4 sin²(π f) of the -3 dB frequency f in cycles per sample, at most 4.
        value: above 0.
        momentum: τ in sample periods, above 0.
    """
    model = Model.of(momentum)
    if target == "lag":
        return model.ratio_of_lag(value)
    if target == "gain":
        return model.ratio(value, 1.0 - value)
    seen = model.noise if target == "noise" else model.cutoff
    return model.ratio(*_gain_where(lambda gain, kept: seen(gain, kept, model.product(gain, kept)) >= value))


def momentum_for_overshoot(overshoot: float, ratio_at: Callable[[float], float]) -> float:
    """The momentum at which the step response overshoots by the share `overshoot`.

    0 for no overshoot: momentum up to half of the lag has none either, but saves only 0.2 dB of noise.

    Along every curve of equal lag, noise, cut-off or gain the overshoot rises with the momentum; at lags below 0.2
    samples not strictly, because a step is seen at whole samples only. The bisection ends within the target in any
    case, and a larger target never ends at less momentum.

    Args:
        overshoot: share of the step, ≥ 0.
        ratio_at: λ that keeps the other target, by momentum.

    Raises:
        BadSetting: the overshoot is not from 0 to 1, or more than any momentum has.
    """
    if not 0.0 <= overshoot < 1.0:
        raise BadSetting(f"overshoot must be a share of the step from 0 to 1, such as 0.1 (got {overshoot:g})")

    def within(momentum: float) -> bool:
        return overshoot_of(ratio_at(momentum), momentum) <= overshoot

    if overshoot == 0.0 or not within(MIN_MOMENTUM):
        return 0.0
    largest = overshoot_of(ratio_at(MAX_MOMENTUM), MAX_MOMENTUM)
    if overshoot > largest:
        possible = 100.0 * 0.9995 * largest  # still possible when it is rounded
        raise BadSetting(
            f"overshoot must be at most {possible:.4g} % of a step with this target (got {100.0 * overshoot:g} %)"
        )
    low, high = math.log(MIN_MOMENTUM), math.log(MAX_MOMENTUM)
    for _ in range(STEPS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if within(math.exp(middle)) else (low, middle)
    return math.exp(low)


def _gain_where(reached: Callable[[float, float], bool]) -> tuple[float, float]:
    """The least K, and 1 - K, for which `reached` is true, false below and true above."""
    low, high = -MAX_LOGIT, MAX_LOGIT
    for _ in range(STEPS):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if reached(*_logistic(middle)) else (middle, high)
    return _logistic(high)


def _logistic(x: float) -> tuple[float, float]:
    """K and 1 - K of ln K/(1 - K) = x."""
    return 1.0 / (1.0 + math.exp(-x)), 1.0 / (1.0 + math.exp(x))
