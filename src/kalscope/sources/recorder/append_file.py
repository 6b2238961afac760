"""A file that only grows, by whole entries, whatever the disk does.

An entry is the text of one line from the board (or a comment). All waiting entries go out in one `os.write`: a
program that is killed between two writes leaves whole lines. A full disk cuts a write short, inside a number; the
file is then cut back to its last whole entry at once, and the entries wait in memory until there is space.
"""

from __future__ import annotations

import errno
import os
import threading
from collections import deque
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from kalscope.errors import BadFile

RETRY_S = 1.0
"""Pause between two attempts to write to a disk that refuses, s."""
MAX_WAIT_S = 60.0
"""Seconds of entries that wait in memory for such a disk; later ones are lost, and counted."""
MAX_WAIT_BYTES = 32_000_000
"""Memory that these may take: 60 s of 1,000 lines/s are 11 MB, and of 10,000 lines/s some 18 s fit."""
_OVERHEAD = 150  # bytes of memory that an entry takes besides its text

_FULL = {
    errno.ENOSPC: "the disk is full",
    errno.EFBIG: "the file may not grow any further",
    getattr(errno, "EDQUOT", errno.ENOSPC): "the disk is full (quota)",
}
_fdatasync = getattr(os, "fdatasync", os.fsync)


def write_some(fd: int, data: memoryview) -> int:
    """Write as much as the disk takes, at least a byte; a disk that accepts nothing is full."""
    count = os.write(fd, data)
    if count == 0:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    return count


@dataclass(frozen=True, slots=True)
class _Entry:
    """What is written whole or not at all."""

    data: bytes
    """Its bytes, which end in a newline."""
    at: float
    """Monotonic time of the line, s."""
    lines: int
    """1 for a line of the board, 0 for a comment."""


