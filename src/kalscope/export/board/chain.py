"""A channel as a small board filters it, in float32: by Kalman or a classic filter, or either after a median."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from kalscope.common.text import number
from kalscope.errors import BadSetting
from kalscope.export.float32 import Float32Params, Floats, filter_float32, float32_params, to_float32
from kalscope.filtering.classic.running import RunningStages
from kalscope.filtering.classic.stages import Stage
from kalscope.tuning.tuning import ChannelTuning


def runs_kalman(channel: ChannelTuning) -> bool:
    """Whether the last filter of a channel is its Kalman filter."""
    return channel.chain is None or channel.chain.then is None


def float32_tuning(channel: ChannelTuning) -> Float32Params | None:
    """What a board holds of a channel's Kalman filter, its median included; None where a classic filter is last.

    Raises:
        BadSetting: float32 cannot hold a value (the message names it).
    """
    chain = channel.chain
    if chain is None or chain.then is None:
        return float32_params(channel.params, 1 if chain is None else chain.median)
    _check(chain.then)
    return None


def filter_channel_float32(z: ArrayLike, channel: ChannelTuning) -> Floats:
    """The filtered signal of a channel as a board with float32 computes it, bit for bit.

    Args:
        z: Samples since the start, shape (n,), rounded to float32; NaN where missing.
        channel: The filter.

    Returns:
        x, float32, shape (n,).

    Raises:
        BadSetting: float32 cannot hold a value.
    """
    held = float32_tuning(channel)
    if held is not None or channel.chain is None:
        return filter_float32(z, held or channel.params)
    return RunningStages(channel.chain.stages, np.float32).take(np.asarray(z, dtype=np.float32), np.empty(0))


def _check(stage: Stage) -> None:
    for value in stage.constants:
        try:
            to_float32("a number", value)
        except BadSetting:
            raise BadSetting(
                f"{stage.name} must compute with numbers that float32 holds, up to 3.4e38 (got {number(value)},"
                f" {stage.words})"
            ) from None
