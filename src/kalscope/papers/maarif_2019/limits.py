"""The advice of Ma'arif et al. (2019), tested: "ratio 100", and "a mean error of 40 to 55".

Three kinds of signal under the table's noise, σ = 72: one stationary, one that wanders with a true r/q of 100, one
that swings fast. Each is filtered with ratios from 1 to 100,000; its RMSE against the known truth says what a
ratio is worth, the paper's mean error against the raw signal does not.
"""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass

import numpy as np

from kalscope.common.array import Array
from kalscope.filtering.filter import denoise
from kalscope.filtering.params import FilterParams
from kalscope.filtering.steady_state import steady_state
from kalscope.papers.maarif_2019.paper import SIGMA, theoretical_mean_error

ADVISED = 100.0
"""The paper's recommended r/q."""
RULE = (40.0, 55.0)
"""The paper's range of good mean errors, u."""
SAMPLES, SETTLING = 2000, 300
"""Length of a signal, and its first part that is left out: the start is not the question."""
RATIOS = np.logspace(0.0, 5.0, 41)
"""r/q that are tried; every eighth is a power of ten."""
SWING, SWING_PERIOD = 300.0, 60
"""Amplitude in u and period in samples of the fast signal."""


@dataclass(frozen=True)
class AdviceTest:
    """One kind of signal, filtered with each of RATIOS; errors in u, averages over draws."""

    kind: str
    """"stationary", "wandering" or "swinging"."""
    rmse: Array
    """Root mean square of x − truth, shape (41,)."""
    mean_error: Array
    """Mean |z − x|, shape (41,)."""
    best_ratio: float
    """r/q of the smallest RMSE; 1e5 means: the largest one tried."""
    best_rmse: float
    """RMSE there."""
    advised_rmse: float
    """RMSE at r/q = 100."""
    raw_rmse: float
    """RMSE of the raw signal, no filter at all; its mean error is 0."""

    @property
    def loss(self) -> float:
        """How many times larger the RMSE is at the advised ratio than at the best one."""
        return self.advised_rmse / self.best_rmse


@dataclass(frozen=True)
class RuleTest:
    """Which settled filters the rule "mean error 40 to 55" admits on pure noise."""

    ratios: tuple[float, float]
    """Lowest and highest r/q that it admits at σ = 72."""
    row_2: float
    """Mean error of Table 1's row 2 (ratio 10), which the text calls too aggressive."""
    sigma_too_small: float
    """Below this σ, u, no filter at all reaches 40."""
    sigma_too_large: float
    """At this σ, u, ratio 100 exceeds the rule."""


def try_advice(draws: int) -> tuple[AdviceTest, ...]:
    """The three kinds of signal over `draws` draws each (the noise, and the walk)."""
    return tuple(_test_one(kind, draws) for kind in ("stationary", "wandering", "swinging"))


def truth_of(kind: str, draws: int, rng: np.random.Generator) -> Array:
    """The noise-free signals of a kind, shape (SAMPLES, draws)."""
    if kind == "stationary":
        return np.zeros((SAMPLES, draws))
    if kind == "wandering":  # q_true = σ²/100
        return np.cumsum(SIGMA / math.sqrt(ADVISED) * rng.standard_normal((SAMPLES, draws)), axis=0)
    swing = SWING * np.sin(2.0 * np.pi * np.arange(SAMPLES) / SWING_PERIOD)
    return np.repeat(swing[:, None], draws, axis=1)


def _test_one(kind: str, draws: int) -> AdviceTest:
    rng = np.random.default_rng(100)
    truth = truth_of(kind, draws, rng)
    z = truth + SIGMA * rng.standard_normal(truth.shape)
    rmse, mean_error = np.empty(len(RATIOS)), np.empty(len(RATIOS))
    for i, ratio in enumerate(RATIOS):
        x = denoise(z, FilterParams(q=1.0 / ratio, r=1.0))
        rmse[i] = np.sqrt(np.mean((x - truth)[SETTLING:] ** 2))
        mean_error[i] = np.mean(np.abs(x - z)[SETTLING:])
    best = int(np.argmin(rmse))
    return AdviceTest(
        kind=kind,
        rmse=rmse,
        mean_error=mean_error,
        best_ratio=float(RATIOS[best]),
        best_rmse=float(rmse[best]),
        advised_rmse=float(rmse[np.argmin(np.abs(np.log(RATIOS / ADVISED)))]),
        raw_rmse=float(np.sqrt(np.mean((z - truth)[SETTLING:] ** 2))),
    )


def swinging_rmse(ratio: float) -> float:
    """RMSE of the settled filter on the swinging signal, u, from its frequency response.

    With a = 1 − K the share of a sine that is lost is |a (1 − e^−iω)/(1 − a e^−iω)|; noise adds K/(2 − K).
    """
    gain = float(steady_state(FilterParams(q=1.0 / ratio, r=1.0)).gain)
    turn = cmath.exp(-2j * math.pi / SWING_PERIOD)
    lost = abs((1.0 - gain) * (1.0 - turn) / (1.0 - (1.0 - gain) * turn))
    return math.sqrt((SWING * lost) ** 2 / 2.0 + SIGMA**2 * gain / (2.0 - gain))


def judge_rule() -> RuleTest:
    """The rule of thumb on white noise around a constant, by the formula of the mean error."""
    low, high = RULE
    per_sigma = theoretical_mean_error(1.0 / ADVISED, 1.0)
    return RuleTest(
        ratios=(_ratio_of(low, SIGMA), _ratio_of(high, SIGMA)),
        row_2=theoretical_mean_error(0.1, SIGMA),
        sigma_too_small=low / math.sqrt(2.0 / math.pi),  # K → 0: the mean error is c σ at most
        sigma_too_large=high / per_sigma,
    )


def _ratio_of(mean_error: float, sigma: float) -> float:
    """The r/q whose settled filter has this mean error on white noise; it grows with the ratio."""
    low, high = -6.0, 12.0
    for _ in range(80):
        middle = 0.5 * (low + high)
        if theoretical_mean_error(10.0**-middle, sigma) < mean_error:
            low = middle
        else:
            high = middle
    return 10.0 ** (0.5 * (low + high))
