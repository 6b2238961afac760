"""Changes of the State, as truth tables, the queue that carries them, undo and redo, and a settings file loaded."""

from __future__ import annotations

import math
from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.app.recordings import walk

from kalscope import BadFile, BadSetting, open_source, read_recording
from kalscope.estimation.request import starting_params
from kalscope.filtering.params import MAX_MOMENTUM
from kalscope.sources.samples import list_samples
from kalscope.tuning.file import dumps
from kalscope_app.session import changes
from kalscope_app.session.changes import reset_parameters, select_channel, set_slider, set_text
from kalscope_app.session.opening import later_answers, opened, opened_raw, with_firsts
from kalscope_app.session.session import HELD, LIMIT, Failed, History, Session, record, redo, step, undo
from kalscope_app.session.state import View
from kalscope_app.studies.checks import compute_checks


@pytest.fixture
def state():
    return opened(walk())


def test_a_new_recording_starts_with_its_first_answer(state):
    assert state.params == starting_params(state.z)
    wide = opened(walk(names=tuple(map(str, range(40)))))
    late = select_channel("39")(wide)
    assert late.params == late.start.params == starting_params(late.z) != wide.starts[39].params


@pytest.mark.slow
def test_no_sample_opens_as_too_slow_or_too_fast():
    for sample in list_samples():
        judgement = compute_checks(opened(open_source(f"sample:{sample.name}"))).judgement
        assert judgement.status not in ("too_slow", "too_fast", "band", "spikes", "gate"), sample.name


def test_late_first_answers_leave_what_was_touched_and_are_no_step_of_undo():
    raw, whole = opened_raw(walk()), opened(walk())
    session = Session(raw)
    session.request(set_text("q", "0.5"))
    for firsts in later_answers(raw):
        session.request(lambda state, firsts=firsts: with_firsts(state, firsts))
    now = session.apply_requests()[0]
    assert (now.tuning.q, now.tuning.how) == (0.5, "by hand")
    assert (now.starts, now.tunings[1:]) == (whole.starts, whole.tunings[1:])
    session.request(undo)
    before = session.apply_requests()[0]
    assert (before.settings, before.outcome.message) == (whole.settings, whole.outcome.message)
    session.request(undo)
    assert "nothing to undo" in session.apply_requests()[0].note


@pytest.mark.parametrize("scale", [1e-9, 1.0, 1e9])
def test_a_slider_follows_the_scale_of_the_data_sets_three_digits_and_is_clamped(scale):
    state = opened(walk(scale=scale))
    for name in ("q", "r", "p0"):
        low, high = changes.slider_limits(state, name)
        assert low < math.log10(getattr(state.tuning, name) or state.tuning.r) < high
        assert abs((low + high) / 2 - math.log10(scale**2)) < 4
        place = low + 0.77
        for exponent, value in (99.0, 10.0**high), (-99.0, 10.0**low), (place, float(f"{10**place:.2e}")):
            assert getattr(set_slider(name, exponent)(state).tuning, name) == pytest.approx(value, rel=1e-12)
    assert set_slider("q", math.nan)(state) is state


def test_typed_text_is_taken_exactly_or_refused_with_its_name(state):
    state = set_text("p0", "1")(state)
    for name, text, value in (
        *(("q", "1e-9", 1e-9), ("q", "0", 0.0), ("r", " 0,5 ", 0.5), ("r", "1e300", 1e300)),
        *(("p0", "0", 0.0), ("p0", "diffuse", None), ("x0", "-3.5", -3.5), ("x0", "", None), ("x0", "first", None)),
    ):
        assert getattr(set_text(name, text)(state).tuning, name) == value
    for text in ("abc", "", "1e", "nan", "inf", "0x10", "1 2"):
        with pytest.raises(BadSetting, match=r"q must be a .*number"):
            set_text("q", text)(state)


def test_the_window_is_clamped_ordered_and_never_empty(state):
    for ends, window in (
        *(((1.0, 2.0), (1.0, 2.0)), ((2.0, 1.0), (1.0, 2.0)), ((-5.0, 3.0), (0.0, 3.0)), ((-5.0, 99.0), None)),
        *(((4.0, 4.0), (4.0, 4.1)), ((99.0, 99.0), (9.89, 9.99)), ((math.nan, 1.0), None)),
    ):
        seen = changes.set_window(*ends)(state).view.window
        assert seen == (window if window is None else pytest.approx(window)), ends


