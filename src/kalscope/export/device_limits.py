"""What a small board cannot do, reported before the export: float32 that stops changing, time, another rate."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, cast

import numpy as np

from kalscope.common.checks import above_zero
from kalscope.errors import BadSetting
from kalscope.export.float32 import STALLING_GAIN, float32_params
from kalscope.filtering.params import FilterParams
from kalscope.filtering.steady_state import steady_state

UNO_UPDATE_US = 120
"""Time of one update on an Uno, 16 MHz, µs: measured in simavr, avr-gcc 5.4 with -Os."""
UNO_FLASH = 7738
"""Bytes of flash of the exported sketch with one channel, of an Uno's 32,256; measured as above."""
UNO_RAM = 314
"""Bytes of RAM of the same, of an Uno's 2,048; the stack comes on top."""
UNO_READ_US = 112
"""Time of one analogRead() on an Uno, µs."""


FLOAT32_TARGETS = {"arduino": True, "platformio": False, "esphome": False, "bachagas": False}
"""Targets that compute in float32, at least on an AVR board; and whether they go on with a constant gain."""


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
        constant_gain: Whether the target goes on with a constant gain where float32 does not settle, as the
            exported Arduino code does.

    Returns:
        The limits that apply, none where the board runs the filter as shown.

    Raises:
        BadSetting: level or sample_period is not positive; `params` holds several channels.
    """
    if not (0.0 < level < math.inf):
        raise BadSetting(f"level must be a positive number in the unit of the signal (got {level})")
    if sample_period is not None:
        above_zero("sample_period", sample_period)
    if params.channels is not None:
        raise BadSetting(f"params must be those of one channel (got {params.channels} channels)")
    found = [_refused(params)]
    if found == [None]:
        found = [_gain(params, constant_gain=constant_gain), _estimate(params, level)]
    return tuple(limit for limit in (*found, _time(sample_period, channels)) if limit is not None)


def _refused(params: FilterParams) -> DeviceLimit | None:
    try:
        float32_params(params)
    except BadSetting as error:
        return DeviceLimit("refused", f"{error}. Scale the signal, or export to a target with double.")
    return None


def _gain(params: FilterParams, *, constant_gain: bool) -> DeviceLimit | None:
    gain = _settled(params)[0]
    if not 0.0 < gain < STALLING_GAIN:
        return None
    if constant_gain:
        then = (
            f"The exported code then goes on with exactly this gain, some {1.0 / gain:.2g} samples after the start."
        )
    else:
        then = "This target has no constant gain to go on with: use the code for arduino or c, or a larger q/r."
    return DeviceLimit(
        "gain",
        f"float32 cannot settle to a gain as small as {gain:.3g}: its variance stops changing too early. {then}",
    )


def _estimate(params: FilterParams, level: float) -> DeviceLimit | None:
    """A correction below half the distance of two floats is lost: x no longer moves."""
    gain, spread = _settled(params)
    half_ulp = float(np.spacing(np.float32(level))) / 2.0
    if gain * spread >= half_ulp:
        return None
    if gain > 0.0:
        where = f"the board's filtered value stands still while the signal is within {half_ulp / gain:.3g} of it"
    else:
        where = f"after {spread / half_ulp:.2g} samples the board's filtered value stands still"
    return DeviceLimit(
        "estimate",
        f"float32 steps by {2.0 * half_ulp:.2g} at {level:.4g}, more than a usual correction: {where}. Subtract "
        "the level before filtering, filter every n-th sample with n times q, or use a board with double.",
    )


def _settled(params: FilterParams) -> tuple[float, float]:
    """Settled gain, and the standard deviation of the innovation, unit: √s with s = r / (1 - K)."""
    gain = float(np.asarray(steady_state(params).gain))
    q, r = cast("float", params.q), cast("float", params.r)
    return gain, math.sqrt(q if gain == 1.0 else r / (1.0 - gain))


def _time(sample_period: float | None, channels: int) -> DeviceLimit | None:
    needed_us = channels * (UNO_UPDATE_US + UNO_READ_US)
    all_of_them = "one channel" if channels == 1 else f"{channels} channels"
    if sample_period is None or needed_us <= sample_period * 1e6:
        return None
    return DeviceLimit(
        "time",
        f"an Uno needs {needed_us} µs to read and filter {all_of_them}, more than "
        f"the sample period of {sample_period * 1e6:.4g} µs. Take fewer samples, with q multiplied by as much.",
    )
