"""What is kept between two starts and where, and that a broken file does no harm."""

from __future__ import annotations

import os
import sys

import pytest

from kalscope_app.program import user_settings
from kalscope_app.program.user_settings import FOLDER_VARIABLE, UserSettings, config_folder, state_folder


def test_the_tour_is_seen_once_it_was_put_away(tmp_path):
    folder = tmp_path / "new" / "kalscope"
    assert not UserSettings(folder).tour_seen
    assert not folder.exists()  # asking writes nothing
    UserSettings(folder).keep(tour_seen=True)
    assert UserSettings(folder).tour_seen
    assert [path.name for path in folder.iterdir()] == ["settings.toml"]


@pytest.mark.parametrize("content", [b"", b"tour_seen = 1", b"tour_seen = [", b"\xff\xfe", b"other = true"])
def test_a_file_that_says_nothing_counts_as_not_seen(content, tmp_path):
    (tmp_path / "settings.toml").write_bytes(content)
    assert not UserSettings(tmp_path).tour_seen


def test_one_setting_is_kept_while_another_is_written_and_unknown_ones_go(tmp_path):
    settings = UserSettings(tmp_path)
    (tmp_path / "settings.toml").write_text('tour_seen = true\nother = true\nmap_shown = "yes"\n')
    assert (settings.tour_seen, settings.map_shown) == (True, False)
    settings.keep(map_shown=True)
    assert (settings.tour_seen, settings.map_shown) == (True, True)
    assert "other" not in settings.path.read_text()
    settings.keep(map_shown=False)
    assert (settings.tour_seen, settings.map_shown) == (True, False)


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
    assert not UserSettings().tour_seen


def test_a_folder_that_cannot_be_made_is_an_error_of_the_system(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OSError, match="file"):
        UserSettings(tmp_path / "file" / "kalscope").keep(tour_seen=True)


@pytest.mark.skipif(os.name == "nt", reason="pipes and devices have no names there")
@pytest.mark.parametrize(
    "make", [getattr(os, "mkfifo", None), lambda path: os.symlink("/dev/zero", path)], ids=["pipe", "device"]
)
def test_what_never_ends_counts_as_empty(tmp_path, make):
    make(tmp_path / "settings.toml")
    assert not UserSettings(tmp_path).tour_seen


def test_brackets_without_end_count_as_empty(tmp_path):
    (tmp_path / "settings.toml").write_text("a = " + "[" * 60_000)
    assert not UserSettings(tmp_path).tour_seen
