"""A live board in the State: which stretch follows the newest sample, what is paused. Pure; no viser here.

The State holds the record as it was when last looked at (`Snapshot`: views, so taking one costs nothing);
`refreshed` looks again. What a person chose stays; only the record under it grows.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from kalscope.errors import BadSetting
from kalscope.recording import Recording
from kalscope.tuning.choose import adapt_tuning
from kalscope_app.session.opening import opened, reopened
from kalscope_app.session.state import Feed, Live, State

if TYPE_CHECKING:
    from collections.abc import Callable

    from kalscope.sources.live.live_samples import Snapshot
    from kalscope.tuning.tuning import Tuning

SPANS = {
    "1 s": 1.0,
    "2 s": 2.0,
    "5 s": 5.0,
    "10 s": 10.0,
    "30 s": 30.0,
    "1 min": 60.0,
    "2 min": 120.0,
    "5 min": 300.0,
    "10 min": 600.0,
    "all": math.inf,
}
"""Lengths of the window that follows the newest sample, s."""


ENOUGH_SAMPLES, ENOUGH_SECONDS = 100, 2.0
"""The starting r is measured on the first samples: on so many, or on so long if the board is slow."""

FEWEST_SAMPLES = 10
"""Fewer samples than this show nothing yet."""

SAME_RATE = 0.05
"""Share by which a measured sample period may differ from that of a tuning file before q is rescaled."""

STUDIED = 100_000
"""Newest samples that the checks, spectra and maps of a live record are computed from."""


def opened_live(feed: Feed, title: str, before: State | None = None, tuning: Tuning | None = None) -> State:
    """A state that waits for the first samples of a board and then shows them.

    Args:
        feed: the board.
        title: how it was named.
        before: what was on screen.
        tuning: values to begin with, for the channels of the same names; None = measured on the first samples.
    """
    wanted = () if tuning is None else (set_tuning(tuning),)
    return refreshed(replace(opened(waiting(title), before), live=Live(feed, wanted=wanted)))


def waiting(title: str) -> Recording:
    """What stands on screen until a board has sent something: two missing samples."""
    return Recording(np.arange(2.0), ("signal",), ("",), np.full((2, 1), np.nan), None, title=title)


def set_tuning(tuning: Tuning) -> Callable[[State], State]:
    """The values of a tuning file for the channels of a board; what had to be adapted is said in the note.

    A measured sample period is never quite the one of the file: within a few percent it is taken for the same.
    """

    def change(state: State) -> State:
        measured, meant, tuned = state.recording.sample_period, tuning.sample_period, tuning
        if measured and meant and abs(measured / meant - 1) <= SAME_RATE:
            tuned = replace(tuning, sample_period=measured)
        entries, notes = adapt_tuning(state.recording, tuned)
        tunings = tuple(
            replace(entries[own.name], name=own.name, unit=own.unit) if own.name in entries else own
            for own in state.tunings
        )
        channel = tuning.selected if tuning.selected in entries else next(iter(entries))
        note = " ".join(f"{note[:1].upper()}{note[1:]}." for note in notes)
        return replace(state, tunings=tunings, channel=channel, note=note)

    return change


def when_known(state: State, change: Callable[[State], State]) -> State:
    """Do `change` as soon as the channels of a board are known; at once where they are."""
    live = state.live
    if live is None or live.settled:
        return change(state)
    return replace(state, live=replace(live, wanted=(*live.wanted, change)))


def _as_wanted(state: State) -> State:
    """The state with what the command line asked for; what cannot be is said in the note."""
    live = state.live
    if live is None or not live.settled or not live.wanted:
        return state
    state = replace(state, live=replace(live, wanted=()))
    notes = []
    for change in live.wanted:
        try:
            state = change(state)
            notes += [state.note] if state.note else []
        except BadSetting as error:
            notes.append(f"Of the command line was left out: {error}.")
    return replace(state, note=" ".join(notes), resets=state.resets + 1)


def refreshed(state: State) -> State:
    """The state with the samples that have come since; the same object where nothing has."""
    live = state.live
    if live is None or live.paused:
        return state
    snapshot = live.feed.snapshot()
    if snapshot is None or len(snapshot.recording) < FEWEST_SAMPLES:
        return state
    if live.snapshot is not None and same_samples(snapshot, live.snapshot):
        return state
    if live.snapshot is None or snapshot.generation != live.snapshot.generation or not live.settled:
        state = _begun(state, snapshot)
    grown = replace(state.live or live, snapshot=snapshot)
    return replace(state, recording=snapshot.recording, live=grown)


def same_samples(one: Snapshot, other: Snapshot) -> bool:
    """Whether nothing has come between two looks at a feed."""
    return (one.generation, one.version) == (other.generation, other.version)


def _begun(state: State, snapshot: Snapshot) -> State:
    """Starting values from the first samples; what a person has tuned already stays, by name."""
    recording = snapshot.recording
    lasted = float(recording.time[-1] - recording.time[0])
    settled = len(recording) >= ENOUGH_SAMPLES or lasted >= ENOUGH_SECONDS
    head = _part(recording, 0, ENOUGH_SAMPLES)
    same_board = replace(state, recording=replace(state.recording, source=head.source, title=head.title))
    fresh = reopened(head, same_board)
    live = replace(state.live, settled=settled) if state.live else None
    same_names = fresh.recording.names == state.recording.names
    resets = state.resets if same_names else fresh.resets
    choice = state.board_choice if state.board_choice in (*fresh.recording.names, None) else fresh.board_choice
    fresh = replace(fresh, board_choice=choice, options=state.options)
    return _as_wanted(replace(fresh, live=live, resets=resets))


def at_rest(state: State) -> State:
    """The state as the history keeps it: without the samples, which are the feed's."""
    if state.live is None or state.live.snapshot is None:
        return state
    few = _part(state.recording, 0, 2)
    stub = replace(few, time=few.time.copy(), values=few.values.copy())  # a view would keep all that it is of
    return replace(state, recording=stub, live=replace(state.live, snapshot=None, paused=False))


