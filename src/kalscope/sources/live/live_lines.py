"""The bytes of a port as lines that can be trusted: the first one after each opening, boot text, other firmware.

Every line that came is in one of three counts: accepted (it became samples), rejected (it should have), and
dropped (it had no samples to give, or could not be trusted).
"""

from __future__ import annotations

import re
from collections import deque
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from kalscope.sources.lines.cells import is_comment
from kalscope.sources.lines.line_parser import LONGEST_LINE, LineParser
from kalscope.sources.lines.line_reader import LineEvent

if TYPE_CHECKING:
    from collections.abc import Iterator

    from kalscope.sources.lines.read_options import ReadOptions
    from kalscope.sources.lines.sniffer import Layout
    from kalscope.sources.port.events import Came

BOOT_SECONDS = 2.0
"""Time after an opening in which a board may start anew: what is no row then is boot text, not damage."""
_SILENCE = 0.3
"""Seconds without a byte after which a line begins anew: a line is sent in one go."""
_PATIENCE = 32
"""Rejected lines in a row after which the board is thought to run another program."""
_PATIENCE_AT_FIRST = 8
"""Lines after which those that nothing is known of are looked at again."""
_WINDOW = 2.0
_ODD_SHARE = 0.25
_FEW_BYTES = 16
_LONGEST_KEPT = 200

_LINE_END = re.compile(rb"\r\n|\n|\r(?=[^\n])")
_ODD = bytes(set(range(256)) - set(range(32, 127)) - set(b"\t\r\n"))
_CELL_END = re.compile(r"[,;|\s]+")
# What the ROM of an ESP chip says before any program runs; some of it reads as name:value pairs.
_BOOT_TEXT = re.compile(rb"0x[0-9A-Fa-f]{2}|^ets [A-Z][a-z]{2} |^mode:[A-Z]+, clock div:")


@dataclass
class Counts:
    """The account of a stream: received = accepted + rejected + dropped, always."""

    received: int = 0
    """Lines that came, torn ones included."""
    accepted: int = 0
    """Lines that became samples."""
    rejected: int = 0
    """Lines that should have become samples and did not."""
    dropped: int = 0
    """The rest: blank lines, comments, headers, text, boot text, the first line after each opening, and what was
    torn when the board went."""


class LiveLines:
    """Lines of one port, over all its openings."""

    def __init__(self, options: ReadOptions) -> None:
        self.counts = Counts()
        self.wrong_baud = False
        """True where the last 2 s brought no row and more than a quarter of odd bytes."""
        self.untold = 0
        """Lines that were dropped without an event; whoever reads it sets it back to 0."""
        # No board prints a decimal comma; below a remark such as "Ready", 512,300 would look like one.
        self._parser = LineParser(replace(options, decimal=options.decimal or "."))
        self._raw = True  # bytes go to the parser as they come
        self._held = bytearray()  # otherwise: the line that is coming
        self._skip = self._whole = False
        self._opened = self._last = 0.0
        self._boot = False
        self._recent: deque[str] = deque(maxlen=_PATIENCE)
        self._names = ""
        self._window = (0.0, 0, 0)

    @property
    def layout(self) -> Layout | None:
        """How the lines are written; None as long as that is unknown."""
        return self._parser.layout

    def opened(self, at: float) -> None:
        """The port was opened: what comes next may begin inside a line."""
        self._raw, self._skip, self._whole, self._boot = False, True, False, True
        self._held.clear()
        self._opened = self._last = at
        self._window, self.wrong_baud = (at, 0, 0), False

    def lost(self) -> None:
        """The port is gone, and the rest of its last line with it."""
        if self._parser.restart() or self._held:
            self._drop()
        self._held.clear()

    def feed(self, came: Came) -> Iterator[LineEvent]:
        """The lines that are complete. Take them all before the next bytes."""
        self._boot = came.end - self._opened <= BOOT_SECONDS
        silent = came.end - self._last > _SILENCE
        self._last = came.end
        if not self._raw and silent:
            if not self._held:
                self._whole = True
            elif self._boot:
                self._skip, self._whole = True, False  # the board was reset inside this line
        self._parser.feed(came.data if self._raw else self._trusted(came.data))
        rows = self.counts.accepted
        while (event := self._parser.next_line()) is not None:
            event = self._judged(event)
            if event is not None:
                yield event
        self._look_for_noise(came, self.counts.accepted - rows)

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
        if len(held) > LONGEST_LINE:
            self._skip, self._whole = True, False
            del held[_LONGEST_KEPT:-1]
        if not (self._boot or self._skip):
            self._raw = True
            kept += held
            held.clear()
        return bytes(kept)

    def _trust(self, line: bytes) -> bool:
        """The first line is surely whole only after a silence, and no sample is taken from it even then."""
        if self._skip:
            text = line.decode("latin-1")
            return is_comment(text) or (self._whole and _are_names(text))
        return not _BOOT_TEXT.search(line)

    def _judged(self, event: LineEvent) -> LineEvent | None:
        """Count a line; None where nobody else needs to know of it."""
        unknown = self.layout is None and event.kind == "text"
        if unknown or event.kind in {"row", "rejected"}:
            event = self._by_other_program(event) or event
            if event.kind == "rejected" and self._boot:
                self._drop()
                return None
        counts = self.counts
        counts.received += 1
        if event.kind == "row":
            counts.accepted += 1
        elif event.kind == "rejected":
            counts.rejected += 1
        else:
            counts.dropped += 1
        return event

    def _by_other_program(self, event: LineEvent) -> LineEvent | None:
        """The line as that of another program, where a header or many lines that do not fit show there is one.

        Names above lines that fit the old ones as well count only after an opening, or where there are none yet:
        `ERR,OK` is no header.
        """
        text, names, fits = event.text, self._names, event.kind == "row" and not event.issues
        if not fits and _are_names(text):
            self._names = text
            return LineEvent(event.number, "text", text)  # and no row of missing samples
        self._names = ""
        if fits and not (names and (self._boot or self._unnamed)):
            self._recent.clear()
            return None
        self._recent.append(text)
        patience = _PATIENCE if self.layout else _PATIENCE_AT_FIRST
        full = len(self._recent) >= patience and event.kind != "row"
        if not (names or full):
            return None
        head = [names, text] if names else list(self._recent)
        self._recent.clear()
        return self._parser.look_anew(head)

    @property
    def _unnamed(self) -> bool:
        """True where the board has not said what its channels are called."""
        layout = self.layout
        return layout is not None and layout.form.kind == "table" and not layout.header_rows

    def _drop(self) -> None:
        self.counts.received += 1
        self.counts.dropped += 1
        self.untold += 1

    def _look_for_noise(self, came: Came, rows: int) -> None:
        begin, size, odd = self._window
        if rows:
            self._window, self.wrong_baud = (came.end, 0, 0), False
            return
        size += len(came.data)
        odd += len(came.data) - len(came.data.translate(None, _ODD))
        self._window = (begin, size, odd)
        if came.end - begin >= _WINDOW and size >= _FEW_BYTES:
            self.wrong_baud = odd > _ODD_SHARE * size
            self._window = (came.end, 0, 0)


def _are_names(text: str) -> bool:
    """True for a line of distinct names, of which none is a number."""
    cells = [cell for cell in _CELL_END.split(text.strip()) if cell]
    named = all(re.match(r"[A-Za-z_µ(\[\"]", cell) and ":" not in cell for cell in cells)
    return bool(cells) and named and text.isprintable() and len(set(cells)) == len(cells)
