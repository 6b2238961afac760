"""Undo and redo: one entry a gesture, at least a hundred states, and the view left alone."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

from kalscope import Recording
from kalscope_app.session.changes import (
    pin_present,
    set_exponent,
    set_link,
    set_text,
)
from kalscope_app.session.opening import opened
from kalscope_app.session.session import (
    LIMIT,
    SAME_GESTURE,
    History,
    Session,
    record,
    redo,
    step,
    undo,
)
from kalscope_app.session.state import SAME_NUMBERS, View


def recording(seed=0):
    z = np.random.default_rng(seed).normal(size=(100, 1))
    return Recording(np.arange(100.0), ("z",), ("",), z, 1.0)


@pytest.fixture
def state():
    return opened(recording())


@pytest.mark.parametrize(
    ("key", "next_key", "pause", "entries"),
    [
        ("slider q", "slider q", 0.1, 1),
        ("slider q", "slider q", SAME_GESTURE + 0.1, 2),
        ("slider q", "slider q", SAME_GESTURE, 2),
        ("slider q", "slider r", 0.1, 2),
        ("text q", "text q", 0.9, 1),
        ("text q", "slider q", 0.1, 2),
        ("slider q", "", 0.1, 2),
        ("", "slider q", 0.1, 2),
        ("", "", 0.1, 2),
    ],
)
def test_quick_changes_of_one_control_are_one_gesture(state, key, next_key, pause, entries):
    first, second = set_text("q", "1")(state), set_text("q", "2")(state)
    history = record(History(), state, first, key, 10.0)
    history = record(history, first, second, next_key, 10.0 + pause)
    assert len(history.past) == entries
    assert history.past[0] is state


TUNING_CHANGES = [pin_present, set_link(SAME_NUMBERS), set_text("gate", "9")]


@pytest.mark.parametrize("change", TUNING_CHANGES)
def test_pins_and_channels_are_remembered(state, change):
    history = record(History(), state, change(state), "", 0.0)
    assert history.past == (state,)
    assert step(history, change(state), back=True)[1] == replace(
        state.with_answers(note=""), view=change(state).view
    )


@pytest.mark.parametrize("name", [field.name for field in fields(View)])
def test_undo_and_redo_leave_the_view_as_it_is(state, name):
    history = record(History(), state, set_text("q", "1")(state), "", 0.0)
    looked = set_text("q", "1")(state).with_view(**{name: "otherwise"})
    history, back = step(history, looked, back=True)
    assert (back.tuning.q, getattr(back.view, name)) == (state.tuning.q, "otherwise")
    _, forth = step(history, back.with_view(**{name: "again"}), back=False)
    assert (forth.tuning.q, getattr(forth.view, name)) == (1.0, "again")


def test_back_and_forth_is_the_identity(state):
    tuned = set_text("q", "1")(state)
    history = record(History(), state, tuned, "", 0.0)
    history, before = step(history, tuned, back=True)
    assert before.settings.tunings == state.settings.tunings
    history, after = step(history, before, back=False)
    assert after.settings.tunings == tuned.settings.tunings
    assert step(history, after, back=False) == (history, after)
    assert step(History(), state, back=True) == (History(), state)


def test_at_least_a_hundred_gestures_are_kept_but_few_recordings(state):
    history, present = History(), state
    for i in range(500):
        after = set_exponent("q", -3 + i / 200)(present)
        history, present = record(history, present, after, "", float(i)), after
    assert LIMIT >= 100
    assert 100 <= len(history.past) <= LIMIT
    for seed in range(10):
        after = opened(recording(seed), present)
        history, present = record(history, present, after, "", 0.0), after
    assert len({id(s.recording) for s in history.past}) <= 4


def test_the_session_undoes_and_redoes_by_request(state):
    session = Session(state)
    session.request(set_text("q", "1"))
    session.request(set_text("q", "2"))
    session.request(undo)
    assert session.apply_requests()[0].tuning.q == 1
    session.request(undo)
    assert session.apply_requests()[0].tuning.q == state.tuning.q
    session.request(undo)
    assert session.apply_requests()[0].answers.note == "There is nothing to undo."
    session.request(redo)
    session.request(redo)
    session.request(redo)
    settled = session.apply_requests()[0]
    assert (settled.tuning.q, settled.answers.note) == (2, "There is nothing to redo.")
