"""The nearest filter without momentum, for libraries that have only the five lines."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace

from kalscope.common.text import decibels, lag_in_full, number
from kalscope.errors import BadSetting
from kalscope.export.header_text import chain_words
from kalscope.export.job import ExportJob, FusionJob
from kalscope.export.names import comment_text, number_text
from kalscope.filtering.classic.chain import Chain
from kalscope.filtering.classic.stages import Exponential, MovingAverage, PowerOfTwo
from kalscope.filtering.params import MAX_VARIANCE
from kalscope.filtering.steady_state import ratio_for, steady_state
from kalscope.tuning.fusion import FusionTuning
from kalscope.tuning.tuning import ChannelTuning

LARGEST_RATIO = 1e15
"""q/r that means no noise reduction at all: the gain is 1 to fifteen digits."""

MAX_SENSORS_SHOWN = 4
"""Sensors whose mean a message writes out: it is one line."""


def nearest_without_momentum(channel: ChannelTuning) -> ChannelTuning:
    """The same r with the q of the five lines that reduce white noise as much once settled; they lag more.

    Equal noise rather than equal lag: a long momentum follows a ramp almost without lag, and the five lines that
    do so hardly filter.
    """
    if channel.momentum == 0.0 or channel.r == 0.0 or channel.q == 0.0:
        return replace(channel, momentum=0.0)
    decibel = steady_state(channel.params).noise_reduction_db
    ratio = min(ratio_for(noise_reduction_db=decibel), LARGEST_RATIO) if decibel > 0.0 else LARGEST_RATIO
    return replace(channel, q=min(ratio * channel.r, MAX_VARIANCE), momentum=0.0)


def refusal_of_fusion(job: FusionJob, target: str, able: Iterable[str]) -> BadSetting:
    """What to raise for a target that takes one reading, with the mean of the readings that would do instead.

    Args:
        job: The fusion.
        target: Its name.
        able: The targets that fuse.
    """
    fusion, (single,) = job.fusion, job.as_single.channels
    instead = "or choose a channel, for its own filter"
    if single.momentum == 0.0 and len(fusion.sensors) <= MAX_SENSORS_SHOWN:
        filtered = f"{_mean_text(fusion)} with q = {single.q:.6g} and r = {single.r:.6g}"
        instead += f"; or, if all sensors always answer, give it {filtered}"
    return BadSetting(
        f"target must be a filter of several sensors (got {target}, which takes one reading per sample)."
        f" Export {', '.join(able)}; {instead}"
    )


def refusal_of_chain(job: ExportJob, target: str, able: Iterable[str]) -> BadSetting:
    """What to raise for a target that holds the Kalman filter only, for the first channel that has another.

    Args:
        job: An export with a chain.
        target: Its name.
        able: What holds chains.
    """
    channel, chain = next((one, one.chain) for one in job.channels if one.chain is not None)
    native = _in_esphome(chain) if target == "esphome" else ""
    return BadSetting(
        f"target must run the filter of {comment_text(channel.name)}, {chain_words(chain)} (got {target}, which"
        f" does not). Export {', '.join(able)}; or use the Kalman filter alone in that channel{native}"
    )


def _in_esphome(chain: Chain) -> str:
    """The filter of ESPHome itself that equals a classic filter except for rounding, while no sample is missing."""
    last = chain.then
    if chain.median > 1 or not isinstance(last, Exponential | PowerOfTwo | MovingAverage):
        return ""
    if isinstance(last, MovingAverage):
        code = f"sliding_window_moving_average: {{window_size: {last.window}, send_every: 1}}"
    else:
        code = f"exponential_moving_average: {{alpha: {last.constants[0]!r}, send_every: 1}}"
    return (
        f"; or give the sensor ESPHome's own filter, equal except for rounding while no sample is missing: {code}"
    )


def _mean_text(fusion: FusionTuning) -> str:
    """The mean of the readings, offset and gain taken out, by their shares: 0.25 (a - 3) + 0.75 b."""
    parts: list[str] = []
    for name, share, gain, offset in zip(
        fusion.sensors, fusion.params.shares.tolist(), fusion.gain, fusion.offset, strict=True
    ):
        reading = comment_text(name)
        if offset:
            reading = f"({reading} {'-' if offset > 0.0 else '+'} {abs(offset):.6g})"
        parts.append(f"{share / gain:.4g} {reading}")
    return " + ".join(parts)


def refusal_of_momentum(job: ExportJob, target: str, able: Iterable[str]) -> BadSetting:
    """What to raise for a target that has no momentum, with the q that comes nearest for the first channel.

    Args:
        job: An export with momentum.
        target: Its name.
        able: What has momentum.
    """
    channel = next(one for one in job.channels if one.momentum)
    nearest = nearest_without_momentum(channel)
    settled, wanted = job.steady(nearest), job.steady(channel)
    lag, before = (float(each.lag_samples) for each in (settled, wanted))
    slower = (
        f", and lags {lag_in_full(lag, job.sample_period)} behind a ramp instead of"
        f" {lag_in_full(before, job.sample_period)}"
        if math.isfinite(lag)
        else ""
    )
    return BadSetting(
        f"target must be a filter with momentum (got {target}, which has none, and a momentum of"
        f" {number(channel.momentum)} samples for {comment_text(channel.name)}). Export {', '.join(able)};"
        f" or set the momentum to 0 and q to {number_text(float(f'{nearest.q:.4g}'))}:"
        f" that reduces white noise as much, {decibels(-settled.noise_reduction_db)}{slower}"
    )
