"""Changes of the State, as truth tables: what is asked, what comes of it; and the queue that carries them."""

from __future__ import annotations

import math
import threading
from dataclasses import replace

import numpy as np
import pytest

from kalscope import BadSetting, Recording, open_source, read_recording, starting_params
from kalscope.sources.samples import list_samples
from kalscope.tuning.tuning import ChannelTuning, Tuning
from kalscope_app.session.changes import (
    reset_parameters,
    select_channel,
    set_automatic_start,
    set_exponent,
    set_sample_period,
    set_text,
    set_window,
    slider_limits,
)
from kalscope_app.session.opening import later_answers, opened, opened_raw, opened_with, with_firsts
from kalscope_app.session.session import Failed, Session, undo
from kalscope_app.studies.checks import compute_checks


def recording(n=1000, period=0.01, scale=1.0, names=("a", "b"), sha256="x"):
    g = np.random.default_rng(0)
    values = scale * g.normal(size=(n, len(names)))
    time = np.arange(n) * (period or 1.0)
    return Recording(time, names, ("V",) * len(names), values, period, source="file.csv", sha256=sha256)


@pytest.fixture
def state():
    return opened(recording())


def apply(state, *changes):
    for change in changes:
        state = change(state)
    return state


def test_a_new_recording_starts_with_its_first_answer(state):
    assert state.params == starting_params(state.recording.channel("a"))
    wide = opened(recording(names=tuple(map(str, range(40)))))
    late = select_channel("39")(wide)
    assert (
        late.params
        == late.start.params
        == starting_params(wide.recording.channel("39"))
        != wide.settings.starts[39].params
    )


@pytest.mark.parametrize("source", ["demo", *(f"sample:{sample.name}" for sample in list_samples())])
def test_no_recording_opens_as_too_slow_or_too_fast(source):
    found = compute_checks(opened(open_source(source)))
    assert found.judgement.status not in ("too_slow", "too_fast", "band", "spikes", "gate")


def test_late_first_answers_leave_what_was_touched_and_are_no_step_of_undo():
    raw, whole = opened_raw(recording()), opened(recording())
    session = Session(raw)
    session.request(set_text("q", "0.5"))
    for firsts in later_answers(raw):
        session.request(lambda state, firsts=firsts: with_firsts(state, firsts))
    now = session.apply_requests()[0]
    assert (now.tuning.q, now.tuning.how) == (0.5, "by hand")
    assert now.settings.starts == whole.settings.starts
    assert now.settings.tunings[1:] == whole.settings.tunings[1:]
    session.request(undo)
    before = session.apply_requests()[0]
    assert before.settings == whole.settings
    assert before.outcome.message == whole.outcome.message
    session.request(undo)
    assert "nothing to undo" in session.apply_requests()[0].answers.note


@pytest.mark.parametrize("scale", [1e-9, 1.0, 1e9])
@pytest.mark.parametrize("name", ["q", "r", "p0"])
def test_slider_limits_follow_the_scale_of_the_data_and_hold_the_value(scale, name):
    state = opened(recording(scale=scale))
    low, high = slider_limits(state, name)
    assert low < math.log10(getattr(state.tuning, name) or state.tuning.r) < high
    assert abs((low + high) / 2 - math.log10(scale**2)) < 4


@pytest.mark.parametrize(
    ("exponent", "expected"),
    [(-1.0, 0.1), (-1.23, 0.0589), (99.0, "high"), (-99.0, "low"), (math.nan, "same")],
)
def test_a_slider_sets_three_digits_and_is_clamped(state, exponent, expected):
    low, high = slider_limits(state, "q")
    wanted = {"high": 10.0**high, "low": 10.0**low, "same": state.tuning.q}.get(expected, expected)
    assert set_exponent("q", exponent)(state).tuning.q == pytest.approx(wanted)


@pytest.mark.parametrize(
    ("name", "text", "value"),
    [
        ("q", "1e-9", 1e-9),
        ("r", " 0,5 ", 0.5),
        ("q", "0", 0.0),
        ("p0", "0", 0.0),
        ("x0", "-3.5", -3.5),
        ("x0", "", None),
        ("x0", "first", None),
        ("q", "1e-300", 1e-300),
        ("r", "1e300", 1e300),
    ],
)
def test_typed_text_is_taken_exactly(state, name, text, value):
    by_value = set_automatic_start(False)(state) if name == "x0" else state
    assert getattr(set_text(name, text)(by_value).tuning, name) == value


@pytest.mark.parametrize("text", ["abc", "", "1e", "nan", "inf", "0x10", "1 2"])
def test_text_that_is_no_number_is_refused_with_its_name(state, text):
    with pytest.raises(BadSetting, match=r"q must be a .*number"):
        set_text("q", text)(state)


def test_both_variances_zero_are_refused_and_each_alone_is_not(state):
    zero_q = set_text("q", "0")(state)
    with pytest.raises(BadSetting, match="not both be 0"):
        set_text("r", "0")(zero_q)
    assert set_text("r", "0")(state).params.r == 0


