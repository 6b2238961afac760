"""From a stream of bytes to the lines of a log: for live ports, stdin and records."""

from __future__ import annotations

import math
import re
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import replace

from kalscope.recording import MAX_ISSUE_LENGTH
from kalscope.sources.grammar.cells import DAMAGED, is_blank, is_comment, is_damaged
from kalscope.sources.grammar.line_format import LineFormat, Teleplot, split_teleplot, without_escapes
from kalscope.sources.grammar.read_options import DEFAULTS, ReadOptions
from kalscope.sources.reading.columns import Column
from kalscope.sources.reading.line_reader import TAIL_LINES, Kind, LineEvent, LineReader, rejected
from kalscope.sources.reading.sniffer import MAX_STREAM_COLUMNS, Layout, sniff

# New variables of Teleplot: one more column each, after the others.


_MAX_NAMES = 1024
"""Names that were seen once and are remembered; damage on the wire makes a new one of each line."""


class TeleplotVariables:
    """Which new names of one stream are accepted."""

    def __init__(self) -> None:
        self._seen_once = set[str]()

    def layout_with(self, line: str, layout: Layout | None, *, settled: bool) -> Layout | None:
        """The layout with the new variable of a line; None for a line without one.

        Args:
            line: The line.
            layout: As it is known.
            settled: Whether the head of the stream is over: a name then counts from its second line on, because one
                that came once may be damage.
        """
        plot = split_teleplot(line) if line.lstrip().startswith(">") else None
        grown = None if plot is None else with_variable(layout, plot)
        if plot is None or grown is None or not settled or plot.only_names or plot.name in self._seen_once:
            return grown
        if len(self._seen_once) >= _MAX_NAMES:
            self._seen_once.clear()
        self._seen_once.add(plot.name)
        return None


def with_variable(layout: Layout | None, plot: Teleplot) -> Layout | None:
    """The layout with a column for the variable of a line.

    Args:
        layout: As it is known; None before any line, when `>name:` alone is enough.
        plot: The line.

    Returns:
        None where no column is to be added: the lines are not of Teleplot, the variable has one, the line has no
        valid name, or there are MAX_STREAM_COLUMNS already.
    """
    if not plot.name or not plot.name.isprintable():
        return None
    column = Column(plot.name, plot.unit)
    if layout is None:
        form = LineFormat("teleplot", labels=(plot.name,))
        notes = ("each line is one variable of Teleplot",)
        return Layout(form, (column,), None, 1, frozenset(), (), notes) if plot.only_names else None
    form = layout.form
    if form.kind != "teleplot" or plot.name in form.labels or len(layout.columns) >= MAX_STREAM_COLUMNS:
        return None
    return replace(layout, form=replace(form, labels=(*form.labels, plot.name)), columns=(*layout.columns, column))


# From a stream of bytes to the lines of a log: for live ports, stdin and replays.
#
#     parser = LineParser()
#     parser.feed(port.read())
#     while (event := parser.next_line()) is not None:
#         ...
#
# The layout is detected as for a file: at the first line with data, and again while the head of the stream shows
# lines that do not fit. From then on each line is read by the `LineReader` of the file reader, so the same line
# means the same everywhere. Only labels that come in turn on several lines differ: a file gathers them into one
# row, while a stream makes a row of each line at once, because the next one may take long.


MAX_LINE_BYTES = 65_536
"""Bytes of one line, ten times the widest table; a longer one is not a line of numbers and is dropped."""

HEAD_BYTES = 65_536
"""Bytes of the stream that may still change the layout, as many as are sniffed of a file."""

_MIN_DISTINCT_ROWS, _MIN_ROWS = 3, 8
"""How many lines with words beside numbers are enough to take them for rows: different ones, or in all."""

_SHORT_HEAD = 64
"""A head without data is sniffed at every line up to this length, then whenever it has grown by a quarter."""

_NEWLINE = re.compile(rb"[\r\n]")


