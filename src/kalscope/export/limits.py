"""What a small board cannot do, reported before the export: float32 that stops changing, lack of time."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from kalscope.common.numbers import above_zero
from kalscope.errors import BadSetting
from kalscope.export.float32 import STALLING_GAIN, float32_tuning, runs_kalman
from kalscope.filtering.classic import Butterworth, Exponential, Median, MovingAverage, OneEuro, Stage
from kalscope.filtering.params import FilterParams
from kalscope.filtering.steady import steady_state
from kalscope.tuning.tuning import ChannelTuning

# Times on an Uno at 16 MHz, µs, measured in simavr with avr-gcc 5.4 -Os; of two the second is with momentum.

UPDATE_US = 115, 317
"""An update of one channel; with momentum also where only a channel beside it has it."""
FUSION_US, PREDICT_US = (113, 199), (0, 124)
"""An update of a fusion: for each sensor, and once a row."""
GAIN_US = 29
"""For each sensor where one has a gain."""
CLASSIC_US: dict[type[Stage], int] = {
    MovingAverage: 88,
    Exponential: 80,
    Median: 2,
    Butterworth: 163,
    OneEuro: 240,
}
"""An update of a classic filter, to 10 %; the time of a median comes on top."""
MEDIAN_US, MEDIAN_SAMPLE_US = 30, 4.0
"""A median, and about each sample of its window."""
READ_US = 112
"""One analogRead()."""

COUNTS = frozenset(("count", "counts", "lsb", "lsbs", "adc", "adu", "digit", "digits", "raw"))
"""Units of what analogRead() returns."""


def tuning_limits(
    filters: Sequence[ChannelTuning],
    *,
    levels: Iterable[float],
    sample_period: float | None = None,
    constant_gain: bool = True,
) -> list[str]:
    """The limits of the filters of a board that computes in float32, a sentence or two each.

    Args:
        filters: The channels, or one filter that fuses sensors.
        levels: Largest size of the signal of each, or of what each sensor reads, in its unit, > 0: 1023 for
            counts of an Uno.
        sample_period: s; None = unknown, then time is not checked.
        constant_gain: Whether the target continues with a constant gain where float32 does not settle, as the
            exported Arduino code does for channels.

    Raises:
        BadSetting: A level or the sample period is not positive.
    """
    found: list[str] = []
    remaining, inputs = iter(levels), sum(one.params.sensors for one in filters)
    for one in filters:
        level = max(
            above_zero("level", size) / abs(gain)
            for gain, size in zip(one.params.gain.tolist(), remaining, strict=False)
        )
        try:
            float32_tuning(one)
        except BadSetting as error:
            found.append(f"{error}. Scale the signal, or export to a target with double.")
            continue
        if runs_kalman(one):
            instead = _NO_CONSTANT_OF_FUSION if one.sensors else "" if constant_gain else _NO_CONSTANT
            found += _stalls(one.params.as_single, level, instead)
    needed = sum(update_us(one, filters) for one in filters) + inputs * READ_US
    if sample_period is not None and needed > 1e6 * above_zero("sample_period", sample_period):
        work = f"fuse {inputs} sensors" if filters[0].sensors else f"filter {inputs} channels"
        has_chain = any(one.chain is not None for one in filters)
        then = "and export for that period" if has_chain else "with q multiplied by as much"
        found.append(
            f"an Uno needs {needed:g} µs to read and {'filter one channel' if inputs == 1 else work}, more than"
            f" the sample period of {sample_period * 1e6:.4g} µs. Take fewer samples, {then}."
        )
    return found


def update_us(one: ChannelTuning, beside: Iterable[ChannelTuning] = ()) -> float:
    """Time of one update of a channel or a fusion on an Uno, about, µs; `beside` are all channels of its export."""
    momentum = any(each.momentum and runs_kalman(each) for each in (one, *beside))
    if one.sensors:
        gain = GAIN_US if one.has_gains else 0
        return len(one.sensors) * (FUSION_US[momentum] + gain) + PREDICT_US[momentum]
    stages = () if one.chain is None else one.chain.stages
    windows = [stage.window for stage in stages if isinstance(stage, Median) and stage.window > 1]
    medians = sum(MEDIAN_US + MEDIAN_SAMPLE_US * window for window in windows)
    last = None if one.chain is None else one.chain.then
    return medians + (UPDATE_US[momentum] if last is None else CLASSIC_US[type(last)])


def not_in_counts(channels: Iterable[ChannelTuning]) -> list[ChannelTuning]:
    """The filters in a unit such as g or V, which analogRead() does not return; an unknown unit may be counts."""
    return [one for one in channels if one.unit and COUNTS.isdisjoint(re.findall(r"[^\W\d_]+", one.unit.lower()))]


_NO_CONSTANT = "This target has no constant gain to continue with: use the code for arduino or c, or a larger q/r."
_NO_CONSTANT_OF_FUSION = "A fusion has no constant gain to continue with: export c, in double, or take a larger q."


def _stalls(params: FilterParams, level: float, instead: str) -> Iterator[str]:
    """A gain that float32 does not settle to, and an estimate that stops moving.

    A correction below half the distance of two floats is lost: x no longer moves. With momentum the velocity
    collects what single corrections lose: a lasting innovation i drives it to τ L i.

    Args:
        params: Those of one sensor.
        level: Largest size of its signal, unit.
        instead: What helps; "" = the code continues with a constant gain.
    """
    steady, r = steady_state(params), float(params.r)
    gain = float(steady.gain)
    if 0.0 < gain < STALLING_GAIN:
        settled = f"some {1.0 / gain:.2g} samples after the start."
        yield (
            f"float32 cannot settle to a gain as small as {gain:.3g}: its variance stops changing too early."
            f" {instead or f'The exported code then continues with exactly this gain, {settled}'}"
        )
    spread = math.sqrt(params.q if gain == 1.0 else r / (1.0 - gain))  # of the innovation: s = r / (1 - K)
    gain = max(gain, params.momentum * float(steady.velocity_gain))
    half_ulp = float(np.spacing(np.float32(level))) / 2.0
    if gain * spread >= half_ulp:
        return
    if gain > 0.0:
        where = f"the board's filtered value does not move while the signal is within {half_ulp / gain:.3g} of it"
    else:
        where = f"after {spread / half_ulp:.2g} samples the board's filtered value stops moving"
    yield (
        f"float32 steps by {2.0 * half_ulp:.2g} at {level:.4g}, more than a usual correction: {where}. Subtract "
        "the level before filtering, filter every n-th sample with n times q, or use a board with double."
    )
