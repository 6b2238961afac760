"""Files that are whole or untouched, paths that stay inside their folder, and how much memory is free."""

from __future__ import annotations

import errno
import os
import re
import secrets
import stat
import tempfile
from collections.abc import Generator, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from kalscope.common.stopping import removed_at_stop
from kalscope.errors import BadFile, BadSetting, NoMemory

# Files that are whole or untouched, and paths that stay inside their folder.
#
# A rewrite in place leaves a torn file when the program is killed half-way, and shows one to concurrent readers. A
# temporary file in the same folder that is renamed over the old one does neither.


_DEVICE = re.compile(r" *(?:con|prn|aux|nul|conin\$|conout\$|(?:com|lpt)[0-9¹²³]) *(?:[.:].*)?", re.IGNORECASE)
"""Names that Windows takes for a device in every folder, whatever their ending."""


def check_new(*paths: Path, force: bool) -> None:
    """Refuse existing files of -o unless --force is given; devices and pipes lose nothing when they are written.

    Raises:
        BadSetting: One exists, and `force` is off.
    """
    there = [repr(str(path)) for path in paths if path.is_file()]
    if there and not force:
        raise BadSetting(f"-o must name a new file unless --force is given (got {', '.join(there)}, which exists)")


def make_folder(folder: Path) -> None:
    """Make a folder for the output where there is none.

    Raises:
        BadSetting: It is a file.
        OSError: It cannot be made.
    """
    if folder.exists() and not folder.is_dir():
        raise BadSetting(f"the output must go to a folder (got {str(folder)!r}, a file)")
    folder.mkdir(parents=True, exist_ok=True)


def write_atomic(path: str | os.PathLike[str], data: bytes) -> None:
    """Write `data` to `path` so that any reader, at any moment, finds all of the old or all of the new.

    Args:
        path: The file to create or to replace. A symbolic link stays, its target is replaced.
        data: The whole content.

    Raises:
        OSError: The folder is missing, the file is write-protected, the disk is full; `path` is unchanged.
    """
    with atomic_file(path) as file:
        file.write(data)


def write_private(path: str | os.PathLike[str], data: bytes) -> None:
    """Write `data` to `path` as `write_atomic` does, but so that no other user can read it at any moment.

    A symbolic link is replaced, not followed.
    """
    with atomic_file(path, 0o600) as file:
        file.write(data)


@contextmanager
def atomic_file(path: str | os.PathLike[str], mode: int | None = None) -> Generator[BinaryIO]:
    """Open a binary file for writing that becomes `path` when the block ends, and vanishes if it raises.

    The content is on the disk before the name changes.

    Args:
        path: As in `write_atomic`. A device or a pipe such as /dev/null has nothing to replace: it is written
            directly.
        mode: The permissions, see `write_private`; None = those of the file that is replaced, or the usual ones.

    Raises:
        OSError: As in `write_atomic`.
    """
    target = Path(os.path.realpath(path) if mode is None else path)
    if mode is None and target.exists():
        if not target.is_file():
            with _named(path, target), open(target, "wb") as device:  # a folder raises IsADirectoryError here
                yield device
            return
        if not os.access(target, os.W_OK):  # the rename would succeed all the same, and override the read-only mode
            raise PermissionError(errno.EACCES, "the file is write-protected", os.fspath(path))
        mode = stat.S_IMODE(target.stat().st_mode)
    temporary = target.with_name(f".{target.name[:50]}.kalscope-{secrets.token_hex(8)}.tmp")
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0)
    try:
        with removed_at_stop(temporary), _named(path, temporary):
            descriptor = os.open(temporary, flags, 0o666 if mode is None else mode)  # less the umask
            with os.fdopen(descriptor, "wb") as file:
                yield file
                file.flush()
                os.fsync(file.fileno())
            if mode is not None:
                os.chmod(temporary, mode)
            os.replace(temporary, target)
    except BaseException:  # Ctrl+C as well must leave no temporary file
        with suppress(OSError):
            temporary.unlink()
        raise
    sync_folder(target.parent)


@contextmanager
def _named(path: str | os.PathLike[str], opened: Path) -> Generator[None]:
    """Errors of the file that is `opened`, or of none, name the one that the caller knows."""
    try:
        yield
    except OSError as error:
        if error.errno is None or error.filename not in (None, opened, str(opened)):
            raise
        raise OSError(error.errno, error.strerror, os.fspath(path)) from None


def check_inside(path: str | os.PathLike[str], folder: str | os.PathLike[str]) -> Path:
    """Resolve a path from the browser, and refuse it unless it is inside `folder`.

    Args:
        path: As typed; a relative path starts in `folder`.
        folder: The working folder.

    Returns:
        The absolute path without symbolic links. Use this one: the typed one may point elsewhere later.

    Raises:
        BadSetting: The path leads out of the folder, by "..", by a link or by being absolute; or it is empty,
            or Windows would take a part of it for a device, as nul or com1.csv.
    """
    typed = os.fspath(path)
    if not typed.strip():
        raise BadSetting("path must name a file (got nothing)")
    if any(_DEVICE.fullmatch(part) for part in re.split(r"[/\\]", typed)):
        raise BadSetting(f"path must have no name that is a device on Windows (got {typed!r:.200})")
    base = Path(os.path.realpath(folder))
    try:
        resolved = Path(os.path.realpath(base / typed))
    except (OSError, ValueError) as error:  # a NUL in the name
        raise BadSetting(f"path must be usable as a file name (got {typed!r:.200}: {error})") from None
    if not resolved.is_relative_to(base):
        raise BadSetting(f"path must stay inside the working folder {str(base)!r} (got {typed!r:.200})")
    return resolved