class LineParser:
    r"""Turns a stream of bytes into `LineEvent`s. Holds one line and the head of the stream, no more.

    Lines end with \n, \r\n or \r. They are UTF-8, or where they are not, Latin-1.
    """

    def __init__(
        self, options: ReadOptions = DEFAULTS, *, layout: Layout | None = None, skip_first: bool = False
    ) -> None:
        """Begin a stream.

        Args:
            options: What is decided already; everything else is detected.
            layout: How the lines are written, where that is known; it then never changes.
            skip_first: Drop the first line: a port that was just opened may begin inside it.
        """
        self._options = options
        self._reader = LineReader(layout, options) if layout is not None else None
        self._settled = layout is not None
        self._skip_first = skip_first
        self._buffer = bytearray()
        self._searched = 0  # bytes of the buffer known to hold no newline
        self._after_cr = False
        self._overlong = False
        self._head: list[str] = []
        self._head_bytes = 0
        self._misfits = 0
        self._next_look = 0
        self._before: deque[str] = deque(maxlen=TAIL_LINES)
        self._variables = TeleplotVariables()
        self._number = 0
        self.line = ""
        """The last line of `next_line`, whole; "" where it was too long."""

    @property
    def layout(self) -> Layout | None:
        """How the lines are written, as far as is known; None before the first line with data.

        The rows of an event are of the layout at that moment: it is another object after an event that
        changed it, because new labels bring new columns.
        """
        return None if self._reader is None else self._reader.layout

    @property
    def buffered(self) -> int:
        """Bytes that wait for the end of their line or for `next_line`."""
        return len(self._buffer)

    def feed(self, data: bytes) -> None:
        """Add bytes from the stream, any number, cut anywhere."""
        self._buffer += data

    def restart(self) -> bool:
        """The stream was interrupted and starts again; the layout stays known.

        Returns:
            True where the beginning of a line was discarded.
        """
        torn = bool(self._buffer) and not (self._after_cr and bytes(self._buffer) == b"\n")
        self._buffer, self._searched = bytearray(), 0
        self._after_cr = self._overlong = False
        return torn

    def adopt_layout(self, head: Sequence[str], *, named: bool = False) -> LineEvent | None:
        """Adopt the layout of these lines, the last of which is the last line of `next_line`.

        Args:
            head: The lines.
            named: Adopt only a layout with a header, so that known names are not replaced by none.

        Returns:
            That line, read again; None, and nothing changes, if they show no other layout, or one in which it is
            not a row.
        """
        if not self._has_chosen_rows(head):
            return None
        layout, known = self._sniffed(head), self.layout
        if layout is None or (known and (layout.form, layout.columns) == (known.form, known.columns)):
            return None
        if named and not layout.header_rows:
            return None
        reader = LineReader(layout, self._options)
        event = reader.read(self._number, head[-1])
        if event.kind != "row" or not self._is_surely_data(head, layout):
            return None
        self._reader, self._settled, self._misfits = reader, False, 0
        self._head, self._head_bytes = list(head), sum(len(line) + 1 for line in head)
        return event

    def next_line(self) -> LineEvent | None:
        """The next line that is complete; None where more bytes are needed."""
        while (line := self._maybe_extract_line()) is not None:
            if self._skip_first:
                self._skip_first = False
                continue
            self._number += 1
            return self._read(line)
        return None

    def close(self) -> LineEvent | None:
        """The stream has ended: the last line, where it lacks its newline; torn unless it proves whole."""
        if self._overlong:
            self._buffer, self._overlong = bytearray(), False
            return self._overlong_event()
        if not self._buffer or self._skip_first:
            return None
        line, self._buffer = _decoded(self._buffer), bytearray()
        self._number += 1
        if self._reader is None:
            return rejected(self._number, line, "must end with a newline (torn: the stream ends inside this line)")
        return self._reader.read_last(self._number, line, list(self._before))

    def __iter__(self) -> Iterator[LineEvent]:
        """All lines that are complete."""
        while (event := self.next_line()) is not None:
            yield event

    def _maybe_extract_line(self) -> str | None:
        buffer = self._buffer
        if self._after_cr and buffer:
            # \r ended the last line at once, without waiting to see whether \n follows.
            if buffer.startswith(b"\n"):
                del buffer[:1]
            self._after_cr = False
        match = _NEWLINE.search(buffer, self._searched)
        if match is None:
            self._searched = len(buffer)
            if len(buffer) > MAX_LINE_BYTES:
                self._overlong = True
                del buffer[MAX_ISSUE_LENGTH:]
                self._searched = len(buffer)
            return None
        line, self._after_cr, self._searched = bytes(buffer[: match.start()]), match[0] == b"\r", 0
        del buffer[: match.end()]
        return _decoded(line)

    def _overlong_event(self) -> LineEvent:
        self._number += 1
        return rejected(self._number, "", f"must be at most {MAX_LINE_BYTES} bytes long")

    def _read(self, line: str) -> LineEvent:
        if self._overlong or len(line) > MAX_LINE_BYTES:
            self._overlong, self.line = False, ""
            return rejected(self._number, line, f"must be at most {MAX_LINE_BYTES} bytes long")
        if self._number == 1:
            line = line.removeprefix("\ufeff")
        self.line = line
        self._before.append(line)
        if grown := self._variables.layout_with(line, self.layout, settled=self._settled):
            self._reader = LineReader(grown, self._options)
        event = self._reader.read(self._number, line) if self._reader else None
        if self._settled:
            return event or _without_layout(self._number, line)
        damaged = is_damaged(line)  # then it can be neither a row nor names
        self._head.append(DAMAGED if damaged else line)
        self._head_bytes += len(line) + 1
        if not damaged and (event is None or event.kind in ("rejected", "text") or event.issues):
            event = self._look_again(line, event)
        if self._head_bytes >= HEAD_BYTES:
            # As long as nothing was data, the head is still to come.
            self._settled, self._head, self._head_bytes = self._reader is not None, [], 0
            self._next_look = 0
        return event or _without_layout(self._number, line)

    def prime(self, lines: Sequence[str]) -> None:
        """Take the variables of lines of Teleplot that are still to come: one layout for all, if none is known."""
        layout = self._sniffed(lines) if self._reader is None and lines else None
        if layout is not None and layout.form.kind == "teleplot":
            self._reader = LineReader(layout, self._options)

    def _look_again(self, line: str, event: LineEvent | None) -> LineEvent:
        """Sniff the head again if that is due, for data, new labels or a new header."""
        self._misfits += 1
        if self._is_look_due(line):
            layout = self._sniffed(self._head)
            known = None if self._reader is None else self._reader.layout
            if layout and known is None and not self._is_surely_data(self._head, layout):
                layout = None
            if layout and (known is None or (layout.form, layout.columns) != (known.form, known.columns)):
                self._reader = LineReader(layout, self._options)
                event = self._reader.read(self._number, line)
        return event or _without_layout(self._number, line)

    def _sniffed(self, head: Sequence[str]) -> Layout | None:
        """The layout of these lines; None where they show none, or one that is too wide."""
        layout = sniff(head, self._options)
        return None if layout is None or len(layout.columns) > MAX_STREAM_COLUMNS else layout

    def _is_look_due(self, line: str) -> bool:
        """Whether to sniff the head again at a line that does not fit; the total cost stays linear in the head.

        With a known layout that is at the 1st, 2nd, 4th, 8th, … such line.
        """
        if not self._has_chosen_rows(self._head) or not any(c.isdigit() for c in line):
            return False
        if self._reader is not None:
            return self._misfits & (self._misfits - 1) == 0
        if len(self._head) < self._next_look:
            return False
        self._next_look = 0 if len(self._head) < _SHORT_HEAD else len(self._head) * 5 // 4
        return True

    def _has_chosen_rows(self, head: Sequence[str]) -> bool:
        """Whether lines reach below the rows that the user chose as names and units; a shorter head is refused."""
        last = max(self._options.header_row or 0, self._options.unit_row or 0)
        return last == 0 or len(head) > last

    def _is_surely_data(self, head: Sequence[str], layout: Layout) -> bool:
        """Whether lines that look like rows are rows: `sine 1,sine 2` is a header, and only looks like one.

        A row of words beside numbers is believed once there are others like it.
        """
        form = layout.form
        if form.kind != "table" or not any(column.role == "text" for column in layout.columns):
            return True
        reader = LineReader(layout, self._options)
        rows = [text for text in head if reader.read(0, text).kind == "row"]
        return len(set(rows)) >= _MIN_DISTINCT_ROWS or len(rows) >= _MIN_ROWS


