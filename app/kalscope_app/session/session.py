"""The session: the present State, undo and redo, and the requests that wait."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Protocol

from kalscope.sources.live.source import LiveSource
from kalscope_app.session.changes import refreshed, with_current_samples, without_samples
from kalscope_app.session.opening import with_firsts
from kalscope_app.session.state import NO_CONNECTION, Change, ConnectionState, State

# Undo and redo of gestures, pure: what is remembered, what belongs to one gesture, the steps back and forth.


LIMIT = 200
"""Gestures that can be undone."""

RECORDINGS = 4
"""Recordings that the remembered states may hold on to; older states are forgotten, because they fill memory."""

SAME_GESTURE = 1.0
"""Seconds: changes of one control that follow each other faster are one gesture."""

HELD = "held:"
"""Prefix of a key that belongs to one gesture, such as one drag: it stays one gesture however long it pauses."""


@dataclass(frozen=True)
class History:
    """States before and after the present one."""

    past: tuple[State, ...] = ()
    """Oldest first."""
    future: tuple[State, ...] = ()
    """Undone states, the nearest first."""
    key: str = ""
    """Control of the last gesture; "" never continues."""
    time: float = 0.0
    """When it last changed something, s."""


def record(history: History, before: State, after: State, key: str, now: float) -> History:
    """Remember `before` if `after` differs in what the user tunes; the view and late first answers do not count."""
    if _tuned(after) in (_tuned(before), _tuned(with_firsts(before, after.firsts))):
        return history
    if key and key == history.key and (key.startswith(HELD) or now - history.time < SAME_GESTURE):
        return replace(history, future=(), time=now)
    kept = before if before.fleet is None else replace(before, fleet=None)  # the present one stays, see `_seen_as`
    past = (*history.past, kept)
    newest = list(dict.fromkeys(state.record_key for state in reversed(past)))[:RECORDINGS]
    return History(tuple(state for state in past[-LIMIT:] if state.record_key in newest), (), key, now)


def _tuned(state: State) -> tuple[object, ...]:
    return state.record_key, state.channel, state.shows_fused, state.settings


def step(history: History, present: State, *, back: bool) -> tuple[History, State]:
    """One gesture back, or one undone gesture forward; the same if there is none."""
    past, future = history.past, history.future
    if not (past if back else future):
        return history, present
    if back:
        return History(past[:-1], (present, *future)), _seen_as(present, past[-1])
    return History((*past, present), future[1:]), _seen_as(present, future[0])


def _seen_as(present: State, other: State) -> State:
    """The other state in the present view and, on the same recording, in the present window."""
    same_record = present.record_key == other.record_key
    view = present.view if same_record else replace(present.view, window=other.view.window)
    if not (same_record and present.channel == other.channel):
        view = replace(view, resets=view.resets + 1)
    live = present.live if same_record else other.live  # following and pausing belong to the view
    now = with_firsts(other, present.firsts) if same_record else other
    # What a board has taken stays taken, and what it measured stays measured.
    stays = {name: getattr(present, name) for name in ("sent", "calibration", "fleet")}
    return replace(now, view=view, live=live, note="", **stays)


# The session: the present State, its history, and the requests that wait for the engine. No viser here.
#
# Any thread may file a request; only the engine's thread applies it.


class Failed(StrEnum):
    """What failed: the heading of a refusal, given where the request is filed or the job is started."""

    OPEN = "Cannot open"
    CONNECT = "Cannot open port"
    RECORD = "Cannot record"
    NUMBER = "Not a valid number"
    FIND = "Cannot find q and r"
    FUSE = "Cannot fuse sensors"
    SAVE = "Cannot save"
    EXPORT = "Cannot export"
    SEND = "Cannot send to the board"
    MEASURE = "Cannot measure on the board"
    KEEP = "Cannot keep on the board"
    OTHER = "Not possible"


def undo(state: State) -> State:
    """A request to go one gesture back; the session knows to where."""
    return state


def redo(state: State) -> State:
    """A request to go one undone gesture forward; the session knows to where."""
    return state


class Boards(Protocol):
    """What connects live boards; `BoardConnection` does. No call may wait for a port."""

    def state(self, board: LiveSource | None) -> ConnectionState:
        """The state of the connection to the board on screen; None: no board is on screen."""
        ...

    def look_at(self, board: LiveSource | None) -> None:
        """This board is on screen now; None: none is."""


class Session:
    """The State and the changes that wait for the engine. `wakeup` is set when a request is waiting."""

    def __init__(self, state: State, boards: Boards | None = None) -> None:
        """Args: what is shown first; what connects live boards."""
        self._state, self._boards = state, boards
        self._history = History()
        self._lock = threading.Lock()
        self._waiting: list[tuple[str, Change, Failed]] = []
        self._serial = 0
        self.wakeup = threading.Event()

    def request(self, change: Change, *, key: str = "", failed: Failed = Failed.OTHER) -> int:
        """File a change and return its serial number; a frame contains all requests up to its own serial.

        Args:
            change: applied later by the engine.
            key: a request replaces one with the same key that waits just before it.
            failed: the heading of a refusal.
        """
        with self._lock:
            self._serial += 1
            if key and self._waiting and self._waiting[-1][0] == key:
                self._waiting.pop()
            self._waiting.append((key, change, failed))
            serial = self._serial
        self.wakeup.set()
        return serial

    def with_state(self, callback: Callable[[State], None]) -> None:
        """Hand the state to `callback` once every earlier request is in it; on the engine's thread, so be quick."""
        self.request(lambda state: callback(state) or state)

    def apply_requests(self) -> tuple[State, int, list[tuple[Failed, Exception]]]:
        """Apply what waits, in order; a change that fails leaves the state as it was.

        Returns the state, the serial up to which every request was seen, and what failed and why.
        """
        with self._lock:
            waiting, self._waiting, serial = self._waiting, [], self._serial
        failures: list[tuple[Failed, Exception]] = []
        self._refresh()
        now = time.monotonic()
        for key, change, failed in waiting:
            try:
                self._apply(change, key, now)
            except Exception as error:  # whatever it is, the dashboard continues and reports it
                failures.append((failed, error))
        if waiting:  # another board may be on screen now, or no longer be paused
            self._refresh()
        if self._boards is not None:
            self._boards.look_at(self.board)
        return self._state, serial, failures

    def _refresh(self) -> None:
        if self._boards is not None and self.board is not None:
            self._state = refreshed(self._state, self.board.snapshot())

    @property
    def board(self) -> LiveSource | None:
        """The board whose samples come in; None for a finished record."""
        return self._state.live and self._state.live.board

    @property
    def steps(self) -> tuple[int, int]:
        """Gestures that can be undone, and redone."""
        return len(self._history.past), len(self._history.future)

    def connection(self) -> ConnectionState:
        """The state of the connection to the board on screen now."""
        return NO_CONNECTION if self._boards is None else self._boards.state(self.board)

    def _apply(self, change: Change, key: str, now: float) -> None:
        present = without_samples(self._state)
        if change is not undo and change is not redo:
            after = change(self._state)
            self._history, self._state = record(self._history, present, without_samples(after), key, now), after
            return
        history, kept = step(self._history, present, back=change is undo)
        if history is self._history:
            self._state = replace(self._state, note=f"There is nothing to {change.__name__}.")
            return
        self._history, self._state = history, with_current_samples(kept, self._state)
        self._refresh()  # a later request of the same turn needs the samples, which the history does not keep
