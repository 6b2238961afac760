"""Whether another method's answer is as close to the maximum-likelihood pair as chance allows."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from kalscope.analysis.alternatives.agreement.simulation import (
    FIRST_SIMULATIONS,
    SIMULATIONS,
    law,
    pattern,
    simulated_pair,
)
from kalscope.common.array import Array
from kalscope.common.progress import Progress
from kalscope.common.text import count
from kalscope.estimation.likelihood.profile import Differences
from kalscope.estimation.methods.by_name import QUICK
from kalscope.estimation.methods.pair import Pair
from kalscope.estimation.verdict.conclude import gain_of
from kalscope.filtering.filter import kalman_filter
from kalscope.filtering.params import FilterParams

_USUAL = 0.2
"""Above this share among the first simulations the whole distribution is not needed."""
_MIN_ANSWERS = 0.9
"""Share of simulated records in which a method must find an answer to count."""
_BIAS = 0.05
"""A method counts unless the true pair lies in this part of either tail of its answers."""
_FAR = 4.0
"""Standard deviations beyond which an innovation is not noise."""
_FAR_SHARE = 6.334e-5
"""Share of a normal distribution that lies beyond."""
_MIN_CHANCE = 1e-3
"""Chance below which the number of such innovations, or the largest one, means spikes or jumps."""
_MAX_POWER = 0.05
"""Share of the power of all innovations, above which they mislead a method that is not robust."""


_NO_ANSWER = {"irregular": "the samples are not regular", "too_few": "the samples are too few"}
"""Why a method has no answer, by its verdict."""


@dataclass(frozen=True)
class Opinion:
    """What a second method's answer is worth."""

    agreement: float
    """Share of simulated records in which the method lies as far from the maximum-likelihood pair, 0 … 1;
    1 where it does not count."""
    not_counted: str = ""
    """Why it does not count, a clause for the user; "" where it does."""


def weigh(method: str, data: Differences, best: Pair, found: Pair, broken: str, progress: Progress) -> Opinion:
    """Compare a method's pair with what it finds in records simulated under the best pair.

    Args:
        method: its name; EM climbs the same likelihood and never counts.
        data: the record.
        best: the maximum-likelihood pair.
        found: the method's pair.
        broken: what `spikes_in` says of the record.
        progress: receives progress reports.
    """
    if method not in QUICK:
        return Opinion(1.0, "it maximises the same likelihood")
    if found.verdict or best.verdict:
        return Opinion(1.0, _NO_ANSWER.get(found.verdict, "there is no pair to compare with"))
    if broken:
        return Opinion(1.0, broken)
    scale = _Scale.of(data, best)
    ratio = best.q / best.r if best.r > 0.0 else math.inf
    truth, here = scale.place(np.array([[best.q, best.r], [found.q, found.r]]))
    q, r = simulated_pair(ratio)
    # The spread of variances that are estimated falls with the root of the number of samples.
    shrink = math.sqrt(pattern(data)[1] / data.m)
    share = 1.0
    for simulations in (FIRST_SIMULATIONS, SIMULATIONS):
        answers = law(method, data, ratio, simulations, progress)
        if len(answers) < _MIN_ANSWERS * simulations:
            return Opinion(1.0, "too few samples follow each other without a gap")
        answers = answers * (best.q / q if r == 0.0 else best.r / r)
        if _biased(truth, scale.place(answers)):
            return Opinion(1.0, "gaps between the samples bias it")
        pair = np.array([best.q, best.r])
        share = _share_as_far(here, scale.place(pair + shrink * (answers - pair)))
        if share > _USUAL:
            break
    return Opinion(share)


def spikes_in(data: Differences, best: Pair) -> str:
    """How many innovations of the best pair are spikes or jumps, in words; "" where they do not matter."""
    from scipy.special import pdtrc

    dt = np.append(1.0, data.gap) if len(data.gap) else None
    z = np.concatenate([[0.0], np.cumsum(data.d)])
    result = kalman_filter(z, FilterParams(q=best.q, r=best.r), dt)
    nis = result.innovation[1:] ** 2 / result.s[1:]
    beyond = nis > _FAR**2
    far = int(np.count_nonzero(beyond))
    if float(nis[beyond].sum()) <= _MAX_POWER * float(nis.sum()):
        return ""
    largest = data.m * math.erfc(math.sqrt(0.5 * float(nis.max())))
    if min(float(pdtrc(far - 1, _FAR_SHARE * data.m)), largest) > _MIN_CHANCE:
        return ""
    samples = "1 sample is a spike or jump" if far == 1 else f"{count(far)} samples are spikes or jumps"
    return f"{samples}, beyond 4 σ"


@dataclass(frozen=True)
class _Scale:
    """Coordinates of pairs: gain, and r as r/(r + unit), both 0 … 1, so that an edge is a point like others."""

    unit: float
    """Variance of the difference of two samples under the best pair."""

    @staticmethod
    def of(data: Differences, best: Pair) -> _Scale:
        gap = float(np.mean(data.gap)) if len(data.gap) else 1.0
        return _Scale(best.q * gap + 2.0 * best.r)

    def place(self, pairs: Array) -> Array:
        """Gain and noise of each pair, shape (k, 2)."""
        gains = [gain_of(q / r if r > 0.0 else math.inf) for q, r in pairs.tolist()]
        return np.stack([np.array(gains), pairs[:, 1] / (pairs[:, 1] + self.unit)], axis=1)


def _biased(truth: Array, places: Array) -> bool:
    """Whether the true pair lies in a tail of what the method finds, in gain or in noise."""
    below, above = np.mean(places <= truth, axis=0), np.mean(places >= truth, axis=0)
    return bool(np.any(np.minimum(below, above) < _BIAS))


def _share_as_far(here: Array, places: Array) -> float:
    """The share of simulated answers as far from their middle as this one, itself counted among them."""
    low, middle, high = np.quantile(places, (0.16, 0.5, 0.84), axis=0)
    spread = np.maximum(0.5 * (high - low), 1e-9)
    far = np.max(np.abs(places - middle) / spread, axis=1)
    as_far = np.count_nonzero(far >= float(np.max(np.abs(here - middle) / spread)) * (1.0 - 1e-9))
    return (1.0 + as_far) / (1.0 + len(places))
