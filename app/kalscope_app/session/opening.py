"""How a newly opened recording begins: with what was tuned for its channels, else with its first answer.

A tuning file or a figure of a source document overrides both.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from kalscope.analysis.channel_kinds import default_channel
from kalscope.common.numbers import check_sample_period
from kalscope.common.text import one_line, sample_rate
from kalscope.estimation.noise import noise_scale
from kalscope.estimation.request import find_parameters
from kalscope.filtering.filter import Filter, StandardFilter
from kalscope.papers.generalized import GeneralizedParams
from kalscope.recording import Recording, Timing
from kalscope.tuning.choose import adapt_tuning, name_of_fused
from kalscope.tuning.tuning import ChannelTuning, Tuning, same_period
from kalscope_app.session.state import Fusion, Outcome, State

SAME_RATE = 0.05
"""Share by which a board's measured sample period may differ from that of a tuning file before q is rescaled."""

MOST_FITTED = 200_000
"""Samples of one channel that are fitted when a recording opens, in its middle: the picture waits for it."""

MOST_CHANNELS, NOT_FITTED = 24, "not fitted yet"
"""Channels that are fitted after the first picture, and share MOST_FITTED; the others are when they are chosen."""

FEW_CHANNELS, FEW_READINGS = 4, 20_000
"""Channels, and readings of all of them, up to which all are fitted before the first picture."""


def opened(recording: Recording, before: State | None = None, firsts: tuple[Outcome, ...] | None = None) -> State:
    """A state that looks at a newly opened recording.

    Every channel has its starting values, unless it was tuned before: what the user set for a channel of the same
    name and unit stays, whatever was open in between. The note says so.

    Args:
        recording: What was opened.
        before: The state until then.
        firsts: How each channel begins; None = as the recording says, of a large one those off screen later.
    """
    now = firsts is None
    small = len(recording.names) <= FEW_CHANNELS and recording.values.size <= FEW_READINGS
    firsts = firsts or tuple((first_answer if small else not_fitted)(recording, name) for name in recording.names)
    state = State(recording, default_channel(recording), tuple(one.before for one in firsts), firsts)
    state = state if before is None else _with_what_stays(state, before)
    return with_first_answer(state) if now else state


def opened_raw(recording: Recording) -> State:
    """A state that looks at a recording without a fit, for which the first picture need not wait."""
    return opened(recording, None, tuple(not_fitted(recording, name) for name in recording.names))


def _with_what_stays(fresh: State, before: State) -> State:
    channels, here = set(map(_key, fresh.tunings)), set(map(_key, before.tunings))
    pairs = zip(before.tunings, before.starts, strict=True)
    tuned = {_key(one): one for one in (*before.elsewhere, *(now for now, start in pairs if now != start))}
    fused = before.fused
    if fused and not {_key(one) for one in before.tunings if one.name in fused.tuning.sensors} <= channels:
        fused = None
    note = "Filters and pins of channels of the same name and unit stay (Reset gives starting values); "
    stays = channels & {*tuned, *(_key(pin.tuning) for pin in before.pins)}
    return replace(
        fresh,
        tunings=tuple(tuned.get(_key(own), own) for own in fresh.tunings),
        elsewhere=tuple(one for key, one in tuned.items() if key not in channels),
        pins=before.pins,
        link=before.link if channels <= here else fresh.link,
        fused=fused,
        shows_fused=before.shows_fused and fused is not None,
        channel=before.channel if _key(before.tuning) in channels else fresh.channel,
        view=before.with_reset_view(window=None).view,
        note=f"{note}Undo returns to the previous recording." if stays else "",
        fleet=before.fleet,
    )


def _key(tuning: ChannelTuning) -> tuple[str, str]:
    """Name and unit: what must be the same for settings to stay."""
    return tuning.name, tuning.unit


def not_fitted(recording: Recording, name: str) -> Outcome:
    """A harmless filter, until there is a better one."""
    r = noise_scale(recording.channel(name))
    start = ChannelTuning(name, recording.units[recording.index(name)], r, r, how=NOT_FITTED)
    return Outcome(None, NOT_FITTED, "", before=start, after=start)


def with_first_answer(state: State) -> State:
    """The state with the filter of the channel on screen found, where that was left for later."""
    if state.firsts[state.index].how != NOT_FITTED:
        return state
    return with_firsts(state, (first_answer(state.recording, state.channel),))


def later_answers(state: State) -> Iterator[tuple[Outcome, ...]]:
    """What is found in the channels that were left for later: first in that on screen, then in the others."""
    if state.live is not None:
        return
    late = [one.before.name for one in state.firsts[:MOST_CHANNELS] if one.how == NOT_FITTED]
    if state.firsts[state.index].how == NOT_FITTED:
        yield (first_answer(state.recording, state.channel),)
    if others := [name for name in late if name != state.channel]:
        most = MOST_FITTED // min(len(state.firsts), MOST_CHANNELS)
        yield tuple(first_answer(state.recording, name, most) for name in others)


