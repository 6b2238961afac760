"""The recorder of a live source: every line that the board sends, as received."""

from __future__ import annotations

import shutil
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from kalscope.common.files import sync_folder
from kalscope.common.text import count
from kalscope.errors import BadFile
from kalscope.recording import LineIssue
from kalscope.sources.reading.line_reader import LineEvent
from kalscope.sources.reading.sniffer import Layout
from kalscope.sources.recorded_files import (
    REJECTS_HEADER,
    AppendFile,
    RecordingEnds,
    RowEncoder,
    SyncThread,
    check_free,
    continues_line,
    escaped,
    existing_parts,
    free_part,
    header_line,
    preamble,
    read_ends,
    rejects_lines,
    rejects_path,
    repair,
    restart_note,
    row_encoder,
    taken,
    unwritable,
)

# The account of a recording.


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
    """Lines that are in neither: lost before they reached the recorder, while the disk was full for too long, or
    because another program truncated or deleted the file."""
    unwritable: int = 0
    """Of the dropped lines, those that the disk refused for too long."""
    removed: int = 0
    """Of the dropped lines, those that were in a file until another program truncated or deleted it."""
    waiting: int = 0
    """Lines in memory, because the disk refuses them; they count as received once written or dropped."""
    other: int = 0
    """Blank lines, comments, headers and text such as a boot message; the text is in NAME.rejects."""

    def __str__(self) -> str:
        """The account in words."""
        text = (
            f"received {self.received} lines = {self.written} written + {self.rejected} rejected"
            f" + {self.dropped} dropped"
        )
        text += f"; {self.other} other{'s' * (self.other != 1)}" if self.other else ""
        return text + (f"; another program removed {self.removed} written lines" if self.removed else "")

    def add_unwritable(self, lines: int) -> None:
        """Count lines that the disk did not take."""
        self.dropped += lines
        self.unwritable += lines

    def move_removed(self, lines: int) -> None:
        """Count lines that another program removed from a file after they were written."""
        self.written -= lines
        self.dropped += lines
        self.removed += lines


# How long a disk will last at the rate at which a recording grows.


MIN_SECONDS_LEFT = 300.0
"""A disk that will be full sooner gets a warning, s."""
_RATE_S = 30.0
"""Seconds over which the rate is measured."""
_CHECK_S = 1.0


