"""The Export tab: what leaves is what is on screen, or it is refused in plain words."""

from __future__ import annotations

import html
import re
from dataclasses import replace

import numpy as np
import pytest

from kalscope import BadSetting, Recording, export_tuning
from kalscope.estimation.request import Noise, Request, find_parameters
from kalscope_app.session.changes import apply_found, pin_present, set_text, share_line
from kalscope_app.session.opening import opened, opened_experiment
from kalscope_app.session.session import History, record, step
from kalscope_app.views import export
from kalscope_app.views.export import Choice, files_of, limits_text


@pytest.fixture
def state():
    z = np.random.default_rng(2).normal(500.0, 3.0, (300, 2))
    recording = Recording(np.arange(300) * 0.005, ("a", "b"), ("counts", ""), z, 0.005)
    return set_text("q", "0.02")(opened(recording))


def undated(files):
    """The files without the moment at which each was made."""
    return {name: re.sub(r"\d{4}-\d\d-\d\dT[\d:]+Z", "", text) for name, text in files.items()}


@pytest.mark.slow
def test_the_files_are_those_of_the_setting_on_screen(state):
    for target in set(export.TITLES.values()) - {"one-euro"}:
        for choice, how in (
            (Choice(target), {"channel": "a"}),
            (Choice(target, all_channels=True), {"channel": None}),
            (Choice(target, period=" 0,02 "), {"channel": "a", "sample_period": 0.02}),
        ):
            assert undated(files_of(state, choice)) == undated(export_tuning(state.as_tuning(), target, **how))
    choice = Choice("arduino", calibration=True)
    expected = export_tuning(state.as_tuning(), "arduino", channel="a", calibration=True)
    assert undated(files_of(state, choice)) == undated(expected)
    assert export.packed("json", {"a.json": "{}"}) == ("a.json", b"{}")  # one file as it is, several as a zip
    assert export.packed("json", {"a": "", "b": ""})[0] == "kalscope-json.zip"
    assert "r of a must be above 0 for a sketch that measures it" in limits_text(state.with_tuning(r=0.0), choice)


def test_what_differs_on_a_device_is_told_of_what_is_chosen(state):
    assert limits_text(state) == ""
    assert "period must be a number" in limits_text(state, Choice(period="often"))
    small = set_text("q", "1e-12")(state)
    assert "Export c, in double, or take a larger q" in limits_text(small)
    volts = opened(replace(state.recording, units=("V", "")))
    assert "The sketch reads counts, but a is in V:" in limits_text(volts).replace("\\", "")
    assert limits_text(small, Choice("c")) == limits_text(volts, Choice("c")) == ""
    uneven = replace(state.recording, time=state.recording.time + (np.arange(300) > 100) * 1.0, gaps="dt")
    for recording, told in ((uneven, True), (replace(uneven, gaps="rows"), False)):
        assert (export.GAPS in limits_text(replace(state, recording=recording))) is told


def test_the_lag_at_the_period_of_the_device_is_shown(state):
    request = Request(target={"lag_s": 0.05}, noise=Noise(r=state.tuning.r))
    answer = find_parameters(state.z, request, sample_period=state.recording.sample_period)
    found = apply_found(state.recording, state.channel, answer)(state)
    assert export.device_notes(found, Choice()) == "Lag **50 ms** at 5 ms per sample."
    slower = export.device_notes(found, Choice("c", period="0.01"))
    assert re.fullmatch(r"Lag \*\*(6\d|7\d)[.\d]* ms\*\* at 10 ms per sample\.", slower)
    untimed = replace(state, recording=replace(state.recording, sample_period=None))
    assert export.device_notes(untimed) == ""
    assert "Lag" not in export.device_notes(state, Choice(period="often"))


@pytest.mark.slow
def test_the_report_of_the_dashboard_reopens_without_a_file_and_has_the_pins(state):
    pinned = set_text("q", "0.5")(pin_present(state))
    text = export.html_report(pinned).decode()
    assert html.escape(share_line(pinned).line) in text
    assert "tuning.toml" not in text
    assert "<td>A</td><td>0.0200</td>" in text
    assert b'"q": 0.5' in export.shared_page(pinned)
    with pytest.raises(BadSetting, match="choose the Kalman filter"):
        export.html_report(opened_experiment("generalized_figure_8"))


def test_undo_brings_no_earlier_sending_back(state):
    before, present = replace(state, sent="first"), replace(set_text("q", "0.5")(state), sent="second")
    history = record(History(), before, present, "", 0.0)
    assert step(history, present, back=True)[1].sent == "second"
