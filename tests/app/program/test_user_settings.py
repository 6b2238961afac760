"""What is remembered between two starts, where it lies, and that a broken file harms nobody."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest

from kalscope_app.program.user_settings import FOLDER_VARIABLE, Remembered, config_folder
from kalscope_app.views.help import KEYS, card
from kalscope_app.views.tour import STEPS


def test_the_tour_is_seen_once_it_was_put_away(tmp_path):
    folder = tmp_path / "new" / "kalscope"
    assert not Remembered(folder).tour_seen
    assert not folder.exists()  # asking writes nothing
    Remembered(folder).forget_tour()
    assert Remembered(folder).tour_seen
    assert [path.name for path in folder.iterdir()] == ["settings.toml"]


@pytest.mark.parametrize("content", [b"", b"tour_seen = 1", b"tour_seen = [", b"\xff\xfe", b"other = true"])
def test_a_file_that_says_nothing_counts_as_not_seen(content, tmp_path):
    (tmp_path / "settings.toml").write_bytes(content)
    assert not Remembered(tmp_path).tour_seen


def test_the_folder_is_the_systems_unless_another_is_named(monkeypatch, tmp_path):
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path))
    assert config_folder() == tmp_path
    monkeypatch.delenv(FOLDER_VARIABLE)
    if sys.platform == "linux":
        monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
        assert config_folder() == tmp_path / "kalscope"
        monkeypatch.delenv("XDG_CONFIG_HOME")
        monkeypatch.setenv("HOME", str(tmp_path))
        assert config_folder() == Path(tmp_path) / ".config" / "kalscope"


def test_a_folder_that_cannot_be_made_is_an_error_of_the_system(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OSError, match="file"):
        Remembered(tmp_path / "file" / "kalscope").forget_tour()


def test_the_tour_has_at_most_five_short_steps():
    assert len(STEPS) <= 5
    assert all(len(text) < 400 for _, text in STEPS)


def test_the_card_names_every_key():
    assert all(f"| {what} | {does} |" in card() for what, does in KEYS)


@pytest.mark.skipif(os.name == "nt", reason="pipes and devices have no names there")
@pytest.mark.parametrize(
    "make", [getattr(os, "mkfifo", None), lambda path: os.symlink("/dev/zero", path)], ids=["pipe", "device"]
)
def test_what_never_ends_counts_as_empty(tmp_path, make):
    make(tmp_path / "settings.toml")
    assert not Remembered(tmp_path).tour_seen


def test_brackets_without_end_count_as_empty(tmp_path):
    (tmp_path / "settings.toml").write_text("a = " + "[" * 60_000)
    assert not Remembered(tmp_path).tour_seen
