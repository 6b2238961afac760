"""`kalscope demo-board`: a recording or a made-up sensor, sent over a port as a board would, for ever.

For whoever has no hardware at hand, and for tests of what reads a port.
"""

from __future__ import annotations

import math
import signal
import threading
import time
from collections.abc import Callable
from functools import reduce
from typing import Annotated, Any

import numpy as np
import typer
from numpy.typing import NDArray

from kalscope.cli.board.wires import PtyWire, SocketWire, Wire
from kalscope.errors import BadSetting
from kalscope.recording import Recording

FASTEST = 100_000.0
"""Most lines a second; no serial line carries more."""
USUAL_RATE = 100.0
"""Lines a second of a recording without time."""
BOOT = 0.05
"""Seconds from the opening of the port to the first line: whoever opens it throws away what is there by then, as
pyserial does. A real board takes longer to start."""
FORMATS = ("labels", "csv")
_LONGEST_SLEEP = 0.02
_MOST_WAITING = 1 << 16
_SLEPT = 5.0
"""Seconds of delay after which the board does not catch up: the machine slept."""


class BoardLines:
    """The lines of a board, one a sample, and when each is due. The recording repeats."""

    def __init__(
        self, recording: Recording, *, form: str = "labels", checksum: bool = False, rate: float | None = None
    ) -> None:
        """Write all lines.

        Args:
            recording: What the sensor sees; a gap in its time is a pause.
            form: "labels": `name:value,name:value`; "csv": a header, then values.
            checksum: End each line with `*` and the XOR of its bytes.
            rate: Lines a second; None = as the recording was sampled.

        Raises:
            BadSetting: the rate is not within 0 … 100,000, or the form is neither.
        """
        if form not in FORMATS:
            raise BadSetting(f"--format must be one of {', '.join(FORMATS)} (got {form!r})")
        if rate is not None and not 0 < rate <= FASTEST:
            raise BadSetting(f"--rate must be above 0 and at most {FASTEST:.0f} lines a second (got {rate:g})")
        self.due, self.turn = _due(recording, rate)
        """Seconds at which each line is due, shape (n,), and the length of one turn."""
        names = [_name(name, unit) for name, unit in zip(recording.names, recording.units, strict=True)]
        heads = [f"{name}:" for name in names] if form == "labels" else [""] * len(names)
        end = _with_checksum if checksum else _bare
        self.lines = [
            end(",".join(head + _number(value) for head, value in zip(heads, row, strict=True)))
            for row in recording.values.tolist()
        ]
        """One line a sample, newline included."""
        # "sine 1" above the numbers could be taken for a text and a number.
        self.header = end(",".join(name.replace(" ", "_") for name in names)) if form == "csv" else b""
        """What comes before them each time the board starts; b"" where the lines bring their names."""

    def between(self, sent: int, now: float) -> tuple[list[bytes], float]:
        """The lines after the first `sent` ones that are due at `now`, s, and when the next one is."""
        turns, at = divmod(sent, len(self.lines))
        found = []
        while self.due[at] + turns * self.turn <= now:
            found.append(self.lines[at])
            at += 1
            if at == len(self.lines):
                turns, at = turns + 1, 0
        return found, float(self.due[at] + turns * self.turn)


def _due(recording: Recording, rate: float | None) -> tuple[NDArray[np.float64], float]:
    n = len(recording)
    if rate is None and recording.sample_period is None:
        rate = USUAL_RATE
    if rate is not None:
        return np.arange(n) / rate, n / rate
    period = max(recording.sample_period or 0.0, 1 / FASTEST)
    due = np.concatenate(([0.0], np.cumsum(np.maximum(np.diff(recording.time), 0.0))))
    if n > 1 and due[-1] < (n - 1) / FASTEST:
        raise BadSetting(f"--rate must be given where a recording is faster than {FASTEST:.0f} lines a second")
    return due, float(due[-1]) + period


def _name(name: str, unit: str) -> str:
    """A name that cannot be taken for anything else on the line."""
    bare = "".join("_" if c in ",:;*#\t|" or not c.isprintable() else c for c in name).strip() or "value"
    return f"{bare}[{unit}]" if unit and unit.isprintable() and not set(unit) & set(",:;*[]") else bare


def _number(value: float) -> str:
    return "nan" if math.isnan(value) else f"{value:.9g}"


def _bare(line: str) -> bytes:
    return f"{line}\r\n".encode()


