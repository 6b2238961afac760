"""Which sensor disagrees with the others: its difference from them moves, or its noise changes.

In a row in which several sensors answer, the quantity cancels out of the difference of one from the mean of the
others, weighted by their information: what is left is white noise of known variance. Where sensors answer in
different rows, the others are smoothed, and take part in the difference with their own error. The sensor that is
furthest beyond chance is set aside before the others are compared, because it is in their mean.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from kalscope.common.array import Array
from kalscope.filtering.filter import smooth
from kalscope.filtering.params import FilterParams
from kalscope.filtering.steady_state import steady_state

BEYOND_CHANCE = 5.0
"""Standard errors above which a difference is not chance: many blocks of many sensors are compared."""

MIN_DRIFT = 0.5
"""Smallest drift that is worth reporting, in standard deviations of the sensor's noise."""

MIN_NOISE_RATIO = 2.0
"""Smallest change of a noise variance that is worth reporting."""

MAX_BLOCKS, MIN_BLOCK, MIN_NOISE_BLOCK = 16, 30, 100
"""Blocks of a record, and the readings that the mean and the variance of one need."""

MIN_OWN = 1e-300
"""Smallest variance used as a divisor."""

MAX_SIZE = 4.0
"""Differences are clipped at this many standard deviations: spikes are not drift."""

MAX_FAINTER = 4.0
"""A row far from readings of the others, where their error variance is over this many times the least, is left
out."""

SMALLER, MEAN_OF_SMALLER = 0.9, 0.6573
"""Share of the steps whose size is averaged, and that average for a standard normal distribution."""


@dataclass(frozen=True)
class Difference:
    """One sensor less the others, on the scale of x, where both answer."""

    d: Array
    """Its values, shape (m,)."""
    own: Array
    """Variance of what is new in each value."""
    others: float
    """Variance of the error of the others that lasts for some values, 0 where it is new in each row too."""
    lasting: float
    """For how many values that error lasts."""

    @property
    def scaled(self) -> Array:
        """The values divided by the standard deviations that the model gives to what is new in them."""
        return self.d / np.sqrt(np.maximum(self.own, MIN_OWN))


def difference(z: Array, dt: Array | None, params: FilterParams, sensor: int, others: Sequence[int]) -> Difference:
    """Sensor less others."""
    y = (z - params.offset) / params.gain
    own, rest = y[:, sensor], y[:, list(others)]
    information = np.where(np.isfinite(rest), params.information[list(others)], 0.0)
    total, r = information.sum(axis=1), float(params.scaled_r[sensor])
    answered = np.isfinite(own)
    both = answered & (total > 0.0)
    if 2 * both.sum() >= answered.sum():
        mean = (information * np.where(np.isfinite(rest), rest, 0.0)).sum(axis=1)[both] / total[both]
        return Difference(own[both] - mean, r + 1.0 / total[both], 0.0, 1.0)
    remaining = params.only(others)
    smoothed = smooth(z[:, list(others)], remaining, dt)
    error = np.where(answered & np.isfinite(smoothed.p), smoothed.p, math.inf)
    known = np.isfinite(error) & (error <= MAX_FAINTER * error.min(initial=math.inf))
    per_row = known.sum() / max(len(z), 1)
    lasting = 1.0 + 2.0 * steady_state(remaining.as_single).lag_samples * per_row
    others_p = float(smoothed.p[known].mean()) if known.any() else 0.0
    return Difference((own - smoothed.x)[known], np.full(int(known.sum()), r), others_p, lasting)


