"""Changes of the State, as truth tables: what is asked, what comes of it; and the queue that carries them."""

from __future__ import annotations

import math
import threading
from dataclasses import replace

import numpy as np
import pytest

from kalscope import BadSetting, FilterParams, Recording, read_recording, starting_params
from kalscope.common.text import typed_number
from kalscope.tuning.tuning import ChannelTuning, Tuning
from kalscope_app.session.changes import (
    reset_parameters,
    reset_view,
    select_channel,
    set_automatic_start,
    set_exponent,
    set_sample_period,
    set_text,
    set_window,
    slider_limits,
)
from kalscope_app.session.opening import opened, opened_with
from kalscope_app.session.session import Failed, Session, undo


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


@pytest.mark.parametrize("scale", [1e-9, 1.0, 1e9])
@pytest.mark.parametrize("name", ["q", "r", "p0"])
def test_slider_limits_follow_the_scale_of_the_data_and_hold_the_value(scale, name):
    state = opened(recording(scale=scale))
    low, high = slider_limits(state, name)
    assert low < math.log10(getattr(state.tuning, name) or state.tuning.r) < high
    assert abs((low + high) / 2 - math.log10(scale**2)) < 4


def test_slider_limits_widen_for_a_value_typed_outside(state):
    low, high = slider_limits(apply(state, set_text("q", "1e-20")), "q")
    assert (low, high) == (-20, slider_limits(state, "q")[1])


@pytest.mark.parametrize(
    ("exponent", "expected"),
    [(-1.0, 0.1), (-1.23, 0.0589), (99.0, "high"), (-99.0, "low"), (math.nan, "same")],
)
def test_a_slider_sets_three_digits_and_is_clamped(state, exponent, expected):
    low, high = slider_limits(state, "q")
    wanted = {"high": 10.0**high, "low": 10.0**low, "same": state.tuning.q}.get(expected, expected)
    assert set_exponent("q", exponent)(state).tuning.q == pytest.approx(wanted)


def test_moving_p0_means_a_start_by_value(state):
    moved = set_exponent("p0", 0.5)(state)
    assert (moved.tuning.p0, moved.tuning.x0) == (pytest.approx(3.16), None)


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


def test_typing_x0_in_the_automatic_start_brings_its_variance(state):
    typed = set_text("x0", "2")(state)
    assert (typed.tuning.x0, typed.tuning.p0) == (2.0, state.tuning.r)


def test_the_start_goes_to_values_and_back_to_automatic(state):
    by_value = set_automatic_start(False)(state)
    assert (by_value.tuning.p0, by_value.tuning.x0) == (state.tuning.r, None)
    back = apply(by_value, set_text("x0", "1"), set_automatic_start(True))
    assert (back.tuning.p0, back.tuning.x0) == (None, None)
    assert set_automatic_start(True)(back) is back


def test_reset_returns_to_the_starting_values(state):
    changed = apply(state, set_text("q", "7"), set_text("r", "8"), set_text("p0", "9"))
    assert reset_parameters(changed).params == state.params


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


def test_a_reset_of_the_view_shows_the_whole_recording(state):
    reset = reset_view(set_window(1.0, 3.0)(state))
    assert reset.view.window is None
    assert reset.view.resets == state.view.resets + 1


def test_a_parameter_change_never_touches_the_view(state):
    zoomed = set_window(1.0, 3.0)(state)
    for change in (set_exponent("q", 0.0), set_text("r", "2"), set_automatic_start(False), reset_parameters):
        after = change(zoomed)
        assert (after.view.window, after.view.resets, after.channel) == (
            zoomed.view.window,
            zoomed.view.resets,
            zoomed.channel,
        )


def test_a_tuning_reopens_the_same_state(state):
    tuned = apply(state, set_text("q", "7"), select_channel("b"), set_text("p0", "0"), set_text("x0", "2"))
    again = opened_with(tuned.recording, tuned.as_tuning())
    assert again.settings.tunings == tuned.settings.tunings
    assert again.channel == "b"
    assert again.answers.note == ""


