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
from kalscope.sources.reading.line_parser import MAX_LINE_BYTES, LineParser
from kalscope.sources.reading.line_reader import LineEvent
from kalscope.sources.reading.sniffer import Layout

BOOT_SECONDS = 2.0
"""Seconds after an opening in which a board may restart: a line that is not a row is then boot text, not damage."""
_SILENCE = 0.3
"""Seconds without a byte after which a new line begins: a line is sent in one go."""
_MAX_REJECTED_RUN = 32
"""Successive rejected lines after which the board is assumed to run another program."""
_UNKNOWN_RUN = 8
"""Lines of unknown layout that are sniffed together."""
MAX_UNKNOWN_LINES = 32
"""Most lines between two such attempts, and so the most that a board may send after noise before it is read: the
first attempts follow each run, and each that finds nothing doubles the lines until the next."""
_WINDOW = 2.0
_ODD_SHARE = 0.25
_MIN_BYTES_JUDGED = 16
_MAX_KEPT_BYTES = 200

_LINE_END = re.compile(rb"\r\n|\n|\r(?=[^\n])")
_ODD = bytes(set(range(256)) - set(range(32, 127)) - set(b"\t\r\n"))
_NUMBER_MARKS = "0123456789+-.eE,;|[]() \t"
_CELL_END = re.compile(r"[,;|\s]+")
# What the ROM of an ESP chip prints before any program runs; some of it reads as name:value pairs.
_BOOT_TEXT = re.compile(rb"0x[0-9A-Fa-f]{2}|^ets [A-Z][a-z]{2} |^mode:[A-Z]+, clock div:")


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
        self.wrong_baud = False
        """True if the last 2 s brought no row and more than a quarter of odd bytes."""
        self.unreported_drops = 0
        """Lines that were dropped without an event; the caller resets it to 0 after reading it."""
        self._options = options = replace(options, missing=(*options.missing, *OVERFLOWS))
        # No board prints a decimal comma; below a remark such as "Ready", 512,300 would look like one.
        self._parser = LineParser(replace(options, decimal=options.decimal or "."))
        self._may_prime = False  # the next bytes are the first of whole lines
        self._raw = True  # bytes go to the parser as they arrive
        self._held = bytearray()  # otherwise: the line being received
        self._skip = self._whole = False
        self._opened = 0.0
        self._boot = False
        self._fresh = False  # no sample since the opening
        self._recent: deque[str] = deque(maxlen=_MAX_REJECTED_RUN)
        self._void = 0  # consecutive rows without a number
        self._names = ""
        self._patience = _UNKNOWN_RUN
        self._window = (0.0, 0, 0)

    @property
    def layout(self) -> Layout | None:
        """How the lines are written; None while that is unknown."""
        return self._parser.layout

    def opened(self, at: float, starts: Start = "inside a line", *, keeps: bool = False) -> None:
        """The port was opened at the monotonic time `at`, s; `starts` and `keeps` are those of `Opened`."""
        if keeps and not self.counts.received:
            self._parser = LineParser(self._options)  # a file may have a decimal comma
        inside = starts == "inside a line"  # the first line may be half of one, and the board have restarted
        self._raw, self._skip, self._whole, self._boot = not inside, inside, False, inside
        self._may_prime = starts == "at a line"
        self._held.clear()
        self._opened, self._fresh = at if inside else -math.inf, starts != "where it stopped"
        self._window, self.wrong_baud = (at, 0, 0), False
        self._patience = _UNKNOWN_RUN

    def disconnected(self) -> None:
        """The port was lost, and the rest of its last line with it."""
        if self._parser.restart() or self._held:
            self._drop()
        self._held.clear()

    def overrun(self, count: int) -> None:
        """So many lines were left out, including the one being received; the next bytes begin a line."""
        self._parser.restart()
        self._held.clear()
        self._skip = self._whole = False
        self.counts.received += count
        self.counts.dropped += count
        self.counts.overrun += count
        self.unreported_drops += count

    def feed(self, received: BytesReceived) -> Iterator[LineEvent]:
        """The lines that are complete. Take them all before the next bytes."""
        self._boot = received.end - self._opened <= BOOT_SECONDS
        if self._may_prime and received.data.startswith(b">"):  # all variables of Teleplot at once
            self._parser.prime(received.data.decode("utf-8", "replace").splitlines())
        self._may_prime = False
        if not self._raw and received.silence > _SILENCE:
            if not self._held:
                self._whole = True
            elif self._boot:
                self._skip, self._whole = True, False  # the board was reset inside this line
        self._parser.feed(received.data if self._raw else self._trusted(received.data))
        rows = self.counts.accepted
        while (event := self._parser.next_line()) is not None:
            event = self._judged(event)
            if event is not None:
                yield event
        self._check_for_noise(received, self.counts.accepted - rows)

    def _trusted(self, data: bytes) -> bytes:
        """Soon after an opening: the lines without the first one and without boot text."""
        held, kept, at = self._held, bytearray(), 0
        start = max(len(held) - 1, 0)
        held += data
        while (match := _LINE_END.search(held, max(at, start))) is not None:
            line = bytes(held[at : match.start()])
            if self._trust(line):
                kept += line + b"\n"
            else:
                self._drop()
            self._skip, self._whole, at = False, False, match.end()
        del held[:at]
        if len(held) > MAX_LINE_BYTES:
            self._skip, self._whole = True, False
            del held[_MAX_KEPT_BYTES:-1]
        if not (self._boot or self._skip):
            self._raw = True
            kept += held
            held.clear()
        return bytes(kept)

    def _trust(self, line: bytes) -> bool:
        """Whether a line is used; the first one is whole only after a silence, and never becomes a sample."""
        if self._skip:
            text = line.decode("latin-1")
            return is_comment(text) or (self._whole and _are_names(text))
        return not _BOOT_TEXT.search(line)

    def _judged(self, event: LineEvent) -> LineEvent | None:
        """Count a line; None if it needs no event."""
        # Where each line names its values, a row of bare numbers is text, but still shows another program.
        unknown = event.kind == "text" and (self.layout is None or _are_numbers(event.text))
        if event.kind == "comment" and self._names_columns(event.text):
            self._names = event.text.lstrip("#").strip()
        if unknown or event.kind in {"row", "rejected"}:
            event = self._after_program_change(event) or event
            if event.kind == "rejected" and self._boot:
                self._drop()
                return None
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
        if is_damaged(text):
            self._names, self._void = "", 0
            self._recent.append(DAMAGED)
            return None
        if not fits and _are_names(text):
            self._names = text
            return LineEvent(event.number, "text", event.text)  # and not a row of missing samples
        self._names = ""
        self._void = self._void + 1 if self._is_void(event) else 0
        if fits and not (names and self._may_be_renamed):
            self._recent.clear()
            return None
        self._recent.append(text)
        patience = _MAX_REJECTED_RUN if self.layout else self._patience
        full = len(self._recent) >= patience and (event.kind != "row" or self._void >= patience)
        if not (names or full):
            return None
        head = [names, text] if names else list(self._recent)
        if full and self.layout is None:
            head, self._patience = head[-_UNKNOWN_RUN:], min(2 * patience, MAX_UNKNOWN_LINES)
        self._recent.clear()
        self._void = 0
        return self._parser.adopt_layout(head, named=fits)

    def _names_columns(self, comment: str) -> bool:
        """Whether a comment names each column of a table without names, as a sketch that restarts writes it."""
        layout, names = self.layout, comment.lstrip("#").strip()
        return (
            layout is not None
            and self._may_be_renamed
            and "=" not in names
            and _are_names(names)
            and len(re.split(r"[,;\t]", names)) == len(layout.columns)
        )

    def _is_void(self, event: LineEvent) -> bool:
        """Whether a line has the width of a row and no number, as `a:1,b:2` in a table of two columns."""
        layout = self.layout
        if event.kind != "row" or not event.issues or layout is None:
            return False
        return all(math.isnan(row[i]) for row in event.rows for i in layout.channels)

    @property
    def _may_be_renamed(self) -> bool:
        """Whether names above lines of the same layout can be a header: of a table, unnamed or just opened."""
        layout = self.layout
        just_opened = self._boot or self._fresh
        return layout is not None and layout.form.kind == "table" and (just_opened or not layout.header_rows)

    def _drop(self) -> None:
        self.counts.received += 1
        self.counts.dropped += 1
        self.unreported_drops += 1

    def _check_for_noise(self, received: BytesReceived, rows: int) -> None:
        begin, size, odd = self._window
        if rows:
            self._window, self.wrong_baud = (received.end, 0, 0), False
            return
        size += len(received.data)
        odd += len(received.data) - len(received.data.translate(None, _ODD))
        self._window = (begin, size, odd)
        if received.end - begin >= _WINDOW and size >= _MIN_BYTES_JUDGED:
            self.wrong_baud = odd > _ODD_SHARE * size
            self._window = (received.end, 0, 0)


def _are_numbers(text: str) -> bool:
    """True for a line of nothing but the characters of numbers."""
    return any(c.isdigit() for c in text) and not text.strip(_NUMBER_MARKS)


def _are_names(text: str) -> bool:
    """True for a line of distinct names, of which none is a number."""
    cells = [cell for cell in _CELL_END.split(text.strip()) if cell]
    named = all(re.match(r"[A-Za-z_µ(\[\"]", cell) and ":" not in cell for cell in cells)
    return bool(cells) and named and text.isprintable() and len(set(cells)) == len(cells)
