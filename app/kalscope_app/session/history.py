"""Undo and redo of gestures, pure: what is remembered, what belongs to one gesture, the steps back and forth."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from kalscope_app.session.state import State

LIMIT = 200
"""Gestures that can be undone."""

RECORDINGS = 4
"""Recordings that the remembered states may hold on to; older states are forgotten, because they fill memory."""

SAME_GESTURE = 1.0
"""Seconds: changes of one control that follow each other faster are one gesture."""

HELD = "held:"
"""Begins a key that one gesture has for itself, such as one drag: it stays one gesture however long it rests."""


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
    """Remember `before` if `after` differs in what a person tunes; the view and the theme do not count."""
    if _essence(before) == _essence(after):
        return history
    if key and key == history.key and (key.startswith(HELD) or now - history.time < SAME_GESTURE):
        return replace(history, future=(), time=now)
    return History(_within_limits((*history.past, before)), (), key, now)


def step_back(history: History, present: State) -> tuple[History, State]:
    """One gesture back; the same if there is none."""
    if not history.past:
        return history, present
    past = History(history.past[:-1], (present, *history.future))
    return past, _seen_as(present, history.past[-1])


def step_forward(history: History, present: State) -> tuple[History, State]:
    """One undone gesture forward; the same if there is none."""
    if not history.future:
        return history, present
    future = History((*history.past, present), history.future[1:])
    return future, _seen_as(present, history.future[0])


def _essence(state: State) -> tuple[object, ...]:
    return state.record_key, state.channel, state.tunings, state.rules, state.pins, state.together


def _seen_as(present: State, other: State) -> State:
    """The other state in the present view and, on the same recording, in the present window."""
    same_record = present.record_key == other.record_key
    window = present.window if same_record else other.window
    same_view = same_record and present.channel == other.channel
    resets = present.resets if same_view else present.resets + 1
    live = present.live if same_record else other.live  # what follows or is paused is the view's, not tuned
    # What a board has taken stays taken.
    return replace(other.seen_as(present), window=window, resets=resets, note="", live=live, sent=present.sent)


def _within_limits(past: tuple[State, ...]) -> tuple[State, ...]:
    kept: list[State] = []
    seen: set[tuple[int, int]] = set()
    for state in reversed(past[-LIMIT:]):
        seen.add(state.record_key)
        if len(seen) > RECORDINGS:
            break
        kept.append(state)
    return tuple(reversed(kept))
