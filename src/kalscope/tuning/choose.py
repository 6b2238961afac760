"""Which filter a command runs: that of its options, of a tuning file, or an estimate."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from kalscope.common.text import first_sentence, unused_name
from kalscope.errors import BadSetting
from kalscope.estimation.request import Noise, Request, find_parameters
from kalscope.filtering.classic import Chain
from kalscope.recording import Recording
from kalscope.tuning.file import load_tuning
from kalscope.tuning.tuning import ChannelTuning, Tuning, same_period

# Which channels of a recording are fused, and what is known of each: texts such as "a,b,c" and "a=4,b=9".


MAX_NAMED = 24
"""Channels that a refusal names; a car sends hundreds."""


def channels_to_fuse(units: Mapping[str, str], text: str, *, mixed_units: bool = False) -> tuple[str, ...]:
    """The channels that `text` names, by their names or their numbers from 1, with commas between them.

    Args:
        units: the unit of every channel there is, "" where unknown, in order.
        text: what a user typed. A name with a comma can only be given by its number.
        mixed_units: whether the units may differ: the gains of the sensors are estimated too.

    Raises:
        BadSetting: fewer than two, an unknown one, one twice, or two units.
    """
    must = f"--fuse must be two or more channels of one unit, of {', '.join(list(units)[:MAX_NAMED])}"
    names = tuple(
        _channel(tuple(units), cell, f"{must} (got {cell!r}, which is not a channel)") for cell in _cells(text)
    )
    if len(names) < 2 or len(set(names)) < len(names):
        raise BadSetting(f"{must} (got {text!r})")
    if not mixed_units and len({units[name] for name in names}) > 1:
        each = ", ".join(f"{name} in {units[name]}" if units[name] else f"{name} without a unit" for name in names)
        raise BadSetting(
            f"fused channels must have one unit (got {each}); channels that measure one quantity in different "
            "units can be fused with --sensor-gains and --reference"
        )
    return names


def sensor_named(sensors: Sequence[str], option: str, text: str) -> str:
    """The sensor of this name, or of this number from 1 among them; BadSetting names the choices."""
    return _channel(sensors, text, f"{option} must be a sensor of --fuse: {', '.join(sensors)} (got {text!r})")


def for_each_sensor(sensors: Sequence[str], option: str, given: Mapping[str, float] | float) -> tuple[float, ...]:
    """The number of an option such as `--r 4` or `--r a=4,b=9` for each sensor; NaN where it names none for it.

    Raises:
        BadSetting: a name that is not one of the sensors.
    """
    if not isinstance(given, Mapping):
        return (given,) * len(sensors)
    by_name = {sensor_named(sensors, option, name): value for name, value in given.items()}
    return tuple(by_name.get(name, math.nan) for name in sensors)


def named_numbers(text: str, number: Callable[[str], float]) -> dict[str, float]:
    """The numbers of "a=4,b=9" by their names, in order; {} where the text has another form.

    Args:
        text: what a user typed.
        number: reads one of them; may raise.
    """
    pairs = [cell.rpartition("=") for cell in _cells(text)]
    names = [name.strip() for name, _, _ in pairs]
    if not all(names) or len(set(names)) < len(names):
        return {}
    return {name: number(value) for name, (_, _, value) in zip(names, pairs, strict=True)}


def _cells(text: str) -> list[str]:
    return [cell.strip() for cell in text.split(",")]


def _channel(names: Sequence[str], text: str, refusal: str) -> str:
    """The channel of this name, else of this number from 1."""
    if text in names:
        return text
    if text.isdecimal() and 1 <= int(text) <= len(names):
        return names[int(text) - 1]
    raise BadSetting(refusal)


# Which filter a command runs: its options, the tuning file, or what the signal determines, in this order.


Given = dict[str, Any]
"""Fields of ChannelTuning by name, those that were given: floats, None for an automatic start, a Chain; r of a
fusion as `for_each_sensor` takes it."""


def name_of_fused(recording: Recording) -> str:
    """What the fused value is called: a name that no channel has."""
    return unused_name("fused", set(recording.names), " ")


def units_of(recording: Recording) -> dict[str, str]:
    """The unit of each channel, in order."""
    return dict(zip(recording.names, recording.units, strict=True))


def filters_for(
    recording: Recording | None,
    config: Path | None,
    given: Given,
    channel: str | None = None,
    fuse: str | None = None,
    period: float | None = None,
) -> tuple[list[ChannelTuning], list[str]]:
    """Choose the filter of each channel of a recording, or the one that fuses several.

    Args:
        recording: The recording to filter; None = a stream without names: without `config` one filter for all
            columns, else one per column, in the order of the file, or the one that fuses all of them.
        config: Tuning file, or None. Its q is rescaled to the recording's sample period.
        given: Parameters that override it, by name; None is an automatic start.
        channel: The only channel to filter; None = the fusion of the file, or all where it has none.
        fuse: The channels to fuse, as `channels_to_fuse` takes them; None = those that the file fuses.
        period: Sample period of a stream, s.

    Returns:
        (filters, notes): the filters, with the names of their channels, and notes on the choice for the user.

    Raises:
        BadFile: `config` is not a tuning file.
        BadSetting: --fuse with --channel, an r of each sensor without a fusion, or a chain with one; no such
            channel, fewer than two to fuse; the tuning has none of the channels, or no fusion; a recording that
            gives no filter that fuses; a parameter is out of its range.
    """
    tuning = None if config is None else load_tuning(config)
    if fuse is not None and channel is not None:
        raise BadSetting(f"--fuse must be used without --channel: it names its channels (got {channel!r})")
    if fuse is not None or (tuning is not None and channel is None and tuning.fusion is not None):
        if given.get("chain") is not None:
            raise BadSetting("--chain must be used without fused channels: a chain filters one (got both)")
        return _fusion_for(recording, tuning, given, fuse, period)
    if not isinstance(r := given.get("r", math.nan), float):
        raise BadSetting(f"--r must be one number without --fuse (got one for {', '.join(r)})")
    if recording is None:
        return _filters_for_stream(tuning, given, channel, period)
    if channel is not None:
        recording.index(channel)
    if tuning is not None:
        pairs, notes = adapt_tuning(recording, tuning, given, channel)
        return [_overridden(replace(entry, name=name), given) for name, entry in pairs.items()], notes
    names = recording.names if channel is None else (channel,)
    chosen = [_untuned(name, given, recording) for name in names]
    return [used for used, _ in chosen], [note for _, note in chosen if note]


def _filters_for_stream(
    tuning: Tuning | None, given: Given, channel: str | None, period: float | None
) -> tuple[list[ChannelTuning], list[str]]:
    if tuning is not None:
        used = replace(tuning.only(channel), fusion=None)
        used, notes = rescaled(used, period or used.sample_period, given)
        return [_overridden(entry, given) for entry in used.channels], notes
    if channel is not None:
        raise BadSetting(f"--channel needs --config, because stdin has no names (got {channel!r})")
    return [_untuned("stdin", given, None)[0]], []


def _fusion_for(
    recording: Recording | None, tuning: Tuning | None, given: Given, fuse: str | None, period: float | None
) -> tuple[list[ChannelTuning], list[str]]:
    one = _fusion_in(tuning, fuse)
    used, notes = rescaled(one, recording.sample_period if recording else period or one.sample_period, given)
    (fusion,) = used.channels
    here = [name for name in fusion.sensors if recording is None or name in recording.names]
    if absent := [name for name in fusion.sensors if name not in here]:
        notes.append(f"the recording has no channel {', '.join(absent)}: fused without")
    if not here:
        raise BadSetting(f"the recording must have a channel of the fusion, {', '.join(fusion.sensors)} (got none)")
    return [_overridden(fusion.of_sensors(here), given)], notes


def _overridden(entry: ChannelTuning, given: Given) -> ChannelTuning:
    """The filter with the parameters that were given."""
    values: Given = dict(given)
    if entry.sensors and given.get("r") is not None:
        named = for_each_sensor(entry.sensors, "--r", given["r"])
        values["r"] = tuple(old if math.isnan(new) else new for old, new in zip(entry.r, named, strict=True))
    return replace(entry, **values)


def _untuned(name: str, given: Given, recording: Recording | None) -> tuple[ChannelTuning, str]:
    """The filter as given, with what the signal determines where q or r is missing and matters; and a note."""
    values, note, chain = dict(given), "", given.get("chain")
    if not {"q", "r"} <= set(given) and not (isinstance(chain, Chain) and chain.then is not None):
        if recording is None:
            raise BadSetting('filtering "-" must begin with q and r: give --config, or --q and --r')
        momentum = given.get("momentum", "auto")
        found = find_parameters(
            recording.channel(name),
            Request(noise=Noise(r=given["r"])) if "r" in given else Request(momentum=momentum),
            dt=recording.steps() if recording.gaps == "dt" else None,
            sample_period=recording.sample_period,
        )
        one = found.params
        assert one is not None
        r = float(one.r) * (given["q"] / one.q if "q" in given else 1.0)
        start = {} if {"p0", "x0"} & set(given) else {"p0": one.p0, "x0": one.x0}
        values = {"q": one.q, "r": r, "momentum": one.momentum, "gate": one.gate} | start | given
        why = "the best fit" if found.reason == "best_fit" else first_sentence(found.message)
        note = f"{name}: q = {values['q']:.6g}, r = {values['r']:.6g}: {why}; kalscope tune says more"
    return _overridden(ChannelTuning(name, "", 1.0, 1.0), values), note


def _fusion_in(tuning: Tuning | None, names: str | None) -> Tuning:
    """The tuning with its fusion alone, only of the sensors that are named."""
    fusion = None if tuning is None else tuning.fusion
    if tuning is None or fusion is None:
        raise BadSetting("--fuse needs --config with a fusion: kalscope tune LOG --fuse … -o FILE makes one")
    if names is not None:
        fusion = fusion.of_sensors(channels_to_fuse(dict.fromkeys(fusion.sensors, fusion.unit), names))
    return replace(tuning, channels=(fusion,), selected="", fusion=None)


def adapt_tuning(
    recording: Recording, tuning: Tuning, given: Given | None = None, channel: str | None = None
) -> tuple[dict[str, ChannelTuning], list[str]]:
    """Which entry of a tuning belongs to which channel of a recording, q rescaled to its sample period.

    Args:
        recording: The recording to filter.
        tuning: The tuning, perhaps of another recording.
        given: Parameters that will override the tuning; they are not rescaled.
        channel: The only channel to filter, or None for all.

    Returns:
        (entries, notes): a tuning by channel, and notes on the choice for the user.

    Raises:
        BadSetting: The tuning has none of the channels.
    """
    tuned = {entry.name: entry for entry in tuning.channels}
    wanted = recording.names if channel is None else (channel,)
    pairs = {name: tuned[name] for name in wanted if name in tuned}
    choices: list[str] = []
    if not pairs and len(wanted) == len(tuned) == 1:
        pairs = {wanted[0]: tuning.channels[0]}
        choices.append(f"{wanted[0]}: filtered as the tuning's only channel, {tuning.channels[0].name}")
    if not pairs:
        raise BadSetting(f"the tuning must hold {' or '.join(wanted)} (got channels {', '.join(tuned)})")
    if absent := [name for name in wanted if name not in pairs]:
        choices.append(f"the tuning has no such channel: {', '.join(absent)}")
    used = replace(tuning, channels=tuple(pairs.values()), selected="", fusion=None)
    used, notes = rescaled(used, recording.sample_period, given or {})
    return dict(zip(pairs, used.channels, strict=True)), notes + choices


def rescaled(tuning: Tuning, period: float | None, given: Given) -> tuple[Tuning, list[str]]:
    """The tuning, perhaps of another recording, at the sample period of this one in s; and a note for the user."""
    before = tuning.sample_period
    if before is None or (period is not None and same_period(period, before)):
        return tuning, []
    if period is None:
        used = "q and momentum are used" if tuning.has_momentum else "q is used"
        note = (
            f"{used} as tuned at a sample period of {before:.6g} s: the recording gives none (see --sample-period)"
        )
        return tuning, [] if "q" in given else [note]
    if "momentum" in given:
        tuning = replace(tuning, channels=tuple(replace(one, momentum=0.0) for one in tuning.channels))
    factor = f"{period / before:.6g}"
    changes = [] if "q" in given else [f"q was multiplied by {factor}"]
    changes += [f"momentum was divided by {factor}"] if tuning.has_momentum else []
    if not changes and not tuning.has_chain:
        return tuning, []
    moved = tuning.rescaled(period)
    changes += [
        f"the chain of {old.name} became {'Kalman alone' if new.chain is None else new.chain.words}"
        for old, new in zip(tuning.channels, moved.channels, strict=True)
        if old.chain != new.chain
    ]
    they = "they were" if len(changes) > 1 else "it was"
    periods = f"tuned at a sample period of {before:.6g} s, here it is {period:.6g} s"
    note = f"{' and '.join(changes)}: {they} {periods}"
    return moved, [note] if changes else []
