"""The secret of the link on disk: kept over a restart and passed to the browser, readable by this user only."""

from __future__ import annotations

import logging
import os
import secrets
import stat
from collections.abc import Generator
from contextlib import contextmanager, suppress
from html import escape
from pathlib import Path

from kalscope.common.files import temporary_folder, write_private
from kalscope.errors import describe
from kalscope_app.guard.rules import is_token
from kalscope_app.program.user_settings import state_folder

_log = logging.getLogger(__name__)
_MAX_BYTES = 1024
"""Bytes of a token file that are read, at most."""
_IS_POSIX = os.name == "posix"


def kept_token(port: int, folder: Path | None = None, *, renew: bool = False) -> str:
    """The token of this port, the same as last time, so that open tabs reconnect after a restart.

    A file that others could have read or put there is replaced. Where none can be kept safely the token is new each
    time, and the log says why.

    Args:
        port: the port listened on; each has a token of its own.
        folder: where tokens are kept; None is the user's state folder.
        renew: make a new one, which makes the old link useless.
    """
    token = secrets.token_urlsafe(32)
    try:
        folder = state_folder() if folder is None else folder
        with suppress(FileExistsError):
            folder.mkdir(mode=0o700, parents=True)
        _check_folder(folder)
        file = folder / f"token-{port}"
        known = None if renew else _read_private(file)
        if known is not None and is_token(known):
            return known
        write_private(file, token.encode())
    except OSError as error:
        _log.warning("The link changes with each start, because its token cannot be kept: %s", describe(error))
    return token


@contextmanager
def opening_page(url: str) -> Generator[Path]:
    """A page, readable by this user only, that sends the browser on to `url`; it is removed when the block ends.

    Every user of the machine can read command lines; the name of this file tells them nothing.
    """
    with temporary_folder("kalscope-open-") as folder:
        file = folder / "kalscope.html"
        target = escape(url, quote=True)
        page = (
            f'<!doctype html><meta charset="utf-8"><meta name="referrer" content="no-referrer">'
            f'<meta http-equiv="refresh" content="0; url={target}"><title>Opening Kalscope…</title>'
            f'<p><a href="{target}">Open Kalscope</a></p>\n'
        )
        write_private(file, page.encode())
        yield file


def _check_folder(folder: Path) -> None:
    """Refuse a folder in which another user could replace the file."""
    found = folder.lstat()
    if stat.S_ISLNK(found.st_mode):
        raise OSError(f"{str(folder)!r} must be a folder, not a link")
    if not stat.S_ISDIR(found.st_mode):
        raise OSError(f"{str(folder)!r} must be a folder, not a file")
    if _IS_POSIX and found.st_uid != os.geteuid():
        raise OSError(f"{str(folder)!r} must belong to you")
    if _IS_POSIX and found.st_mode & 0o022:
        raise OSError(f"{str(folder)!r} must not be writable by others (got mode {found.st_mode & 0o777:o})")


def _read_private(file: Path) -> str | None:
    """The content of a file that only this user could read and write; None for any other file, link or device."""
    flags = os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
    try:
        handle = os.open(file, flags)
    except OSError:  # missing, or a link
        return None
    with os.fdopen(handle, "rb") as opened:
        found = os.fstat(opened.fileno())  # of the open file itself: its name may point elsewhere by now
        is_ours = not _IS_POSIX or (found.st_uid == os.geteuid() and not found.st_mode & 0o077)
        if not stat.S_ISREG(found.st_mode) or found.st_nlink != 1 or not is_ours:
            return None
        return opened.read(_MAX_BYTES).decode("ascii", "replace").strip()