def test_channels_keep_their_own_parameters(state):
    there = apply(state, set_text("q", "7"), select_channel("b"), set_text("q", "8"))
    assert there.tuning.q == 8
    assert select_channel("a")(there).tuning.q == 7
    with pytest.raises(BadSetting, match="channel must be one of a, b"):
        select_channel("<img>")(state)


@pytest.mark.parametrize(
    ("ends", "window"),
    [
        ((1.0, 2.0), (1.0, 2.0)),
        ((2.0, 1.0), (1.0, 2.0)),
        ((-5.0, 3.0), (0.0, 3.0)),
        ((-5.0, 99.0), None),
        ((4.0, 4.0), (4.0, 4.1)),
        ((99.0, 99.0), (9.89, 9.99)),
        ((math.nan, 1.0), None),
    ],
)
def test_the_window_is_clamped_ordered_and_never_empty(state, ends, window):
    seen = set_window(*ends)(state).view.window
    assert seen == (window if window is None else pytest.approx(window))


def test_a_tuning_reopens_the_same_state(state):
    tuned = apply(state, set_text("q", "7"), select_channel("b"), set_text("p0", "0"), set_text("x0", "2"))
    again = opened_with(tuned.recording, tuned.as_tuning())
    assert again.settings.tunings == tuned.settings.tunings
    assert again.channel == "b"
    assert again.answers.note == ""


def test_a_tuning_without_a_common_channel_is_refused(state):
    with pytest.raises(BadSetting, match="the tuning must hold a or b"):
        opened_with(state.recording, Tuning((ChannelTuning("other", "", 1.0, 1.0),)))


# --- the queue ------------------------------------------------------------------------------------------


def test_requests_are_applied_in_order_and_the_serial_covers_them(state):
    session = Session(state)
    session.request(set_text("q", "1"))
    last = session.request(set_text("q", "2"))
    settled, serial, failures = session.apply_requests()
    assert (settled.tuning.q, serial, failures) == (2.0, last, [])


def test_of_requests_with_one_key_only_the_last_is_left(state):
    session, ran = Session(state), []
    for i in range(5):
        session.request(lambda s, i=i: ran.append(i) or s, key="slider")
    session.apply_requests()
    assert ran == [4]


def test_only_q_and_r_by_hand_end_how_they_were_found(state):
    found = state.with_tuning(how="maximum likelihood")
    for change in (set_text("gate", "9"), set_text("p0", "1"), set_automatic_start(False), set_exponent("p0", 0.0)):
        assert change(found).tuning.how == "maximum likelihood"
    assert set_text("q", "1")(found).tuning.how == "by hand"
    assert reset_parameters(set_text("gate", "9")(found)).tuning.gate is None


def test_a_failing_change_leaves_the_state_and_is_reported(state):
    session = Session(state)
    session.request(set_text("q", "-1"), failed=Failed.NUMBER)
    session.request(set_text("r", "5"))
    settled, _, failures = session.apply_requests()
    assert settled.tuning == replace(state.tuning, r=5.0, how="by hand")
    assert [(failed, str(error)[:9]) for failed, error in failures] == [(Failed.NUMBER, "q must be")]


@pytest.mark.slow
def test_requests_of_many_threads_are_all_applied(state):
    session, hits = Session(state), []

    def ask():
        for _ in range(200):
            session.request(lambda s: hits.append(1) or s)

    threads = [threading.Thread(target=ask) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    _, serial, _ = session.apply_requests()
    assert (len(hits), serial) == (1600, 1600)


def test_a_recording_without_time_takes_the_period_that_is_typed(state):
    untimed = opened(recording(period=None))
    timed = set_sample_period("0,02")(untimed)
    assert timed.recording.sample_period == 0.02
    assert timed.recording.time[:3].tolist() == [0.0, 0.02, 0.04]
    assert timed.settings.tunings == untimed.settings.tunings
    with pytest.raises(BadSetting, match="above 0"):
        set_sample_period("0")(untimed)


def test_the_rate_of_a_file_can_be_overruled_and_given_back(tmp_path):
    """As `--sample-period` does: the stamps stay where they are."""
    file = tmp_path / "log.csv"
    file.write_text("t_s,z\n" + "".join(f"{0.01 * i:.2f},{i % 7}\n" for i in range(60)))
    read = opened(read_recording(file))
    typed = set_sample_period("0.02")(read)
    as_option = read_recording(file, sample_period=0.02)
    assert (typed.recording.sample_period, as_option.sample_period) == (0.02, 0.02)
    assert np.array_equal(typed.recording.time, as_option.time)
    assert typed.recording.report.timing.source == "option"
    assert set_sample_period("")(set_sample_period("0.5")(typed)).recording is read.recording
    session = Session(read)
    session.request(set_sample_period("0.02"))
    assert session.apply_requests()[0].recording.sample_period == 0.02
    session.request(undo)
    assert session.apply_requests()[0].recording is read.recording