def awake(rested: State, present: State) -> State:
    """A state from the history with the samples of now: those on screen if it is the same board."""
    if rested.live is None:
        return rested
    same_names = tuple(tuning.name for tuning in rested.tunings) == present.recording.names
    if present.live is not None and present.live.feed is rested.live.feed and same_names:
        rested = replace(rested, live=present.live, recording=present.recording)
    return refreshed(rested)


def studied(state: State) -> State:
    """The state that slow studies look at: the newest samples of a live record, all of any other."""
    if state.live is None or len(state.recording) <= STUDIED:
        return state
    return replace(state, recording=_part(state.recording, len(state.recording) - STUDIED, len(state.recording)))


def live_window(state: State) -> tuple[float, float] | None:
    """First and last moment on screen, s, of whatever is open; None = all of it."""
    if state.live is None or not state.live.following:
        return state.window
    if math.isinf(state.live.span):
        return None
    end = float(state.recording.time[-1])
    return end - state.live.span, end


def _part(recording: Recording, first: int, last: int) -> Recording:
    return replace(recording, time=recording.time[first:last], values=recording.values[first:last])


def follow(state: State) -> State:
    """The Live button: go on, at the newest sample."""
    if state.live is None:
        return state
    live = replace(state.live, following=True, paused=False)
    return refreshed(replace(state, live=live, window=None, resets=state.resets + 1))


def set_paused(paused: bool) -> Callable[[State], State]:
    """Let the screen stand still, or go on; samples come in all the same."""

    def change(state: State) -> State:
        return state if state.live is None else replace(state, live=replace(state.live, paused=bool(paused)))

    return change


def set_span(words: str) -> Callable[[State], State]:
    """Choose how much the following window shows, by its words."""
    if words not in SPANS:
        raise BadSetting(f"the live window must be one of {', '.join(SPANS)} (got {words[:40]!r})")

    def change(state: State) -> State:
        if state.live is None:
            return state
        live = replace(state.live, span=SPANS[words], following=True)  # a paused screen stays so
        return refreshed(replace(state, live=live, window=None, resets=state.resets + 1))

    return change
