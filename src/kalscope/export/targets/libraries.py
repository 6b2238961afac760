"""Settings for filters of other projects, and the libraries whose Kalman filter is a different one."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from kalscope.common.text import decibels, lag_in_full, number
from kalscope.errors import BadSetting
from kalscope.export.job import ExportJob, about, about_channel, chain_words, commented, fill_template
from kalscope.export.names import comment_text, number_text
from kalscope.filtering.classic import Chain, Exponential, MovingAverage
from kalscope.filtering.params import MAX_VARIANCE
from kalscope.filtering.steady import ratio_for, steady_state
from kalscope.tuning.tuning import ChannelTuning

# The nearest filter without momentum, for libraries that have only the five lines.


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


def refusal_of_fusion(job: ExportJob, target: str, able: Iterable[str]) -> BadSetting:
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
    if chain.median > 1 or not isinstance(last, Exponential | MovingAverage):
        return ""
    if isinstance(last, MovingAverage):
        code = f"sliding_window_moving_average: {{window_size: {last.window}, send_every: 1}}"
    else:
        code = f"exponential_moving_average: {{alpha: {last.constants[0]!r}, send_every: 1}}"
    return (
        f"; or give the sensor ESPHome's own filter, equal except for rounding while no sample is missing: {code}"
    )


def _mean_text(fusion: ChannelTuning) -> str:
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


# Libraries whose filter is called Kalman but is a different one: refused, with the nearest fixed gain instead.


MAX_CHANNELS_SHOWN = 4
"""Channels whose code the message gives: it is one line."""

OTHER_FILTERS = {
    "simplekalmanfilter": ("SimpleKalmanFilter", "{name} += {gain} * (z - {name})"),
    "gyverfilters": ("GKalman of GyverFilters", "GFilterRA {name}({gain}) (starts at 0)"),
}
"""Libraries in which q and r mean something else: the name of their filter, and code for exponential smoothing with
α = K, which our filter settles into (GFilterRA is the other filter of GyverFilters)."""


def refusal_of_other_filter(job: ExportJob, target: str, able: Iterable[str]) -> BadSetting:
    """What to raise for one of these libraries, with the nearest code for each channel.

    Args:
        job: The export.
        target: A name of `OTHER_FILTERS`.
        able: What holds chains.
    """
    if job.has_chain:
        return refusal_of_chain(job, target, able)
    lines: list[str] = []
    filter_name, nearest = OTHER_FILTERS[target]
    for name, channel in job.as_single.named_channels[:MAX_CHANNELS_SHOWN]:
        gain = float(job.steady(nearest_without_momentum(channel)).gain)
        code = nearest.format(name=name, gain=number_text(float(f"{gain:.6g}")))
        lines.append(f"{comment_text(channel.name)}: {code if gain > 0.0 else 'none, because q is 0 (a mean)'}")
    more = len(job.channels) - MAX_CHANNELS_SHOWN
    return BadSetting(
        f"target must use q and r as Kalscope does (got {filter_name}: its q multiplies the size of the"
        " last step, |x - x before|, and it starts at 0, so these values would give a different filter)."
        f" Export arduino or c, or use the nearest fixed gain: {'; '.join(lines)}"
        f"{f'; and {more} more channels' if more > 0 else ''}"
    )


# bachagas/Kalman.h: the same five lines, so its constructor takes the numbers unchanged.
#
# Its own code supports neither missing samples nor an automatic start nor a gate; a short function adds them.


def bachagas_files(job: ExportJob) -> dict[str, str]:
    """`kalscope_bachagas.h`, C++ as the Arduino compiles it."""
    channels = "\n".join(_channel(job, *pair) for pair in job.named_channels)
    text = fill_template("libraries/kalscope_bachagas.h", about=commented(about(job), "//"), channels=channels)
    return {"kalscope_bachagas.h": text}


def _channel(job: ExportJob, word: str, channel: ChannelTuning) -> str:
    p0 = number_text(channel.p0, "INFINITY")
    x0 = number_text(channel.x0, "NAN")
    gate = number_text(channel.gate, "INFINITY")
    init = f"kalman_init({number_text(channel.q)}, {number_text(channel.r)}, {p0}, {x0})"
    return (
        commented(about_channel(job, channel), "//")
        + f"static kalscope_channel kalscope_filter_{word} = {{{init}, {gate}, 0}};\n"
    )


# ESPHome: a Kalman combination sensor, which takes standard deviations, the process noise per √second.
#
# Its component (esphome/components/combination) adds process_std_dev² to the variance per second of the board's
# clock, and computes in float32.


_SENSOR = """\
{about}  - platform: combination
    type: kalman
    id: {word}
    name: {name}
    process_std_dev: {process}
    sources:
{sources}"""
_SOURCE = """\
      - source: {source}{remark}
        error: {error}