def test_a_tuning_of_another_rate_scales_q_and_says_so(state):
    tuning = set_text("q", "7")(state).as_tuning()
    slower = opened_with(recording(period=0.02), tuning)
    assert slower.tuning.q == pytest.approx(14)
    assert slower.tuning.r == state.tuning.r
    assert "tuned at a sample period of 0.01 s, here it is 0.02 s" in slower.answers.note


def test_a_tuning_without_a_common_channel_is_refused(state):
    with pytest.raises(BadSetting, match="the tuning must hold a or b"):
        opened_with(state.recording, Tuning((ChannelTuning("other", "", 1.0, 1.0),)))


def test_channels_missing_in_the_tuning_get_starting_values(state):
    tuning = Tuning((ChannelTuning("b", "", 1.0, 2.0),))
    again = opened_with(state.recording, tuning)
    assert again.channel == "b"
    assert again.settings.tunings[0] == state.settings.tunings[0]


@pytest.mark.parametrize(
    ("text", "value"), [("1,5e-3", 1.5e-3), ("15 100", 15100.0), ("1 000 000", 1e6), ("−3", -3.0), ("0,001", 0.001)]
)
def test_numbers_are_read_as_people_and_the_screen_write_them(text, value):
    assert typed_number("q", text) == value


def test_minus_zero_becomes_zero():
    assert math.copysign(1.0, typed_number("x0", "-0")) == 1.0


@pytest.mark.parametrize("text", ["1,000", "12,345,678"])
def test_a_comma_for_thousands_is_refused(text):
    with pytest.raises(BadSetting, match="without a comma for thousands"):
        typed_number("q", text)


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


def test_what_is_typed_stays_with_the_channel_that_was_on_screen(state):
    session = Session(state)
    session.request(set_text("q", "7"), key="text q")
    session.request(select_channel("b"))
    session.request(set_text("q", "9"), key="text q")
    settled, serial, _ = session.apply_requests()
    assert [tuning.q for tuning in settled.settings.tunings] == [7.0, 9.0]
    assert serial == 3


def test_asking_for_the_state_sees_every_earlier_request(state):
    session, seen = Session(state), []
    session.request(set_text("q", "7"))
    session.with_state(lambda present: seen.append(present.tuning.q))
    session.apply_requests()
    assert seen == [7.0]


def test_only_q_and_r_by_hand_end_how_they_were_found(state):
    found = state.with_tuning(how="maximum likelihood")
    for change in (set_text("gate", "9"), set_text("p0", "1"), set_automatic_start(False), set_exponent("p0", 0.0)):
        assert change(found).tuning.how == "maximum likelihood"
    assert set_text("q", "1")(found).tuning.how == "by hand"
    assert reset_parameters(set_text("gate", "9")(found)).tuning.gate is None


def test_the_only_channel_of_a_tuning_fits_the_only_channel_of_a_recording(state):
    one = opened(recording(names=("z",)))
    again = opened_with(one.recording, Tuning((ChannelTuning("other", "mV", 3.0, 4.0),)))
    assert (again.tuning.name, again.tuning.unit, again.tuning.q) == ("z", "V", 3.0)
    assert "only channel" in again.answers.note


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


def test_nothing_waits_at_first(state):
    assert Session(state).apply_requests() == (state, 0, [])
    assert isinstance(state.params, FilterParams)


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


def test_a_tuning_brings_its_period_to_a_recording_without_time():
    untimed = opened(recording(period=None))
    tuned = set_sample_period("0.02")(untimed)
    again = opened_with(untimed.recording, tuned.as_tuning())
    assert again.recording.sample_period == 0.02
    assert (again.settings.tunings, again.answers.note) == (tuned.settings.tunings, "")


@pytest.mark.parametrize("text", ["", "automatic", "diffuse"])
def test_p0_is_automatic_in_every_word_for_it(state, text):
    assert apply(state, set_text("p0", "2.5"), set_text("p0", text)).tuning.p0 is None