def _with_checksum(line: str) -> bytes:
    return f"{line}*{reduce(int.__xor__, line.encode(), 0):02X}\r\n".encode()


class Board:
    """Sends the lines while somebody listens; begins anew whenever the port is opened, as an Arduino does."""

    def __init__(self, lines: BoardLines, wire: Wire, clock: Callable[[], float] = time.monotonic) -> None:
        self.lines, self._wire, self._clock = lines, wire, clock
        self.dropped = 0
        """Lines that nobody fetched in time."""
        self._opened: float | None = None
        self._started: float | None = None
        self._sent = 0
        self._pending = bytearray()
        self._heard = bytearray()

    def step(self) -> float:
        """Do what is due; seconds until there is more to do."""
        if not self._wire.connected():
            self._started = self._opened = None
            return _LONGEST_SLEEP
        now = self._clock()
        self._opened = now if self._opened is None else self._opened
        if now - self._opened < BOOT:
            return BOOT - (now - self._opened)
        if self._started is None:
            self._started, self._sent = now, 0
            self._pending[:] = b"# kalscope demo-board\r\n" + self.lines.header
            self._heard.clear()
        self._answer()
        lines, due = self.lines.between(self._sent, now - self._started)
        if now - self._started > due + _SLEPT or (lines and len(lines) > _SLEPT * FASTEST):
            self._started = now
        self._sent += len(lines)
        for i, line in enumerate(lines):
            if len(self._pending) + len(line) > _MOST_WAITING:
                self.dropped += len(lines) - i
                break
            self._pending += line
        if self._pending:
            del self._pending[: self._wire.send(bytes(self._pending))]
        if self._pending:
            return 0.001
        return min(max(due - (now - self._started), 0.0), _LONGEST_SLEEP)

    def _answer(self) -> None:
        """Say what was heard, in a line that begins with #, as our sketches answer."""
        self._heard += self._wire.receive()
        while b"\n" in self._heard:
            line, _, rest = self._heard.partition(b"\n")
            self._heard = bytearray(rest)
            self._pending += b"# heard " + bytes(line).strip()[:64] + b"\r\n"
        del self._heard[:-64]


def demo_board_command(
    source: Annotated[
        str, typer.Argument(metavar="SOURCE", help='A file, "demo", "sample:NAME" or "synthetic:SHAPE?…".')
    ] = "demo",
    port: Annotated[
        int | None,
        typer.Option(
            "--socket", metavar="PORT", help="A socket on 127.0.0.1 instead of a pseudo-terminal; 0 = any."
        ),
    ] = None,
    rate: Annotated[
        str | None, typer.Option("--rate", metavar="NUMBER", help="Lines a second; else as SOURCE was sampled.")
    ] = None,
    form: Annotated[
        str,
        typer.Option("--format", metavar="FORMAT", help="labels (name:value,…) or csv (a header, then values)."),
    ] = "labels",
    channels: Annotated[
        list[str] | None,
        typer.Option("--channel", metavar="NAME", help="Send this channel only; may be given again."),
    ] = None,
    checksum: Annotated[
        bool, typer.Option("--checksum", help="End each line with *XX, as NMEA 0183 does.")
    ] = False,
) -> None:
    """Pretend to be a board: send a recording over a port, at its true rate, until Ctrl-C."""
    from kalscope.catalogue import open_source

    lines_a_second = None if rate is None else _number_of(rate)
    recording = _chosen(open_source(source), channels)
    lines = BoardLines(recording, form=form, checksum=checksum, rate=lines_a_second)
    wire = PtyWire() if port is None else SocketWire(port)
    try:
        print(f"Demo board: kalscope open {wire.address}", flush=True)
        run_board(Board(lines, wire))
    finally:
        wire.close()


def run_board(board: Board) -> None:
    """Send until Ctrl-C or SIGTERM."""
    stop = threading.Event()

    def end(*_: Any) -> None:
        stop.set()

    before = {number: signal.signal(number, end) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        wait = 0.0
        while not stop.wait(wait):
            wait = board.step()
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _chosen(recording: Recording, channels: list[str] | None) -> Recording:
    if not channels:
        return recording
    from dataclasses import replace

    at = [recording.index(name) for name in channels]
    return replace(
        recording,
        names=tuple(recording.names[i] for i in at),
        units=tuple(recording.units[i] for i in at),
        values=recording.values[:, at],
        truth=None,
    )


def _number_of(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise BadSetting(f"--rate must be a number (got {text!r})") from None
