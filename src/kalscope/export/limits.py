"""What a small board cannot do, reported before the export: float32 that stops changing, lack of time."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from kalscope.common.numbers import above_zero
from kalscope.errors import BadSetting
from kalscope.export.float32 import STALLING_GAIN, float32_params, float32_tuning, runs_kalman
from kalscope.filtering.classic import Butterworth, Exponential, Median, MovingAverage, OneEuro, PowerOfTwo, Stage
from kalscope.filtering.params import FilterParams, require_one_sensor
from kalscope.filtering.steady import steady_state
from kalscope.tuning.tuning import ChannelTuning


@dataclass(frozen=True)
class Cost:
    """What the exported sketch with one channel needs on an Uno: measured in simavr, avr-gcc 5.4 with -Os."""

    update_us: float
    """Time of one update at 16 MHz, µs."""
    flash: int
    """Bytes of flash, of 32,256."""
    ram: int
    """Bytes of RAM, of 2,048; the stack comes on top."""


UNO = Cost(update_us=115, flash=7738, ram=314)
"""The five lines."""
UNO_WITH_MOMENTUM = Cost(update_us=317, flash=9916, ram=386)
"""The filter with momentum, also in a channel without it beside one that has it."""
UNO_FIXED_US, UNO_FIXED_WITH_MOMENTUM_US = 34, 70
"""Time of one update with fixed gains, µs."""
UNO_MEASURING = Cost(update_us=496, flash=15092, ram=494)
"""The five lines in a sketch that measures r; the time is that of an update while it measures."""
UNO_FUSION = Cost(update_us=113, flash=5152, ram=317)
"""A fusion: the time for each sensor; the others for three of them."""
UNO_FUSION_WITH_MOMENTUM = Cost(update_us=199, flash=5942, ram=385)
"""The same with momentum."""
UNO_FUSION_PREDICT_US = 124
"""Time that momentum takes once a row, µs."""
UNO_GAIN_US = 29
"""Time for each sensor where one has a gain, µs."""
_EXPONENTIAL = Cost(update_us=80, flash=4388, ram=232)
UNO_CLASSIC: dict[type[Stage], Cost] = {
    MovingAverage: Cost(update_us=88, flash=4972, ram=244),
    Exponential: _EXPONENTIAL,
    PowerOfTwo: _EXPONENTIAL,
    Median: Cost(update_us=2, flash=4640, ram=226),
    Butterworth: Cost(update_us=163, flash=4690, ram=256),
    OneEuro: Cost(update_us=240, flash=5064, ram=256),
}
"""Classic filters, a power of two in floats as well: time to 10 %. Windows and the time of a median come on top."""
UNO_MEDIAN_US, UNO_MEDIAN_SAMPLE_US = 30, 4.0
"""Time that a median takes, and about that of each sample of its window, µs."""
UNO_READ_US = 112
"""Time of one analogRead() on an Uno, µs."""

COUNTS = frozenset(("count", "counts", "lsb", "lsbs", "adc", "adu", "digit", "digits", "raw"))
"""Units of what analogRead() returns."""


@dataclass(frozen=True)
class DeviceLimit:
    """One thing that differs on the board."""

    kind: Literal["refused", "gain", "estimate", "time"]
    """"refused": float32 cannot hold a value; "gain": the export uses a constant gain once settled; "estimate":
    the filtered value stops short of the signal; "time": an Uno is too slow."""
    message: str
    """One or two sentences: what happens, and what helps."""


def device_limits(
    params: FilterParams,
    *,
    level: float,
    sample_period: float | None = None,
    channels: int = 1,
    constant_gain: bool = True,
) -> tuple[DeviceLimit, ...]:
    """The limits of this filter on a board that computes in float32.

    Args:
        params: The parameters of one channel.
        level: Largest size of the signal, unit, > 0: 1023 for counts of an Uno.
        sample_period: s; None = unknown, then time is not checked.
        channels: How many such filters the board runs.
        constant_gain: Whether the target continues with a constant gain where float32 does not settle, as the
            exported Arduino code does.

    Returns:
        The limits that apply, none where the board runs the filter as shown.

    Raises:
        BadSetting: level or sample_period is not positive; `params` are not those of one sensor.
    """
    if not (0.0 < level < math.inf):
        raise BadSetting(f"level must be a positive number in the unit of the signal (got {level})")
    if sample_period is not None:
        above_zero("sample_period", sample_period)
    require_one_sensor(params)
    found = [_refused(params)]
    if found == [None]:
        found = [_gain(params, "" if constant_gain else _NO_CONSTANT), _estimate(params, level)]
    cost = UNO_WITH_MOMENTUM if params.momentum else UNO
    time = _time(channels * cost.update_us, sample_period, channels)
    return tuple(limit for limit in (*found, time) if limit is not None)


def tuning_limits(
    channels: Sequence[ChannelTuning],
    *,
    levels: Sequence[float],
    sample_period: float | None = None,
    constant_gain: bool = True,
) -> tuple[DeviceLimit, ...]:
    """The limits of all channels of a board, whatever filters they have, or of one filter that fuses.

    Args:
        channels: The filters.
        levels: Largest size of the signal of each, or of what each sensor reads, in its unit, > 0.
        sample_period: s, > 0; None = unknown, then time is not checked.
        constant_gain: As in `device_limits`.
    """
    if channels[0].sensors:
        return _fusion_limits(channels[0], levels, sample_period)
    found: list[DeviceLimit] = []
    for channel, level in zip(channels, levels, strict=True):
        if runs_kalman(channel):
            found += device_limits(channel.params, level=level, constant_gain=constant_gain)
            continue
        try:
            float32_tuning(channel)
        except BadSetting as error:
            found.append(_refusal(error))
    again = "" if all(one.chain is None for one in channels) else "and export for that period"
    time = _time(sum(update_us(one, channels) for one in channels), sample_period, len(channels), again)
    return tuple(found) if time is None else (*found, time)


def update_us(channel: ChannelTuning, beside: Iterable[ChannelTuning] = ()) -> float:
    """Time of one update of a channel on an Uno, about, µs; `beside` are all channels of its export."""
    stages = () if channel.chain is None else channel.chain.stages
    windows = [stage.window for stage in stages if isinstance(stage, Median) and stage.window > 1]
    medians = sum(UNO_MEDIAN_US + UNO_MEDIAN_SAMPLE_US * window for window in windows)
    if channel.chain is not None and channel.chain.then is not None:
        return medians + UNO_CLASSIC[type(channel.chain.then)].update_us
    momentum = any(one.momentum and runs_kalman(one) for one in (channel, *beside))
    return medians + (UNO_WITH_MOMENTUM if momentum else UNO).update_us


def _fusion_limits(
    fusion: ChannelTuning, levels: Sequence[float], sample_period: float | None
) -> tuple[DeviceLimit, ...]:
    try:
        float32_params(fusion.params)
    except BadSetting as error:
        return (_refusal(error),)
    scaled = (level / abs(gain) for level, gain in zip(levels, fusion.gain, strict=True))
    # Settled it is the filter of one reading, so what float32 cannot hold of that one it cannot hold of this one.
    single = fusion.params.as_single
    found = (
        _gain(single, _NO_CONSTANT_OF_FUSION),
        _estimate(single, max(scaled)),
        _too_slow(fusion_us(fusion) + len(levels) * UNO_READ_US, f"fuse {len(levels)} sensors", sample_period),
    )
    return tuple(limit for limit in found if limit is not None)


def fusion_us(fusion: ChannelTuning) -> float:
    """Time of one update of a fusion, all sensors, on an Uno, µs."""
    cost = UNO_FUSION_WITH_MOMENTUM if fusion.momentum else UNO_FUSION
    each = cost.update_us + (UNO_GAIN_US if fusion.has_gains else 0)
    return len(fusion.sensors) * each + (UNO_FUSION_PREDICT_US if fusion.momentum else 0)


def not_in_counts(channels: Iterable[ChannelTuning]) -> list[ChannelTuning]:
    """The filters in a unit such as g or V, which analogRead() does not return; an unknown unit may be counts."""
    return [one for one in channels if one.unit and COUNTS.isdisjoint(re.findall(r"[^\W\d_]+", one.unit.lower()))]


def _refused(params: FilterParams) -> DeviceLimit | None:
    try:
        float32_params(params)
    except BadSetting as error:
        return _refusal(error)
    return None


def _refusal(error: BadSetting) -> DeviceLimit:
    return DeviceLimit("refused", f"{error}. Scale the signal, or export to a target with double.")


_NO_CONSTANT = "This target has no constant gain to continue with: use the code for arduino or c, or a larger q/r."
_NO_CONSTANT_OF_FUSION = "A fusion has no constant gain to continue with: export c, in double, or take a larger q."


def _gain(params: FilterParams, instead: str) -> DeviceLimit | None:
    """A gain that float32 does not settle to; `instead` says what helps, "" where the code uses a constant gain."""
    gain = _settled(params)[0]
    if not 0.0 < gain < STALLING_GAIN:
        return None
    then = (
        instead
        or "The exported code then continues with exactly this gain, "
        f"some {1.0 / gain:.2g} samples after the start."
    )
    return DeviceLimit(
        "gain",
        f"float32 cannot settle to a gain as small as {gain:.3g}: its variance stops changing too early. {then}",
    )


def _estimate(params: FilterParams, level: float) -> DeviceLimit | None:
    """A correction below half the distance of two floats is lost: x no longer moves.

    With momentum the velocity collects what single corrections lose: a lasting innovation i drives it to τ L i.
    """
    gain, spread = _settled(params)
    gain = max(gain, params.momentum * float(np.asarray(steady_state(params).velocity_gain)))
    half_ulp = float(np.spacing(np.float32(level))) / 2.0
    if gain * spread >= half_ulp:
        return None
    if gain > 0.0:
        where = f"the board's filtered value does not move while the signal is within {half_ulp / gain:.3g} of it"
    else:
        where = f"after {spread / half_ulp:.2g} samples the board's filtered value stops moving"
    return DeviceLimit(
        "estimate",
        f"float32 steps by {2.0 * half_ulp:.2g} at {level:.4g}, more than a usual correction: {where}. Subtract "
        "the level before filtering, filter every n-th sample with n times q, or use a board with double.",
    )


def _settled(params: FilterParams) -> tuple[float, float]:
    """Settled gain, and the standard deviation of the innovation, unit: √s with s = r / (1 - K)."""
    gain = float(np.asarray(steady_state(params).gain))
    q, r = params.q, float(params.r)
    return gain, math.sqrt(q if gain == 1.0 else r / (1.0 - gain))


def _time(filtering_us: float, sample_period: float | None, channels: int, then: str = "") -> DeviceLimit | None:
    all_of_them = "one channel" if channels == 1 else f"{channels} channels"
    return _too_slow(filtering_us + channels * UNO_READ_US, f"filter {all_of_them}", sample_period, then)


def _too_slow(needed_us: float, work: str, sample_period: float | None, then: str = "") -> DeviceLimit | None:
    """The time that is missing; `then` says what fewer samples need, "" = another q."""
    if sample_period is None or needed_us <= sample_period * 1e6:
        return None
    then = then or "with q multiplied by as much"
    return DeviceLimit(
        "time",
        f"an Uno needs {needed_us:g} µs to read and {work}, more than "
        f"the sample period of {sample_period * 1e6:.4g} µs. Take fewer samples, {then}.",
    )
