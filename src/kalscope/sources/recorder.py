"""The recorder of a live source: every line that the board sends, as received, never filtered.

    NAME.csv      host time, device time if sent, the values; gaps and the final account as comment lines
    NAME-2.csv    the same again, where the board began to send other columns
    NAME.rejects  the lines that are not data, with their numbers and reasons

All lines of a call go out in one `os.write`: a program that is killed loses only lines not passed yet.
Host time is the difference of two monotonic times, so that no step of the wall clock
changes a row.
"""

from __future__ import annotations

import math
import os
import threading
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import chain
from itertools import count as numbers
from pathlib import Path

from kalscope.common.files import sync_folder
from kalscope.common.text import one_line, program, unused_name
from kalscope.errors import BadFile, reason_of
from kalscope.recording import LineIssue
from kalscope.sources.grammar.timestamps import TimeColumn
from kalscope.sources.port.reader import SYSTEM, Clock
from kalscope.sources.reading.columns import Column, named_column, only_text
from kalscope.sources.reading.line_reader import LineEvent
from kalscope.sources.reading.sniffer import Layout

# The files of one recording, by name: NAME.csv, NAME-2.csv, …, NAME.rejects.


def rejects_path(path: Path) -> Path:
    """Where the rejected lines of a recording go."""
    return path.with_name(f"{path.stem}.rejects")


def first_free(path: Path) -> Path:
    """`path`, or a similar name if a recording has it."""
    others = (path.with_name(f"{path.stem}_{n}{path.suffix}") for n in numbers(2))
    return next(name for name in chain([path], others) if not _is_taken(name))


def _is_taken(path: Path) -> bool:
    return os.path.lexists(path) or os.path.lexists(rejects_path(path))


def check_free(path: Path) -> None:
    """Refuse a name that is taken.

    Raises:
        BadFile: The name cannot be used; a free one is proposed.
    """
    if not path.name or path.is_dir():
        raise BadFile(f"a recording must be a file (got {str(path)!r})")
    if _is_taken(path):
        raise BadFile(f"{path.name!r} exists already: choose another name, such as {first_free(path).name!r}")


# How a recording of a live source is written: its header, its rows, its rejected lines. Pure functions on text.
#
# One comment line says one thing; then come a CSV header and one row per line. Every name survives a round trip
# through our own reader, a spreadsheet and pandas (`comment="#"`), whatever the board calls its channels.


HOST_TIME = "host time [s]"
"""Header of the first column."""
DEVICE_TIME = "device time"
"""Name of the second column, where the board sends its time; its unit follows."""


def preamble(source: str, wall: float, *, rejects: bool = False) -> str:
    """The comment lines above the header; of the rejected lines the header, too.

    Args:
        source: What is recorded, in the words of the command line.
        wall: Unix time at host time 0, s.
        rejects: True for the file of rejected lines.
    """
    started = datetime.fromtimestamp(wall, UTC).isoformat(timespec="microseconds").replace("+00:00", "Z")
    lines = [
        f"# kalscope {'rejects' if rejects else 'recording'} {program().rpartition(' ')[2]}",
        f"# source: {escaped(source)}",
        f"# started: {started}",
        "# host time: s since the start, by this computer's monotonic clock; the rest as the board sent it",
    ]
    if rejects:
        lines.append("# text: a line as received, cut at 200 characters, with \\ before what cannot be printed")
        lines.append(f"{HOST_TIME},line,column,reason,text")
    return "\n".join(lines) + "\n"


def header_line(layout: Layout) -> str:
    """The CSV header of a layout: host time, device time where the board sends it, the channels with units."""
    cells = [HOST_TIME]
    if layout.time is not None:
        unit = layout.columns[layout.time.index].unit or layout.time.unit
        cells.append(_cell(DEVICE_TIME, unit if layout.time.kind == "number" else "s"))
    taken = {"host time", DEVICE_TIME}
    columns = [layout.columns[i] for i in layout.channels]
    cells += [_cell(unused_name(_harmless(column.name), taken, " "), column.unit) for column in columns]
    return ",".join(map(quoted, cells)) + "\n"


def row_line(time: TimeColumn | None, channels: Sequence[int], host: float, row: Sequence[float]) -> str:
    """The line of a row: host time in s, device time where the board sends it, the channels.

    A number is written with the fewest digits that give the same double, a missing value as an empty
    cell. A device time that is a calendar stamp or a clock is written in s since 1970 (UTC) or midnight.
    """
    cells = [f"{host:.6f}"]
    if time is not None:
        stamp = row[time.index]
        cells.append(_number(stamp) if time.kind == "number" or math.isnan(stamp) else f"{stamp / 1e6:.6f}")
    return ",".join(cells + [_number(row[i]) for i in channels]) + "\n"


