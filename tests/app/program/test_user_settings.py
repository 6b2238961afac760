"""What is kept between two starts and where, and that a broken file does no harm."""

from __future__ import annotations

import sys

import pytest

from kalscope_app.program import user_settings
from kalscope_app.program.user_settings import FOLDER_VARIABLE, UserSettings, config_folder, state_folder


def test_what_is_kept_stays_while_something_else_is_changed(tmp_path):
    settings = UserSettings(tmp_path / "new" / "kalscope")
    assert not settings.has("tour_seen")
    assert not (tmp_path / "new").exists()  # looking writes nothing
    settings.keep(tour_seen=True, map_shown=True)
    settings.keep(map_shown=False)
    assert [settings.has(name) for name in ("tour_seen", "map_shown")] == [True, False]


FOLDERS = {config_folder: ("XDG_CONFIG_HOME", ".config"), state_folder: ("XDG_STATE_HOME", ".local/state")}


@pytest.mark.parametrize("folder", FOLDERS, ids=lambda folder: folder.__name__)
def test_a_folder_is_the_systems_unless_another_is_named(folder, monkeypatch, tmp_path):
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path))
    assert folder() == tmp_path
    monkeypatch.delenv(FOLDER_VARIABLE)
    if sys.platform == "linux":
        variable, below_home = FOLDERS[folder]
        monkeypatch.setenv(variable, str(tmp_path))
        assert folder() == tmp_path / "kalscope"
        monkeypatch.delenv(variable)
        monkeypatch.setenv("HOME", str(tmp_path))
        assert folder() == tmp_path / below_home / "kalscope"


def test_without_a_home_folder_nothing_is_remembered_and_nothing_breaks(monkeypatch):
    monkeypatch.delenv(FOLDER_VARIABLE, raising=False)
    for function in ("user_config_dir", "user_state_dir"):
        monkeypatch.setattr(user_settings.platformdirs, function, lambda *_, **__: "~/kalscope")
    for folder in FOLDERS:
        with pytest.raises(OSError, match="no home folder"):
            folder()
    assert not UserSettings().has("tour_seen")
