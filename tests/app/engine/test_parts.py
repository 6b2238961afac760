"""What is drawn when, with a clock of the test: the signal at once, the rest soon, and all of it in the end."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kalscope import Recording
from kalscope_app.engine.engine import DELAYS, Part, Schedule, is_move
from kalscope_app.session.changes import (
    pin_present,
    select_channel,
    set_exponent,
    set_momentum_text,
    set_text,
    set_window,
)
from kalscope_app.session.opening import opened

SETTLED = 0.3
"""Seconds after the last step of a control in which all must be drawn."""


def drawn(moments):
    """The parts that are drawn, as (moment, frame, part), when frames come at these moments."""
    schedule, log = Schedule(), []
    for number, (now, following) in enumerate(pairwise([*moments, math.inf])):
        log += [(now, number, part) for part in schedule.begin(now, whole=number == 0)]
        while (due := schedule.next_due()) < following:
            log += [(due, number, part) for part in schedule.take_due(due, moving=False)]
    return log


@pytest.mark.slow
@given(st.lists(st.floats(0.001, 0.5), max_size=60))
def test_every_part_shows_the_last_frame_soon_and_none_is_starved(gaps):
    moments = np.cumsum([1.0, *gaps]).tolist()
    log = drawn(moments)
    for part in Part:
        shown = [(moment, number) for moment, number, which in log if which is part]
        if part is not Part.SIGNAL:
            longest = DELAYS[part][1]
            for (_, before), (moment, _) in pairwise(shown):  # the first frame that this part left out
                assert moment <= moments[before + 1] + longest + 1e-9
        else:
            assert shown == [(moment, number) for number, moment in enumerate(moments)]
    for part in set(Part) - {Part.SIGNAL}:
        moment, number = [(moment, number) for moment, number, which in log if which is part][-1]
        assert number == len(moments) - 1
        assert moment <= moments[-1] + SETTLED


def test_the_signal_is_drawn_alone_and_what_is_no_move_at_once():
    schedule = Schedule()
    assert schedule.begin(0.0, whole=True) == tuple(Part)
    assert schedule.next_due() == math.inf
    assert schedule.begin(1.0, whole=False) == (Part.SIGNAL,)
    assert schedule.take_due(1.0, moving=False) == ()
    assert schedule.begin(1.01, whole=True) == tuple(Part)
    assert schedule.next_due() == math.inf


def test_a_newer_frame_goes_before_what_may_wait_and_after_what_may_not():
    schedule, step, drawn = Schedule(), 0.001, {part: [0.0] for part in DELAYS}
    schedule.begin(0.0, whole=True)
    for moment in np.arange(1, 5000) * step:  # newer frames all the time
        for part in schedule.take_due(moment, moving=True):
            drawn[part].append(moment)
        schedule.begin(moment, whole=False)
    for part, (_, longest) in DELAYS.items():
        if longest < math.inf:
            assert np.diff(drawn[part]) == pytest.approx(longest, abs=2 * step)
        else:
            assert len(drawn[part]) == 1


@pytest.fixture(scope="module")
def state():
    z = np.random.default_rng(0).normal(size=(300, 2))
    return opened(Recording(np.arange(300.0), ("a", "b"), ("", ""), z, 1.0))


def test_a_move_changes_values_only(state):
    assert is_move(state, state)
    assert is_move(state, set_exponent("q", 1.0)(state))
    assert is_move(state, set_text("p0", "4")(state))
    for change in (
        set_window(10.0, 20.0),
        select_channel("b"),
        pin_present,
        lambda state: state.with_view(dark=True),
        set_momentum_text("momentum", "5"),
        lambda state: state.with_answers(note="said"),
        lambda state: opened(
            Recording(state.recording.time, ("a", "b"), ("", ""), 2 * state.recording.values, 1.0)
        ),
    ):
        assert not is_move(state, change(state))
