"""What is kept between two starts: settings, the filters of each file; that a broken file does no harm."""

from __future__ import annotations

import os
import sys
from itertools import count
from types import SimpleNamespace

import pytest

from kalscope import open_source
from kalscope.tuning.tuning import ChannelTuning, Tuning
from kalscope_app.dashboard import Dashboard
from kalscope_app.program import user_settings
from kalscope_app.program.user_settings import FOLDER_VARIABLE, KeptTunings, UserSettings, state_folder
from kalscope_app.session.changes import as_it_was_left, set_dark, set_text
from kalscope_app.session.opening import opened


def test_the_folder_is_the_systems_or_a_named_one_and_without_any_nothing_is_remembered(monkeypatch, tmp_path):
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path))
    assert state_folder() == tmp_path
    monkeypatch.delenv(FOLDER_VARIABLE)
    if sys.platform == "linux":
        monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
        assert state_folder() == tmp_path / "kalscope"
    monkeypatch.setattr(user_settings.platformdirs, "user_state_dir", lambda *_, **__: "~/kalscope")
    with pytest.raises(OSError, match="no home folder"):
        state_folder()
    assert not UserSettings().has("tour_seen")


def test_the_newest_files_are_kept_and_damage_counts_as_nothing(tmp_path, monkeypatch):
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path))
    monkeypatch.setattr(user_settings, "MAX_FILES", 2)
    kept, times = KeptTunings(), count(1)
    assert (kept.of("a.csv"), kept.last()) == (None, "")
    files = [tmp_path / name for name in ("a.csv", "b.csv", "ü\n.csv")]
    for file in files:
        file.write_text("1\n2\n")
        kept.keep(Tuning((ChannelTuning("a", "", 1.0, 2.0, None, None, "by hand"),), source=str(file)))
        for written in sorted((tmp_path / "tunings").iterdir(), key=lambda one: one.stat().st_mtime_ns):
            os.utime(written, ns=(next(times),) * 2)
    assert [kept.of(str(file)) is not None for file in files] == [False, True, True]
    assert kept.last() == str(files[-1])
    files[-1].unlink()
    assert kept.last() == ""
    for written in (tmp_path / "tunings").iterdir():
        written.write_bytes(b"\xff=")
    assert (kept.of(str(files[1])), kept.last()) == (None, "")
    if os.name == "posix":
        assert (tmp_path / "tunings").stat().st_mode & 0o077 == 0


@pytest.mark.slow
def test_filters_are_written_once_for_each_change_and_a_file_opens_as_it_was_left(tmp_path):
    (tmp_path / "log.csv").write_text("t,z\n" + "".join(f"{i},{i % 7}.5\n" for i in range(60)))
    state, written = opened(open_source(str(tmp_path / "log.csv"))), []
    screen = SimpleNamespace(_written=None, _kept=SimpleNamespace(keep=written.append))
    tuned = set_text("q", "7")(state)
    for shown in (state, set_dark(True)(state), tuned, set_dark(True)(tuned), opened(open_source("demo"))):
        Dashboard._keep_tuning(screen, shown)
    assert [tuning.channels[0].q for tuning in written] == [state.tuning.q, 7.0]
    assert as_it_was_left(written[-1])(state).tunings == tuned.tunings
