"""From a stream of bytes to the lines of a log: for live ports, stdin and records."""

from __future__ import annotations

import math
import re
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import replace

from kalscope.recording import MAX_ISSUE_LENGTH
from kalscope.sources.grammar.cells import DAMAGED, is_blank, is_comment, is_damaged, is_number
from kalscope.sources.grammar.line_format import LineFormat, split_teleplot, without_escapes
from kalscope.sources.grammar.read_options import DEFAULTS, ReadOptions
from kalscope.sources.reading.columns import Column
from kalscope.sources.reading.line_reader import Kind, LineEvent, LineReader, rejected
from kalscope.sources.reading.sniffer import MAX_STREAM_COLUMNS, Layout, sniff

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

_TELEPLOT = Layout(LineFormat("teleplot"), (), None, 1, frozenset(), (), ("each line is one variable of Teleplot",))
_NEWLINE = re.compile(rb"[\r\n]")


class LineParser:
    r"""Turns a stream of bytes into `LineEvent`s. Holds one line and the head of the stream, no more.

    Lines end with \n, \r\n or \r. They are UTF-8, or where they are not, Latin-1.
    """

    def __init__(self, options: ReadOptions = DEFAULTS) -> None:
        """Begin a stream; `options` are what is decided already."""
        self._options = options
        self._reader: LineReader | None = None
        self._settled = False
        self._buffer = bytearray()
        self._searched = 0  # bytes of the buffer known to hold no newline
        self._after_cr = self._overlong = False
        self._head: list[str] = []
        self._head_bytes = 0
        self._misfits = self._next_look = 0
        self._seen_once: deque[str] = deque(maxlen=1024)  # names of Teleplot: damage makes a new one of each line
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

    def feed(self, data: bytes) -> None:
        """Add bytes from the stream, any number, cut anywhere."""
        self._buffer += data

    @property
    def is_inside_line(self) -> bool:
        """Whether the beginning of a line waits for its end."""
        return bool(self._buffer) and not (self._after_cr and bytes(self._buffer) == b"\n")

    def restart(self, last: bytes = b"") -> bool:
        """The stream was interrupted and starts again; the layout stays known.

        Args:
            last: The last byte that was left out: a line that ended with it may have ended with CR and LF.

        Returns:
            True where the beginning of a line was discarded.
        """
        torn = self.is_inside_line
        self._buffer, self._searched = bytearray(), 0
        self._after_cr, self._overlong = last == b"\r", False
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
        layout = self._other_layout(head)
        if layout is None or (named and not layout.header_rows):
            return None
        reader = LineReader(layout, self._options)
        event = reader.read(self._number, head[-1])
        if event.kind != "row":
            return None
        self._reader, self._settled, self._misfits, self._next_look = reader, False, 0, 0
        self._head, self._head_bytes = list(head), sum(len(line) + 1 for line in head)
        return event

    def next_line(self) -> LineEvent | None:
        """The next line that is complete; None where more bytes are needed."""
        line = self.next_text()
        return None if line is None else self.read(line)

    def __iter__(self) -> Iterator[LineEvent]:
        """All lines that are complete."""
        return iter(self.next_line, None)

    def next_text(self) -> str | None:
        """The text of the next line that is complete, for `read`; None where more bytes are needed."""
        buffer = self._buffer
        if self._after_cr and buffer:
            # \r ended the last line at once, without waiting to see whether \n follows.
            del buffer[: buffer.startswith(b"\n")]
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

    def read(self, line: str, *, trusted: bool = True) -> LineEvent:
        """Read a line from `next_text`; one that is not trusted is text, whatever it holds."""
        self._number += 1
        if not trusted:
            self._overlong = False
            return LineEvent(self._number, "text", line[:MAX_ISSUE_LENGTH])
        if self._overlong or len(line) > MAX_LINE_BYTES:
            self._overlong, self.line = False, ""
            return rejected(self._number, line, f"must be at most {MAX_LINE_BYTES} bytes long")
        self.line = line = line.removeprefix("\ufeff") if self._number == 1 else line
        if line.lstrip().startswith(">"):
            self._add_variable(line)
        event = self._reader.read(self._number, line) if self._reader else None
        if not self._settled:
            damaged = is_damaged(line)  # then it can be neither a row nor names
            self._head.append(DAMAGED if damaged else line)
            self._head_bytes += len(line) + 1
            fits = event is not None and event.kind not in ("rejected", "text") and not event.issues
            if not (damaged or fits) and self._is_look_due(line) and (layout := self._other_layout(self._head)):
                self._reader = LineReader(layout, self._options)
                event = self._reader.read(self._number, line)
            if self._head_bytes >= 65_536:  # as many as are sniffed of a file
                # As long as nothing was data, the head is still to come.
                self._settled, self._head, self._head_bytes = self._reader is not None, [], 0
                self._misfits = self._next_look = 0
        return event or _without_layout(self._number, line)

    def _add_variable(self, line: str) -> None:
        """Add a column for the new variable of a line of Teleplot, after the others.

        The first line brings those of all lines that wait. Once the head of the stream is over, a name counts from
        its second line on: the first may be damage.
        """
        plot, layout = split_teleplot(line), self.layout
        if not (plot and plot.samples and plot.name and plot.name.isprintable()):
            return
        if layout is None and plot.only_names:  # `>name:` is enough
            layout = _TELEPLOT
        elif layout is None and any(is_number(value) for _, value in plot.samples):
            layout = self._other_layout([line, *_decoded(self._buffer).splitlines()])
            if layout is not None and layout.form.kind == "teleplot":
                self._reader = LineReader(layout, self._options)
        if layout is None or layout.form.kind != "teleplot" or plot.name in layout.form.labels:
            return
        if len(layout.columns) >= MAX_STREAM_COLUMNS:
            return
        if self._settled and not plot.only_names and plot.name not in self._seen_once:
            self._seen_once.append(plot.name)
            return
        form = replace(layout.form, labels=(*layout.form.labels, plot.name))
        columns = (*layout.columns, Column(plot.name, plot.unit))
        self._reader = LineReader(replace(layout, form=form, columns=columns), self._options)

    def _other_layout(self, head: Sequence[str]) -> Layout | None:
        """The layout of these lines where they surely show one, and another than is known.

        The rows that the user chose as names and units must be above the last line. `sine 1,sine 2` is a header,
        and only looks like a row: rows of words beside numbers are believed once there are others like them.
        """
        if len(head) <= max(self._options.header_row or 0, self._options.unit_row or 0):
            return None
        layout, known = sniff(head, self._options), self.layout
        if layout is None or len(layout.columns) > MAX_STREAM_COLUMNS:
            return None
        if known and (layout.form, layout.columns) == (known.form, known.columns):
            return None
        has_words = layout.form.kind == "table" and any(column.role == "text" for column in layout.columns)
        mark = layout.form.decimal if known and layout.form.decimal != known.form.decimal else ""
        if has_words or mark:  # 2,3 alone is damage rather than the first decimal comma
            reader = LineReader(layout, self._options)
            rows = [text for text in head if mark in text and reader.read(0, text).kind == "row"]
            if len(set(rows)) < 3 and len(rows) < 8:
                return None
        return layout

    def _is_look_due(self, line: str) -> bool:
        """Whether to sniff the head again at a line that does not fit; the total cost stays linear in the head.

        That of a known layout is sniffed whenever the lines that do not fit have doubled, one without data at every
        line up to 64, then whenever it has grown by about a quarter.
        """
        self._misfits = n = self._misfits + 1
        if n < self._next_look or not any(map(str.isdigit, line)):
            return False
        self._next_look = 2 * n if self._reader else n + 1 + max(0, n - 64) // 4
        return True


