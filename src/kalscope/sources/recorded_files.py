"""The files of a recording: their names and format, written by whole entries, and repaired where cut short."""

from __future__ import annotations

import errno
import math
import os
import threading
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from itertools import count
from pathlib import Path
from typing import BinaryIO

from kalscope.common.text import one_line, unused_name
from kalscope.errors import BadFile
from kalscope.recording import LineIssue
from kalscope.sources.grammar.cells import is_comment
from kalscope.sources.reading.columns import Column, named_column, only_text
from kalscope.sources.reading.sniffer import Layout

# A file that only grows, by whole entries, whatever the disk does.
#
# An entry is the text of one line from the board (or a comment). All waiting entries go out in one `os.write`: a
# program that is killed between two writes leaves whole lines. A full disk cuts a write short, inside a number; the
# file is then cut back to its last whole entry at once, and the entries wait in memory until there is space.


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


# The files of one recording, by name: NAME.csv, NAME-2.csv, …, NAME.rejects, NAME.torn.


_HEAD_BYTES = 4096


def rejects_path(path: Path) -> Path:
    """Where the rejected lines of a recording go."""
    return path.with_name(f"{path.stem}.rejects")


def part_path(path: Path, number: int) -> Path:
    """Part `number`, from 1, of a recording."""
    return path if number == 1 else path.with_name(f"{path.stem}-{number}{path.suffix}")


def torn_path(path: Path) -> Path:
    """Where the torn tail of a file goes: NAME.torn, NAME.rejects.torn."""
    return path.with_name(f"{path.name}.torn" if path.suffix == ".rejects" else f"{path.stem}.torn")


def free_part(path: Path, number: int) -> tuple[int, Path]:
    """The first part from `number` on whose name is free: its number and its path."""
    return next((n, part_path(path, n)) for n in count(number) if not os.path.lexists(part_path(path, n)))


def free_path(path: Path) -> Path:
    """A name similar to `path` that no recording has."""
    candidates = (path.with_name(f"{path.stem}_{n}{path.suffix}") for n in count(2))
    return next(p for p in candidates if not _is_taken(p))


def first_free(path: Path) -> Path:
    """`path`, or a similar name if a recording has it."""
    return free_path(path) if _is_taken(path) else path


def _is_taken(path: Path) -> bool:
    return os.path.lexists(path) or os.path.lexists(rejects_path(path))


def check_free(path: Path) -> None:
    """Refuse a name that is taken.

    Raises:
        BadFile: The name cannot be used; a free one is proposed.
    """
    if not path.name or path.is_dir():
        raise BadFile(f"a recording must be a file (got {str(path)!r})")
    if path.suffix.lower() in (".rejects", ".torn"):
        raise BadFile(f"a recording must not end in .rejects or .torn (got {path.name!r})")
    if _is_taken(path):
        raise taken(path)


def taken(path: Path) -> BadFile:
    """The error of a name that is taken."""
    return BadFile(f"{path.name!r} exists already: choose another name, such as {free_path(path).name!r}")


def unwritable(path: Path, error: Exception) -> BadFile:
    """The error of a file that cannot be created or opened."""
    reason = getattr(error, "strerror", None) or str(error)
    return BadFile(f"cannot write the recording {str(path)!r}: {reason}")


def continues_line(before: Path) -> str:
    """The comment by which a part names the one before it."""
    return f"# continues {escaped(before.name)}, with the same host time\n"


def existing_parts(path: Path) -> list[Path]:
    """The parts of a recording that exist; files of other recordings that have such names are left out.

    Raises:
        BadFile: not even the first does, or one cannot be read.
    """
    if not path.is_file():
        raise BadFile(f"there is no recording {str(path)!r} to resume")
    parts = [path]
    for n in count(2):
        part = part_path(path, n)
        if not part.is_file():
            break
        try:
            with part.open("rb") as file:
                head = file.read(_HEAD_BYTES)
        except OSError as error:
            raise unwritable(part, error) from None
        if continues_line(parts[-1]).encode() in head:
            parts.append(part)
    return parts


# How a recording of a live source is written: its header, its rows, its rejected lines. Pure functions on text.
#
# One comment line says one thing; then come a CSV header and one row per line. Every name survives a round trip
# through our own reader, a spreadsheet and pandas (`comment="#"`), whatever the board calls its channels.


MAGIC = "# kalscope recording "
"""What a recording begins with; the version follows."""
REJECTS_MAGIC = "# kalscope rejects "
"""What the file of rejected lines begins with."""
STARTED = "# started: "
"""Before the wall clock's time at host time 0."""
HOST_TIME = "host time [s]"
"""Header of the first column."""
DEVICE_TIME = "device time"
"""Name of the second column, where the board sends its time; its unit follows."""
REJECTS_HEADER = f"{HOST_TIME},line,column,reason,text\n"
"""Header of the file of rejected lines."""

