"""How a newly opened recording begins: starting values, or those of a tuning file or of a figure."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from kalscope.errors import BadSetting
from kalscope.estimation.starting import starting_params
from kalscope.papers.experiments import open_experiment
from kalscope.papers.generalized_filter import GeneralizedParams
from kalscope.tuning.choose import adapt_tuning
from kalscope.tuning.tuning import ChannelTuning, Tuning
from kalscope_app.session.state import State

if TYPE_CHECKING:
    from kalscope.filtering.params import FilterParams
    from kalscope.recording import Recording


def opened(recording: Recording, before: State | None = None) -> State:
    """A state that looks at a newly opened recording, every channel at its starting values."""
    starts = tuple(starting_tuning(recording, name) for name in recording.names)
    resets = before.resets + 1 if before else 0
    fresh = State(recording, recording.names[0], starts, starts, resets=resets)
    if before is None:
        return fresh
    return fresh.seen_as(before)


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
    old = before.recording
    if (recording.source, recording.title) != (old.source, old.title):
        units = dict(zip(recording.names, recording.units, strict=True))
        pins = tuple(one for one in before.pins if units.get(one.tuning.name) == one.tuning.unit)
        said = "Pinned settings stay on channels of the same name and unit." if pins else ""
        return replace(state, pins=pins, note=said)
    known = {now.name: now for now, start in zip(before.tunings, before.starts, strict=True) if now != start}
    tunings = tuple(known.get(tuning.name, tuning) for tuning in state.tunings)
    channel = before.channel if before.channel in recording.names else state.channel
    pins = tuple(variant for variant in before.pins if variant.tuning.name in recording.names)
    return replace(state, tunings=tunings, channel=channel, pins=pins, together=before.together)


def opened_with(recording: Recording, tuning: Tuning, before: State | None = None) -> State:
    """A state at the values of a tuning file; what had to be adapted is said in its note.

    Raises:
        BadSetting: none of the recording's channels is in the file.
    """
    typed_period = None
    if recording.sample_period is None and tuning.sample_period is not None:
        typed_period = tuning.sample_period
        recording = timed(recording, typed_period)
    adapted, notes = adapt_tuning(recording, tuning)
    state = opened(recording, before)
    units = dict(zip(recording.names, recording.units, strict=True))
    tunings = tuple(
        replace(adapted[t.name], name=t.name, unit=units[t.name]) if t.name in adapted else t for t in state.tunings
    )
    channel = tuning.selected if tuning.selected in adapted else next(iter(adapted))
    note = " ".join(f"{note[:1].upper()}{note[1:]}." for note in notes)
    return replace(state, tunings=tunings, channel=channel, typed_period=typed_period, note=note)


def opened_experiment(name: str, before: State | None = None) -> State:
    """A state that looks at a figure of a source document, at that figure's settings.

    Raises:
        BadSetting: no such experiment.
    """
    recording, settings = open_experiment(name)
    state = opened(recording, before)
    chosen = [settings[channel] for channel in recording.names]
    tunings = tuple(map(_tuning_of, state.tunings, chosen))
    rules = tuple(s if isinstance(s, GeneralizedParams) else None for s in chosen)
    return replace(state, tunings=tunings, starts=tunings, rules=rules)


def _tuning_of(start: ChannelTuning, settings: FilterParams | GeneralizedParams) -> ChannelTuning:
    """Five-line parameters of a figure; the starting values where the figure has another filter."""
    if isinstance(settings, GeneralizedParams):
        return start
    p0, x0 = (None if value is None else float(value) for value in (settings.p0, settings.x0))
    return ChannelTuning(start.name, start.unit, float(settings.q), float(settings.r), p0, x0, "source document")


def timed(recording: Recording, sample_period: float) -> Recording:
    """A recording without time, taken to be sampled every `sample_period` s, > 0; one with time stays as it is."""
    if recording.sample_period is not None:
        return recording
    if not (0.0 < sample_period < math.inf):
        raise BadSetting(f"sample period must be a finite number of seconds above 0 (got {sample_period:g})")
    time = np.arange(len(recording)) * sample_period
    return replace(recording, time=time, sample_period=sample_period)
