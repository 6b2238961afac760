"""Files of the user: written whole or not at all, private ones, and paths that must stay in a folder."""

from __future__ import annotations

import os
import random
import stat
import time
from pathlib import Path

import pytest
from tests.support.effort import FUZZ
from tests.support.forked import Forked
from tests.support.program import next_line

from kalscope.common.files import atomic_file, check_inside, write_atomic, write_private
from kalscope.errors import BadSetting

posix_only = pytest.mark.skipif(os.name == "nt", reason="POSIX modes, signals and links")

OLD, NEW = b"old " * 250_000, b"new " * 250_000
WRITER = """
from kalscope.common.files import write_atomic
print("ready", flush=True)
while True:
    for word in (b"new ", b"old "):
        write_atomic("tuning.toml", word * 250_000)
"""


def names(folder):
    return sorted(entry.name for entry in folder.iterdir())


@posix_only
def test_a_killed_writer_leaves_all_of_the_old_or_all_of_the_new(tmp_path):
    target = tmp_path / "tuning.toml"
    write_atomic(target, OLD)
    moments = random.Random(11)
    for kill in range(100 * FUZZ):  # on a busy machine many kills meet a writer that waits
        with Forked(WRITER, tmp_path, os.environ) as writer:
            assert next_line(writer) == "ready\n"
            time.sleep(moments.uniform(0.0, 0.02))
        assert target.read_bytes() in (OLD, NEW)
        if kill >= 6 * FUZZ and len(names(tmp_path)) > 1:
            break
    assert len(names(tmp_path)) > 1, "no kill met a write, else a temporary file would be left"


@posix_only
def test_the_mode_of_an_existing_file_is_kept(tmp_path):
    target = tmp_path / "a.toml"
    target.write_bytes(b"old")
    for mode in (0o600, 0o640, 0o755):
        target.chmod(mode)
        write_atomic(target, b"new")
        assert stat.S_IMODE(target.stat().st_mode) == mode


@posix_only
@pytest.mark.parametrize("before", ["nothing", "readable by all", "a link"])
def test_a_private_file_is_for_its_owner_from_the_first_byte(tmp_path, before):
    path, other = tmp_path / "file", tmp_path / "other"
    other.write_bytes(b"untouched")
    if before == "readable by all":
        path.touch(0o666)
    elif before == "a link":
        path.symlink_to(other)
    umask = os.umask(0)
    try:
        write_private(path, b"secret")
        with atomic_file(path, 0o600) as file:
            (temporary,) = tmp_path.glob(".file*")
            assert stat.S_IMODE(temporary.stat().st_mode) == 0o600
            file.write(b"secret")
    finally:
        os.umask(umask)
    assert stat.S_IMODE(path.lstat().st_mode) == 0o600
    assert (path.read_bytes(), other.read_bytes()) == (b"secret", b"untouched")


def refused(*_):
    raise PermissionError(13, "in use by another program")


@pytest.mark.parametrize(
    ("name", "value", "says"), [("access", lambda *_: False, "write-protected"), ("replace", refused, "in use")]
)
def test_a_write_protected_or_busy_file_stays_without_litter(tmp_path, monkeypatch, name, value, says):
    (tmp_path / "a.toml").write_bytes(b"old")
    monkeypatch.setattr(os, name, value)  # root may write everywhere
    with pytest.raises(PermissionError, match=says):
        write_atomic(tmp_path / "a.toml", b"new")
    assert (names(tmp_path), (tmp_path / "a.toml").read_bytes()) == (["a.toml"], b"old")


@posix_only
def test_paths_in_the_folder_are_resolved_and_others_refused_in_one_line(tmp_path):
    folder = tmp_path / "work"
    (folder / "sub").mkdir(parents=True)
    (folder / "out").symlink_to(tmp_path)
    (folder / "in").symlink_to(".")
    for typed in ("a.toml", "sub/a.toml", "./sub/../a.toml", "sub/new/a.toml", "~"):
        assert check_inside(typed, folder) == Path(os.path.normpath(folder.resolve() / typed))
    assert check_inside("in/in/a", folder) == folder.resolve() / "a"
    outside = ("..", "../a", "sub/../../a", "/etc/passwd", "../work2", "out/a")
    for typed in (*outside, "", "  ", "a\0b", "nul", "a/COM1.csv", "Con .x"):
        with pytest.raises(BadSetting, match="inside" if typed in outside else None) as caught:
            check_inside(typed, folder)
        assert len(str(caught.value).splitlines()) == 1
