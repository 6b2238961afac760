"""`kalscope demo-board`: send a recording or a synthetic signal over a port as a board would, until stopped.

For users without hardware, and for tests of what reads a port.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import replace
from functools import reduce
from typing import Annotated

import numpy as np
import typer
from numpy.typing import NDArray

from kalscope.cli.board.wires import PtyWire, SocketWire, Wire
from kalscope.cli.options import Source, number, number_option
from kalscope.common.stopping import stop_signals
from kalscope.errors import BadSetting
from kalscope.recording import Recording

MAX_RATE = 100_000.0
"""Maximum number of lines per second; no serial line carries more."""
DEFAULT_RATE = 100.0
"""Lines per second of a recording without time."""
BOOT_S = 0.05
"""Time from the opening of the port to the first line, s: pyserial discards what has arrived when it opens a port.
A real board takes longer to start."""
FORMATS = ("labels", "csv")
_MAX_SLEEP_S = 0.02
_MAX_PENDING_BYTES = 1 << 16
_MAX_BACKLOG_S = 5.0
"""Delay after which the board does not catch up, s: the machine was suspended."""


class BoardLines:
    """The lines of a board, one per sample, and when each is due. The recording repeats."""

    def __init__(
        self, recording: Recording, *, form: str = "labels", checksum: bool = False, rate: float | None = None
    ) -> None:
        """Format all lines.

        Args:
            recording: What the sensor sees; a gap in its time is a pause.
            form: "labels": `name:value,name:value`; "csv": a header, then values.
            checksum: End each line with `*` and the XOR of its bytes.
            rate: Lines per second; None = as the recording was sampled.

        Raises:
            BadSetting: the rate is not within 0 … 100,000, or the form is neither.
        """
        if form not in FORMATS:
            raise BadSetting(f"--format must be one of {', '.join(FORMATS)} (got {form!r})")
        if rate is not None and not 0 < rate <= MAX_RATE:
            raise BadSetting(f"--rate must be above 0 and at most {MAX_RATE:.0f} lines per second (got {rate:g})")
        self.due, self.period = _due(recording, rate)
        """When each line is due, s, shape (n,), and after what time the recording repeats, s."""
        names = [_name(name, unit) for name, unit in zip(recording.names, recording.units, strict=True)]
        heads = [f"{name}:" for name in names] if form == "labels" else [""] * len(names)
        self.lines = [
            _terminated(",".join(head + _number(value) for head, value in zip(heads, row, strict=True)), checksum)
            for row in recording.values.tolist()
        ]
        """One line per sample, newline included."""
        # "sine 1" above the numbers could be taken for a text and a number.
        header = ",".join(name.replace(" ", "_") for name in names)
        self.header = _terminated(header, checksum) if form == "csv" else b""
        """What precedes them each time the board starts; b"" where the lines carry the names."""

    def between(self, sent: int, now: float) -> tuple[list[bytes], float]:
        """The lines after the first `sent` ones that are due at `now`, s, and when the next one is."""
        repeats, at = divmod(sent, len(self.lines))
        found: list[bytes] = []
        while self.due[at] + repeats * self.period <= now:
            found.append(self.lines[at])
            at += 1
            if at == len(self.lines):
                repeats, at = repeats + 1, 0
        return found, float(self.due[at] + repeats * self.period)


def _due(recording: Recording, rate: float | None) -> tuple[NDArray[np.float64], float]:
    n = len(recording)
    if rate is None and recording.sample_period is None:
        rate = DEFAULT_RATE
    if rate is not None:
        return np.arange(n) / rate, n / rate
    period = max(recording.sample_period or 0.0, 1 / MAX_RATE)
    due = np.concatenate(([0.0], np.cumsum(np.maximum(np.diff(recording.time), 0.0))))
    if n > 1 and due[-1] < (n - 1) / MAX_RATE:
        raise BadSetting(f"--rate must be given where a recording is faster than {MAX_RATE:.0f} lines per second")
    return due, float(due[-1]) + period


def _name(name: str, unit: str) -> str:
    """A name that cannot be mistaken for anything else on the line."""
    bare = "".join("_" if c in ",:;*#\t|" or not c.isprintable() else c for c in name).strip() or "value"
    return f"{bare}[{unit}]" if unit and unit.isprintable() and not set(unit) & set(",:;*[]") else bare


def _number(value: float) -> str:
    return "nan" if math.isnan(value) else f"{value:.9g}"


def _terminated(line: str, checksum: bool) -> bytes:
    end = f"*{reduce(int.__xor__, line.encode(), 0):02X}" if checksum else ""
    return f"{line}{end}\r\n".encode()


class Board:
    """Sends the lines while the port is open, from the start each time it is opened, as an Arduino does."""

    def __init__(self, lines: BoardLines, wire: Wire, clock: Callable[[], float] = time.monotonic) -> None:
        self.lines, self._wire, self._clock = lines, wire, clock
        self.dropped = 0
        """Lines that were not read in time."""
        self._opened: float | None = None
        self._started: float | None = None
        self._sent = 0
        self._pending = bytearray()
        self._received = bytearray()

    def step(self) -> float:
        """Do what is due; returns the seconds until there is more to do."""
        if not self._wire.connected():
            self._started = self._opened = None
            return _MAX_SLEEP_S
        now = self._clock()
        self._opened = now if self._opened is None else self._opened
        if now - self._opened < BOOT_S:
            return BOOT_S - (now - self._opened)
        if self._started is None:
            self._started, self._sent = now, 0
            self._pending[:] = b"# kalscope demo-board\r\n" + self.lines.header
            self._received.clear()
        self._answer()
        lines, due = self.lines.between(self._sent, now - self._started)
        if now - self._started > due + _MAX_BACKLOG_S or (lines and len(lines) > _MAX_BACKLOG_S * MAX_RATE):
            self._started = now
        self._sent += len(lines)
        for i, line in enumerate(lines):
            if len(self._pending) + len(line) > _MAX_PENDING_BYTES:
                self.dropped += len(lines) - i
                break
            self._pending += line
        if self._pending:
            del self._pending[: self._wire.send(bytes(self._pending))]
        if self._pending:
            return 0.001
        return min(max(due - (now - self._started), 0.0), _MAX_SLEEP_S)

    def _answer(self) -> None:
        """Repeat what was received in a line that begins with #, as the sketches of Kalscope answer."""
        self._received += self._wire.receive()
        while b"\n" in self._received:
            line, _, rest = self._received.partition(b"\n")
            self._received = bytearray(rest)
            self._pending += b"# heard " + bytes(line).strip()[:64] + b"\r\n"
        del self._received[:-64]


