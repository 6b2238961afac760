"""The folder "Export code": what leaves is what is on screen, or it is refused in plain words."""

from __future__ import annotations

import io
import re
import zipfile
from dataclasses import replace

import numpy as np
import pytest

from kalscope import BadSetting, Recording, export_tuning
from kalscope.export.registry import TARGETS
from kalscope_app.session.changes.parameters import set_text
from kalscope_app.session.history import History, record, step_back
from kalscope_app.session.opening import opened, opened_experiment
from kalscope_app.views.export.code import GAPS, TITLES, Choice, files_of, has_fixed_gains, limits_text, packed


@pytest.fixture
def state():
    z = np.random.default_rng(2).normal(500.0, 3.0, (300, 2))
    recording = Recording(np.arange(300) * 0.005, ("a", "b"), ("counts", ""), z, 0.005)
    return set_text("q", "0.02")(opened(recording))


def undated(files):
    """The files without the moment at which each was made."""
    return {name: re.sub(r"\d{4}-\d\d-\d\dT[\d:]+Z", "", text) for name, text in files.items()}


@pytest.mark.parametrize("target", [name for name in TITLES.values() if "filter" not in name])
def test_the_files_are_those_of_the_setting_on_screen(state, target):
    one, both = (export_tuning(state.as_tuning(), target, channel=name) for name in ("a", None))
    assert undated(files_of(state, Choice(target))) == undated(one)
    assert undated(files_of(state, Choice(target, all_channels=True))) == undated(both)


def test_fixed_gains_are_the_settled_filter_and_are_refused_before_a_button_is_pressed(state):
    choice = Choice("c", fixed_gains=True)
    expected = export_tuning(state.as_tuning(), "c", channel="a", fixed_gains=True)
    assert undated(files_of(state, choice)) == undated(expected)
    assert [name for name in TARGETS if has_fixed_gains(name)] == ["arduino", "c"]
    gated = set_text("gate", "9")(state)
    assert "outlier gate of a must be off" in limits_text(gated, choice).replace("\\", "")
    assert limits_text(gated, Choice("c")) == ""
    slow = Choice("arduino", period="0.00002")
    assert "an Uno needs" in limits_text(state, slow)
    assert "an Uno needs" not in limits_text(state, replace(slow, fixed_gains=True))


def test_another_period_of_the_device_carries_q_over(state):
    (text,) = files_of(state, Choice("json", period=" 0,02 ")).values()
    assert '"process_noise_q": 0.08' in text
    assert "at 0.005 s: by hand; q times 4" in text
    with pytest.raises(BadSetting, match="period must be a number"):
        files_of(state, Choice("json", period="often"))


def test_the_second_papers_filter_is_refused_wherever_it_would_leave():
    state = opened_experiment("generalized_figure_8")
    with pytest.raises(BadSetting, match="must be the filter with q and r"):
        files_of(state, Choice())
    assert "Khan et al. filter" in limits_text(state)
    assert files_of(state.with_filter(None), Choice())


def test_what_differs_on_a_device_is_told_of_what_is_chosen(state):
    assert limits_text(state) == ""
    assert "an Uno needs 232 µs" in limits_text(state, Choice(period="0.0001"))
    assert "an Uno needs 464 µs" in limits_text(state, Choice(period="0.0001", all_channels=True))
    assert limits_text(state, Choice("python", period="0.0001")) == ""
    assert "period must be a number" in limits_text(state, Choice(period="often"))
    small = set_text("q", "1e-12")(state)
    assert "goes on with exactly this gain" in limits_text(small)
    for target in ("platformio", "esphome", "bachagas"):
        assert "has no constant gain to go on with" in limits_text(small, Choice(target))
    assert limits_text(small, Choice("c")) == ""


def test_a_unit_that_the_board_does_not_read_is_said(state):
    recording = replace(state.recording, units=("V", ""))
    in_volts = state.with_open(recording=recording).with_settings(
        tunings=tuple(replace(one, unit=unit) for one, unit in zip(state.settings.tunings, ("V", ""), strict=True))
    )
    assert "readSensor() returns a in V" in limits_text(in_volts).replace("\\", "")
    assert limits_text(in_volts, Choice("c")) == limits_text(in_volts, Choice("arduino", fixed_gains=True)) == ""


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
        assert {one: archive.read(one).decode() for one in archive.namelist()} == files
    assert name == "kalscope-arduino.zip"


def test_undo_brings_no_earlier_sending_back(state):
    before, present = replace(state, sent="first"), replace(set_text("q", "0.5")(state), sent="second")
    history = record(History(), before, present, "", 0.0)
    assert step_back(history, present)[1].sent == "second"
