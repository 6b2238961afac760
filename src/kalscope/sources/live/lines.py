"""The lines of a port that can be trusted: no first line after an opening, no boot text; new firmware is detected.

Every line that arrived is in one of three counts: accepted (it became samples), rejected (it should have), and
dropped (it had no samples, or could not be trusted).
"""

from __future__ import annotations

import math
import re
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, replace

from kalscope.sources.grammar.cells import DAMAGED, OVERFLOWS, is_comment, is_damaged
from kalscope.sources.grammar.read_options import ReadOptions
from kalscope.sources.port.reader import BytesReceived, Start
from kalscope.sources.reading.line_parser import LineParser
from kalscope.sources.reading.line_reader import LineEvent
from kalscope.sources.reading.sniffer import Layout

BOOT_SECONDS = 2.0
"""Seconds after an opening in which a board may restart: a line that is not a row is then boot text, not damage."""
_SILENCE = 0.3
"""Seconds after which the rest of a line does not come: a line is sent in one go."""
_MAX_REJECTED_RUN = 32
"""Successive rejected lines after which the board is assumed to run another program."""

_ODD = bytes(set(range(256)) - set(range(32, 127)) - set(b"\t\r\n"))
# What the ROM of an ESP chip prints before any program runs; some of it reads as name:value pairs.
_BOOT_TEXT = re.compile(r"0x[0-9A-Fa-f]{2}|^ets [A-Z][a-z]{2} |^mode:[A-Z]+, clock div:")


@dataclass
class LineCounts:
    """The line counts of a stream: received = accepted + rejected + dropped, always."""

    received: int = 0
    """Lines that arrived, torn ones included."""
    accepted: int = 0
    """Lines that became samples."""
    rejected: int = 0
    """Lines that should have become samples and did not."""
    dropped: int = 0
    """The rest: blank lines, comments, headers, text, boot text, the first line after each opening, what was torn
    when the board disconnected, and `overrun`."""
    overrun: int = 0
    """Of the dropped lines, those that came faster than they could be processed."""