class DiskSpaceMonitor:
    """Checks the disk of a folder once a second."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._sizes: deque[tuple[float, int]] = deque()
        self._warning = ""

    def check(self, now: float, size: int) -> str:
        """The warning at the monotonic time `now`, s, with `size` bytes written; "" if there is enough space."""
        if self._sizes and now - self._sizes[-1][0] < _CHECK_S:
            return self._warning
        self._sizes.append((now, size))
        while now - self._sizes[0][0] > _RATE_S:
            self._sizes.popleft()
        self._warning = self._judge(now, size)
        return self._warning

    def _judge(self, now: float, size: int) -> str:
        first, before = self._sizes[0]
        if size <= before or now <= first:
            return ""
        try:
            free = shutil.disk_usage(self._folder).free
        except OSError:  # a folder that was moved away: the next write will report what is wrong
            return ""
        left = free * (now - first) / (size - before)
        if left >= MIN_SECONDS_LEFT:
            return ""
        return f"the disk has space left for {left / 60.0:.1f} min at the current rate"


# NAME.rejects, the file of the lines of a recording that are not data; it exists once there is one.


class RejectsFile:
    """Takes lines with the reasons why they are not data."""

    def __init__(self, recording: Path, source: str) -> None:
        """Args: NAME.csv; what is recorded, as the command line names it."""
        self.file = AppendFile(rejects_path(recording))
        """The file itself."""
        self._source = source
        self._begun = False

    def resume(self) -> None:
        """Continue the file where there is one, because the recording is resumed.

        Raises:
            BadFile: it cannot be repaired.
        """
        if self.file.path.exists():
            self._begun = repair(self.file.path).kept > 0

    def continue_in_new(self, wall: float, at: float) -> Path:
        """Go on in NAME-2.rejects, because another program changed the file; returns the new path.

        Raises:
            OSError: It cannot be created.
        """
        _, path = free_part(self.file.path, 2)
        self.file = self.file.continued(path, preamble(self._source, wall, rejects=True) + REJECTS_HEADER, at)
        return path

    def put(
        self, host: float, at: float, wall: float, event: LineEvent, issues: Sequence[LineIssue], lines: int
    ) -> bool:
        """Queue a line with its reasons; False where it is lost because too much waits already.

        Args:
            host: Host time, s.
            at: Monotonic time, s.
            wall: Unix time at host time 0, s.
            event: The line.
            issues: Why it is not data, or which of its cells are not.
            lines: 1 where it counts as rejected, else 0.
        """
        if not self._begun:
            self._begun = True
            self.file.put_note(preamble(self._source, wall, rejects=True) + REJECTS_HEADER, at)
        text = rejects_lines(host, event.number, event.text, issues)
        return self.file.put(text.encode("utf-8", "backslashreplace"), at, lines)


# The recorder of a live source: every line that the board sends, as received, never filtered.
#
#     NAME.csv      host time, device time if sent, the values; gaps and the final account as comment lines
#     NAME-2.csv    the same again, where the board began to send other columns
#     NAME.rejects  the lines that are not data, with their numbers and reasons
#     NAME.torn     what a crash left after the last whole line, moved there when the recording is resumed
#
# Each call writes with one `os.write`: a program that is killed loses only lines that had not been passed yet.
# All clocks are passed in: host time is the difference of two monotonic times, so that no step of the wall clock
# changes a row.


_WHAT = {"comment": "a comment", "header": "a header", "text": "text, not data"}


class Recorder:
    """Writes one recording. Any thread may call it; its calls run one after the other."""

    path: Path
    """NAME.csv, the first part."""
    error: str
    """What keeps lines from reaching the disk, in words; "" if nothing."""
    warning: str
    """What another program did to a file, or a warning that the disk will soon be full; "" if neither."""
    counts: RecorderCounts
    """The account up to the last call."""

    def __init__(
        self,
        path: Path,
        *,
        source: str,
        started: float,
        wall: float,
        resume: bool = False,
        clock: Callable[[], float] = time.monotonic,
        sync_every: float = 1.0,
    ) -> None:
        """Create a recording, which never overwrites a file, or resume one that ended or that a crash cut short.

        To resume, the torn tail is moved into NAME.torn, then a comment says how long nothing was recorded. Host
        time continues by the wall clock; where that was set back, at the last row. Lines with other columns than
        those of the file go into a new part.

        Args:
            path: NAME.csv; its folder exists, and the caller has checked that it may be written to.
            source: What is recorded, as the command line names it.
            started: Monotonic time at host time 0, s.
            wall: Unix time at host time 0, s.
            resume: Continue the recording at `path`.
            clock: Monotonic clock, s; it times the retries on a full disk.
            sync_every: Pause between two requests that the disk keep what it has, s.

        Raises:
            BadFile: The name is taken (a free one is proposed), or the file cannot be created. To resume: there is
                no such recording, it is being recorded, or it cannot be written to.
        """
        path = Path(path)
        if not resume:
            check_free(path)
        parts = existing_parts(path) if resume else [path]
        self.path = path
        self.error = self.warning = ""
        self.counts = RecorderCounts()
        self._source, self._started, self._wall, self._clock = source, started, wall, clock
        self._offset = 0.0
        self._csv = AppendFile(parts[-1])
        self._rejects = RejectsFile(path, source)
        self._parts = [self._csv]
        self._older: list[AppendFile] = []  # parts that wait for disk space
        self._notice = ""
        self._part = len(parts)
        self._header = ""
        self._layout: Layout | None = None
        self._encode: RowEncoder | None = None
        self._width = 0
        self._tally = RecorderCounts()  # its `received` includes the lines that wait
        self._disk_space = DiskSpaceMonitor(path.parent)
        self._lock = threading.Lock()
        self._closed = False
        self._open(resume=resume)
        self._sync = SyncThread(sync_every)
        sync_folder(path.parent)
        with self._lock:
            self._flush()

    def _open(self, *, resume: bool) -> None:
        """Open the file and queue its first comments."""
        path = self._csv.path
        try:
            self._csv.open(new=not resume)  # locked first: no other program appends while the tail is judged
            if resume:
                repair(path)
                self._rejects.resume()
                self._csv.close()
                self._csv.open(new=False)
                self._resume_times(read_ends(path))
            else:
                self._csv.put_note(preamble(self._source, self._wall), self._started)
        except FileExistsError:
            raise taken(path) from None
        except BadFile:
            self._csv.close()
            raise
        except (OSError, ValueError) as error:
            self._csv.close()
            raise unwritable(path, error) from None

    def _resume_times(self, ends: RecordingEnds) -> None:
        """Continue the host time and the columns of a part with these ends."""
        if ends.wall is None:  # a crash right after the start left no header
            self._csv.put_note(preamble(self._source, self._wall), self._started)
            return
        since = self._wall - ends.wall - ends.host
        self._offset = ends.host + max(since, 0.0)
        self._header = ends.header
        self._csv.put_note(restart_note(self._source, self._wall, since, self._offset), self._started)

    @property
    def paths(self) -> tuple[Path, ...]:
        """The parts written so far in this session, the current one last."""
        return tuple(part.path for part in self._parts)

    @property
    def rejects_path(self) -> Path:
        """NAME.rejects; it exists once there is something in it."""
        return self._rejects.file.path

    @property
    def files(self) -> str:
        """The names of the parts; where there are several, with the lines that are in each."""
        texts: list[str] = []
        for part in self._parts:
            change = part.change or ("" if part.path.exists() else "deleted or renamed")
            if change or len(self._parts) > 1:
                by = f", {change} by another program" if change else ""
                texts.append(f"{part.path.name} ({count(part.lines)} lines{by})")
        return " and ".join(texts) or self.path.name

    def write(self, stamped: Sequence[tuple[float, LineEvent]], layout: Layout | None) -> None:
        """Write lines; called often, also without lines, and never raises disk errors.

        Args:
            stamped: (monotonic time in s, line), in order of time.
            layout: Of all these rows: lines before and after a new layout are two calls. None as long as
                no layout is known; then no line is a row.
        """
        with self._lock:
            if self._closed:
                return
            if layout is not None and layout is not self._layout and any(one.kind == "row" for _, one in stamped):
                self._use(layout)  # with its first row: names of variables may come long before
            for at, event in stamped:
                self._take(at, event)
            self._flush()

    def gap(self, kind: str, seconds: float) -> None:
        """Note in the file how long nothing was received, and why: "unplug", "suspend"."""
        with self._lock:
            if not self._closed:
                self._csv.put(f"# gap {escaped(kind)} {seconds:.3f} s\n".encode(), self._clock())
                self._flush()

    def drop(self, count: int) -> None:
        """Count lines that were lost before they could be passed on."""
        with self._lock:
            if not self._closed:
                self._tally.received += count
                self._tally.dropped += count
                self._publish()

    def close(self) -> RecorderCounts:
        """Write the account as a last comment and close the files; safe to call twice, never raises disk errors."""
        with self._lock:
            if self._closed:
                return self.counts
            self._closed = True
            self._flush(at_once=True)
            for part in self._parts:
                if change := part.find_change():
                    self._settle(part, change)
            for file in self._files():
                self._tally.add_unwritable(file.give_up())
            self._publish()
            if not self._csv.error:
                self._csv.put_note(f"# end: {self.counts}\n", self._clock())
                self._csv.flush(self._clock(), at_once=True)
            self._sync.close()
            self._publish()
            for file in self._files():
                file.close()
            return self.counts

    def _files(self) -> tuple[AppendFile, ...]:
        return (*self._older, self._csv, self._rejects.file)

    def _use(self, layout: Layout) -> None:
        """Write rows of this layout from now on, in a new part if the columns differ."""
        header = header_line(layout)
        if not self._header:
            self._csv.put_note(header, self._started)
        elif header != self._header:
            self._next_part(header)
        self._layout, self._header = layout, header
        self._encode, self._width = row_encoder(layout), len(layout.columns)

    def _next_part(self, header: str) -> None:
        before = self._csv
        self._part, path = free_part(self.path, self._part + 1)
        before.put_note(f"# continued in {escaped(path.name)}: the columns changed\n", self._clock())
        self._older.append(before)
        self._csv = AppendFile(path)
        self._parts.append(self._csv)
        self._csv.put_note(self._start_of_part(before, header), self._started)

    def _start_of_part(self, before: AppendFile, header: str) -> str:
        return preamble(self._source, self._wall - self._offset) + continues_line(before.path) + header

    def _leave_changed(self) -> None:
        """Go on in a new file where another program truncated, renamed, replaced or deleted one."""
        for file in (self._csv, self._rejects.file):
            change = file.find_change()
            if not change:
                continue
            try:
                path = self._replace(file)
            except OSError as error:  # the old one may still take lines, as in a folder that was renamed
                result = f", and no new file can be created ({error.strerror})"
            else:
                self._settle(file, change)
                file.close()
                result = f": the recording goes on in {path.name}"
            self._notice = f"{file.path.name} was {change} by another program{result}"

    def _replace(self, file: AppendFile) -> Path:
        """Create the file that takes the place of this one."""
        if file is not self._csv:
            return self._rejects.continue_in_new(self._wall - self._offset, self._clock())
        number, path = free_part(self.path, self._part + 1)
        self._csv = file.continued(path, self._start_of_part(file, self._header), self._clock())
        self._parts.append(self._csv)
        self._part = number
        return path

    def _settle(self, file: AppendFile, change: str) -> None:
        """Correct the counts after a change by another program."""
        removed = file.settle(change, self._header)
        if file in self._parts:  # rejected lines stay counted as rejected
            self._tally.move_removed(removed)

    def _take(self, at: float, event: LineEvent) -> None:
        host = at - self._started + self._offset
        if event.kind == "row":
            self._tally.received += 1
            if self._encode is None or any(len(row) != self._width for row in event.rows):
                why = LineIssue(event.number, f"must have {self._width} values, as the columns say", event.text)
                self._reject(host, at, event, (why,), 1)
                return
            rows = "".join(self._encode(host, row) for row in event.rows)
            self._tally.add_unwritable(not self._csv.put(rows.encode(), at, 1))
            if event.issues:  # of single cells: the row has empty cells there
                self._reject(host, at, event, event.issues, 0)
        elif event.kind == "rejected":
            self._tally.received += 1
            self._reject(host, at, event, event.issues, 1)
        else:
            self._tally.other += 1
            if event.kind != "blank":
                why = LineIssue(event.number, f"is {_WHAT.get(event.kind, event.kind)}", event.text)
                self._reject(host, at, event, (why,), 0)

    def _reject(self, host: float, at: float, event: LineEvent, issues: Sequence[LineIssue], lines: int) -> None:
        if not self._rejects.put(host, at, self._wall - self._offset, event, issues, lines):
            self._tally.add_unwritable(lines)

    def _flush(self, *, at_once: bool = False) -> None:
        now = self._clock()
        self._leave_changed()
        for file in (*self._older, self._csv):
            self._tally.written += file.flush(now, at_once=at_once)
        self._tally.rejected += self._rejects.file.flush(now, at_once=at_once)
        for file in [file for file in self._older if file.idle]:
            self._older.remove(file)
            file.close()
        self._sync.watch(self._files())
        space = self._disk_space.check(now, sum(file.size for file in self._files()))
        self.warning = "; ".join(filter(None, (self._notice, space)))
        self._publish()

    def _publish(self) -> None:
        waiting = sum(file.waiting for file in self._files())
        self.counts = replace(self._tally, received=self._tally.received - waiting, waiting=waiting)
        files = self._files()
        self.error = next(filter(None, [*(file.error for file in files), *(file.sync_error for file in files)]), "")
