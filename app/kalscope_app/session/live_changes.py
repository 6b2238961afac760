"""A live board in the State: its window follows the newest sample or is paused; `refreshed` adds new samples.

The State holds the record as of the last refresh (`Snapshot`: views, so taking one costs nothing). What the user
chose stays; only the record under it grows.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from kalscope.errors import BadSetting
from kalscope.recording import Recording
from kalscope.sources.live.samples import Snapshot
from kalscope.sources.live.source import LiveSource
from kalscope.tuning.tuning import Tuning
from kalscope_app.session.opening import MOST_CHANNELS, adapted, first_answer, not_fitted, opened, with_first_answer
from kalscope_app.session.state import BoardCalibration, Change, Live, Sent, State, requested

SPANS = {
    **{f"{seconds} s": float(seconds) for seconds in (1, 2, 5, 10, 30)},
    **{f"{minutes} min": 60.0 * minutes for minutes in (1, 2, 5, 10)},
    "all": math.inf,
}
"""Lengths of the window that follows the newest sample, s."""

START_SAMPLES, START_SECONDS = 100, 2.0
"""The starting r is measured on the first samples: on this many, or over this long if the board is slow."""

MIN_SAMPLES = 10
"""Fewer samples than this show nothing yet."""

WAITING = f"waiting for the first {MIN_SAMPLES} samples"
"""What is said instead of the size of the placeholder."""

MAX_STUDIED = 100_000
"""Newest samples that the checks, spectra and maps of a live record are computed from."""


def opened_live(board: LiveSource, title: str, before: State | None = None, tuning: Tuning | None = None) -> State:
    """A state that waits for the first samples of a board and then shows them.

    Args:
        board: the board.
        title: its name, as the user gave it.
        before: what was on screen.
        tuning: values to begin with, for the channels of the same names; None = measured on the first samples.
    """
    live = Live(board, deferred=() if tuning is None else (lambda state: adapted(state, tuning),))
    # Until it has sent something, two missing samples are on screen.
    waiting = Recording(np.arange(2.0), ("signal",), ("",), np.full((2, 1), np.nan), None, title=title)
    return replace(opened(waiting, before), note="", live=live)


def when_settled(state: State, change: Change) -> State:
    """Make a change of the command line as soon as the channels of a board are known; at once where they are."""
    live = state.live
    if live is None or live.settled:
        return change(state)
    return state.with_live(deferred=(*live.deferred, change))


def _apply_deferred(state: State) -> State:
    """The state with what the command line asked for; the note says what could not be applied."""
    live, notes = state.live, list[str]()
    if live is None or not live.settled or not live.deferred:
        return state
    state = state.with_live(deferred=())
    for change in live.deferred:
        try:
            state = change(state)
            notes += filter(None, [state.note])
        except BadSetting as error:
            notes.append(f"Ignored command-line option: {error}.")
    return replace(state.with_reset_view(), note=" ".join(notes))


def refreshed(state: State, snapshot: Snapshot | None) -> State:
    """The state with the samples that its board has now; the same object where there are no new ones."""
    live = state.live
    if live is None or live.paused or snapshot is None or len(snapshot.recording) < MIN_SAMPLES:
        return state
    last = live.snapshot
    if last is not None and (last.generation, last.version) == (snapshot.generation, snapshot.version):
        return state
    if last is None or last.generation != snapshot.generation or not live.settled:
        state = _begun(state, snapshot)
    return replace(state, recording=snapshot.recording).with_live(snapshot=snapshot)


def _begun(state: State, snapshot: Snapshot) -> State:
    """Starting values from the first samples, and what is kept from before."""
    recording = snapshot.recording
    firsts: list[int] = np.isfinite(recording.values).argmax(axis=0).tolist()  # a topic may first appear later
    begin = max(firsts, default=0)
    lasted = float(recording.time[-1] - recording.time[begin])
    settled = len(recording) - begin >= START_SAMPLES or lasted >= START_SECONDS
    head = _part(recording, begin, begin + START_SAMPLES)
    found = tuple(
        (first_answer if i < MOST_CHANNELS else not_fitted)(_part(recording, first, first + START_SAMPLES), name)
        for i, (first, name) in enumerate(zip(firsts, recording.names, strict=True))
    )
    fresh = with_first_answer(opened(head, state, found))
    last, now = state.live and state.live.snapshot, recording.names
    before = last.recording.names if last else ()
    if last is not None and (last.generation == snapshot.generation or before == now[: len(before)] != now):
        fresh = replace(fresh, note=state.note)
    if now == state.recording.names:
        fresh = fresh.with_view(resets=state.view.resets)
    choice = state.board_choice if state.board_choice in (*now, None) else fresh.board_choice
    fresh = replace(fresh, board_choice=choice, options=state.options, live=state.live)
    return _apply_deferred(fresh.with_live(settled=settled))


def without_samples(state: State) -> State:
    """The state as the history keeps it: without the samples, which the connection keeps."""
    if state.live is None or state.live.snapshot is None:
        return state
    few = _part(state.recording, 0, 2)
    stub = replace(few, time=few.time.copy(), values=few.values.copy())  # a view would keep the whole array
    return replace(state, recording=stub).with_live(snapshot=None, paused=False)


def with_current_samples(kept: State, present: State) -> State:
    """A state from the history with the samples on screen, if it is the same board."""
    if kept.live is None or present.live is None or present.live.board is not kept.live.board:
        return kept
    if tuple(tuning.name for tuning in kept.tunings) != present.recording.names:
        return kept
    return replace(kept, recording=present.recording, live=present.live)


def studied(state: State) -> State:
    """The state that idle-time computations use: the newest samples of a live record, all of any other."""
    n = len(state.recording)
    if state.live is None or n <= MAX_STUDIED:
        return state
    return replace(state, recording=_part(state.recording, n - MAX_STUDIED, n))


def live_window(state: State) -> tuple[float, float] | None:
    """First and last time on screen, s, of what is open; None = all of it."""
    if state.live is None or not state.live.following:
        return state.view.window
    if math.isinf(state.live.span):
        return None
    end = float(state.recording.time[-1])
    return end - state.live.span, end


def _part(recording: Recording, first: int, last: int) -> Recording:
    return replace(recording, time=recording.time[first:last], values=recording.values[first:last])


def follow(state: State) -> State:
    """The Live button: continue, at the newest sample."""
    return state.with_live(following=True, paused=False).with_reset_view(window=None) if state.live else state


@requested
def set_paused(state: State, paused: bool) -> State:
    """Freeze the screen, or continue; samples arrive in either case."""
    return state.with_live(paused=bool(paused))


@requested
def set_span(state: State, words: str) -> State:
    """Choose the length of the window that follows, by its label."""
    if words not in SPANS:
        raise BadSetting(f"the live window must be one of {', '.join(SPANS)} (got {words[:40]!r})")
    after = state.with_live(span=SPANS[words], following=True)  # a paused screen stays so
    return after.with_reset_view(window=None) if state.live else state


@requested
def set_sent(state: State, sent: Sent | None) -> State:
    """The board has taken a setting, and its curve is drawn; None: what it uses is not known."""
    if sent is not None and state.board is None and sent.filtered in state.recording.names:
        state = replace(state, board_choice=sent.filtered)
    return replace(state, sent=sent)


@requested
def set_calibration(state: State, calibration: BoardCalibration | None) -> State:
    """The board has measured its noise, or could not; None: it begins to."""
    # Its filter continued with what it measured: there is no restart from which to compare it.
    sent = state.sent if calibration is None or calibration.values is None else None
    return replace(state, calibration=calibration, sent=sent)


@requested
def set_kept(state: State, kept: bool) -> State:
    """The board keeps its values for its next start, or those of its export."""
    known = state.calibration
    return state if known is None else replace(state, calibration=replace(known, kept=kept))


def calibration_here(state: State) -> BoardCalibration | None:
    """The result of letting the board measure the channel on screen."""
    known = state.calibration
    return known if known and (known.record, known.channel) == (state.record_key, state.channel) else None


def use_calibration(state: State) -> State:
    """Filter the channel on screen with the r and q that its board measured."""
    known = calibration_here(state)
    if known is None or known.values is None:
        raise BadSetting("the board must have measured this channel first (got none)")
    state = state if state.uses_parameters else state.with_standard_filter()
    return state.with_tuning(**known.values.parameters, how="measured by the board")