def rejects_lines(host: float, number: int, text: str, issues: Iterable[LineIssue]) -> str:
    """The lines that give the reasons why a line, or cells of it, were rejected."""
    shown = quoted(escaped(text))
    return "".join(
        f"{host:.6f},{number},{quoted(escaped(issue.column or ''))},{quoted(escaped(issue.reason))},{shown}\n"
        for issue in issues
    )


def escaped(text: str) -> str:
    r"""Printable text on one line: `\n`, `\x00`, `\\`."""
    return "".join(c if c.isprintable() and c != "\\" else c.encode("unicode_escape").decode() for c in text)


def quoted(cell: str) -> str:
    """A CSV cell; pandas takes a bare # for the start of a comment."""
    if any(mark in cell for mark in ',"#') or cell != cell.strip():
        return '"' + cell.replace('"', '""') + '"'
    return cell


def _number(value: float) -> str:
    return "" if math.isnan(value) else repr(value).removesuffix(".0")


def _cell(name: str, unit: str) -> str:
    """`name [unit]`; `name []` where our reader would take a bare name for something else."""
    unit = one_line(unit.replace("[", " ").replace("]", " "))[:30]
    if unit:
        return f"{name} [{unit}]"
    plain = named_column(name) == Column(name) and only_text((name,), ".")
    return name if plain else f"{name} []"


def _harmless(name: str) -> str:
    """A name on one line that no spreadsheet takes for a formula."""
    name = one_line(name)[:60].rstrip()  # the reader cuts a header with its unit at 100
    return f"'{name}" if name.startswith(("=", "+", "-", "@")) else name or "channel"


# A file that only grows, by whole lines, whatever the disk does.
#
# A full disk cuts a write short, inside a number; the file is then cut back to where it was, and the lines of that
# write, and those that come until there is space, are counted as lost.


SYNC_EVERY_S = 1.0
"""Pause between two requests that the disk keep what it has, s."""
RETRY_S = 1.0
"""Pause between two attempts to write to a disk that refuses, s."""

_fdatasync = getattr(os, "fdatasync", os.fsync)


class AppendFile:
    """One growing file. Not for several threads, except `sync`, which may be called from another."""

    def __init__(self, path: Path, head: str = "") -> None:
        """Name the file; it is created by `create`, or by the first `flush`. `head` comes before all else."""
        self.path, self._head = path, head
        self.error = ""
        """What keeps lines from reaching the file; "" while they do."""
        self._damage = ""
        self.lines = 0
        """Lines of the board that are in the file."""
        self.lost: int = 0
        """Lines of the board that the disk refused."""
        self._fd: int | None = None
        self._fd_lock = threading.Lock()
        self.size = 0
        """Bytes of the file, without what other programs do to it."""
        self._notes, self._texts, self._put = "", list[str](), 0  # what the next write holds, and its lines
        self._failed: tuple[float, int] = (0.0, 0)  # when the error began, and the lines lost before

    @property
    def problem(self) -> str:
        """What is wrong with the file; "" for nothing."""
        return self.error or self._damage

    def create(self) -> int:
        """Create the file; its descriptor.

        Raises:
            OSError: It cannot be created (FileExistsError: it is there already).
        """
        flags = os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0)
        self._fd = os.open(self.path, flags, 0o666)
        return self._fd

    def put(self, text: str, lines: int = 0) -> None:
        """Queue the text of so many lines of the board for the next flush."""
        self._texts.append(text)
        self._put += lines

    def note(self, text: str) -> None:
        """Queue comments or a header, which come before the lines and wait for a disk that refuses."""
        self._notes += text

    def flush(self, now: float, *, at_once: bool = False) -> None:
        """Write what was queued; never raises disk errors.

        Args:
            now: Monotonic time, s: a disk that refused is tried again after RETRY_S.
            at_once: Do not wait for that.
        """
        self._check()
        texts, lines, (since, lost) = "".join(self._texts), self._put, self._failed
        self._texts, self._put = [], 0
        if self.error and now < self._retry_at and not at_once:
            self.lost += lines
            return
        gap = f"# gap disk {now - since:.3f} s ({self.lost - lost} lines dropped)\n" if self.error else ""
        try:
            if text := self._notes + gap + texts:
                self._write((self._head + text).encode("utf-8", "backslashreplace"))
                self._head = self._notes = self.error = ""
            self.lines += lines
        except OSError as error:
            self._failed = self._failed if self.error else (now, self.lost)
            self.error = f"the disk refuses ({reason_of(error)}): lines for {self.path.name} are lost"
            self.lost += lines
            self._retry_at = now + RETRY_S

    def _check(self) -> None:
        """Note what another program did to the file. A renamed file goes on under its new name."""
        status = None if self._fd is None else os.fstat(self._fd)
        if status and (not status.st_nlink or status.st_size < self.size):
            self._damage = f"{self.path.name} was deleted or cut short by another program: record to a new file"

    def _write(self, data: bytes) -> None:
        """Write all of it; where that raises OSError, nothing."""
        fd = self.create() if self._fd is None else self._fd
        end, rest = self.size + len(data), memoryview(data)
        try:
            if self.error:
                self._cut_back(fd)
            while rest:
                rest = rest[os.write(fd, rest) :]
        except OSError:
            with suppress(OSError):  # tried again before the next write
                self._cut_back(fd)
            raise
        self.size = end

    def _cut_back(self, fd: int) -> None:
        """Cut off what a refused write left after the last whole line."""
        if os.fstat(fd).st_size > self.size:
            os.ftruncate(fd, self.size)

    def sync(self) -> None:
        """Sync the file to the disk; from any thread."""
        with self._fd_lock:
            if self._fd is not None:
                try:
                    _fdatasync(self._fd)
                except OSError as error:  # which Linux reports once, even where the data are lost
                    self._damage = f"the disk did not confirm what was written ({reason_of(error)})"

    def close(self) -> None:
        """Close the file once the disk has it. Safe to call twice."""
        self.sync()
        with self._fd_lock:
            if self._fd is not None:
                with suppress(OSError):  # network disks report here what they did not keep
                    os.close(self._fd)
                self._fd = None


