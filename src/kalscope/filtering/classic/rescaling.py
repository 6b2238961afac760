"""A chain at another sample period: cut-offs stay in hertz, windows and time constants in seconds."""

from __future__ import annotations

import math
from dataclasses import replace

from kalscope.filtering.classic.chain import Chain
from kalscope.filtering.classic.stages import (
    MAX_SHIFT,
    Butterworth,
    Exponential,
    Median,
    MovingAverage,
    OneEuro,
    PowerOfTwo,
    Stage,
)


def rescaled_chain(chain: Chain, ratio: float) -> Chain | None:
    """The chain at a sample period `ratio` times as long.

    Windows are rounded to whole samples, those of a median to odd ones, and a power of two to the nearest. α keeps
    its time constant, 1 − (1 − α)^ratio; β is per unit of the signal and stays.

    Returns:
        The chain; None where nothing is left of it but the Kalman filter.

    Raises:
        BadSetting: A window or a cut-off leaves its range.
    """
    median = _odd(chain.median, ratio)
    if median == 1 and chain.then is None:
        return None
    return Chain(median, None if chain.then is None else _rescaled(chain.then, ratio))


def _rescaled(stage: Stage, ratio: float) -> Stage:
    match stage:
        case MovingAverage():
            return MovingAverage(max(1, round(stage.window / ratio)))
        case Median():
            return Median(_odd(stage.window, ratio))
        case Exponential():
            return Exponential(_share(stage.alpha, ratio))
        case PowerOfTwo():
            return PowerOfTwo(min(max(0, round(-math.log2(_share(stage.alpha, ratio)))), MAX_SHIFT))
        case Butterworth():
            return Butterworth(stage.cutoff * ratio)
        case OneEuro():
            return replace(stage, cutoff=stage.cutoff * ratio, speed_cutoff=stage.speed_cutoff * ratio)


def _odd(window: int, ratio: float) -> int:
    """The odd number nearest to window/ratio."""
    return max(1, 2 * round(0.5 * (window / ratio - 1.0)) + 1)


def _share(alpha: float, ratio: float) -> float:
    """The α with the same time constant in seconds; 1 stays 1."""
    return 1.0 if alpha >= 1.0 else -math.expm1(ratio * math.log1p(-alpha))