_FORMULA = ("=", "+", "-", "@")
_MAX_CELL_LENGTH = 100  # of a header: the reader cuts there
_MAX_UNIT_LENGTH = 30

RowEncoder = Callable[[float, Sequence[float]], str]
"""Turns host time in s and the values of a row, one per column of the layout, into its line."""


def preamble(source: str, wall: float, *, rejects: bool = False) -> str:
    """The comment lines above the header.

    Args:
        source: What is recorded, in the words of the command line.
        wall: Unix time at host time 0, s.
        rejects: True for the file of rejected lines.
    """
    lines = [
        f"{REJECTS_MAGIC if rejects else MAGIC}{_version()}",
        f"# source: {escaped(source)}",
        f"{STARTED}{iso_utc(wall)}",
        "# host time: s since the start, by this computer's monotonic clock; the rest as the board sent it",
    ]
    if rejects:
        lines.append("# text: a line as received, cut at 200 characters, with \\ before what cannot be printed")
    return "\n".join(lines) + "\n"


def restart_note(source: str, wall: float, since: float, host: float) -> str:
    """The comment lines where a recording is resumed.

    Args:
        source: What is recorded from here on.
        wall: Unix time, s.
        since: How long nothing was recorded, s; negative where the wall clock was set back.
        host: Host time, s.
    """
    said = f"{since:.3f} s" if since >= 0.0 else "of unknown length, the clock was set back"
    return f"# gap restart {said}\n# restarted: {iso_utc(wall)} (host time {host:.6f}), source: {escaped(source)}\n"


def iso_utc(unix: float) -> str:
    """Unix time as ISO 8601 in UTC, with microseconds."""
    stamp = datetime.fromtimestamp(unix, UTC).replace(tzinfo=None)
    return f"{stamp.isoformat(timespec='microseconds')}Z"


def header_line(layout: Layout) -> str:
    """The CSV header of a layout: host time, device time where the board sends it, the channels with units."""
    cells = [HOST_TIME]
    if layout.time is not None:
        unit = layout.columns[layout.time.index].unit or layout.time.unit
        cells.append(_cell(DEVICE_TIME, unit if layout.time.kind == "number" else "s"))
    taken = {"host time", DEVICE_TIME}
    for i in layout.channels:
        column = layout.columns[i]
        name = unused_name(_harmless(column.name), taken, " ")
        cells.append(_cell(name, column.unit))
    return ",".join(map(quoted, cells)) + "\n"


def row_encoder(layout: Layout) -> RowEncoder:
    """The function that writes the rows of a layout.

    A number is written with the fewest digits that give the same double, a missing value as an empty
    cell. A device time that is a calendar stamp or a clock is written in s since 1970 (UTC) or midnight.
    """
    time, channels = layout.time, layout.channels

    def encode(host: float, row: Sequence[float]) -> str:
        cells = [f"{host:.6f}"]
        if time is not None:
            stamp = row[time.index]
            cells.append(_number(stamp) if time.kind == "number" else _microseconds(stamp))
        cells += [_number(row[i]) for i in channels]
        return ",".join(cells) + "\n"

    return encode


def rejects_lines(host: float, number: int, text: str, issues: Iterable[LineIssue]) -> str:
    """The lines that give the reasons why a line, or cells of it, were rejected."""
    shown = quoted(escaped(text))
    return "".join(
        f"{host:.6f},{number},{quoted(escaped(issue.column or ''))},{quoted(escaped(issue.reason))},{shown}\n"
        for issue in issues
    )


def escaped(text: str) -> str:
    r"""Printable text on one line: `\n`, `\x00`, `\\`."""
    if text.isprintable() and "\\" not in text:
        return text
    return "".join(c if c.isprintable() and c != "\\" else c.encode("unicode_escape").decode() for c in text)


def quoted(cell: str) -> str:
    """A CSV cell; pandas takes a bare # for the start of a comment."""
    if any(mark in cell for mark in ',"#') or cell != cell.strip():
        return '"' + cell.replace('"', '""') + '"'
    return cell


def _number(value: float) -> str:
    return "" if math.isnan(value) else repr(value).removesuffix(".0")


def _microseconds(stamp: float) -> str:
    if math.isnan(stamp):
        return ""
    whole = round(abs(stamp))
    return f"{'-' if stamp < 0 else ''}{whole // 1_000_000}.{whole % 1_000_000:06d}"


def _cell(name: str, unit: str) -> str:
    """`name [unit]`; `name []` where our reader would take a bare name for something else."""
    unit = " ".join("".join(c if c.isprintable() and c not in "[]" else " " for c in unit).split())[
        :_MAX_UNIT_LENGTH
    ]
    name = name[: _MAX_CELL_LENGTH - len(unit) - 3].rstrip()
    if unit:
        return f"{name} [{unit}]"
    plain = named_column(name) == Column(name) and only_text((name,), ".")
    return name if plain else f"{name} []"


