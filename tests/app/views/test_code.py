"""The folder "Export code": what leaves is what is on screen, or it is refused in plain words."""

from __future__ import annotations

import html
import io
import re
import zipfile
from dataclasses import replace

import numpy as np
import pytest

from kalscope import BadSetting, Recording, export_tuning, steady_state
from kalscope.estimation.request import Noise, Request, find_parameters
from kalscope.export.registry import TARGETS
from kalscope_app.session.changes import apply_found, pin_present, set_text
from kalscope_app.session.opening import opened, opened_experiment
from kalscope_app.session.session import History, record, step
from kalscope_app.session.share import share_line
from kalscope_app.views.export import (
    GAPS,
    TITLES,
    Choice,
    DeviceNotes,
    device_notes,
    device_tuning,
    files_of,
    goal_of,
    has_calibration,
    html_report,
    limits_text,
    packed,
    toggled,
)


@pytest.fixture
def state():
    z = np.random.default_rng(2).normal(500.0, 3.0, (300, 2))
    recording = Recording(np.arange(300) * 0.005, ("a", "b"), ("counts", ""), z, 0.005)
    return set_text("q", "0.02")(opened(recording))


def undated(files):
    """The files without the moment at which each was made."""
    return {name: re.sub(r"\d{4}-\d\d-\d\dT[\d:]+Z", "", text) for name, text in files.items()}


@pytest.mark.parametrize("target", list(TITLES.values()))
def test_the_files_are_those_of_the_setting_on_screen(state, target):
    one, both = (export_tuning(state.as_tuning(), target, channel=name) for name in ("a", None))
    assert undated(files_of(state, Choice(target))) == undated(one)
    assert undated(files_of(state, Choice(target, all_channels=True))) == undated(both)


def test_another_period_of_the_device_carries_q_over(state):
    (text,) = files_of(state, Choice("json", period=" 0,02 ")).values()
    assert '"process_noise_q": 0.08' in text
    assert "at 0.005 s: by hand; q times 4" in text
    with pytest.raises(BadSetting, match="period must be a number"):
        files_of(state, Choice("json", period="often"))


@pytest.mark.slow
def test_the_second_papers_filter_is_refused_wherever_it_would_leave():
    state = opened_experiment("generalized_figure_8")
    with pytest.raises(BadSetting, match="cannot be exported"):
        files_of(state, Choice())
    assert "Khan et al. filter" in limits_text(state)
    assert files_of(state.with_standard_filter(), Choice())


def test_what_differs_on_a_device_is_told_of_what_is_chosen(state):
    assert limits_text(state) == ""
    assert "period must be a number" in limits_text(state, Choice(period="often"))
    small = set_text("q", "1e-12")(state)
    assert "Export c, in double, or take a larger q" in limits_text(small)
    assert limits_text(small, Choice("c")) == ""


def test_a_unit_that_the_board_does_not_read_is_said(state):
    recording = replace(state.recording, units=("V", ""))
    in_volts = state.with_open(recording=recording).with_settings(
        tunings=tuple(replace(one, unit=unit) for one, unit in zip(state.settings.tunings, ("V", ""), strict=True))
    )
    assert "The sketch reads counts, but a is in V:" in limits_text(in_volts).replace("\\", "")
    assert limits_text(in_volts, Choice("c")) == ""


def test_gaps_that_count_on_screen_are_said_not_to_count_on_a_device(state):
    uneven = replace(state.recording, time=state.recording.time + (np.arange(300) > 100) * 1.0, gaps="dt")
    assert GAPS in limits_text(state.with_open(recording=uneven))
    assert GAPS not in limits_text(state.with_open(recording=replace(uneven, gaps="rows")))
    assert GAPS not in limits_text(state.with_open(recording=replace(state.recording, gaps="dt")))


def test_one_file_is_sent_as_it_is_and_several_as_a_zip(state):
    assert packed("json", {"a.json": "{}"}) == ("a.json", b"{}")
    files = files_of(state, Choice(), vectors=True)
    name, content = packed("arduino", files)
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        found = {one: archive.read(one).decode() for one in archive.namelist()}
    assert found == {f"kalscope_filter/{one}": text for one, text in files.items()}, "as the Arduino IDE opens it"
    assert name == "kalscope_filter.zip"
    assert packed("json", {"a": "", "b": ""})[0] == "kalscope-json.zip"


def found_at(state, **target):
    """The state after a search for a goal."""
    request = Request(target=target, noise=Noise(r=state.tuning.r))
    answer = find_parameters(state.z, request, sample_period=state.recording.sample_period)
    return apply_found(state.recording, state.channel, answer)(state)


