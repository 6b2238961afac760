from __future__ import annotations

import os
import random
import signal
import stat
import subprocess
import sys
import time
from pathlib import Path

import pytest
from tests.support.effort import FUZZ
from tests.support.waiting import PATIENCE

from kalscope.common.files import atomic_file, check_inside, write_atomic, write_private
from kalscope.errors import BadSetting

posix_only = pytest.mark.skipif(os.name == "nt", reason="POSIX modes, signals and links")

OLD = b"old " * 250_000
NEW = b"new " * 250_000

KILLED_WRITER = """
import sys
from kalscope.common.files import write_atomic
path, old, new = sys.argv[1], b"old " * 250_000, b"new " * 250_000
print("ready", flush=True)
while True:
    write_atomic(path, new)
    write_atomic(path, old)
"""


def names(folder: Path) -> list[str]:
    return sorted(entry.name for entry in folder.iterdir())


@posix_only
def test_a_killed_writer_leaves_all_of_the_old_or_all_of_the_new(tmp_path: Path) -> None:
    target = tmp_path / "tuning.toml"
    write_atomic(target, OLD)
    moments = random.Random(11)
    for kill in range(100 * FUZZ):  # on a busy machine many kills meet a writer that waits
        writer = subprocess.Popen(
            [sys.executable, "-c", KILLED_WRITER, str(target)], stdout=subprocess.PIPE, text=True
        )
        assert writer.stdout is not None
        with writer.stdout as ready:
            ready.readline()
            time.sleep(moments.uniform(0.0, 0.02))
            writer.send_signal(signal.SIGKILL)
            assert writer.wait(PATIENCE) == -signal.SIGKILL
        assert target.read_bytes() in (OLD, NEW)
        if kill >= 6 * FUZZ and len(names(tmp_path)) > 1:
            break
    assert len(names(tmp_path)) > 1, "no kill met a write, else a temporary file would be left"


@posix_only
@pytest.mark.parametrize("mode", [0o600, 0o640, 0o755])
def test_the_mode_of_an_existing_file_is_kept(tmp_path: Path, mode: int) -> None:
    target = tmp_path / "a.toml"
    target.write_bytes(b"old")
    target.chmod(mode)
    write_atomic(target, b"new")
    assert stat.S_IMODE(target.stat().st_mode) == mode


@posix_only
@pytest.mark.parametrize("before", ["nothing", "readable by all", "a link"])
def test_a_private_file_is_for_its_owner_from_the_first_byte(tmp_path: Path, before: str) -> None:
    path, other = tmp_path / "file", tmp_path / "other"
    other.write_bytes(b"untouched")
    if before == "readable by all":
        path.touch(0o666)
    elif before == "a link":
        path.symlink_to(other)
    umask = os.umask(0)
    try:
        with atomic_file(path, 0o600) as file:
            (temporary,) = tmp_path.glob(".file*")
            assert stat.S_IMODE(temporary.stat().st_mode) == 0o600
            file.write(b"secret")
        write_private(path, b"secret")
    finally:
        os.umask(umask)
    assert stat.S_IMODE(path.lstat().st_mode) == 0o600
    assert (path.read_bytes(), other.read_bytes()) == (b"secret", b"untouched")


def refused(*_: object) -> None:
    raise PermissionError(13, "in use by another program")


@pytest.mark.parametrize(
    ("name", "value", "says"), [("access", lambda *_: False, "write-protected"), ("replace", refused, "in use")]
)
def test_a_write_protected_or_busy_file_stays_without_litter(tmp_path, monkeypatch, name, value, says) -> None:
    (tmp_path / "a.toml").write_bytes(b"old")
    monkeypatch.setattr(os, name, value)  # root may write everywhere
    with pytest.raises(PermissionError, match=says):
        write_atomic(tmp_path / "a.toml", b"new")
    assert (names(tmp_path), (tmp_path / "a.toml").read_bytes()) == (["a.toml"], b"old")


@pytest.mark.parametrize("typed", ["a.toml", "sub/a.toml", "./sub/../a.toml", "sub/new/a.toml", "~"])
def test_paths_in_the_folder_are_resolved(tmp_path: Path, typed: str) -> None:
    (tmp_path / "sub").mkdir()
    assert check_inside(typed, tmp_path) == Path(os.path.normpath(tmp_path.resolve() / typed))


@pytest.mark.parametrize(
    "typed",
    ["..", "../a", "sub/../../a", "/etc/passwd", "../work2", "", "  ", "a\0b", "nul", "a/COM1.csv", "Con .x"],
)
def test_paths_out_of_the_folder_are_refused_in_one_line(tmp_path: Path, typed: str) -> None:
    folder = tmp_path / "work"
    folder.mkdir()
    with pytest.raises(BadSetting) as caught:
        check_inside(typed, folder)
    assert len(str(caught.value).splitlines()) == 1


@posix_only
def test_links_do_not_lead_out_of_the_folder(tmp_path: Path) -> None:
    folder = tmp_path / "work"
    folder.mkdir()
    (folder / "out").symlink_to(tmp_path)
    (folder / "in").symlink_to(".")
    assert check_inside("in/in/a", folder) == folder.resolve() / "a"
    with pytest.raises(BadSetting, match="inside"):
        check_inside("out/a", folder)