def with_firsts(state: State, firsts: tuple[Outcome, ...]) -> State:
    """The state with what was found of channels that were not fitted yet; what was set since then stays."""
    late = {one.before.name: one for one in firsts}
    found = tuple(late.get(one.before.name, one) if one.how == NOT_FITTED else one for one in state.firsts)
    each = zip(state.tunings, state.firsts, found, strict=True)
    tunings = tuple(new.before if tuning == old.before else tuning for tuning, old, new in each)
    return replace(state, firsts=found, tunings=tunings)


def first_answer(recording: Recording, name: str, most: int = MOST_FITTED) -> Outcome:
    """What `find_parameters` finds in `most` samples of one channel, in the middle of a long one."""
    first = max((len(recording) - most) // 2, 0)
    part = slice(first, first + most)
    dt = recording.steps()[part] if recording.gaps == "dt" else None
    found = find_parameters(recording.channel(name)[part], dt=dt, sample_period=recording.sample_period)
    assert found.params is not None
    start = ChannelTuning.of_params(name, recording.units[recording.index(name)], found.params, found.how)
    return Outcome(**vars(found), before=start, after=start)


def adapted(state: State, tuning: Tuning, note: str = "") -> State:
    """The state at the values of a tuning file, and at the channel that it selects.

    A recording without a sample period takes that of the file. What had to be adapted is added to the note.

    Raises:
        BadSetting: none of the recording's channels is in the file.
    """
    period, own = tuning.sample_period, state.recording.sample_period
    if state.live is not None and period and own and abs(own / period - 1) <= SAME_RATE:
        tuning = replace(tuning, sample_period=own)
    elif state.live is None and period and own is None:
        state = with_sample_period(state, period)
    entries, notes = adapt_tuning(state.recording, tuning)
    tunings = tuple(replace(entries.get(own.name, own), name=own.name, unit=own.unit) for own in state.tunings)
    channel = tuning.selected if tuning.selected in entries else next(iter(entries))
    said = [note, *(f"{one[:1].upper()}{one[1:]}." for one in notes)]
    state = replace(state, tunings=tunings, channel=channel, shows_fused=False, searched=None)
    fused, recording = tuning.fusion, state.recording
    if fused is not None and not set(fused.sensors) <= set(recording.names):
        names = ", ".join(map(one_line, fused.sensors))[:120]
        said.append(f"The sensors that the file fuses are not all here: {names}.")
    elif fused is not None:
        period, filed = recording.sample_period, tuning.sample_period
        if period is not None and filed is not None and not same_period(period, filed):
            fused = tuning.rescaled(period).fusion or fused
        name = name_of_fused(recording) if fused.name in recording.names else fused.name
        fused = replace(fused, name=name)
        state = state.with_fusion(Fusion(fused, fused))
    return replace(state, note=" ".join(filter(None, said)))


def opened_experiment(name: str, before: State | None = None) -> State:
    """A state that looks at a figure of a source document, at that figure's settings.

    Raises:
        BadSetting: no such experiment.
    """
    from kalscope.papers.reproduction import open_experiment

    recording, filters = open_experiment(name)
    state = opened(recording, before, tuple(first_answer(recording, name) for name in recording.names))
    each = zip(state.firsts, filters.values(), strict=True)  # both in the order of the channels
    firsts = tuple(replace(first, before=_tuning_of(first.before, one), after=None) for first, one in each)
    return replace(state, firsts=firsts, tunings=tuple(one.before for one in firsts), note="")


def _tuning_of(start: ChannelTuning, chosen: Filter) -> ChannelTuning:
    """The setting of a figure: its q and r, or its Khan et al. filter."""
    if isinstance(chosen, StandardFilter):
        return ChannelTuning.of_params(start.name, start.unit, chosen.params, "source document")
    assert isinstance(chosen, GeneralizedParams)
    return replace(start, chain=None, paper=chosen)


def with_sample_period(state: State, period: float | None) -> State:
    """The state with another time between two samples, s; None = as the recording was read.

    Raises:
        BadSetting: it is not a valid period.
    """
    recorded = state.as_read or state.recording
    recording, as_read = (recorded, None) if period is None else (timed(recorded, period), recorded)
    changed = replace(state, recording=recording, typed_period=period, as_read=as_read, searched=None)
    return changed.with_reset_view(window=None)


def timed(recording: Recording, sample_period: float) -> Recording:
    """A recording whose samples are taken to be `sample_period` s apart, > 0; its time stamps are kept."""
    check_sample_period(sample_period)
    timing = recording.report.timing or Timing("none", "none", None)
    time = np.arange(len(recording)) * sample_period if timing.stamps == "none" else recording.time
    summary = f"{sample_rate(sample_period)} as typed"
    timing = replace(timing, period=sample_period, source="option", summary=summary)
    report = replace(recording.report, timing=timing)
    return replace(recording, time=time, sample_period=sample_period, report=report)
