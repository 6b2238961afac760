"""Which filter a command runs: its options, the tuning file, or a guess from the signal, in this order."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from kalscope.errors import BadSetting
from kalscope.estimation.known import params_for_specification
from kalscope.estimation.sensor.starting import starting_params
from kalscope.filtering.classic.chain import Chain
from kalscope.filtering.protocol import Filter
from kalscope.filtering.steady_state import steady_state
from kalscope.recording import Recording
from kalscope.tuning.tuning import ChannelTuning, Tuning, same_period
from kalscope.tuning.tuning_file import load_tuning

Given = dict[str, Any]
"""Fields of ChannelTuning by name, those that were given: floats, None for an automatic start, a Chain."""


def filters_for(
    recording: Recording, config: Path | None, given: Given, channel: str | None
) -> tuple[dict[str, Filter], list[str]]:
    """Choose the filter of each channel of a recording.

    Args:
        recording: The recording to filter.
        config: Tuning file, or None. Its q is rescaled to the recording's sample period.
        given: Parameters that override it, by name; None is an automatic start.
        channel: The only channel to filter, or None for all.

    Returns:
        (filters, notes): filters by channel, and notes on the choice for the user.

    Raises:
        BadFile: `config` is not a tuning file.
        BadSetting: No such channel, the tuning has none of the channels, or a parameter is out of its range.
    """
    if channel is not None:
        recording.index(channel)
    if config is not None:
        pairs, notes = adapt_tuning(recording, load_tuning(config), given, channel)
        return {name: _with(entry, given).filter for name, entry in pairs.items()}, notes
    names = recording.names if channel is None else (channel,)
    chosen = [_untuned_filter(recording, name, given) for name in names]
    notes = [note for _, note in chosen if note]
    return {name: used for name, (used, _) in zip(names, chosen, strict=True)}, notes


def _with(entry: ChannelTuning, given: Given) -> ChannelTuning:
    values: dict[str, Any] = dict(given)
    return replace(entry, **values)


def _untuned_filter(recording: Recording, name: str, given: Given) -> tuple[Filter, str]:
    if _ends_with_a_classic_filter(given):
        return _untuned(given).filter, ""
    values: dict[str, Any] = dict(given)
    note = ""
    if "q" not in given or "r" not in given:
        values.setdefault("r", starting_params(recording.channel(name)).r)
        values.setdefault("q", values["r"] / 100.0)
        note = (
            f"{name}: q = {values['q']:.6g}, r = {values['r']:.6g}; values not given are the starting values"
            " r = var(Δz)/2, q = r/100"
        )
    return _untuned(values).filter, note


def _untuned(given: Given) -> ChannelTuning:
    """What was given, without a tuning file; q and r may be missing where they have no effect."""
    return _with(ChannelTuning("stdin", "", 1.0, 1.0), given)


def _ends_with_a_classic_filter(given: Given) -> bool:
    """Whether a chain is given on which q and r have no effect."""
    chain = given.get("chain")
    return isinstance(chain, Chain) and chain.then is not None


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
    pairs, choices = _pairs(recording, tuning, channel)
    used = replace(tuning, channels=tuple(pairs.values()), selected="", fusion=None)
    used, notes = at_recording(recording, used, given or {})
    return dict(zip(pairs, used.channels, strict=True)), notes + choices


def at_recording(recording: Recording, tuning: Tuning, given: Given) -> tuple[Tuning, list[str]]:
    """The tuning, perhaps of another recording, at the sample period of this one; and notes for the user."""
    used, notes = rescaled(tuning, recording.sample_period, given)
    if recording.sample_period is None and used.sample_period is not None and "q" not in given:
        notes.append(
            f"{'q and momentum are' if used.has_momentum else 'q is'} used as tuned at a sample period of"
            f" {used.sample_period:.6g} s: the recording gives none (see --sample-period)"
        )
    if tuning.sha256 and recording.sha256 and tuning.sha256 != recording.sha256:
        notes.append(
            f"the recording is not the one of the tuning (SHA-256 {recording.sha256[:12]}…,"
            f" tuned on {tuning.sha256[:12]}…)"
        )
    return used, notes


def _pairs(recording: Recording, tuning: Tuning, channel: str | None) -> tuple[dict[str, ChannelTuning], list[str]]:
    """The entry of each channel that has one, and notes on the others."""
    tuned = {entry.name: entry for entry in tuning.channels}
    wanted = recording.names if channel is None else (channel,)
    pairs = {name: tuned[name] for name in wanted if name in tuned}
    notes: list[str] = []
    if not pairs and len(wanted) == len(tuned) == 1:
        pairs = {wanted[0]: tuning.channels[0]}
        notes.append(f"{wanted[0]}: filtered as the tuning's only channel, {tuning.channels[0].name}")
    if not pairs:
        raise BadSetting(f"the tuning must hold {' or '.join(wanted)} (got channels {', '.join(tuned)})")
    left_out = [name for name in wanted if name not in pairs]
    if left_out:
        notes.append(f"the tuning has no such channel: {', '.join(left_out)}")
    return pairs, notes


def with_momentum(entry: ChannelTuning, momentum: float | None, overshoot: float | None) -> ChannelTuning:
    """The filter with another momentum, or with the momentum that an overshoot allows.

    Args:
        entry: The filter; returned unchanged where both others are None.
        momentum: In sample periods, with the same q and r; or None.
        overshoot: Share of a step: of all filters with the lag of `entry` and no more overshoot, the one that
            leaves the least noise, with the same r; or None.

    Raises:
        BadSetting: A momentum out of its range, or an overshoot that no momentum has at this lag.
    """
    if momentum is not None:
        return replace(entry, momentum=momentum, how=f"{entry.how}, momentum given")
    if overshoot is None:
        return entry
    lag = steady_state(entry.params).lag_samples
    found = params_for_specification(entry.r, lag_samples=lag, overshoot=overshoot)
    how = f"{entry.how}, {100.0 * overshoot:.4g} % overshoot"
    return replace(entry, q=found.q, momentum=found.momentum, how=how)


def rescaled(tuning: Tuning, period: float | None, given: Given) -> tuple[Tuning, list[str]]:
    """The tuning at the recording's sample period in s, and a note where q, momentum or a chain had to change."""
    before = tuning.sample_period
    if period is None or before is None or same_period(period, before):
        return tuning, []
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
    if not changes:
        return moved, []
    note = (
        f"{' and '.join(changes)}: {'they were' if len(changes) > 1 else 'it was'} tuned at a sample period of"
        f" {before:.6g} s, here it is {period:.6g} s"
    )
    return moved, [note]


def tunings_for_stdin(
    config: Path | None, given: Given, channel: str | None, period: float | None
) -> tuple[ChannelTuning | list[ChannelTuning], list[str]]:
    """Choose the filters of a stream without names; arguments and errors as `filters_for`.

    Returns:
        (tunings, notes): one for all columns, or with `config` one per column, in the order of the file.
    """
    if config is None:
        if channel is not None:
            raise BadSetting(f"--channel needs --config, because stdin has no names (got {channel!r})")
        if not ({"q", "r"} <= set(given) or _ends_with_a_classic_filter(given)):
            raise BadSetting('filtering "-" must begin with q and r: give --config, or --q and --r')
        return _untuned(given), []
    tuning, notes = rescaled(replace(load_tuning(config).only(channel), fusion=None), period, given)
    return [_with(entry, given) for entry in tuning.channels], notes
