"""The secret of the link on the disk: who else could read it, does not; what others put there is not believed."""

from __future__ import annotations

import os
import stat
from functools import partial

import pytest

from kalscope_app.guard.requests import is_token, kept_token

SECRET = "Kept-Kept-Kept-Kept_Kept"
posix = pytest.mark.skipif(os.name != "posix", reason="modes and links as POSIX has them")


def put(folder, text=SECRET, mode=0o600, name="token-8080"):
    folder.mkdir(mode=0o700, exist_ok=True)
    file = folder / name
    file.write_text(text)
    file.chmod(mode)
    return file


@posix
def test_the_file_and_its_folder_are_for_the_user_only(tmp_path):
    before = os.umask(0)
    try:
        kept_token(8080, tmp_path / "kalscope")
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "kalscope").stat().st_mode) == 0o700
    assert stat.S_IMODE((tmp_path / "kalscope" / "token-8080").stat().st_mode) == 0o600
    assert os.listdir(tmp_path / "kalscope") == ["token-8080"]
    (tmp_path / "kalscope").chmod(0o755)  # others may look into it
    assert kept_token(8080, tmp_path / "kalscope") == (tmp_path / "kalscope" / "token-8080").read_text()


SPOILT = {
    "a link": lambda folder: (folder / "token-8080").symlink_to(put(folder.parent / "elsewhere", name="target")),
    "a second name": lambda folder: os.link(put(folder), folder.parent / "another name"),
    "a pipe": lambda folder: os.mkfifo(folder / "token-8080", 0o600),
    "a file of another user": lambda folder: os.chown(put(folder), 65534, 65534),
    **{f"mode {mode:o}": partial(put, mode=mode) for mode in (0o644, 0o640, 0o620, 0o604, 0o666)},
    **{
        repr(text): partial(put, text=text)
        for text in ("", "short", "x" * 129, "with space 16 chars", "semi;colon-16-chars", "\0" * 40)
    },
}
"""What may lie where the token is kept, and is not believed."""
UNSAFE = {
    "the group may write": lambda folder: put(folder).parent.chmod(0o720),
    "others may write": lambda folder: put(folder).parent.chmod(0o702),
    "a link": lambda folder: folder.symlink_to(put(folder.parent / "elsewhere").parent),
    "a file": lambda folder: folder.write_text(""),
    "of another user": lambda folder: os.chown(put(folder).parent, 65534, 65534),
}
"""Folders that another user could write to."""


def only_root_can(words):
    if "another user" in words and os.geteuid() != 0:
        pytest.skip("only root can give a file away")


@posix
@pytest.mark.parametrize("spoilt", SPOILT)
def test_what_others_could_have_read_or_put_there_is_replaced(tmp_path, spoilt):
    only_root_can(spoilt)
    folder, file = tmp_path / "kalscope", tmp_path / "kalscope" / "token-8080"
    folder.mkdir(mode=0o700)
    SPOILT[spoilt](folder)
    token = kept_token(8080, folder)
    assert is_token(token)
    assert token != SECRET
    assert not file.is_symlink()
    assert (file.read_text(), stat.S_IMODE(file.stat().st_mode)) == (token, 0o600)
    outside = [path for path in (tmp_path / "elsewhere" / "target", tmp_path / "another name") if path.exists()]
    assert all(path.read_text() == SECRET for path in outside)  # nothing was written through


@posix
@pytest.mark.parametrize("why", UNSAFE)
def test_in_a_folder_that_is_not_safe_nothing_is_kept(tmp_path, caplog, why):
    only_root_can(why)
    UNSAFE[why](tmp_path / "kalscope")
    token = kept_token(8080, tmp_path / "kalscope")
    assert token != SECRET
    assert is_token(token)
    (said,) = caplog.messages
    assert "must be a folder of yours, no link, that no other user can write to (got " in said
    assert token not in said
