"""A tuning file loaded onto what is open: an undoable change, refused in words where it does not fit."""

from __future__ import annotations

import numpy as np
import pytest

from kalscope import BadFile, BadSetting, Recording
from kalscope.tuning.file import dumps
from kalscope_app.session.changes import MAX_BYTES, set_text, uploaded_settings, use_settings
from kalscope_app.session.opening import opened
from kalscope_app.session.session import Session, undo


def recording(names=("a", "b"), period=0.01):
    values = 100.0 + np.random.default_rng(0).normal(size=(300, len(names)))
    return Recording(np.arange(300) * (period or 1.0), names, ("",) * len(names), values, period)


@pytest.fixture
def state():
    return opened(recording())


@pytest.fixture
def file(state):
    tuned = state
    for name, text in {"q": "7", "r": "3", "p0": "2", "gate": "16", "momentum": "12"}.items():
        tuned = set_text(name, text)(tuned)
    return dumps(tuned.as_tuning()).encode(), tuned.settings.tunings


def test_a_file_that_was_saved_comes_back_and_can_be_undone(state, file):
    content, expected = file
    session = Session(state)
    session.request(use_settings(uploaded_settings("mine.toml", content), "mine.toml"))
    loaded = session.apply_requests()[0]
    assert loaded.settings.tunings == expected
    assert loaded.answers.note == "Loaded mine.toml."
    session.request(undo)
    assert session.apply_requests()[0].settings == state.settings


def test_another_rate_rescales_q_and_no_rate_takes_that_of_the_file(file):
    tuning = uploaded_settings("mine.toml", file[0])
    slower = use_settings(tuning, "mine.toml")(opened(recording(period=0.02)))
    assert slower.tuning.q == pytest.approx(14.0)
    assert slower.answers.note.startswith("Loaded mine.toml. Q was multiplied by 2")
    untimed = use_settings(tuning, "mine.toml")(opened(recording(period=None)))
    assert (untimed.recording.sample_period, untimed.tuning.q) == (0.01, 7.0)


def test_a_file_of_other_channels_is_refused(file):
    tuning = uploaded_settings("mine.toml", file[0])
    with pytest.raises(BadSetting, match="channel"):
        use_settings(tuning, "mine.toml")(opened(recording(names=("x", "y"))))


@pytest.mark.parametrize("content", [b"", b"a = 1", b"\xff\xfe", b"[[channel]]\nname = 3", b"#" * (MAX_BYTES + 1)])
def test_what_is_no_settings_file_is_refused_by_name(content):
    with pytest.raises(BadFile, match=r"mine\.toml"):
        uploaded_settings("mine.toml", content)