def demo_board_command(
    source: Source = "demo",
    port: Annotated[
        int | None,
        typer.Option(
            "--socket", metavar="PORT", help="A socket on 127.0.0.1 instead of a pseudo-terminal; 0 = any free one."
        ),
    ] = None,
    rate: Annotated[
        float | None, number_option("Lines per second; default: as SOURCE was sampled.", number)
    ] = None,
    form: Annotated[
        str,
        typer.Option("--format", metavar="FORMAT", help="labels (name:value,…) or csv (a header, then values)."),
    ] = "labels",
    channels: Annotated[
        list[str] | None, typer.Option("--channel", metavar="NAME", help="Send this channel only; may be repeated.")
    ] = None,
    checksum: Annotated[
        bool, typer.Option("--checksum", help="End each line with *XX, as NMEA 0183 does.")
    ] = False,
) -> None:
    """Send a recording over a port, as a board would.

    It is sent at its own rate, until Ctrl+C.
    """
    from kalscope.catalogue import open_source

    recording = open_source(source)
    if channels:
        recording = _only(recording, [recording.index(name) for name in channels])
    lines = BoardLines(recording, form=form, checksum=checksum, rate=rate)
    wire = PtyWire() if port is None else SocketWire(port)
    try:
        print(f"Demo board: kalscope open {wire.address}", flush=True)
        board, wait = Board(lines, wire), 0.0
        with stop_signals() as stop:
            while not stop.wait(wait):
                wait = board.step()
    finally:
        wire.close()


def _only(recording: Recording, channels: list[int]) -> Recording:
    names, units = ([values[i] for i in channels] for values in (recording.names, recording.units))
    return replace(
        recording, names=tuple(names), units=tuple(units), values=recording.values[:, channels], truth=None
    )