class LiveLines:
    """Lines of one port, over all its openings."""

    def __init__(self, options: ReadOptions) -> None:
        self.counts = LineCounts()
        self._options = options = replace(options, missing=(*options.missing, *OVERFLOWS))
        # No board prints a decimal comma; below a remark such as "Ready", 512,300 would look like one.
        self._parser = LineParser(replace(options, decimal=options.decimal or "."))
        self._last = b""  # byte
        self._skip = self._whole = False  # the next line may be half of one; it was sent after a silence
        self._opened = -math.inf
        self._boot = False
        self._fresh = False  # no sample since the opening
        self._recent: deque[str] = deque(maxlen=_MAX_REJECTED_RUN)
        self._names = ""
        self._bytes = self._odd = 0  # since the last row, or the opening

    @property
    def layout(self) -> Layout | None:
        """How the lines are written; None while that is unknown."""
        return self._parser.layout

    @property
    def wrong_baud(self) -> bool:
        """True where many bytes came since the last row, and more than a quarter of them odd."""
        return self._bytes >= 200 and self._odd > 0.25 * self._bytes

    def opened(self, at: float, starts: Start = "inside a line", *, keeps: bool = False) -> None:
        """The port was opened at the monotonic time `at`, s; `starts` and `keeps` are those of `Opened`."""
        if starts == "where it stopped":
            return
        if keeps and not self.counts.received:
            self._parser = LineParser(self._options)  # a file may have a decimal comma
        inside = starts == "inside a line"  # the first line may be half of one, and the board have restarted
        self._skip, self._whole, self._boot = inside, False, inside
        self._fresh = True
        self._opened = at if inside else -math.inf
        self._bytes = self._odd = 0

    def interrupted(self) -> int:
        """The end of the line that was being received will not come: 1 if there is one, which is dropped."""
        torn, self._last = int(self._parser.restart()), b""
        self.counts.received += torn
        self.counts.dropped += torn
        return torn

    def overrun(self, data: bytes) -> int:
        """These bytes were left out: how many lines end in them, the one that was being received included."""
        cr = b"\r" if self._last == b"\r" else b""  # an LF after it ends no other line
        count = len(re.findall(rb"\r\n?|\n", cr + data)) - len(cr)
        self._last = data[-1:]
        self._parser.restart(self._last)
        self._skip, self._whole = self._last not in (b"\n", b"\r"), False
        self.counts.received += count
        self.counts.dropped += count
        self.counts.overrun += count
        return count

    def feed(self, received: BytesReceived) -> Iterator[LineEvent]:
        """The lines that are complete. Take them all before the next bytes."""
        parser, rows = self._parser, self.counts.accepted
        self._boot = received.end - self._opened <= BOOT_SECONDS
        if received.silence > _SILENCE:
            if not parser.is_inside_line:
                self._whole = True
            elif self._boot:
                self._skip, self._whole = True, False  # the board was reset inside this line
        parser.feed(received.data)
        self._last = received.data[-1:]
        while (line := parser.next_text()) is not None:
            torn = self._is_torn(line)
            trusted = not torn and not (self._boot and _BOOT_TEXT.search(line))
            event = parser.read(line, trusted=trusted)
            event = LineEvent(event.number, "blank", "") if torn else event  # counted, and no more
            yield self._counted(self._judged(event) if trusted else event)
        self._bytes += len(received.data)
        self._odd += len(received.data) - len(received.data.translate(None, _ODD))
        if self.counts.accepted > rows:
            self._bytes = self._odd = 0

    def _is_torn(self, line: str) -> bool:
        """Whether it is a first line: it is whole only after a silence, and never becomes a sample."""
        first, self._skip = self._skip, False
        return first and not (is_comment(line) or (self._whole and _are_names(line)))

    def _judged(self, event: LineEvent) -> LineEvent:
        """A line as it is read where it may show another program; while a board starts, damage is boot text."""
        # Where each line names its values, a row of bare numbers is text, but still shows another program.
        names = self.layout is not None and self.layout.form.kind == "table" and _are_names(event.text)
        unknown = event.kind == "text" and (self.layout is None or names or _are_numbers(event.text))
        if event.kind == "comment" and self._names_columns(event.text):
            self._names = event.text.lstrip("#").strip()
        if unknown or event.kind in {"row", "rejected"}:
            event = self._after_program_change(event) or event
        is_boot_text = event.kind == "rejected" and self._boot
        return LineEvent(event.number, "text", event.text) if is_boot_text else event

    def _counted(self, event: LineEvent) -> LineEvent:
        counts = self.counts
        counts.received += 1
        if event.kind == "row":
            counts.accepted += 1
            self._fresh = False
        elif event.kind == "rejected":
            counts.rejected += 1
        else:
            counts.dropped += 1
        return event

    def _after_program_change(self, event: LineEvent) -> LineEvent | None:
        """The line as read after a program change, if a header, or many lines that do not fit, show one.

        Names above lines that fit the old ones as well count only after an opening, or where there are none yet:
        `ERR,OK` is not a header. Where each line names its values, no line above them is one: `a94*2B`.
        """
        text, names, fits = self._parser.line, self._names, event.kind == "row" and not event.issues
        text = DAMAGED if is_damaged(text) else text
        if not fits and _are_names(text):
            self._names = text
            return LineEvent(event.number, "text", event.text)  # and not a row of missing samples
        self._names = ""
        channels = self.layout.channels if self.layout else ()
        has_numbers = fits or any(math.isfinite(row[i]) for row in event.rows for i in channels)
        if has_numbers and not (names and self._may_be_renamed):
            self._recent.clear()
            return None
        self._recent.append(text)
        full = len(self._recent) == _MAX_REJECTED_RUN
        if not (names or full):
            return None
        head = [names, text] if names else list(self._recent)
        self._recent.clear()
        return self._parser.adopt_layout(head, named=fits)

    def _names_columns(self, comment: str) -> bool:
        """Whether a comment names each column of a table without names, as a sketch that restarts writes it."""
        names, width = comment.lstrip("#").strip(), len(self.layout.columns) if self.layout else 0
        fits = len(re.split(r"[,;\t]", names)) == width and "=" not in names
        return fits and self._may_be_renamed and _are_names(names)

    @property
    def _may_be_renamed(self) -> bool:
        """Whether names above lines of the same layout can be a header: of a table, unnamed or just opened."""
        layout = self.layout
        just_opened = self._boot or self._fresh
        return layout is not None and layout.form.kind == "table" and (just_opened or not layout.header_rows)


def _are_numbers(text: str) -> bool:
    """True for a line of nothing but the characters of numbers."""
    return any(c.isdigit() for c in text) and not text.strip("0123456789+-.eE,;|[]() \t")


def _are_names(text: str) -> bool:
    """True for a line of distinct names, of which none is a number."""
    cells = [cell for cell in re.split(r"[,;|\s]+", text.strip()) if cell]
    named = all(re.match(r"[A-Za-z_µ(\[\"]", cell) and ":" not in cell for cell in cells)
    return bool(cells) and named and text.isprintable() and len(set(cells)) == len(cells)