# The recorder.


@dataclass
class RecorderCounts:
    """The account of a recording: received = written + rejected + dropped, always. Recorders return copies."""

    received: int = 0
    """Lines with data, or that should have been data, that were written, rejected or dropped."""
    written: int = 0
    """Lines whose rows are in NAME.csv."""
    rejected: int = 0
    """Lines that are in NAME.rejects because they are not rows."""
    dropped: int = 0
    """Lines that are in neither: lost before they reached the recorder, or while the disk was full."""
    unwritable: int = 0
    """Of the dropped lines, those that the disk refused."""
    other: int = 0
    """Blank lines, comments, headers and text such as a boot message; the text is in NAME.rejects."""

    def __str__(self) -> str:
        """The account in words."""
        text = f"{self.written} written + {self.rejected} rejected + {self.dropped} dropped"
        others = f"; {self.other} other{'s' * (self.other != 1)}" if self.other else ""
        return f"received {self.received} lines = {text}{others}"


StampedLine = tuple[float, LineEvent, Layout | None]
"""Monotonic time in s, a line, and the layout at that line: None as long as none is known."""


class Recorder:
    """Writes one recording. Any thread may call it; its calls run one after the other."""

    def __init__(self, path: Path, source: str, *, clock: Clock = SYSTEM) -> None:
        """Create a recording, which never overwrites a file. Lines with other columns go into a new part.

        Args:
            path: NAME.csv; its folder exists, and the caller has checked that it may be written to.
            source: What is recorded, as the command line names it.
            clock: Host time 0 is its present time; its monotonic part times the retries on a full disk, too.

        Raises:
            BadFile: The name is taken (a free one is proposed), or the file cannot be created.
        """
        self.path = Path(path)
        """NAME.csv, the first part."""
        self.rejects_path = rejects_path(self.path)
        """NAME.rejects; it exists once there is something in it."""
        check_free(self.path)
        self._source, self._clock = source, clock.monotonic
        self._started, self._wall = clock.monotonic(), clock.wall()
        self._header = ""
        self._layout: Layout | None = None
        self._dropped = self._other = 0
        self._lock = threading.Lock()
        self._stop = threading.Event()
        self._csv = AppendFile(self.path)
        self._parts = [self._csv]
        self._rejects = AppendFile(self.rejects_path, preamble(source, self._wall, rejects=True))
        try:
            self._csv.create()
        except (OSError, ValueError) as error:
            raise BadFile(f"cannot write the recording {str(path)!r}: {reason_of(error)}") from None
        self._csv.note(preamble(source, self._wall))
        self._sync = threading.Thread(target=self._keep_synced, name="kalscope-sync", daemon=True)
        self._sync.start()
        sync_folder(self.path.parent)
        self.write([])

    def _keep_synced(self) -> None:
        """Sync the files to the disk.

        On a laptop that takes 0.1 ms, on a memory card seconds: in the thread that writes it would let lines pile
        up in memory, where a crash loses them.
        """
        while not self._stop.wait(SYNC_EVERY_S):
            for file in self._files():
                file.sync()

    @property
    def counts(self) -> RecorderCounts:
        """The account up to now."""
        written, rejected = sum(part.lines for part in self._parts), self._rejects.lines
        unwritable = sum(file.lost for file in self._files())
        dropped = self._dropped + unwritable
        received = written + rejected + dropped
        return RecorderCounts(received, written, rejected, dropped, unwritable, self._other)

    @property
    def error(self) -> str:
        """What keeps lines from reaching the disk, in words; "" if nothing."""
        return next(filter(None, (file.problem for file in self._files())), "")

    @property
    def paths(self) -> tuple[Path, ...]:
        """The parts written so far in this session, the current one last."""
        return tuple(part.path for part in self._parts)

    @property
    def files(self) -> str:
        """The names of the parts."""
        return " and ".join(path.name for path in self.paths)

    def write(self, stamped: Sequence[StampedLine]) -> None:
        """Write lines, in order of time; called often, also without lines, and never raises disk errors."""
        with self._lock:
            if not self._stop.is_set():
                for line in stamped:
                    self._take(*line)
                self._flush()

    def lose(self, lines: int, kind: str = "", seconds: float = 0.0) -> None:
        """Count lines that were lost before they could be passed on.

        Args:
            lines: How many.
            kind: Why nothing was received, "unplug" or "overrun"; the file notes it. "" = it does not.
            seconds: For how long.
        """
        with self._lock:
            if not self._stop.is_set():
                self._dropped += lines
                if kind:
                    self._csv.note(f"# gap {escaped(kind)} {seconds:.3f} s\n")
                    self._flush()

    def close(self) -> RecorderCounts:
        """Write the account as a last comment and close the files; safe to call twice, never raises disk errors."""
        with self._lock:
            if not self._stop.is_set():
                self._flush(at_once=True)
                self._stop.set()
                self._sync.join()
                self._rejects.close()
                self._csv.note(f"# end: {self.counts}\n")
                self._csv.flush(self._clock(), at_once=True)
                self._csv.close()
            return self.counts

    def _files(self) -> tuple[AppendFile, ...]:
        return (*self._parts, self._rejects)

    def _use(self, layout: Layout) -> None:
        """Write rows of this layout from now on, in a new part if the columns differ."""
        header = header_line(layout)
        if not self._header:
            self._csv.note(header)
        elif header != self._header:
            self._next_part(header)
        self._layout, self._header = layout, header

    def _next_part(self, header: str) -> None:
        before, path = self._csv, self.path
        names = (path.with_name(f"{path.stem}-{n}{path.suffix}") for n in numbers(2))
        new = next(name for name in names if not os.path.lexists(name))
        before.put(f"# continued in {escaped(new.name)}: the columns changed\n")
        before.flush(self._clock(), at_once=True)
        before.close()
        self._csv = AppendFile(new)
        self._parts.append(self._csv)
        continues = f"# continues {escaped(before.path.name)}, with the same host time\n"
        self._csv.note(preamble(self._source, self._wall) + continues + header)

    def _take(self, at: float, event: LineEvent, layout: Layout | None) -> None:
        host, issues = at - self._started, event.issues
        if event.kind == "row" and layout is not None:
            if layout is not self._layout:  # with its first row: names of variables may come long before
                self._use(layout)
            rows = (row_line(layout.time, layout.channels, host, row) for row in event.rows)
            self._csv.put("".join(rows), 1)
        elif event.kind != "rejected":
            self._other += 1
            if event.kind != "blank":
                issues = (LineIssue(event.number, f"{event.kind}, not data", event.text),)
        if issues or event.kind == "rejected":  # those of single cells, too: the row has empty cells there
            lines = rejects_lines(host, event.number, event.text, issues)
            self._rejects.put(lines, int(event.kind == "rejected"))

    def _flush(self, *, at_once: bool = False) -> None:
        now = self._clock()
        for file in (self._csv, self._rejects):
            file.flush(now, at_once=at_once)