def drift(one: Difference) -> tuple[float, float]:
    """By how much the difference moves, and how far beyond chance its blocks scatter, in standard deviations."""
    count = min(MAX_BLOCKS, len(one.d) // MIN_BLOCK)
    if count < 2:
        return 0.0, 0.0
    own = one.own * max(1.0, _noise(one.scaled))  # observed noise, where it exceeds that of the model
    reach = MAX_SIZE * np.sqrt(own + one.others) + _reach(one.d)
    d = np.clip(one.d - np.median(one.d), -reach, reach)
    means = np.array([block.mean() for block in np.array_split(d, count)])
    size = len(d) / count
    noise = np.array([block.mean() for block in np.array_split(own, count)]) / size
    variance = np.maximum(noise + one.others * min(1.0, one.lasting / size), MIN_OWN)
    centre = float((means / variance).sum() / (1.0 / variance).sum())
    return float(np.ptp(means)), _beyond(float(((means - centre) ** 2 / variance).sum()), count - 1)


def noise_change(one: Difference) -> tuple[float, float]:
    """The largest over the smallest variance of the noise of blocks, and the standard errors of its logarithm."""
    count = min(MAX_BLOCKS // 2, len(one.d) // MIN_NOISE_BLOCK)
    if count < 2:
        return 1.0, 0.0
    variances = [_noise(block) for block in np.array_split(one.scaled, count)]
    if min(variances) <= 0.0:  # as coarse as its steps
        return 1.0, 0.0
    ratio = max(variances) / min(variances)
    return ratio, math.log(ratio) / (3.0 * math.sqrt(2.0 * count / len(one.d)))  # 3/√m: more than normal steps have


def odd_ones(
    sensors: int,
    compare: Callable[[int, tuple[int, ...]], tuple[float, float]],
    enough: Callable[[int, float], bool],
) -> dict[int, float]:
    """The sensors that differ from the others by more than chance, worst first, and how much each does.

    Args:
        sensors: their number.
        compare: size and standard errors of the difference of a sensor from others.
        enough: whether a size of a sensor is worth reporting.
    """
    odd: dict[int, float] = {}
    left = list(range(sensors))
    while len(left) > 1:
        found = {i: compare(i, tuple(j for j in left if j != i)) for i in left}
        beyond = {i: one for i, one in found.items() if one[1] > BEYOND_CHANCE and enough(i, one[0])}
        if not beyond:
            break
        if len(left) == 2:  # which of the two is odd cannot be known
            return odd | {i: found[i][0] for i in left}
        worst = max(beyond, key=lambda i: beyond[i][1])
        odd[worst] = beyond[worst][0]
        left.remove(worst)
    return odd


def undecided(odd: dict[int, float], sensor: int, sensors: int) -> tuple[int, ...]:
    """The two sensors that no third one tells apart, where this is one of them; () where it is decided."""
    last = tuple(odd)[-2:]
    return last if len(odd) == sensors and sensor in last else ()


def of_both(odd: dict[int, float], sensor: int, sensors: int) -> float | None:
    """The size found for this sensor: the larger one of a pair that nothing tells apart; None where none is odd."""
    return max((odd[i] for i in undecided(odd, sensor, sensors)), default=odd.get(sensor))


def _noise(d: Array) -> float:
    """Variance of white noise in d, by the mean size of its smaller steps: neither drift nor spikes count.

    A median would not do: of a sensor that rounds it is a whole number of steps.
    """
    if len(d) < 2:
        return 0.0
    steps = np.sort(np.abs(np.diff(d)))
    kept = steps[: max(1, int(SMALLER * len(steps)))]
    sigma = float(kept.mean()) / MEAN_OF_SMALLER
    return 0.5 * sigma * sigma  # inf rather than an error where readings are huge


def _beyond(chi2: float, degrees: int) -> float:
    """A χ² as a standard normal variate (Wilson & Hilferty 1931)."""
    width = 2.0 / (9.0 * degrees)
    return (math.cbrt(chi2 / degrees) - 1.0 + width) / math.sqrt(width)


def _reach(d: Array) -> float:
    """What the difference spans without its outer tenths: a drift is not clipped."""
    low, high = np.quantile(d, (0.1, 0.9))
    return float(high - low)