# --- the queue ------------------------------------------------------------------------------------------


def test_requests_are_applied_in_order_of_those_with_one_key_only_the_last_and_one_that_fails_is_reported(state):
    session, ran = Session(state), []
    for i in range(5):
        session.request(lambda s, i=i: ran.append(i) or s, key="slider")
    session.request(set_text("q", "-1"), failed=Failed.NUMBER)
    last = [session.request(set_text("r", text)) for text in "15"][-1]
    settled, serial, failures = session.apply_requests()
    assert (ran, settled.tuning, serial) == ([4], replace(state.tuning, r=5.0, how="by hand"), last)
    assert [(failed, str(error)[:9]) for failed, error in failures] == [(Failed.NUMBER, "q must be")]


def test_only_q_and_r_by_hand_end_how_they_were_found(state):
    found = state.with_tuning(how="maximum likelihood")
    for change in (set_text("gate", "9"), set_text("p0", "1"), set_slider("p0", 0.0)):
        assert change(found).tuning.how == "maximum likelihood"
    assert set_text("q", "1")(found).tuning.how == "by hand"
    assert reset_parameters(set_text("gate", "9")(found)).tuning.gate is None


def test_the_rate_of_a_file_can_be_overruled_and_given_back(tmp_path):
    """As `--sample-period` does: the stamps stay where they are."""
    file = tmp_path / "log.csv"
    file.write_text("t_s,z\n" + "".join(f"{0.01 * i:.2f},{i % 7}\n" for i in range(60)))
    read, as_option = opened(read_recording(file)), read_recording(file, sample_period=0.02)
    typed = changes.set_sample_period("0.02")(read)
    assert typed.recording.sample_period == as_option.sample_period == 0.02
    assert np.array_equal(typed.recording.time, as_option.time)
    assert typed.recording.report.timing.source == "option"
    assert changes.set_sample_period("")(changes.set_sample_period("0.5")(typed)).recording is read.recording
    assert step(record(History(), read, typed, "", 0.0), typed, back=True)[1].recording is read.recording
    untimed = opened(walk(period=None))
    assert changes.set_sample_period("0,02")(untimed).recording.time[:3].tolist() == [0.0, 0.02, 0.04]
    with pytest.raises(BadSetting, match="above 0"):
        changes.set_sample_period("0")(untimed)


# --- undo and redo --------------------------------------------------------------------------------------


def test_quick_changes_of_one_control_are_one_gesture(state):
    first, second = set_text("q", "1")(state), set_text("q", "2")(state)
    for key, next_key, pause, entries in (
        *(("slider q", "slider q", 0.1, 1), ("slider q", "slider q", 1.1, 2), ("slider q", "slider r", 0.1, 2)),
        *(("slider q", "", 0.1, 2), (f"{HELD}map", f"{HELD}map", 60.0, 1)),
    ):
        history = record(History(), state, first, key, 10.0)
        history = record(history, first, second, next_key, 10.0 + pause)
        assert (len(history.past), history.past[0]) == (entries, state)


def test_undo_and_redo_leave_the_view_as_it_is_but_show_another_channel_from_its_beginning(state):
    tuned = set_text("q", "1")(state)
    names = [field.name for field in fields(View)]
    otherwise, again = dict.fromkeys(names, "otherwise"), dict.fromkeys(names, "again")
    history, back = step(record(History(), state, tuned, "", 0.0), tuned.with_view(**otherwise), back=True)
    assert (back.tuning.q, back.view) == (state.tuning.q, View(**otherwise))
    _, forth = step(history, back.with_view(**again), back=False)
    assert (forth.tuning.q, forth.view) == (1.0, View(**again))
    other = select_channel("b")(state)
    _, back = step(record(History(), state, other, "", 0.0), other, back=True)
    assert (back.channel, back.view.resets) == ("a", other.view.resets + 1)


