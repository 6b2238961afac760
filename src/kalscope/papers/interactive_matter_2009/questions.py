"""The three questions that the 2009 document ends with, answered with numbers.

Can q and r be estimated instead of guessed? What would several sensors bring? Is there a much easier filter?
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from kalscope.common.array import Array
from kalscope.estimation.estimate import estimate
from kalscope.filtering.filter import denoise, fuse
from kalscope.filtering.params import FilterParams
from kalscope.filtering.steady_state import steady_state
from kalscope.papers.interactive_matter_2009.document import P0, X0, moved_board, truth_of, walk_params
from kalscope.sources.samples import open_sample

TRUE_Q, TRUE_R = 0.125, 9.0
"""The document's q and the noise of the re-created board, counts²: what the estimates should find."""
RECORD = 2000
"""Samples per recording: 20 s."""
SENSOR_R = (9.0, 25.0)
"""Noise variances of the two sensors of one quantity, counts²."""


@dataclass(frozen=True)
class EstimateAnswer:
    """How close maximum likelihood comes, over many recordings of 2000 samples."""

    q_median: float
    """Median estimate of q, counts²; true is 0.125."""
    q_low: float
    """5 % of the estimates lie below."""
    q_high: float
    """5 % lie above."""
    r_median: float
    """Median estimate of r, counts²; true is 9."""
    r_low: float
    """5 % of the estimates lie below."""
    r_high: float
    """5 % lie above."""
    loss: float
    """RMSE of the filter with the estimated pair over that with the true pair, mean over recordings."""
    found: float
    """Share of the recordings in which a pair was found."""
    board_rmse: float
    """RMSE on the moved board, three axes, each with its own estimated pair, counts."""
    by_eye_rmse: float
    """The same with q = 0.125, r = 4, found by eye."""
    resting_verdicts: tuple[str, ...]
    """What is answered for the three axes of the stationary board, where there is no q to find."""


@dataclass(frozen=True)
class FusionAnswer:
    """Two noisy sensors of one quantity, both fed to one filter; errors in counts."""

    first: float
    """RMSE with the better sensor alone."""
    second: float
    """RMSE with the other one alone."""
    fused: float
    """RMSE with one predict and two updates a sample."""
    fused_theory: float
    """√(K r) with 1/r = 1/r₁ + 1/r₂: what the model promises."""
    difference: float
    """Largest distance to the filter of the weighted mean of both readings: the same filter."""


@dataclass(frozen=True)
class ExponentialAnswer:
    """x ← x + K (z − x) with the settled K, against the filter, on the moved board's z axis.

    That axis rests at 55 counts, far from the start at 0.
    """

    gain: float
    """K."""
    at_start: float
    """Largest difference in the first 10 samples, counts."""
    samples_to_agree: int
    """Samples after which the difference stays below 0.01 counts."""
    at_end: float
    """Largest difference over the last half of the record, counts."""


def answer_estimation(draws: int) -> EstimateAnswer:
    """Estimate q and r of `draws` random walks in noise, and filter with what was found."""
    rng = np.random.default_rng(1960)
    pairs: list[tuple[float, float]] = []
    losses: list[float] = []
    true = FilterParams(q=TRUE_Q, r=TRUE_R)
    for _ in range(draws):
        truth = np.cumsum(math.sqrt(TRUE_Q) * rng.standard_normal(RECORD))
        z = truth + math.sqrt(TRUE_R) * rng.standard_normal(RECORD)
        found = estimate(z, momentum=0.0)
        if found.params is None:
            continue
        pairs.append((found.q, float(found.r)))
        losses.append(_rmse(denoise(z, found.params), truth) / _rmse(denoise(z, true), truth))
    q, r = np.array(pairs).T
    low, middle, high = np.quantile(q, (0.05, 0.5, 0.95)).tolist()
    r_low, r_middle, r_high = np.quantile(r, (0.05, 0.5, 0.95)).tolist()
    return EstimateAnswer(
        middle, low, high, r_middle, r_low, r_high, float(np.mean(losses)), len(pairs) / draws, *_on_the_board()
    )


def _on_the_board() -> tuple[float, float, tuple[str, ...]]:
    """RMSE of estimated pairs and of the pair by eye on the moved board; the verdicts on the resting one."""
    board = moved_board()
    truth = truth_of(board)
    columns: list[Array] = []
    for axis in range(3):
        z = board.values[:, axis]
        found = estimate(z, momentum=0.0).params
        columns.append(z if found is None else denoise(z, found))
    by_eye = denoise(board.values, walk_params(0.125, 4.0))
    resting = open_sample("lis302dl").values
    verdicts = tuple(str(estimate(resting[:, axis], momentum=0.0).verdict) for axis in range(3))
    return _rmse(np.column_stack(columns), truth), _rmse(by_eye, truth), verdicts


def answer_fusion() -> FusionAnswer:
    """Two sensors of σ = 3 and 5 counts on one random walk of 20,000 samples."""
    rng = np.random.default_rng(2)
    n = 10 * RECORD
    truth = np.cumsum(math.sqrt(TRUE_Q) * rng.standard_normal(n))
    z = truth[:, None] + np.sqrt(SENSOR_R) * rng.standard_normal((n, 2))
    both = FilterParams(TRUE_Q, np.array(SENSOR_R))
    fused, one = fuse(z, both).x, both.as_single
    mean = (z * both.shares).sum(axis=1)
    alone = [_rmse(denoise(z[:, i], FilterParams(q=TRUE_Q, r=SENSOR_R[i])), truth) for i in range(2)]
    return FusionAnswer(
        first=alone[0],
        second=alone[1],
        fused=_rmse(fused, truth),
        fused_theory=math.sqrt(steady_state(one).p),
        difference=float(np.abs(fused - denoise(mean, one)).max()),
    )


def exponential(z: Array, gain: float, x0: float) -> Array:
    """The much easier filter: x ← x + K (z − x) with a constant K; z and the result have shape (n,)."""
    x, out = x0, np.empty(len(z))
    for i, value in enumerate(z.tolist()):
        x = x + gain * (value - x)
        out[i] = x
    return out


def answer_exponential(q: float, r: float) -> ExponentialAnswer:
    """The filter against its own settled gain, both from the document's start x = 0."""
    z = moved_board().values[:, 2]
    params = walk_params(q, r)
    gain = steady_state(params).gain
    difference = np.abs(denoise(z, FilterParams(q=q, r=r, p0=P0, x0=X0)) - exponential(z, gain, X0))
    far = np.flatnonzero(difference > 0.01)
    return ExponentialAnswer(
        gain=gain,
        at_start=float(difference[:10].max()),
        samples_to_agree=int(far[-1]) + 1 if len(far) else 0,
        at_end=float(difference[len(z) // 2 :].max()),
    )


def _rmse(x: Array, truth: Array) -> float:
    """Root mean square error after the first 100 samples."""
    return float(np.sqrt(np.mean((x - truth)[100:] ** 2)))