class AppendFile:
    """One growing file. Not for several threads, except `sync`, which may be called from another."""

    def __init__(self, path: Path) -> None:
        """Name the file; it is opened by `open`, or by the first `flush`."""
        self.path = path
        self.error = ""
        """What keeps entries from reaching the file; "" while they do."""
        self.sync_error = ""
        """The error of the last sync; "" if it succeeded."""
        self.waiting = 0
        """Lines in memory that have not reached the file."""
        self.lines = 0
        """Lines of the board that are in the file."""
        self.change = ""
        """What another program did to the file; "" if nothing."""
        self._rows = 0
        self._fd: int | None = None
        self._fd_lock = threading.Lock()
        self._start = self._size = 0
        self._torn = False
        self._dirty = False
        self._waiting: deque[_Entry] = deque()
        self._bytes = 0
        self._losing = False
        self._lost = 0
        self._kind = ""
        self._since = self._retry_at = 0.0

    @property
    def size(self) -> int:
        """Bytes in the file."""
        return self._size

    @property
    def idle(self) -> bool:
        """True where nothing waits."""
        return not self._waiting

    def open(self, *, new: bool) -> int:
        """Open the file, as a new one (FileExistsError if it exists), or to append to it; returns its descriptor.

        Raises:
            OSError: It cannot be opened.
            BadFile: Another program appends to it.
        """
        flags = os.O_WRONLY | os.O_APPEND | os.O_CREAT | (os.O_EXCL if new else 0) | getattr(os, "O_BINARY", 0)
        fd = os.open(self.path, flags, 0o666)
        try:
            _lock(fd, self.path)
            self._start = self._size = os.fstat(fd).st_size
        except BaseException:  # Ctrl+C as well must not keep the file open and locked
            os.close(fd)
            raise
        self._fd = fd
        return fd

    def put(self, data: bytes, at: float, lines: int = 0) -> bool:
        """Queue one entry for the next flush; False where it is lost because too much waits already."""
        if self._losing or self._is_too_much(at):
            self._losing = True  # until all that waits is written: one gap, not a hundred
            self._lost += lines
            return False
        self._queue(data, at, lines)
        return True

    def flush(self, now: float, *, at_once: bool = False) -> int:
        """Write what waits; never raises disk errors.

        Args:
            now: Monotonic time, s: a disk that refused is tried again after RETRY_S.
            at_once: Do not wait for that.

        Returns:
            How many lines reached the file.
        """
        if not self._waiting or (self.error and now < self._retry_at and not at_once):
            return 0
        lines, error = self._write()
        if error is None and self.error:
            lost = f"{self._lost} lines dropped"
            self.put_note(f"# gap {self._kind} {now - self._since:.3f} s ({lost})\n", now)
            more, error = self._write()
            lines += more
        if error is not None:
            self._note_error(error, now)
        elif self.error:
            self.error, self._losing, self._lost = "", False, 0
        return lines

    def put_note(self, text: str, at: float) -> None:
        """Queue a comment, even while lines are being lost."""
        self._queue(text.encode("utf-8", "backslashreplace"), at, 0)

    def find_change(self) -> str:
        """What another program did to the file since it was opened, in one word; "" if nothing can be seen."""
        if self._fd is None:
            return ""
        own = os.fstat(self._fd)
        try:
            named = os.stat(self.path)
        except (FileNotFoundError, NotADirectoryError):
            return "renamed" if own.st_nlink else "deleted"
        except OSError:  # a disk that does not answer
            return ""
        if os.name != "nt" and not os.path.samestat(own, named):  # Windows renames no open file
            return "replaced"
        if own.st_size == self._size or self._torn or self.error:  # a refused write may leave part of a line
            return ""
        return "truncated" if own.st_size < self._size else "changed"

    def settle(self, change: str, header: str) -> int:
        """Count again what is in the file after a change by another program; returns how many lines are gone.

        Args:
            change: What `find_change` found.
            header: The CSV header, which is no line of the board.
        """
        self.change, before = change, self.lines
        if change == "renamed" or not before:
            return 0
        kept = 0
        with suppress(OSError), self.path.open("rb") as file:
            file.seek(self._start)
            kept = sum(line[-1:] == b"\n" and line[:1] != b"#" and line != header.encode() for line in file)
        self.lines = min(before, round(kept * before / self._rows))  # some lines have several rows
        return before - self.lines

    def continued(self, path: Path, start: str, at: float) -> AppendFile:
        """A new file, opened, that begins with this text and takes over what waits.

        Raises:
            OSError: It cannot be created; nothing has changed.
        """
        new = AppendFile(path)
        new.open(new=True)
        new.put_note(start, at)
        for entry in self._waiting:
            new._queue(entry.data, entry.at, entry.lines)
        self.give_up()
        self.error = ""
        return new

    def give_up(self) -> int:
        """Discard the waiting entries before the file is closed; returns how many lines those were."""
        lost = self.waiting
        self._waiting.clear()
        self._bytes = self.waiting = 0
        return lost

    def sync(self) -> None:
        """Sync the file to the disk; from any thread."""
        with self._fd_lock:
            if self._fd is None or not self._dirty:
                return
            self._dirty = False
            try:
                _fdatasync(self._fd)
                self.sync_error = ""
            except OSError as error:
                self._dirty = True  # sync once more
                self.sync_error = f"the disk did not confirm what was written ({error.strerror or error})"

    def close(self) -> None:
        """Close the file once the disk has it; safe to call twice."""
        self.sync()
        with self._fd_lock:
            if self._fd is not None:
                with suppress(OSError):  # network disks report here what they did not keep
                    os.close(self._fd)
                self._fd = None

    def _queue(self, data: bytes, at: float, lines: int) -> None:
        self._waiting.append(_Entry(data, at, lines))
        self._bytes += len(data) + _OVERHEAD
        self.waiting += lines

    def _is_too_much(self, at: float) -> bool:
        if not self.error or not self._waiting:
            return False
        return self._bytes > MAX_WAIT_BYTES or at - self._waiting[0].at > MAX_WAIT_S

    def _write(self) -> tuple[int, OSError | None]:
        """One pass over what waits: lines that reached the file, and why it was not all."""
        data = memoryview(b"".join(entry.data for entry in self._waiting))
        done, error = 0, None
        try:
            fd = self.open(new=False) if self._fd is None else self._fd
            self._cut_back()
            while done < len(data):
                done += write_some(fd, data[done:])
        except OSError as failure:
            error = failure
        except BadFile as failure:  # another program is recording it by now
            error = OSError(errno.EBUSY, str(failure))
        lines, whole = 0, 0
        while self._waiting and whole + len(self._waiting[0].data) <= done:
            entry = self._waiting.popleft()
            whole += len(entry.data)
            lines += entry.lines
            self._rows += entry.data.count(b"\n") if entry.lines else 0
            self._bytes -= len(entry.data) + _OVERHEAD
        self.waiting -= lines
        self._size += whole
        self.lines += lines
        self._dirty |= done > 0
        self._torn |= done > whole
        if self._torn:
            with suppress(OSError):  # tried again before the next write
                self._cut_back()
        return lines, error

    def _cut_back(self) -> None:
        """Cut off what a refused write left after the last whole entry."""
        if self._torn and self._fd is not None:
            if os.fstat(self._fd).st_size > self._size:  # another program may have truncated it
                os.ftruncate(self._fd, self._size)
            self._torn = False

    def _note_error(self, error: OSError, now: float) -> None:
        if not self.error:
            self._since = now
        full = error.errno in _FULL
        self._kind = "disk full" if full else "write error"
        reason = _FULL[error.errno] if full and error.errno else error.strerror or str(error)
        self.error = (
            f"{reason}: lines for {self.path.name} wait in memory" if full else f"{self.path.name}: {reason}"
        )
        self._retry_at = now + RETRY_S


class SyncThread:
    """Syncs the files to the disk once a second.

    On a laptop that takes 0.1 ms, on a memory card seconds: in the thread that writes it would let lines pile up
    in memory, where a crash loses them.
    """

    def __init__(self, every: float = 1.0) -> None:
        """Start; `every` is the pause in s."""
        self._every = every
        self._files: tuple[AppendFile, ...] = ()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="kalscope-sync", daemon=True)
        self._thread.start()

    def watch(self, files: tuple[AppendFile, ...]) -> None:
        """Sync these files from now on."""
        self._files = files

    def close(self) -> None:
        """End the thread, then sync once more."""
        self._stop.set()
        self._thread.join()
        for file in self._files:
            file.sync()

    def _run(self) -> None:
        while not self._stop.wait(self._every):
            for file in self._files:
                file.sync()


def _lock(fd: int, path: Path) -> None:
    """Two programs that append to one file would mix their lines. Windows has no such lock."""
    try:
        import fcntl
    except ImportError:
        return
    try:
        fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise BadFile(f"{path.name} must be free to append to (got a file that is being recorded)") from None
    except OSError:  # a file system without locks
        return
