"""Whether a record needs momentum: by its likelihood, and by how well it predicts samples that it has not seen.

Both must agree, else the simpler model stays. A few jumps of a long record can raise the likelihood although the
prediction of all the rest gets worse; and a slightly better prediction of a short record can be chance.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np

from kalscope.common.array import Array
from kalscope.common.progress import Progress
from kalscope.estimation.likelihood.profile import Differences
from kalscope.estimation.methods import maximum_likelihood as ml
from kalscope.estimation.momentum.free import params_at
from kalscope.estimation.momentum.search import Top, climb
from kalscope.estimation.result import Estimate
from kalscope.filtering.filter import kalman_filter
from kalscope.filtering.params import FilterParams

MIN_GAIN = 12.0
"""Twice the log-likelihood that momentum must add: 2 for its parameter by Akaike's criterion, 10 for safety."""
SHORT_RECORD = 5000.0
"""This over the number of samples is added to it: a short record has few changes of direction, if any."""
MAX_ERROR = 0.995
"""One-step error with momentum over that without, on unseen samples: at least 0.5 % less."""
FOLDS = 5
"""Parts of the record, each of which is predicted by fits to all the others."""
MIN_SAMPLES = 60
"""Samples of the record, so that each part holds a dozen."""
_BLOCKS = 2
"""Stretches of each part. All count alike: a sensor may lie still in one of them, and be shaken in another."""


@dataclass(frozen=True)
class Choice:
    """The evidence for momentum in one channel."""

    gain: float
    """Twice the log-likelihood that it adds."""
    needed: float
    """What it must add; inf for a record that is too short to tell."""
    error: float
    """One-step error with momentum over that without, on unseen samples; NaN where that was not tried."""

    @property
    def chosen(self) -> bool:
        """Whether both tests favour it."""
        return self.gain > self.needed and self.error <= MAX_ERROR


def choose(data: Differences, plain: Estimate, top: Top, progress: Progress) -> Choice:
    """Weigh momentum against the random walk.

    Args:
        data: the record.
        plain: the best random walk.
        top: the best place of the likelihood with momentum.
        progress: receives progress reports.
    """
    gain = 2.0 * (top.loglik - float(plain.loglik))
    count = data.m + 1
    needed = math.inf if count < MIN_SAMPLES else MIN_GAIN + SHORT_RECORD / count
    if not gain > needed:
        return Choice(gain, needed, math.nan)
    z = np.concatenate([[0.0], np.cumsum(data.d)])
    ends = np.linspace(0.0, count, FOLDS + 1).astype(int).tolist()
    ratios: list[Array] = []
    for i, part in enumerate(itertools.pairwise(ends)):
        others = data.parts([(0, part[0]), (part[1], count)])
        if others.d.any():
            now = progress.part(i / FOLDS, (i + 1) / FOLDS)
            pair = ml.fit_near(others, float(plain.ratio), now.part(0.0, 0.2))
            q, r, tau = params_at(others, climb(others, top, now.part(0.2, 0.9)))
            now(0.9, "prediction of unseen samples")
            walk = _squares(z, data.gap, FilterParams(q=pair.q, r=pair.r), part)
            moving = _squares(z, data.gap, FilterParams(q=q, r=r, momentum=tau), part)
            still = (walk == 0.0) | (moving == 0.0)
            ratios.append(np.sqrt(moving[~still] / walk[~still]))
    logs = np.log(np.concatenate([np.empty(0), *ratios]))
    return Choice(gain, needed, float(np.exp(logs.mean())) if len(logs) else math.nan)


def _squares(z: Array, gap: Array, params: FilterParams, part: tuple[int, int]) -> Array:
    """Mean squared one-step error of each stretch of a part."""
    dt = np.append(1.0, gap[: part[1] - 1]) if len(gap) else None
    squares = kalman_filter(z[: part[1]], params, dt).innovation[max(part[0], 1) :] ** 2
    return np.array([float(np.mean(stretch)) for stretch in np.array_split(squares, _BLOCKS)])
