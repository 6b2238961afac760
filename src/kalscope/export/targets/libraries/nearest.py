"""The nearest filter without momentum, for libraries that have only the five lines."""

from __future__ import annotations

import math
from dataclasses import replace

from kalscope.common.text import decibels, lag_in_full, number
from kalscope.errors import BadSetting
from kalscope.export.job import ExportJob
from kalscope.export.names import comment_text, number_text
from kalscope.filtering.params import MAX_VARIANCE
from kalscope.filtering.steady_state import ratio_for, steady_state
from kalscope.tuning.tuning import ChannelTuning

LARGEST_RATIO = 1e15
"""q/r that stands for no noise reduction at all: the gain is 1 to fifteen digits."""


def nearest_without_momentum(channel: ChannelTuning) -> ChannelTuning:
    """The same r with the q of the five lines that reduce white noise as much once settled; they lag more.

    Equal noise rather than equal lag: a long momentum follows a ramp almost without lag, and the five lines that
    do so hardly filter.
    """
    if channel.momentum == 0.0 or channel.r == 0.0 or channel.q == 0.0:
        return replace(channel, momentum=0.0)
    decibel = float(steady_state(channel.params).noise_reduction_db)
    ratio = min(ratio_for(noise_reduction_db=decibel), LARGEST_RATIO) if decibel > 0.0 else LARGEST_RATIO
    return replace(channel, q=min(ratio * channel.r, MAX_VARIANCE), momentum=0.0)


def require_no_momentum(job: ExportJob, target: str) -> None:
    """BadSetting for the first channel that `target` cannot run, with the q that comes nearest."""
    for channel in job.channels:
        if channel.momentum == 0.0:
            continue
        nearest = nearest_without_momentum(channel)
        settled, wanted = job.steady(nearest), job.steady(channel)
        lag, before = (float(each.lag_samples) for each in (settled, wanted))
        slower = (
            f", and lags {lag_in_full(lag, job.sample_period)} behind a ramp instead of"
            f" {lag_in_full(before, job.sample_period)}"
            if math.isfinite(lag)
            else ""
        )
        raise BadSetting(
            f"target must be a filter with momentum (got {target}, which has none, and a momentum of"
            f" {number(channel.momentum)} samples for {comment_text(channel.name)}). Export arduino, c,"
            " python, javascript, matlab or ros2; or set the momentum to 0 and q to"
            f" {number_text(float(f'{nearest.q:.4g}'))}: that reduces white noise as much,"
            f" {decibels(-float(settled.noise_reduction_db))}{slower}"
        )
