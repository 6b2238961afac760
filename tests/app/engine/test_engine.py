"""The engine without a browser: the latest request wins, nothing stops it; which part is drawn when, and what."""

from __future__ import annotations

import math
import threading
from dataclasses import replace
from itertools import count, pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.app.recordings import walk
from tests.support.waiting import wait_until

from kalscope import FilterParams, Recording, diagnose, kalman_filter, steady_state
from kalscope_app.engine.engine import DELAYS, Engine, Part, Schedule, Studies, Study, is_move
from kalscope_app.engine.filter_runs import MAX_POINTS, choose_samples
from kalscope_app.engine.frame import compute_frame, samples_to_settle
from kalscope_app.session.changes import pin_present, select_channel, set_slider, set_text, set_window
from kalscope_app.session.opening import opened
from kalscope_app.session.session import Session


@pytest.mark.slow
def test_while_requests_keep_coming_every_part_is_drawn_and_the_last_value_is_filtered_and_studied():
    frames, drawn, told, studied = [], {part: [] for part in Part}, [], []
    session = Session(opened(walk(3000, ("z",))))

    def show(frame, parts):
        frames.append(frame)
        for part in parts:
            drawn[part].append(frame.serial)

    failing = Study(lambda _: 1 / 0, pytest.fail, lambda error, **_how: told.append(error))
    engine = Engine(session, show, pytest.fail, Studies([failing, Study(lambda s: s, studied.append, pytest.fail)]))
    engine.start()
    often, moves = (Part.SIGNAL, Part.NUMBERS, Part.CHARTS, Part.OTHER), count()

    def moved_until_each_was_drawn():
        session.request(set_slider("q", -3.0 + 0.01 * (next(moves) % 400)), key="slider q")
        return all(len(drawn[part]) >= 4 for part in often)

    wait_until(moved_until_each_was_drawn, "four pictures of each part", pause=0.001)
    last = [session.request(set_text("q", q)) for q in ("7", "0.1")][-1]
    wait_until(lambda: all(serials[-1:] == [last] for serials in drawn.values()), "the last value in every part")
    frame = frames[-1]
    assert frame.state.tuning.q == 0.1
    expected = kalman_filter(frame.state.z, frame.state.params).x
    assert np.array_equal(frame.filtered, expected[frame.drawn.indices])
    assert all(serials == sorted(serials) for serials in drawn.values())
    wait_until(lambda: studied and studied[-1].tuning.q == 0.1, "the studies of the last state")
    assert {type(error) for error in told} == {ZeroDivisionError}  # and the next one runs
    engine.stop()
    assert not any(thread.name == "kalscope-engine" for thread in threading.enumerate())


# --- which part is drawn when ---------------------------------------------------------------------------


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
        assert moment <= moments[-1] + 0.3  # seconds after the last step of a control


def test_a_move_changes_values_only():
    z = np.random.default_rng(0).normal(size=(300, 2))
    state = opened(Recording(np.arange(300.0), ("a", "b"), ("", ""), z, 1.0))
    for move in lambda state: state, set_slider("q", 1.0), set_text("p0", "4"):
        assert is_move(state, move(state))
    for change in (
        set_window(10.0, 20.0),
        select_channel("b"),
        pin_present,
        lambda state: state.with_view(dark=True),
        set_text("momentum", "5"),
        lambda state: replace(state, note="said"),
        lambda state: opened(replace(state.recording, values=2 * z)),
    ):
        assert not is_move(state, change(state))


# --- what a frame holds ---------------------------------------------------------------------------------


@pytest.mark.parametrize("n", [1, 5, MAX_POINTS, MAX_POINTS + 1, 50_000])
def test_never_more_than_the_limit_is_drawn_and_all_of_a_short_record(n):
    for truth, missing in (False, 0.0), (True, 0.0), (False, 0.3), (False, 1.0):
        shown = choose_samples(walk(n, ("z",), missing=missing, truth=truth), "z", None)
        assert len(shown.indices) <= MAX_POINTS
        assert (np.diff(shown.indices) > 0).all()
        assert shown.decimated == (len(shown.indices) < n)
        assert n > MAX_POINTS or len(shown.indices) == n


@pytest.mark.slow
def test_what_is_drawn_is_the_filter_on_all_samples():
    state = opened(walk(20_000, ("z",), missing=0.01))
    result = kalman_filter(state.recording.channel("z"), state.params)
    frame = compute_frame(state)
    at = frame.drawn.indices
    assert frame.drawn.decimated
    assert np.array_equal(frame.filtered, result.x[at])
    assert np.array_equal(frame.spread, 2 * np.sqrt(result.p[at]))
    assert np.array_equal(frame.innovation, result.innovation[at], equal_nan=True)
    assert np.array_equal(frame.innovation_spread, 2 * np.sqrt(result.s[at]))
    assert np.array_equal(frame.gain, result.k[frame.gain_samples.astype(int)])
    assert frame.drawn.missing == np.isnan(state.recording.values).sum()


def test_time_that_steps_back_is_drawn_without_stepping_back():
    rec = walk(100, ("z",))
    time = rec.time.copy()
    time[50:] -= 0.2
    shown = choose_samples(Recording(time, rec.names, rec.units, rec.values, 0.01), "z", None)
    assert (np.diff(shown.time) >= 0).all()


@pytest.mark.parametrize("q", [1e-4, 1e-2, 1.0, 100.0])
def test_the_start_up_ends_where_the_gain_is_within_one_percent(q):
    result = kalman_filter(np.zeros(5000), FilterParams(q, 1.0))
    settled = float(steady_state(FilterParams(q, 1.0)).gain)
    at = samples_to_settle(lambda size: result.k[:size], len(result.k), settled)
    assert abs(result.k[at] / settled - 1) <= 0.01
    assert at == 0 or abs(result.k[at - 1] / settled - 1) > 0.01


@pytest.mark.parametrize("n", [2001, 3999, 50_000])
def test_a_dense_line_is_a_band_that_holds_every_sample_about_it(n):
    z = (rec := walk(n, ("z",))).values[:, 0]
    shown = choose_samples(rec, "z", None)
    low, high = shown.band
    lowest, highest = (extreme.reduceat(z, shown.indices) for extreme in (np.minimum, np.maximum))
    assert (low <= lowest).all()
    assert (highest <= high).all()
    assert (low.min(), high.max()) == (z.min(), z.max())
    late = replace(rec, time=np.where(np.arange(n) < 1000, rec.time, rec.time + 0.02 * rec.time[-1]))
    assert choose_samples(late, "z", None).band is None  # it would show readings in the gap


def test_the_chart_marks_the_samples_that_the_gate_rejected_as_often_as_all_count_them():
    one = walk(900, ("z",))
    one.values[[100, 400, 401], 0] += 40.0
    state = opened(one).with_tuning(gate=16.0)
    frame = compute_frame(state)
    result = kalman_filter(one.channel("z"), state.params)
    assert frame.refused is not None
    assert int(np.isfinite(frame.refused).sum()) == frame.rejected == result.rejected >= 3
    assert frame.rejected == diagnose(result).evidence.refused
    assert set(np.flatnonzero(np.isfinite(frame.refused))) >= {100, 400, 401}
    assert compute_frame(state.with_tuning(gate=None)).refused is None
