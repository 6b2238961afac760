"""Which fused filter a command runs: that of a tuning file, or one estimated from the recording."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from kalscope.errors import BadSetting
from kalscope.filtering.params import FilterParams
from kalscope.recording import Recording
from kalscope.tuning.choose import Given, at_recording, rescaled
from kalscope.tuning.fused_channels import channels_to_fuse, for_each_sensor
from kalscope.tuning.fusion import FusionTuning
from kalscope.tuning.tuning import ChannelTuning, Tuning
from kalscope.tuning.tuning_file import load_tuning

FUSED = "fused"
"""Name of the fused value unless a tuning file gives another."""


@dataclass(frozen=True)
class FusionGiven:
    """What the options give for a fused filter."""

    names: str | None = None
    """The channels, as `channels_to_fuse` takes them; None = those of the tuning file."""
    r: Mapping[str, float] | float | None = None
    """Noise variance of every sensor, or of some of them, unit²; None = as found."""
    others: Given = field(default_factory=dict[str, Any])
    """q, p0, x0, gate and momentum, those that were given."""


def units_of(recording: Recording) -> dict[str, str]:
    """The unit of each channel, in order."""
    return dict(zip(recording.names, recording.units, strict=True))


def fusion_for(recording: Recording, config: Path | None, given: FusionGiven) -> tuple[FusionTuning, list[str]]:
    """Choose the filter that fuses channels of a recording.

    Args:
        recording: The recording to filter.
        config: Tuning file with a fusion, or None: q and r are estimated, unless they are given.
        given: What the options give; it overrides the file and the estimate.

    Returns:
        (fusion, notes): the filter at the sample period of the recording, and notes on the choice for the user.

    Raises:
        BadFile: `config` is not a tuning file.
        BadSetting: No such channels, or fewer than two; no fusion in the file; a recording that gives no filter; or
            a parameter out of its range.
    """
    if config is None:
        return _without_file(recording, given)
    tuning, fusion = _fusion_in(config, given)
    fusion, notes = _at_period(fusion, lambda one: at_recording(recording, one, given.others), tuning)
    here = [name for name in fusion.sensors if name in recording.names]
    if not here:
        raise BadSetting(
            f"the recording must have a channel of the fusion, {', '.join(fusion.sensors)} "
            f"(got {', '.join(recording.names)})"
        )
    if len(here) < len(fusion.sensors):
        absent = ", ".join(name for name in fusion.sensors if name not in here)
        notes.append(f"the recording has no channel {absent}: fused without")
    return _overridden(_only(fusion, here), given), notes


def fusion_for_stdin(
    config: Path | None, given: FusionGiven, period: float | None
) -> tuple[FusionTuning, list[str]]:
    """Choose the filter that fuses the columns of a stream without names; arguments and errors as `fusion_for`."""
    if config is None:
        raise BadSetting(
            '--fuse with SOURCE "-" needs --config with a fusion: kalscope tune LOG --fuse … -o FILE makes one'
        )
    tuning, fusion = _fusion_in(config, given)
    fusion, notes = _at_period(fusion, lambda one: rescaled(one, period, given.others), tuning)
    return _overridden(fusion, given), notes


def _at_period(
    fusion: FusionTuning, rescale: Callable[[Tuning], tuple[Tuning, list[str]]], tuning: Tuning
) -> tuple[FusionTuning, list[str]]:
    """The fusion as `rescale` makes it, which knows tunings of single channels; and its notes."""
    single = ChannelTuning(fusion.name, fusion.unit, fusion.q, 1.0, momentum=fusion.momentum)
    used, notes = rescale(replace(tuning, channels=(single,), selected="", fusion=None))
    return replace(fusion, q=used.channels[0].q, momentum=used.channels[0].momentum), notes


def _fusion_in(config: Path, given: FusionGiven) -> tuple[Tuning, FusionTuning]:
    """The tuning of a file, and its fusion, only of the sensors that were asked for."""
    tuning = load_tuning(config)
    if tuning.fusion is None:
        raise BadSetting(
            f"the tuning must hold a fusion (got channels {', '.join(one.name for one in tuning.channels)} alone): "
            "kalscope tune LOG --fuse … -o FILE makes one"
        )
    if given.names is None:
        return tuning, tuning.fusion
    sensors = dict.fromkeys(tuning.fusion.sensors, tuning.fusion.unit)
    return tuning, _only(tuning.fusion, channels_to_fuse(sensors, given.names))


def _only(fusion: FusionTuning, names: Sequence[str]) -> FusionTuning:
    """The fusion of some of its sensors."""
    at = [fusion.sensors.index(name) for name in names]
    r, offset, gain = (tuple(values[i] for i in at) for values in (fusion.r, fusion.offset, fusion.gain))
    return replace(fusion, sensors=tuple(names), r=r, offset=offset, gain=gain)


def _overridden(fusion: FusionTuning, given: FusionGiven) -> FusionTuning:
    """The fusion with the parameters that were given."""
    r = fusion.r
    if given.r is not None:
        named = for_each_sensor(fusion.sensors, "--r", given.r)
        r = tuple(old if math.isnan(new) else new for old, new in zip(r, named, strict=True))
    values: dict[str, Any] = dict(given.others)
    return replace(fusion, r=r, **values)


def _without_file(recording: Recording, given: FusionGiven) -> tuple[FusionTuning, list[str]]:
    """The filter as given where q and every r are, else by maximum likelihood."""
    units = units_of(recording)
    names = channels_to_fuse(units, given.names or "")
    r = (math.nan,) * len(names) if given.r is None else for_each_sensor(names, "--r", given.r)
    if "q" in given.others and not any(map(math.isnan, r)):
        whole: dict[str, Any] = dict(given.others)
        return FusionTuning(FUSED, units[names[0]], names, r=r, **whole), []
    fusion = _estimated(recording, names, r, given.others.get("momentum"))
    return _overridden(fusion, given), [f"{FUSED}: {_variances(fusion)}, by maximum likelihood"]


def _estimated(
    recording: Recording, names: tuple[str, ...], r: tuple[float, ...], momentum: float | None
) -> FusionTuning:
    from kalscope.estimation.fusion.estimate_fusion import estimate_fusion

    found = estimate_fusion(
        recording.values[:, [recording.index(name) for name in names]],
        dt=recording.steps() if recording.gaps == "dt" else None,
        names=names,
        momentum="auto" if momentum is None else momentum,
        known_r=np.array(r),
    )
    if found.params is None:
        raise BadSetting(
            f"a fusion needs a usable q and r of each sensor, and the record gives none: {found.message}"
        )
    return fusion_tuning(found.params, names, units_of(recording)[names[0]], "maximum likelihood")


def fusion_tuning(params: FilterParams, names: tuple[str, ...], unit: str, how: str) -> FusionTuning:
    """Parameters as a tuning holds them."""
    columns = {"r": params.sensor_r, "offset": params.offset, "gain": params.gain}
    each = {name: tuple(column.tolist()) for name, column in columns.items()}
    whole = {name: getattr(params, name) for name in ("q", "p0", "x0", "gate", "momentum")}
    return FusionTuning(FUSED, unit, names, **each, **whole, how=how)


def _variances(fusion: FusionTuning) -> str:
    """The variances in a few words."""
    r = ", ".join(f"{name} {value:.6g}" for name, value in zip(fusion.sensors, fusion.r, strict=True))
    return f"q = {fusion.q:.6g}, r of {r}"