@pytest.mark.slow
def test_at_least_a_hundred_gestures_are_kept_but_few_recordings(state):
    history, present = History(), state
    for i in range(500):
        after = set_slider("q", -3 + i / 200)(present)
        history, present = record(history, present, after, "", float(i)), after
    assert 100 <= len(history.past) <= LIMIT
    for _ in range(10):
        after = opened(walk(), present)
        history, present = record(history, present, after, "", 0.0), after
    assert len({id(s.recording) for s in history.past}) <= 4


def test_the_session_undoes_and_redoes_by_request(state):
    session, first, changed = Session(state), state.tuning.q, [(set_text("q", q), float(q)) for q in "12"]
    for change, q in (*changed, (undo, 1), (undo, first), (undo, first), (redo, 1), (redo, 2), (redo, 2)):
        session.request(change)
        settled = session.apply_requests()[0]
        assert settled.tuning.q == q
    assert settled.note == "There is nothing to redo."


# --- the momentum τ -------------------------------------------------------------------------------------


def with_momentum(state, momentum):
    return set_text("momentum", repr(momentum))(state)


@pytest.mark.slow
@given(st.floats(0.0, changes.MAX_POSITION))
def test_the_slider_stays_where_it_was_put(position):
    """The slider is set again where it is more than half a step away, so it must come back nearer than that."""
    assert abs(changes.slider_position(changes.momentum_at(position)) - position) < 0.005


def test_the_ends_of_the_slider_are_off_and_the_longest_whatever_a_browser_sends(state):
    for position, expected in (-1e300, 0.0), (0.0, 0.0), (1e300, MAX_MOMENTUM), (math.nan, 7.0):
        assert changes.set_slider("momentum", position)(with_momentum(state, 7.0)).tuning.momentum == expected


def test_a_momentum_is_typed_in_samples_or_as_a_time_or_refused_by_its_name(state):
    for text, samples in (
        *(("12", 12.0), ("12,5", 12.5), ("12 samples", 12.0), ("0", 0.0), ("off", 0.0), ("", 0.0), (" OFF ", 0.0)),
        *(("120 ms", 12.0), ("120ms", 12.0), ("0.12 s", 12.0), ("0.002 min", 12.0)),
    ):
        typed = set_text("momentum", text)(with_momentum(state, 3.0))
        assert typed.tuning.momentum == pytest.approx(samples, rel=1e-12)
    for text in ("-1", "1e6", "nan", "inf", "much", "ms", "-3 ms", "9 h", "1 2"):
        with pytest.raises(BadSetting, match="momentum must be"):
            set_text("momentum", text)(state)
    with pytest.raises(BadSetting, match="momentum must be in samples while the sample period is not known"):
        set_text("momentum", "120 ms")(opened(walk(period=None)))


# --- a settings file loaded onto what is open -----------------------------------------------------------


def test_a_file_that_was_saved_comes_back_can_be_undone_and_is_rescaled_for_another_rate(state):
    tuned = state
    for name, text in {"q": "7", "r": "3", "p0": "2", "gate": "16", "momentum": "12"}.items():
        tuned = set_text(name, text)(tuned)
    session, tuning = Session(state), changes.uploaded_settings("mine.toml", dumps(tuned.as_tuning()).encode())
    session.request(changes.use_settings(tuning, "mine.toml"))
    loaded = session.apply_requests()[0]
    assert (loaded.tunings, loaded.note) == (tuned.tunings, "Loaded mine.toml.")
    session.request(undo)
    assert session.apply_requests()[0].settings == state.settings
    slower = changes.use_settings(tuning, "mine.toml")(opened(walk(period=0.02)))
    assert slower.tuning.q == pytest.approx(14.0)
    assert slower.note.startswith("Loaded mine.toml. Q was multiplied by 2")
    untimed = changes.use_settings(tuning, "mine.toml")(opened(walk(period=None)))
    assert (untimed.recording.sample_period, untimed.tuning.q) == (0.01, 7.0)


@pytest.mark.parametrize("content", [b"", b"a = 1", b"\xff\xfe", b"[[channel]]\nname = 3", b"#" * 1_000_001])
def test_what_is_no_settings_file_is_refused_by_name(content):
    with pytest.raises(BadFile, match=r"mine\.toml"):
        changes.uploaded_settings("mine.toml", content)