def comma_line(parser: LineParser, line: bytes) -> str:
    """One line as numbers with commas between them, in the order of the channels.

    A line that is already written so, or holds no data, is returned unchanged: the filter reports what is wrong.
    """
    parser.feed(line if line.endswith(b"\n") else line + b"\n")
    events, layout = list(parser), parser.layout
    if len(events) != 1 or events[0].kind != "row" or layout is None:
        return _decoded(line)
    form = layout.form
    if form.kind == "table" and (form.delimiter, form.stamped, form.checksum) == (",", False, False):
        return _decoded(line)
    return ",".join("" if math.isnan(x := events[0].rows[-1][i]) else repr(x) for i in layout.channels)


def _decoded(line: bytes | bytearray) -> str:
    try:
        return without_escapes(line.decode("utf-8"))
    except UnicodeDecodeError:
        return without_escapes(line.decode("latin-1"))


def _without_layout(number: int, line: str) -> LineEvent:
    """A line before any data: boot text, or a failed attempt at a number (`12abc`, `0x1F`, `Infinity`)."""
    kind: Kind = "text"
    if is_blank(line):
        kind = "blank"
    elif is_comment(line):
        kind = "comment"
    elif re.match(r"\s*[-+]?(?:[0-9]|\.[0-9]|inf)", line, re.IGNORECASE):
        return rejected(number, line, "must be numbers, or name:value pairs")
    return LineEvent(number, kind, line[:MAX_ISSUE_LENGTH])
