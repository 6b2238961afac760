"""The second question answered with what is found in the readings alone: an accelerometer and a tilt sensor.

The angle of a board that swings is made by the generator, so its truth is known. The accelerometer gives it at
100 Hz with much noise, the tilt sensor at 10 Hz with little, but 2.5° too high. The estimate is given none of that.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from kalscope.common.array import Array
from kalscope.estimation.estimate import estimate
from kalscope.estimation.fusion.estimate_fusion import estimate_fusion
from kalscope.filtering.filter import denoise, fuse
from kalscope.recording import Recording
from kalscope.sources.synthetic import synthesize

NAMES = ("accelerometer", "tilt sensor")
NOISE, OFFSET = (3.0, 0.8), 2.5
"""Standard deviations of both sensors, and what the tilt sensor reads too high, degrees."""
SAMPLE_PERIOD, EVERY = 0.01, 10
"""s; and how many rows apart the readings of the tilt sensor are."""
AFTER = 100
"""Rows left out for the start-up."""


@dataclass(frozen=True)
class TiltAnswer:
    """What is found about two unknown sensors; r in degrees², the rest in degrees."""

    r_first: float
    """r of the accelerometer; true is 9."""
    r_second: float
    """r of the tilt sensor; true is 0.64."""
    offset: float
    """How much higher the tilt sensor reads; true is 2.5."""
    offset_low: float
    """Lower end of its 95 % interval."""
    offset_high: float
    """Upper end."""
    share: float
    """Share of the tilt sensor in a row in which both answer."""
    first: float
    """RMSE of the accelerometer, filtered alone with what is estimated from it."""
    second: float
    """The same of the tilt sensor; its offset, which it cannot know, is subtracted."""
    fused: float
    """RMSE of the fused value."""
    predicted: float
    """The error that the fused filter predicts for itself."""
    without_second: float
    """The error that it predicts without the tilt sensor."""


def tilted_board() -> Recording:
    """40 s of a board that swings by ±20° once in 4 s, seen by both sensors."""
    return synthesize(
        "sine",
        n=4000,
        sample_period=SAMPLE_PERIOD,
        amplitude=20.0,
        period=4.0,
        sigmas=NOISE,
        offsets=(0.0, OFFSET),
        every=(1, EVERY),
    )


def answer_tilt() -> TiltAnswer:
    """Estimate, fuse, and drop one out."""
    board = tilted_board()
    z, truth = board.values, (board.values if board.truth is None else board.truth)[:, 0]
    found = estimate_fusion(z, names=NAMES, reference=NAMES[0])
    if found.params is None:
        raise ArithmeticError(found.message)
    fused, first = fuse(z, found.params), fuse(z[:, :1], found.params.only([0]))
    alone = [_filtered_alone(z[:, 0]), _filtered_alone(z[:, 1] - OFFSET)]
    low, high = found.offset_interval[1].tolist()
    return TiltAnswer(
        r_first=float(found.r[0]),
        r_second=float(found.r[1]),
        offset=float(found.offset[1]),
        offset_low=low,
        offset_high=high,
        share=float(found.params.shares[1]),
        first=_rmse(alone[0], truth),
        second=_rmse(alone[1], truth),
        fused=_rmse(fused.x, truth),
        predicted=_predicted(fused.p),
        without_second=_predicted(first.p),
    )


def _filtered_alone(z: Array) -> Array:
    found = estimate(z)
    return z if found.params is None else denoise(z, found.params)


def _rmse(x: Array, truth: Array) -> float:
    return math.sqrt(float(np.mean((x - truth)[AFTER:] ** 2)))


def _predicted(p: Array) -> float:
    return math.sqrt(float(np.mean(p[AFTER:])))