"""
_SCALED = """\
  - platform: copy
    source_id: {word}  # id of your raw sensor
    id: {word}_scaled
    filters:
      - offset: {offset}
      - multiply: {factor}
"""
_RAW = "  # id of your raw sensor"


def esphome_files(job: ExportJob) -> dict[str, str]:
    """`kalscope_esphome.yaml`: a Kalman combination sensor for each channel, or one of all sensors that are fused.

    Raises:
        BadSetting: The sample period is unknown, or float32 cannot hold the variances.
    """
    sensors = "".join(_combination(job, *named) for named in job.named_channels)
    text = fill_template("libraries/kalscope_esphome.yaml", about=commented(about(job), "#"), sensors=sensors)
    return {"kalscope_esphome.yaml": text}


def _combination(job: ExportJob, word: str, one: ChannelTuning) -> str:
    """One filter; a copy scales each sensor that does not read x itself."""
    if job.sample_period is None:
        raise BadSetting(
            "sample_period of the tuning must be known for ESPHome, which counts q per second (got none)"
        )
    process = math.sqrt(one.q) / math.sqrt(job.sample_period)  # q/T alone might overflow
    _check("q", one.name, one.q, process, 0.001)
    scaled, sources = "", ""
    words = job.sensor_identifiers if one.sensors else (word,)
    each = zip(
        words, one.params.scaled_r.tolist(), one.params.offset.tolist(), one.params.gain.tolist(), strict=True
    )
    for name, r, offset, gain in each:
        is_raw = offset == 0.0 and gain == 1.0
        if not is_raw:
            scaled += _SCALED.format(word=name, offset=number_text(-offset), factor=number_text(1.0 / gain))
        error = math.sqrt(r)
        _check("r", name if one.sensors else one.name, r, error, 1.0)
        source, remark = (name, _RAW) if is_raw else (f"{name}_scaled", "")
        sources += _SOURCE.format(source=source, remark=remark, error=number_text(error))
    ending = "" if one.sensors else " filtered"
    return scaled + _SENSOR.format(
        about=commented(about_channel(job, one), "  #"),
        word=word + ending.replace(" ", "_"),
        name=f'"{comment_text(one.name, 40)}{ending}"',  # harmless: "${…}" would be substituted
        process=number_text(process),
        sources=sources,
    )


def _check(name: str, owner: str, variance: float, deviation: float, factor: float) -> None:
    """Refuse a variance that float32 loses; `factor` is what ESPHome multiplies it by."""
    with np.errstate(over="ignore", under="ignore"):
        held = float(np.float32(deviation) * np.float32(deviation) * np.float32(factor))
    smallest, largest = float(np.finfo(np.float32).tiny), float(np.finfo(np.float32).max)
    if deviation > 0.0 and not smallest <= held <= largest:
        raise BadSetting(
            f"{name} must be a variance that float32 holds, for ESPHome (got {variance!r} of"
            f" {comment_text(owner)}, {deviation * min(deviation, sys.float_info.max) * factor:.3g} inside)"
        )


# kalmanjs: the same filter, but it calls the process noise R and the measurement noise Q.
#
# Its gain is p·(1/s) and its variance p − k·p, so it agrees to the last digits, not in every bit.


MIN_INNOVATION_VARIANCE = 1e-300
"""Smallest q + r: kalmanjs divides 1 by the variance of the innovation."""


def kalmanjs_files(job: ExportJob) -> dict[str, str]:
    """`kalscope_kalmanjs.mjs`.

    Raises:
        BadSetting: q + r is too small for its division.
    """
    filters = "".join(_entry(job, *pair) for pair in job.named_channels)
    text = fill_template("libraries/kalscope_kalmanjs.mjs", about=commented(about(job), "//"), filters=filters)
    return {"kalscope_kalmanjs.mjs": text}


def _entry(job: ExportJob, word: str, channel: ChannelTuning) -> str:
    if channel.q + channel.r < MIN_INNOVATION_VARIANCE:
        raise BadSetting(
            f"q + r must be at least {MIN_INNOVATION_VARIANCE:g} for kalmanjs, which divides by it"
            f" (got {channel.q + channel.r:g} of {comment_text(channel.name)})"
        )
    x0 = number_text(channel.x0, "NaN")
    p0 = number_text(channel.p0, "NaN")
    gate = number_text(channel.gate, "Infinity")
    made = f"new KalmanFilter({{R: {number_text(channel.q)}, Q: {number_text(channel.r)}}})"
    state = f"{{x: {x0}, cov: {p0}, gate: {gate}, refused: 0}}"
    return commented(about_channel(job, channel), "  //") + f'  "{word}": Object.assign({made}, {state}),\n'
