"""What is kept between two starts and where, and that a broken file does no harm."""

from __future__ import annotations

import sys

import pytest

from kalscope_app.program import user_settings
from kalscope_app.program.user_settings import FOLDER_VARIABLE, UserSettings, state_folder


def test_what_is_kept_stays_while_something_else_is_changed(tmp_path):
    settings = UserSettings(tmp_path / "new" / "kalscope")
    assert not settings.has("tour_seen")
    assert not (tmp_path / "new").exists()  # looking writes nothing
    settings.keep(tour_seen=True, map_shown=True)
    settings.keep(map_shown=False)
    assert [settings.has(name) for name in ("tour_seen", "map_shown")] == [True, False]


def test_the_folder_is_the_systems_unless_another_is_named(monkeypatch, tmp_path):
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path))
    assert state_folder() == tmp_path
    monkeypatch.delenv(FOLDER_VARIABLE)
    if sys.platform == "linux":
        monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
        assert state_folder() == tmp_path / "kalscope"
        monkeypatch.delenv("XDG_STATE_HOME")
        monkeypatch.setenv("HOME", str(tmp_path))
        assert state_folder() == tmp_path / ".local/state/kalscope"


def test_without_a_home_folder_nothing_is_remembered_and_nothing_breaks(monkeypatch):
    monkeypatch.delenv(FOLDER_VARIABLE, raising=False)
    monkeypatch.setattr(user_settings.platformdirs, "user_state_dir", lambda *_, **__: "~/kalscope")
    with pytest.raises(OSError, match="no home folder"):
        state_folder()
    assert not UserSettings().has("tour_seen")
