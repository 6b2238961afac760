"""Fused sensors in the session: what each gesture does to the State, what Undo restores, what a file holds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.app.recordings import Board, walk

from kalscope import BadSetting, load_tuning, save_tuning
from kalscope.estimation.result import Estimate
from kalscope.filtering.filter import GrowingRun, fuse
from kalscope.filtering.params import FilterParams
from kalscope.tuning.tuning import ChannelTuning
from kalscope_app.engine.filter_runs import FilterRuns
from kalscope_app.engine.frame import compute_frame
from kalscope_app.session import changes
from kalscope_app.session.changes import apply_estimate, select_channel, set_taking_part, set_text, stop_fusing
from kalscope_app.session.opening import adapted, opened, opened_raw
from kalscope_app.session.session import Session, redo, undo
from kalscope_app.session.state import SAME_NUMBERS

SENSORS = ("a", "b", "c")


def recording(names=(*SENSORS, "t"), units=("mm", "mm", "mm", "degC"), n=600):
    return walk(n, names, units, 0.02)


def params():
    return FilterParams(0.01, [1.0, 0.25, 4.0], gate=16.0, offset=[0.0, 0.5, -0.5])


FOUND = Estimate(q=0.01, r=params().r, loglik=0.0, verdict="ok", message="", params=params())


@pytest.fixture
def state():
    rec = recording()
    return apply_estimate(rec, SENSORS, FOUND)(opened(rec))


def test_one_sensor_and_sensors_of_two_units_are_refused(state):
    for sensors, why in (("a",), "tick 2 to"), (("a", "t"), "one unit"):
        with pytest.raises(BadSetting, match=why):
            changes.readings_of(state, sensors)


def test_fused_sensors_are_on_screen_in_place_of_the_channel(state):
    frame, expected = compute_frame(state), fuse(state.readings, params())
    assert np.array_equal(frame.filtered, expected.x)
    assert np.array_equal(frame.spread, 2.0 * np.sqrt(expected.p))
    assert frame.rejected == expected.rejected.sum()
    assert [(one.name, one.colour) for one in frame.sensors] == [("c", 2), ("a", 0), ("b", 1)]  # the noisiest first
    assert np.array_equal(frame.sensors[2].raw, state.recording.channel("b"))
    assert frame.sensors[2].difference == pytest.approx(state.recording.channel("b") - 0.5 - expected.x)
    assert (state.tuning.name, state.is_standard) == ("fused", False)
    assert state.tuning.r == pytest.approx(1.0 / (1.0 + 4.0 + 0.25))


def test_a_sensor_that_drops_out_changes_line_shares_and_no_other_sensor(state):
    without = set_taking_part("c", False)(state)
    shares = without.fusion.shares
    assert shares == {"a": pytest.approx(0.2), "b": pytest.approx(0.8), "c": 0.0}
    assert np.array_equal(compute_frame(without).filtered, fuse(without.readings, params().only([0, 1])).x)
    assert [one.name for one in compute_frame(without).sensors] == ["a", "b"]
    assert set_taking_part("c", True)(without).settings == state.settings
    with pytest.raises(BadSetting, match="at least one sensor"):
        set_taking_part("a", False)(set_taking_part("b", False)(without))


def test_noise_and_offset_of_a_sensor_are_typed(state):
    assert changes.set_sensor_text("b", "r", "0.1")(state).fusion.tuning.how == "by hand"
    typed = changes.set_sensor_text("c", "offset", "2.5")(changes.set_sensor_text("c", "r", "9")(state))
    assert (typed.fusion.tuning.r[2], typed.fusion.tuning.offset[2]) == (9.0, 2.5)
    assert changes.set_sensor_text("c", "offset", " ")(typed).fusion.tuning.offset[2] == 0.0
    assert changes.set_sensor_text("c", "r", "9")(typed) is typed
    for text in ("much", "-1"):
        with pytest.raises(BadSetting, match=r"r of c|r must be"):
            changes.set_sensor_text("c", "r", text)(state)


def test_q_momentum_and_gate_are_those_of_the_fused_filter_while_it_is_on_screen(state):
    before = state.tunings
    tuned = set_text("momentum", "20")(changes.set_slider("q", -1.0)(state))
    assert (tuned.fusion.used.params.q, tuned.fusion.used.params.momentum) == (0.1, 20.0)
    assert tuned.tunings == before
    assert set_text("gate", "off")(tuned).fusion.used.params.gate is None
    assert np.array_equal(compute_frame(tuned).filtered, fuse(tuned.readings, tuned.fusion.used.params).x)
    assert changes.reset_parameters(set_taking_part("a", False)(tuned)).settings == state.settings
    linked = stop_fusing(changes.set_link(SAME_NUMBERS)(tuned))  # of the channels, not of the fused value
    assert tuple(one.name for one in linked.tunings) == linked.recording.names
    assert linked.tuning == before[0]


def test_each_gesture_is_undone_and_done_again(state):
    fuse_again = apply_estimate(state.recording, SENSORS, FOUND)
    drop, noise = set_taking_part("a", False), changes.set_sensor_text("b", "r", "0.1")
    session = Session(opened(state.recording))
    seen = [session.apply_requests()[0]]
    for gesture in (fuse_again, drop, noise, select_channel("b"), select_channel("fused"), stop_fusing):
        session.request(gesture)
        seen.append(session.apply_requests()[0])
    for step, states in ((undo, seen[-2::-1]), (redo, seen[1:])):
        for wanted in states:
            session.request(step)
            now = session.apply_requests()[0]
            assert (now.settings, now.fusion, now.channel) == (wanted.settings, wanted.fusion, wanted.channel)


def test_the_tuning_file_holds_the_sensors_that_take_part_and_opens_fused(state, tmp_path):
    without = set_taking_part("a", False)(state)
    save_tuning(without.as_tuning(), tmp_path / "t.toml")
    again = adapted(opened_raw(recording()), load_tuning(tmp_path / "t.toml"))
    assert again.fusion.tuning == without.fusion.used
    assert np.array_equal(compute_frame(again).filtered, compute_frame(without).filtered)
    other = adapted(opened_raw(recording(("a", "x"), ("mm", "mm"))), state.as_tuning())
    assert (other.fusion, "not all here" in other.note) == (None, True)


@pytest.mark.slow
def test_a_recording_of_the_same_sensors_stays_fused_and_another_one_not(state):
    assert opened(recording(n=300), state).fusion == state.fusion
    other = opened(recording(("a", "b"), ("mm", "mm")), state)
    assert (other.fusion, other.fused, other.shows_fused) == (None, None, False)
    late = apply_estimate(state.recording, SENSORS, FOUND)(other)
    assert (late.settings, "another recording" in late.note) == (other.settings, True)


def test_of_a_live_record_only_new_rows_are_fused_and_the_line_is_that_of_all(monkeypatch):
    board, runs, taken = Board(SENSORS), FilterRuns(), []
    extend = GrowingRun.extend
    monkeypatch.setattr(GrowingRun, "extend", lambda self, z: (taken.append(len(z)), extend(self, z))[1])
    state = changes.refreshed(changes.opened_live(board.id, "x"), board.send(500).snapshot())
    state = apply_estimate(state.recording, SENSORS, FOUND)(state)
    for sent, first in ((0, 0), (20, 0), (7, 100), (0, 100)):
        board.first = first
        state = changes.refreshed(state, board.send(sent, seed=9).snapshot())
        whole = fuse(board.values, params()).x
        assert np.array_equal(compute_frame(changes.set_span("all")(state), runs=runs).filtered, whole[first:])
    assert taken == [500, 20, 7, 0]


def test_sensors_of_other_units_are_fused_by_a_file_and_drawn_on_the_scale_of_the_quantity():
    rec = recording(("a", "b"), ("mm", "mV"))
    tuning = ChannelTuning("level", "mm", 0.01, (1.0, 4.0), sensors=("a", "b"), offset=(0.0, 5.0), gain=(1.0, -2.0))
    state = adapted(opened_raw(rec), replace(opened(rec).as_tuning(), fusion=tuning))
    assert (state.fusion.tuning, changes.candidates(state)) == (tuning, ("a", "b"))
    drawn = {one.name: one.raw for one in compute_frame(state).sensors}
    assert drawn["b"] == pytest.approx((rec.channel("b") - 5.0) / -2.0)
