"""The secret of the link on the disk: who else could read it, does not; what others put there is not believed."""

from __future__ import annotations

import os
import stat
import tempfile

import pytest

from kalscope_app.guard.requests import is_token, kept_token, opening_page

SECRET = "Kept-Kept-Kept-Kept_Kept"
posix = pytest.mark.skipif(os.name != "posix", reason="modes and links as POSIX has them")


def put(folder, text=SECRET, mode=0o600, name="token-8080"):
    folder.mkdir(mode=0o700, exist_ok=True)
    file = folder / name
    file.write_text(text)
    file.chmod(mode)
    return file


@pytest.mark.slow
def test_a_restart_on_the_same_port_has_the_same_token(tmp_path):
    folder = tmp_path / "a" / "kalscope"
    token = kept_token(8080, folder)
    assert is_token(token)
    assert len(token) >= 43  # 32 bytes in base 64
    assert kept_token(8080, folder) == token
    assert kept_token(8081, folder) != token


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


@pytest.mark.parametrize("text", ["", "short", "x" * 129, "with space 16 chars", "semi;colon-16-chars", "\0" * 40])
def test_a_file_that_holds_no_token_is_replaced(tmp_path, text):
    file = put(tmp_path / "kalscope", text)
    token = kept_token(8080, tmp_path / "kalscope")
    assert is_token(token)
    assert file.read_text() == token


@posix
@pytest.mark.parametrize("mode", [0o644, 0o640, 0o620, 0o604, 0o666])
def test_a_file_that_others_can_read_or_write_is_replaced(tmp_path, mode):
    file = put(tmp_path / "kalscope", mode=mode)
    assert kept_token(8080, tmp_path / "kalscope") != SECRET
    assert stat.S_IMODE(file.stat().st_mode) == 0o600


@posix
def test_a_link_is_neither_believed_nor_written_through(tmp_path):
    target = put(tmp_path / "elsewhere", name="target")
    folder = tmp_path / "kalscope"
    folder.mkdir(mode=0o700)
    (folder / "token-8080").symlink_to(target)
    assert kept_token(8080, folder) != SECRET
    assert target.read_text() == SECRET
    assert not (folder / "token-8080").is_symlink()


@posix
def test_a_second_name_of_the_file_is_not_believed(tmp_path):
    file = put(tmp_path / "kalscope")
    os.link(file, tmp_path / "another name")
    assert kept_token(8080, tmp_path / "kalscope") != SECRET


@posix
def test_a_pipe_does_not_make_the_program_wait(tmp_path):
    (tmp_path / "kalscope").mkdir(mode=0o700)
    os.mkfifo(tmp_path / "kalscope" / "token-8080", 0o600)
    assert is_token(kept_token(8080, tmp_path / "kalscope"))


@posix
@pytest.mark.skipif(os.name == "posix" and os.geteuid() != 0, reason="only root can give a file away")
def test_a_file_of_another_user_is_not_believed(tmp_path):
    os.chown(put(tmp_path / "kalscope"), 65534, 65534)
    assert kept_token(8080, tmp_path / "kalscope") != SECRET


UNSAFE = {
    "writable by others": "must not be writable by others",
    "a link": "must be a folder, not a link",
    "a link that leads nowhere": "must be a folder, not a link",
    "a file": "must be a folder, not a file",
    "of another user": "must belong to you",
}


@posix
@pytest.mark.parametrize("spoilt", UNSAFE)
def test_in_a_folder_that_is_not_safe_nothing_is_kept(tmp_path, caplog, spoilt):
    folder = tmp_path / "kalscope"
    if spoilt.startswith("a link"):
        if spoilt == "a link":
            put(tmp_path / "elsewhere")
        folder.symlink_to(tmp_path / "elsewhere")
    elif spoilt == "a file":
        folder.write_text("")
    elif spoilt == "of another user":
        if os.geteuid() != 0:
            pytest.skip("only root can give a folder away")
        put(folder)
        os.chown(folder, 65534, 65534)
    else:
        put(folder)
        folder.chmod(0o777)
    token = kept_token(8080, folder)
    assert token != SECRET
    assert is_token(token)
    (said,) = caplog.messages
    assert UNSAFE[spoilt] in said
    assert token not in said


def test_the_opening_page_is_private_and_goes_away(tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    url = f"http://127.0.0.1:8080/?token={SECRET}"
    with opening_page(url) as file:
        assert f'content="0; url={url}"' in file.read_text()
        assert SECRET not in str(file)
        if os.name == "posix":
            assert stat.S_IMODE(file.stat().st_mode) == 0o600
            assert stat.S_IMODE(file.parent.stat().st_mode) == 0o700
    assert os.listdir(tmp_path) == []
