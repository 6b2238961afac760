"""The secret of the link on the disk: kept over a restart, and handed to the browser. Nobody else may read it."""

from __future__ import annotations

import logging
import os
import secrets
import stat
import sys
import tempfile
from contextlib import contextmanager, suppress
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

from kalscope_app.guard.rules import is_token

if TYPE_CHECKING:
    from collections.abc import Iterator

_log = logging.getLogger(__name__)
_LONGEST = 1024
"""Bytes of a token file that are read at most."""
_IS_POSIX = os.name == "posix"


def state_folder() -> Path:
    """Where this user's programs keep what should outlive them, by the custom of the system."""
    if sys.platform == "win32":
        base = os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local"
    elif sys.platform == "darwin":
        base = Path.home() / "Library" / "Application Support"
    else:
        base = os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state"
    return Path(base) / "kalscope"


def kept_token(port: int, folder: Path | None = None, *, renew: bool = False) -> str:
    """The token of this port, the same as last time, so that open tabs find their way back after a restart.

    Args:
        port: the port listened on; each has a token of its own.
        folder: where tokens are kept; None is the user's state folder.
        renew: make a new one: whoever has the old link is locked out.

    A file that others could have read or put there is replaced. Where none can be kept safely the token is new each
    time, and the log says why.
    """
    token = secrets.token_urlsafe(32)
    try:
        folder = state_folder() if folder is None else folder
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        _check_folder(folder)
        file = folder / f"token-{port}"
        known = None if renew else _read_private(file)
        if known is not None and is_token(known):
            return known
        _write_private(file, token)
    except (OSError, RuntimeError) as error:  # RuntimeError: no home folder
        _log.warning("The link changes with each start, because its token cannot be kept: %s", error)
    return token


@contextmanager
def opening_page(url: str) -> Iterator[Path]:
    """A page, readable by this user only, that sends the browser on to `url`; it is gone when the block ends.

    Whatever stands on a command line can be read by every user of the machine; the name of this file says nothing.
    """
    with tempfile.TemporaryDirectory(prefix="kalscope-open-", ignore_cleanup_errors=True) as folder:
        file = Path(folder) / "kalscope.html"
        target = escape(url, quote=True)
        _write_private(
            file,
            f'<!doctype html><meta charset="utf-8"><meta name="referrer" content="no-referrer">'
            f'<meta http-equiv="refresh" content="0; url={target}"><title>Opening Kalscope…</title>'
            f'<p><a href="{target}">Open Kalscope</a></p>\n',
        )
        yield file


def _check_folder(folder: Path) -> None:
    """Whoever can write into the folder can exchange the file."""
    found = folder.lstat()
    if not stat.S_ISDIR(found.st_mode):
        raise OSError(f"{str(folder)!r} must be a folder, not a link")
    if _IS_POSIX and found.st_uid != os.geteuid():
        raise OSError(f"{str(folder)!r} must belong to you")
    if _IS_POSIX and found.st_mode & 0o022:
        raise OSError(f"{str(folder)!r} must not be writable by others (got mode {found.st_mode & 0o777:o})")


def _read_private(file: Path) -> str | None:
    """What the file says, if it is ours alone; None for every other file, link or device."""
    flags = os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
    try:
        handle = os.open(file, flags)
    except OSError:  # missing, or a link
        return None
    with os.fdopen(handle, "rb") as opened:
        found = os.fstat(opened.fileno())  # of the very file that is open: a name may point elsewhere by now
        is_ours = not _IS_POSIX or (found.st_uid == os.geteuid() and not found.st_mode & 0o077)
        if not stat.S_ISREG(found.st_mode) or found.st_nlink != 1 or not is_ours:
            return None
        return opened.read(_LONGEST).decode("ascii", "replace").strip()


def _write_private(file: Path, text: str) -> None:
    """Create the file anew for this user only; a link or a foreign file of that name is removed, not followed."""
    fresh = file.with_name(f".{file.name}.{secrets.token_hex(8)}")
    handle = os.open(fresh, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    try:
        with os.fdopen(handle, "w", encoding="utf-8") as opened:
            opened.write(text)
        os.replace(fresh, file)
    except BaseException:
        with suppress(OSError):
            fresh.unlink()
        raise
