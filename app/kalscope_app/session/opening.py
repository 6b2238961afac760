"""How a newly opened recording begins: starting values, or those of a tuning file or of a figure."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from kalscope.analysis.channel_kinds import default_channel
from kalscope.errors import BadSetting
from kalscope.estimation.sensor.starting import starting_params
from kalscope.filtering.protocol import Filter, StandardFilter
from kalscope.papers.experiments import open_experiment
from kalscope.recording import Recording
from kalscope.tuning.choose import adapt_tuning
from kalscope.tuning.tuning import ChannelTuning, Tuning
from kalscope_app.session.state import ChannelSettings, OpenRecording, State


def opened(recording: Recording, before: State | None = None) -> State:
    """A state that looks at a newly opened recording, every channel at its starting values."""
    starts = tuple(starting_tuning(recording, name) for name in recording.names)
    fresh = State(OpenRecording(recording, default_channel(recording)), ChannelSettings(starts, starts))
    return fresh if before is None else replace(fresh, view=before.view).with_reset_view(window=None)


def starting_tuning(recording: Recording, name: str) -> ChannelTuning:
    """R = var(Δz)/2 and q = r/100 of one channel, automatic start."""
    start = starting_params(recording.channel(name))
    unit = recording.units[recording.index(name)]
    return ChannelTuning(name, unit, float(start.q), float(start.r), None, None, "starting values")


def reopened(recording: Recording, before: State) -> State:
    """A state that looks at a recording read again: what was tuned by name stays.

    Of another recording pinned settings stay where name and unit of the channel agree: the next log of one sensor.
    """
    state = opened(recording, before)
    old, settings = before.recording, before.settings
    if (recording.source, recording.title) != (old.source, old.title):
        units = dict(zip(recording.names, recording.units, strict=True))
        pins = tuple(one for one in settings.pins if units.get(one.tuning.name) == one.tuning.unit)
        said = "Pinned settings stay on channels of the same name and unit." if pins else ""
        return state.with_settings(pins=pins).with_answers(note=said)
    known = {now.name: now for now, start in zip(settings.tunings, settings.starts, strict=True) if now != start}
    tunings = tuple(known.get(tuning.name, tuning) for tuning in state.settings.tunings)
    channel = before.channel if before.channel in recording.names else state.channel
    pins = tuple(variant for variant in settings.pins if variant.tuning.name in recording.names)
    return state.with_settings(tunings=tunings, pins=pins, link=settings.link).with_open(channel=channel)


def opened_with(recording: Recording, tuning: Tuning, before: State | None = None) -> State:
    """A state at the values of a tuning file; what had to be adapted is said in its note.

    Raises:
        BadSetting: none of the recording's channels is in the file.
    """
    typed_period = None
    if recording.sample_period is None and tuning.sample_period is not None:
        typed_period = tuning.sample_period
        recording = timed(recording, typed_period)
    return adapted(opened(recording, before), tuning).with_open(typed_period=typed_period)


def adapted(state: State, tuning: Tuning) -> State:
    """The state at the values of a tuning file, and at the channel that it selects.

    Raises:
        BadSetting: none of the recording's channels is in the file.
    """
    entries, notes = adapt_tuning(state.recording, tuning)
    tunings = tuple(
        replace(entries[own.name], name=own.name, unit=own.unit) if own.name in entries else own
        for own in state.settings.tunings
    )
    channel = tuning.selected if tuning.selected in entries else next(iter(entries))
    note = " ".join(f"{note[:1].upper()}{note[1:]}." for note in notes)
    return state.with_settings(tunings=tunings).with_open(channel=channel).with_answers(note=note)


def opened_experiment(name: str, before: State | None = None) -> State:
    """A state that looks at a figure of a source document, at that figure's settings.

    Raises:
        BadSetting: no such experiment.
    """
    recording, filters = open_experiment(name)
    state = opened(recording, before)
    chosen = [filters[channel] for channel in recording.names]
    tunings = tuple(map(_tuning_of, state.settings.tunings, chosen))
    other = tuple(None if one.is_standard else one for one in chosen)
    return state.with_settings(tunings=tunings, starts=tunings, other_filters=other)


def _tuning_of(start: ChannelTuning, chosen: Filter) -> ChannelTuning:
    """The parameters of a figure; the starting values where the figure has another filter."""
    if not isinstance(chosen, StandardFilter):
        return start
    params = chosen.params
    p0, x0 = (None if value is None else float(value) for value in (params.p0, params.x0))
    return ChannelTuning(start.name, start.unit, float(params.q), float(params.r), p0, x0, "source document")


def timed(recording: Recording, sample_period: float) -> Recording:
    """A recording without time, taken to be sampled every `sample_period` s, > 0; one with time stays as it is."""
    if recording.sample_period is not None:
        return recording
    if not (0.0 < sample_period < math.inf):
        raise BadSetting(f"sample period must be a finite number of seconds above 0 (got {sample_period:g})")
    time = np.arange(len(recording)) * sample_period
    return replace(recording, time=time, sample_period=sample_period)