@contextmanager
def temporary_folder(prefix: str = "kalscope-") -> Generator[Path]:
    """A folder for this user only, gone when the block ends, or the program at a signal."""
    made = tempfile.TemporaryDirectory(prefix=prefix, ignore_cleanup_errors=True)
    with made as folder, removed_at_stop(folder):
        yield Path(folder)


def sync_folder(folder: Path) -> None:
    """Put the new name on the disk too; some file systems refuse, but the data is safe anyway."""
    with suppress(OSError):  # Windows opens no folder
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


# How much a packed file may unpack to: a small one can hold terabytes of zeros.


MAX_UNPACKED = 1 << 27
"""Bytes that any file may unpack to, by default; as text they take some seconds and at most 2 GB of memory."""
MAX_RATIO = 32
"""Bytes that a larger file may unpack to for each of its own: logs are packed by a factor of 3 to 20."""


class Unpacking:
    """Adds up what a file unpacks to, over archives in archives: every reader counts before it keeps anything."""

    def __init__(self, path: Path, gigabytes: float | None) -> None:
        """Args: the file as it is on the disk; what it may unpack to, None = MAX_UNPACKED or MAX_RATIO."""
        self._path, self._gigabytes, self._total = path, gigabytes, 0

    def add(self, size: int) -> None:
        """Take `size` more bytes.

        Raises:
            BadFile: together they are too many.
        """
        self._total += size
        if self._gigabytes is None:
            most = max(MAX_UNPACKED, MAX_RATIO * os.path.getsize(self._path))
        else:
            most = int(1e9 * self._gigabytes)
        if self._total > most:
            raise BadFile(
                f"{self._path.name} must unpack to at most {most / 1e9:.3g} GB (got more): --unpack-gb allows more"
            )


# How much memory is free, so that what will not fit is refused before the system kills the program.


MEMORY_FACTOR = 2.2
"""Memory that a reading takes, in bytes of its numbers, until the Recording is made and passed on."""
_MEMORY = Path("/proc/meminfo")
_GROUPS = Path("/sys/fs/cgroup")
_OWN_GROUP = Path("/proc/self/cgroup")
_USED = Path("/proc/self/statm")


def free_memory() -> int | None:
    """Bytes that can still be allocated without swapping, within the limits of a container; None if unknown.

    Known on Linux only: the smallest of what the kernel calls available and what is left in each control group.
    """
    with suppress(OSError, ValueError):
        fields = dict(line.split(":", 1) for line in _MEMORY.read_text().splitlines())
        available = int(fields["MemAvailable"].split()[0]) << 10
        return max(0, min([available, *_left_in_groups()]))
    return None


def does_not_fit(name: str) -> NoMemory:
    """The error for something that filled the memory while it was read."""
    return NoMemory(f"{name} must fit into the memory that is free, and it does not: open a part of it")


def require_memory(need: float, name: str, what: str, instead: str = "open a part of it") -> None:
    """Refuse what will not fit into the memory.

    Args:
        need: What it takes, bytes.
        name: The file.
        what: What is in it.
        instead: What the user can do.

    Raises:
        NoMemory: it does not fit.
    """
    free = free_memory()
    if free is not None and need > free:
        raise NoMemory(
            f"{name} must fit into the memory that is free, {free / 1e9:.1f} GB (got {what}, which take"
            f" {need / 1e9:.1f} GB): {instead}"
        )


def require_memory_for_numbers(count: int, name: str) -> None:
    """Refuse a recording of so many numbers that it will not fit into the memory, see `require_memory`."""
    require_memory(8 * MEMORY_FACTOR * count, name, f"{count} numbers")


def _left_in_groups() -> Iterator[int]:
    """What is left in the control group of this process and in each parent; file caches can be reclaimed."""
    with suppress(OSError, ValueError):
        path = next(line[3:] for line in _OWN_GROUP.read_text().splitlines() if line.startswith("0::"))
        folder = _GROUPS / path.strip("/")
        for group in (folder, *folder.parents):
            if not group.is_relative_to(_GROUPS):
                return
            with suppress(OSError, ValueError):  # "max" is not a limit, and the root group has no such file
                most = int((group / "memory.max").read_text())
                kept = dict(line.split() for line in (group / "memory.stat").read_text().splitlines())
                yield most - int((group / "memory.current").read_text()) + int(kept["file"])


def limit_memory(more: int) -> None:
    """Let this process allocate this many more bytes, then raise MemoryError; only Linux has such a limit."""
    with suppress(ImportError, OSError, ValueError):
        import resource

        data = int(_USED.read_text().split()[5]) * os.sysconf("SC_PAGE_SIZE")
        _, hard = resource.getrlimit(resource.RLIMIT_DATA)
        most = data + more
        resource.setrlimit(resource.RLIMIT_DATA, (most if hard < 0 else min(most, hard), hard))