def _harmless(name: str) -> str:
    """A name on one line that no spreadsheet takes for a formula."""
    name = one_line(name)[: _MAX_CELL_LENGTH - 40].rstrip()
    return f"'{name}" if name.startswith(_FORMULA) else name or "channel"


def _version() -> str:
    try:
        return version("kalscope")
    except PackageNotFoundError:  # run from a checkout that was never installed
        return "unknown"


# A recording whose last line was cut short: whole lines stay, the rest is moved aside.
#
# A program that is killed may leave half a line; a power cut may leave zeros after it, or zeros with old bytes of
# the disk after them. So the file ends with the last newline before the first zero byte. What follows is appended
# to NAME.torn and is on the disk before the file is cut.


_BLOCK = 1 << 20
_REPAIR_HEAD_BYTES = 65_536


@dataclass(frozen=True)
class RepairReport:
    """What a repair did."""

    kept: int
    """Bytes of whole lines that stay in the file."""
    torn: int
    """Bytes after them, moved aside; 0 where the file was whole."""
    torn_path: Path | None
    """Where they went; None where the file was whole."""


@dataclass(frozen=True)
class RecordingEnds:
    """The times and the header in the first and last lines of a recording."""

    wall: float | None
    """Unix time at host time 0, s; None where the file ends before that line."""
    header: str
    """The CSV header with its newline; "" where the file ends before it."""
    host: float
    """Host time of the last row, s; 0 where there is none."""


def repair(path: Path) -> RepairReport:
    """Cut a recording, or its file of rejected lines, at its last whole line.

    Args:
        path: NAME.csv or NAME.rejects. No program may be writing to it.

    Returns:
        What was kept and what was moved to NAME.torn (NAME.rejects.torn for the rejected lines).

    Raises:
        BadFile: The file is not a Kalscope recording, or there is no space to move the torn tail to; the recording
            is then unchanged.
    """
    path = Path(path)
    try:
        with path.open("rb+") as file:
            _check_ours(file, path)
            size, kept = file.seek(0, os.SEEK_END), _end_of_whole_lines(file)
            if kept == size:
                return RepairReport(kept, 0, None)
            torn = torn_path(path)
            _move_aside(file, kept, torn)
            file.truncate(kept)
            file.flush()
            os.fsync(file.fileno())
            return RepairReport(kept, size - kept, torn)
    except OSError as error:
        raise BadFile(f"cannot repair the recording {path.name}: {error.strerror}") from None


def read_ends(path: Path) -> RecordingEnds:
    """The times and the header of a repaired recording.

    Raises:
        BadFile: Its comments or its last row cannot be understood.
        OSError: It cannot be read.
    """
    with path.open("rb") as file:
        head = file.read(_REPAIR_HEAD_BYTES).decode("utf-8", "replace").splitlines(keepends=True)
        size = file.seek(0, os.SEEK_END)
        start = max(0, size - _REPAIR_HEAD_BYTES)
        file.seek(start)
        tail = file.read().decode("utf-8", "replace").splitlines()[1 if start else 0 :]
    started = next((line for line in head if line.startswith(STARTED)), None)
    header = next((line for line in head if not is_comment(line)), "")
    rows = [line for line in tail if not is_comment(line) and line + "\n" != header]
    try:
        wall = None if started is None else datetime.fromisoformat(started[len(STARTED) :].split()[0]).timestamp()
        host = float(rows[-1].partition(",")[0]) if rows else 0.0
    except (ValueError, IndexError):
        raise BadFile(f"{path.name} must be a recording as it was written (got one that was edited)") from None
    return RecordingEnds(wall, header, host)


def _check_ours(file: BinaryIO, path: Path) -> None:
    head = file.read(_REPAIR_HEAD_BYTES)
    for magic in (MAGIC.encode(), REJECTS_MAGIC.encode()):
        if head.startswith(magic) or magic.startswith(head.partition(b"\0")[0]):
            return
    raise BadFile(f"{path.name} must begin with {MAGIC!r}, as a recording does (got {head[:40]!r})")


def _end_of_whole_lines(file: BinaryIO) -> int:
    """Offset after the last newline before the first zero byte."""
    file.seek(0)
    end, offset = 0, 0
    while block := file.read(_BLOCK):
        zero = block.find(b"\0")
        newline = block.rfind(b"\n", 0, zero if zero >= 0 else len(block))
        end = offset + newline + 1 if newline >= 0 else end
        if zero >= 0:
            break
        offset += len(block)
    return end


def _move_aside(file: BinaryIO, start: int, torn: Path) -> None:
    """Append what follows `start` to `torn`, and sync it to the disk."""
    with torn.open("ab") as out:
        before = out.tell()
        try:
            file.seek(start)
            while block := file.read(_BLOCK):
                out.write(block)
            out.write(b"\n")  # tails of several crashes stay apart
            out.flush()
            os.fsync(out.fileno())
        except OSError:
            os.ftruncate(out.fileno(), before)
            raise