def lag_in_code(state, choice):
    """Both lags that the exported header states, ms: as asked for where it says for this period, and settled."""
    text = files_of(state, choice)["kalscope_filter.c"]
    asked = re.search(r"found: (?:at (\S+) s: )?a lag of (\S+) ms", text)
    settled = float(re.search(r"lag behind a ramp .* = (\S+) s", text)[1]) * 1e3
    return (asked[1], float(asked[2])), settled


def test_the_lag_at_the_period_of_the_device_is_shown_and_the_goal_can_be_met_there(state):
    found = found_at(state, lag_s=0.05)
    assert device_notes(found, Choice()).lag == "Lag **50 ms** at 5 ms per sample, as recorded."
    assert device_notes(found, Choice()).offer == ""
    choice = Choice("c", period="0.01")
    notes = device_notes(found, choice)
    assert re.fullmatch(r"Lag \*\*(6\d|7\d)[.\d]* ms\*\* at 10 ms per sample; 50 ms as recorded\.", notes.lag)
    assert notes.offer == "Meet 50 ms at this period"
    asked, settled = lag_in_code(found, choice)
    assert asked == ("0.005", 50.0)
    assert settled > 60.0
    met = toggled(choice, found)
    assert device_notes(found, met).lag == "Lag **50 ms** at 10 ms per sample; 50 ms as recorded."
    assert device_notes(found, met).offer == "Use q as tuned"
    asked, settled = lag_in_code(found, met)
    assert asked == ("0.01", 50.0)
    assert settled == pytest.approx(50.0, rel=1e-3)
    assert toggled(met, found) == choice
    assert "r = " in files_of(found, met)["kalscope_filter.c"]


def test_a_goal_that_is_left_is_no_longer_met(state):
    found = found_at(state, lag_s=0.05)
    met = toggled(Choice("c", period="0.01"), found)
    changed = set_text("q", "0.7")(found)
    assert goal_of(changed) is None
    assert device_notes(changed, met).offer == ""
    assert undated(files_of(changed, met)) == undated(files_of(changed, Choice("c", period="0.01")))


@pytest.mark.parametrize(
    ("target", "offer"),
    [
        ({"noise_reduction_db": 10.0}, "Meet −10.0 dB at this period"),
        ({"cutoff_hz": 5.0}, "Meet 5.00 Hz at this period"),
        ({"lag_samples": 8.0}, "Meet 8 samples at this period"),
        ({"gain": 0.25}, "Meet gain 0.250 at this period"),
    ],
)
def test_every_goal_is_offered_and_met(state, target, offer):
    found = found_at(state, **target)
    choice = Choice("json", period="0.02")
    assert device_notes(found, choice).offer == offer
    met = device_tuning(found, toggled(choice, found))
    steady = steady_state(met.channel("a").params, 0.02)
    ((name, wanted),) = target.items()
    assert float(getattr(steady, name)) == pytest.approx(wanted, rel=1e-6)


def test_without_a_goal_or_a_period_nothing_is_offered(state):
    assert device_notes(state, Choice(period="0.01")).offer == ""
    assert "as recorded" in device_notes(state, Choice(period="0.01")).lag
    assert device_notes(state, Choice(period="often")).lag == ""
    untimed = state.with_open(recording=replace(state.recording, sample_period=None))
    assert device_notes(untimed) == DeviceNotes("", "", "")
    assert device_notes(opened_experiment("generalized_figure_8")).lag == ""


@pytest.mark.slow
def test_the_report_of_the_dashboard_reopens_without_a_file_and_has_the_pins(state):
    pinned = pin_present(state)
    text = html_report(set_text("q", "0.5")(pinned)).decode()
    assert html.escape(share_line(set_text("q", "0.5")(pinned)).line) in text
    assert "tuning.toml" not in text
    assert "<td>A</td><td>0.0200</td>" in text
    assert "Pinned settings" not in html_report(state).decode()
    with pytest.raises(BadSetting, match="choose the Kalman filter"):
        html_report(opened_experiment("generalized_figure_8"))


def test_undo_brings_no_earlier_sending_back(state):
    before, present = replace(state, sent="first"), replace(set_text("q", "0.5")(state), sent="second")
    history = record(History(), before, present, "", 0.0)
    assert step(history, present, back=True)[1].sent == "second"


def test_a_sketch_that_measures_is_that_of_the_command_line(state):
    choice = Choice("arduino", calibration=True)
    expected = export_tuning(state.as_tuning(), "arduino", channel="a", calibration=True)
    assert undated(files_of(state, choice)) == undated(expected)
    assert "KalscopeCalibration.h" in expected
    assert [name for name in TARGETS if has_calibration(name)] == ["arduino"]
    assert "r of a must be above 0 for a sketch that measures it" in limits_text(state.with_tuning(r=0.0), choice)