def comma_line(parser: LineParser, line: bytes) -> str:
    """One line as numbers with commas between them, in the order of the channels.

    A line that is already written so, or cannot be read, is returned unchanged: the filter reports what is wrong.
    """
    parser.feed(line if line.endswith(b"\n") else line + b"\n")
    events, layout = list(parser), parser.layout
    form = LineFormat() if layout is None else replace(layout.form, decimal=".")
    fits = [event.kind for event in events] == ["row"] and not events[0].issues
    if layout is None or form == LineFormat() or not fits:
        return _decoded(line)
    return ",".join("" if math.isnan(x := events[0].rows[-1][i]) else repr(x) for i in layout.channels)


def _decoded(line: bytes | bytearray) -> str:
    try:
        return without_escapes(line.decode("utf-8"))
    except UnicodeDecodeError:
        return without_escapes(line.decode("latin-1"))


def _without_layout(number: int, line: str) -> LineEvent:
    """A line before any data: boot text, or a failed attempt at a number (`12abc`, `0x1F`, `Infinity`)."""
    kind: Kind = "blank" if is_blank(line) else "comment" if is_comment(line) else "text"
    if kind == "text" and re.match(r"\s*[-+]?(?:[0-9]|\.[0-9]|inf)", line, re.IGNORECASE):
        return rejected(number, line, "must be numbers, or name:value pairs")
    return LineEvent(number, kind, line[:MAX_ISSUE_LENGTH])
