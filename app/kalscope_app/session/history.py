"""Undo and redo of gestures, pure: what is remembered, what belongs to one gesture, the steps back and forth."""

from __future__ import annotations

from dataclasses import dataclass, replace

from kalscope_app.session.state import State

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
    """Remember `before` if `after` differs in what the user tunes; the view does not count."""
    if _tuned(before) == _tuned(after):
        return history
    if key and key == history.key and (key.startswith(HELD) or now - history.time < SAME_GESTURE):
        return replace(history, future=(), time=now)
    kept = before if before.fleet is None else replace(before, fleet=None)  # the present one stays, see `_seen_as`
    return History(_within_limits((*history.past, kept)), (), key, now)


def _tuned(state: State) -> tuple[object, ...]:
    return state.record_key, state.channel, state.open.fused, state.settings


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


def _seen_as(present: State, other: State) -> State:
    """The other state in the present view and, on the same recording, in the present window."""
    same_record = present.record_key == other.record_key
    view = present.view if same_record else replace(present.view, window=other.view.window)
    if not (same_record and present.channel == other.channel):
        view = replace(view, resets=view.resets + 1)
    live = present.live if same_record else other.live  # following and pausing belong to the view
    # What a board has taken stays taken, and what it measured stays measured.
    now = replace(other, sent=present.sent, calibration=present.calibration, fleet=present.fleet)
    return replace(now, view=view, live=live).with_answers(note="")


def _within_limits(past: tuple[State, ...]) -> tuple[State, ...]:
    kept: list[State] = []
    seen: set[tuple[int, int]] = set()
    for state in reversed(past[-LIMIT:]):
        seen.add(state.record_key)
        if len(seen) > RECORDINGS:
            break
        kept.append(state)
    return tuple(reversed(kept))
