"""The commands for boards: `kalscope ports`, `record`, `calibrate` and `demo-board`."""

from __future__ import annotations

import json
import math
import os
import re
import select
import socket
import sys
import time
from collections.abc import Callable
from contextlib import closing, suppress
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer
from numpy.typing import NDArray

from kalscope.cli.console import CHECK_FAILED, TerminalLine, progress_line, say
from kalscope.cli.options import Source, number_option
from kalscope.cli.options import number as cli_number
from kalscope.common.progress import Progress
from kalscope.common.stopping import said_at_stop, stop_signals
from kalscope.common.text import count, escaped, number, one_line, plain
from kalscope.errors import BadDevice, BadSetting, Cancelled
from kalscope.recording import Recording
from kalscope.sources.port.registry import address_examples
from kalscope.sources.port.serial_port import PortInfo, list_ports

if TYPE_CHECKING:
    import threading

    from kalscope.export.board import Measurement
    from kalscope.sources.live.source import LiveSource, LiveStatus
    from kalscope.sources.recorder import Recorder

Port = Annotated[str, typer.Argument(metavar="PORT", help=f"{address_examples()}; default 115200 baud.")]
NoReset = Annotated[
    bool, typer.Option("--no-reset", help="Keep DTR and RTS low, so that an Arduino does not restart.")
]


# `kalscope ports`: what is plugged in, and how to open it.


NONE_FOUND = (
    "No serial port was found. Plug the board in with a cable that carries data, and install the driver of its USB"
    " chip (CH340, CP210x) where the system has none. A port that is not listed opens by its path:"
    " kalscope open serial:/dev/ttyACM0. Without a board: kalscope demo-board"
)
"""What to do where nothing is plugged in."""


def ports_command(
    as_json: Annotated[bool, typer.Option("--json", help="Print the ports as JSON.")] = False,
) -> None:
    """List the serial ports: device, description, serial number."""
    ports = list_ports()
    if as_json:
        print(escaped(json.dumps([asdict(port) for port in ports], indent=1, ensure_ascii=False)))
    else:
        print(ports_text(ports))


def ports_text(ports: tuple[PortInfo, ...]) -> str:
    """A table of the ports and the command that opens the first one; advice where there are none."""
    if not ports:
        return NONE_FOUND
    table = [("device", "description", "serial number")]
    table += [(port.device, port.description, port.serial_number) for port in ports]
    rows = [[one_line(cell) or "-" for cell in row] for row in table]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]
    first = next((port for port in ports if port.usb is not None), ports[0])  # a board is on USB
    return "\n".join([*lines, "", f"Open one: kalscope open serial:{one_line(first.device)}@115200"])


# `kalscope record`: write what a board sends to a CSV file, without a dashboard, until stopped.


MAX_CLOSE_S = 1.0
"""Longest wait for an attempt to connect that is under way when the recording is to end, s."""
KEPT_SAMPLES = 10_000
"""Samples that stay in memory: the file has them all, and nothing is drawn."""
POLL_INTERVAL_S = 0.1
"""Pause between two checks of the recording, s."""
_COUNTS = re.compile(r"\d[\d\s,.]*")
"""Counts in a message, which may grow while the problem stays the same."""


def record_command(
    port: Port,
    output: Annotated[Path, typer.Option("-o", "--output", metavar="FILE.csv", help="A new file to record into.")],
    seconds: Annotated[float | None, number_option("Stop after this many seconds.")] = None,
    lines: Annotated[float | None, number_option("Stop once at least this many lines are written.")] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Continue FILE.csv, a recording that ended or that a crash cut short.")
    ] = False,
    no_reconnect: Annotated[
        bool,
        typer.Option("--no-reconnect", help="Stop with status 2 when the board disconnects; default: wait for it."),
    ] = False,
    no_reset: NoReset = False,
) -> None:
    """Record what a board sends, without the dashboard.

    FILE.csv gets every line as received, FILE.rejects the lines that are not data.

    Ctrl+C, SIGTERM and SIGHUP end the recording and write a summary as its last comment: exit status 0, or 1 if not
    all lines are on the disk, because it was full or another program removed them.
    """
    from kalscope.sources.live.source import LiveSource
    from kalscope.sources.port.registry import port_of
    from kalscope.sources.recorder import check_free, existing_parts

    spec = port_of(port, reset=not no_reset)
    _ = existing_parts(output) if resume else check_free(output)  # before the board is reset for nothing
    live = LiveSource(spec, reconnect=not no_reconnect, keep=KEPT_SAMPLES)
    with closing(live):
        live.open()
        recorder, view = None, StatusLine()
        with stop_signals(lambda: one_line(summary(recorder)) if recorder else "nothing was recorded") as stop:
            recorder = live.record(output, resume=resume)  # before the first byte is read
            live.start()
            disconnected = _wait_for_end(live, recorder, stop, view, seconds, lines)
            live.close(MAX_CLOSE_S)  # ends the recording too: the summary is that of a whole file
            view.clear()
    with suppress(OSError):  # the terminal may be gone: the recording is whole all the same
        print(plain(summary(recorder)), flush=True)
    if disconnected:
        raise BadDevice(f"recording ended, because {spec.text} disconnected ({disconnected})")
    if recorder.counts.unwritable or recorder.error:
        raise typer.Exit(CHECK_FAILED)


class StatusLine(TerminalLine):
    """The present state on one line of a terminal; elsewhere a new line for each problem and its end."""

    def __init__(self) -> None:
        super().__init__(sys.stderr)
        self._problem = ""

    def update(self, status: LiveStatus, recorder: Recorder) -> None:
        """Show the state as it is now."""
        problems = [recorder.error, status.hint]
        problems += [status.word] if status.word not in ("connected", status.hint) else []
        problem = "; ".join(" ".join(text.split()) for text in problems if text)
        counts = recorder.counts
        if self.visible:
            self.show(
                f"{count(counts.written)} lines written, {number(status.lines_per_s)} lines/s,"
                f" {count(counts.rejected)} rejected, {count(counts.dropped)} dropped"
                + (f"; {problem}" if problem else "")
            )
        elif (kind := _COUNTS.sub("", problem)) != self._problem:
            self._problem = kind
            with suppress(OSError):  # whatever reads stderr may be gone; the recording goes on
                say(problem or "recording continues")


def summary(recorder: Recorder) -> str:
    """What was recorded, in one line."""
    rejects = f"; see {recorder.rejects_path}" if recorder.rejects_path.exists() else ""
    problem = f"; {recorder.error}" if recorder.error else ""
    return f"{recorder.path.parent / recorder.files}: {recorder.counts}{rejects}{problem}"


def _wait_for_end(
    live: LiveSource,
    recorder: Recorder,
    stop: threading.Event,
    view: StatusLine,
    seconds: float | None,
    lines: float | None,
) -> str:
    """Wait until the recording is to end; the reason if that is a disconnect, else ""."""
    end = time.monotonic() + (math.inf if seconds is None else seconds)
    while not stop.is_set():
        status = live.status()
        view.update(status, recorder)
        if status.word == "closed" or (status.word != "connected" and not live.reconnect):
            return status.hint or "it disconnected"
        if time.monotonic() >= end or (lines is not None and recorder.counts.written >= lines):
            break
        stop.wait(min(end - time.monotonic(), POLL_INTERVAL_S))
    return ""


# `kalscope calibrate`: let a board that runs the exported sketch measure its own noise.


MIN_SAMPLES = 3
"""Samples from which a board counts as started."""
START_S = 10.0
"""Seconds within which a board must have sent them, or the time that it measures if that is longer."""


def calibrate_command(
    port: Port,
    seconds: Annotated[float, number_option("Measure for this many seconds.")] = 10.0,
    channel: Annotated[
        str | None, typer.Option("--channel", metavar="NAME", help="Measure only this channel; default: all.")
    ] = None,
    keep: Annotated[
        bool, typer.Option("--keep", help="Store the measured values on the board for its next starts.")
    ] = False,
    no_reset: NoReset = False,
) -> None:
    """Let a board measure its own noise r.

    Its input must not change during the measurement. The result is compared with the same samples computed here.

    The sketch on it must be exported with --calibration. Exit status 1 if the board refused; it then keeps its
    values.
    """
    from kalscope.export.board import NotCalibrated, measure, set_kept
    from kalscope.sources.live.source import LiveSource
    from kalscope.sources.port.registry import port_of

    live = LiveSource(port_of(port, reset=not no_reset), reconnect=False)
    with closing(live):
        live.start(require=True)
        with stop_signals() as stop, progress_line() as report:
            progress = Progress(report, stop.is_set)
            try:
                _wait_for_samples(live, progress, max(START_S, seconds))
                measured = measure(live, channel, seconds, progress)
            except Cancelled as error:
                say(f"{error}")
                raise typer.Exit(stop.status) from None
        for one in measured:  # before anything else can fail: the board uses it
            print(plain(_measured_text(one)), flush=True)
        refused = sum(isinstance(one.answer, NotCalibrated) for one in measured)
        if keep and not refused:
            with said_at_stop(lambda: "the board may or may not have stored its values"):
                set_kept(live, kept=True)
    if not keep and refused < len(measured):
        print("Not kept: after a reset the board uses the values of its export. --keep stores these.")
    elif not refused:
        print("Kept: the board uses these values from its next start.")
    elif refused < len(measured):
        print("Not kept, because not all channels were measured.")
    if refused:
        raise typer.Exit(CHECK_FAILED)


def _wait_for_samples(live: LiveSource, progress: Progress, seconds: float) -> None:
    """Wait until the board has started."""
    end = time.monotonic() + seconds
    while (snapshot := live.snapshot()) is None or len(snapshot.recording) < MIN_SAMPLES:
        progress(0.0, "the board starts")
        status = live.status()
        if status.word == "closed" or time.monotonic() > end:
            why = f": {status.hint}" if status.hint else ". Does it run the exported sketch at this baud rate?"
            raise BadDevice(f"no sample arrived from {live.spec.text} within {seconds:g} s{why}")
        time.sleep(0.05)


def _measured_text(one: Measurement) -> str:
    """What a board measured of one channel, under the name that it has there."""
    from kalscope.export.board import Calibrated, compared_text, found_text, refusal_text

    if isinstance(one.answer, Calibrated):
        return f"{one.answer.name}: {found_text(one.answer, '')}\n  {compared_text(one, '')}"
    return f"{one.answer.name}: {refusal_text(one.answer)}"


# The connection of the demo board: a pseudo-terminal that opens like a serial port, or a local socket.


class PtyWire:
    """A pseudo-terminal. Linux and macOS."""

    def __init__(self) -> None:
        """Make the port.

        Raises:
            BadDevice: this system has no pseudo-terminals.
        """
        try:
            import tty

            self._master, slave = os.openpty()
        except (ImportError, AttributeError, OSError) as error:
            raise BadDevice("demo-board needs --socket PORT on this system (got no pseudo-terminal)") from error
        try:
            tty.setraw(slave)  # before it is opened: in cooked mode it would echo everything
            self.address = f"serial:{os.ttyname(slave)}"
            """What opens the other end, as `kalscope open` takes it."""
        finally:
            os.close(slave)  # so that POLLHUP shows whether the other end is open
        os.set_blocking(self._master, False)

    def connected(self) -> bool:
        """Whether the port is open elsewhere."""
        poll = select.poll()
        poll.register(self._master, 0)
        return not any(event & select.POLLHUP for _, event in poll.poll(0))

    def send(self, data: bytes) -> int:
        """Send what fits into the buffer of the terminal, about 4 KB."""
        with suppress(BlockingIOError):
            return os.write(self._master, data)
        return 0

    def receive(self) -> bytes:
        """What was sent to the board."""
        with suppress(OSError):  # nothing was sent, or the port is closed
            return os.read(self._master, 4096)
        return b""

    def close(self) -> None:
        """Remove the port, as an unplugged cable does."""
        os.close(self._master)


class SocketWire:
    """A listening socket on 127.0.0.1 for one client at a time."""

    def __init__(self, port: int) -> None:
        """Listen on `port`; 0 means any free one.

        Raises:
            BadSetting: the port is out of range.
            BadDevice: the port is in use.
        """
        if not 0 <= port <= 65535:
            raise BadSetting(f"--socket must be a port from 0 to 65535 (got {port})")
        self._client: socket.socket | None = None
        try:
            self._server = socket.create_server(("127.0.0.1", port), backlog=1)
        except OSError as error:
            raise BadDevice(f"--socket must be a free port (got {port}: {error.strerror})") from error
        self._server.setblocking(False)
        self.address = f"tcp://127.0.0.1:{self._server.getsockname()[1]}"

    def connected(self) -> bool:
        """Whether a client is connected; accepts the next one if not."""
        if self._client is None:
            with suppress(BlockingIOError):
                self._client = self._server.accept()[0]
                self._client.setblocking(False)
        return self._client is not None

    def send(self, data: bytes) -> int:
        """Send what fits into the buffer of the connection."""
        return self._transfer(lambda client: client.send(data)) or 0

    def receive(self) -> bytes:
        """What was sent to the board."""
        data = self._transfer(lambda client: client.recv(4096))
        if data == b"":
            self._disconnect()
        return data or b""

    def _transfer(self, action: Callable[[socket.socket], Any]) -> Any:
        """What the client takes or has sent; None where it can do neither now."""
        try:
            return None if self._client is None else action(self._client)
        except BlockingIOError:
            return None
        except OSError:
            self._disconnect()

    def close(self) -> None:
        """Disconnect and stop listening."""
        self._disconnect()
        self._server.close()

    def _disconnect(self) -> None:
        if self._client is not None:
            self._client.close()
            self._client = None


# `kalscope demo-board`: send a recording or a synthetic signal over a port as a board would, until stopped.
#
# For users without hardware, and for tests of what reads a port.


MAX_RATE = 100_000.0
"""Maximum number of lines per second; no serial line carries more."""
DEFAULT_RATE = 100.0
"""Lines per second of a recording without time."""
BOOT_S = 0.05
"""Time from the opening of the port to the first line, s: pyserial discards what has arrived when it opens a port.
A real board takes longer to start."""
_MAX_SLEEP_S = 0.02
_MAX_PENDING_BYTES = 1 << 16


class BoardLines:
    """The lines of a board, `name:value,name:value` per sample, and when each is due; the recording repeats."""

    def __init__(self, recording: Recording, rate: float | None = None) -> None:
        """Format all lines.

        Args:
            recording: What the sensor sees; a gap in its time is a pause.
            rate: Lines per second; None = as the recording was sampled.

        Raises:
            BadSetting: the rate is not within 0 … 100,000.
        """
        if rate is not None and not 0 < rate <= MAX_RATE:
            raise BadSetting(f"--rate must be above 0 and at most {MAX_RATE:.0f} lines per second (got {rate:g})")
        self.due, self.period = _due(recording, rate)
        """When each line is due, s, shape (n,), and after what time the recording repeats, s."""
        names = [_name(name, unit) for name, unit in zip(recording.names, recording.units, strict=True)]
        self.lines = [
            ",".join(f"{name}:{value:.9g}" for name, value in zip(names, row, strict=True)).encode() + b"\r\n"
            for row in recording.values.tolist()
        ]
        """One line per sample, newline included."""

    def between(self, sent: int, now: float) -> tuple[list[bytes], float]:
        """The lines after the first `sent` ones that are due at `now`, s, and when the next one is."""
        lines: list[bytes] = []
        while True:
            repeats, at = divmod(sent + len(lines), len(self.lines))
            due = float(self.due[at]) + repeats * self.period
            if due > now:
                return lines, due
            lines.append(self.lines[at])


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


class Board:
    """Sends the lines while the port is open, from the start each time it is opened, as an Arduino does."""

    def __init__(
        self, lines: BoardLines, wire: PtyWire | SocketWire, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self.lines, self._wire, self._clock = lines, wire, clock
        self._opened: float | None = None
        self._sent = 0
        self._pending = bytearray()

    def step(self) -> float:
        """Do what is due; returns the seconds until there is more to do."""
        if not self._wire.connected():
            self._opened = None
            return _MAX_SLEEP_S
        now = self._clock()
        if self._opened is None:
            self._opened, self._sent = now, 0
            self._pending[:] = b"# kalscope demo-board\r\n"
        now -= self._opened + BOOT_S
        if now < 0.0:
            return -now
        self._wire.receive()  # or a sender would wait
        lines, due = self.lines.between(self._sent, now)
        self._sent += len(lines)
        for line in lines:
            if len(self._pending) + len(line) > _MAX_PENDING_BYTES:
                break  # they are not read in time: the others are lost
            self._pending += line
        del self._pending[: self._wire.send(bytes(self._pending))]
        return 0.001 if self._pending else min(due - now, _MAX_SLEEP_S)


def demo_board_command(
    source: Source = "demo",
    port: Annotated[
        int | None,
        typer.Option(
            "--socket", metavar="PORT", help="A socket on 127.0.0.1 instead of a pseudo-terminal; 0 = any free one."
        ),
    ] = None,
    rate: Annotated[
        float | None, number_option("Lines per second; default: as SOURCE was sampled.", cli_number)
    ] = None,
) -> None:
    """Send a recording over a port, as a board would.

    It is sent at its own rate, until Ctrl+C.
    """
    from kalscope.catalogue import open_source

    lines = BoardLines(open_source(source), rate)
    wire = PtyWire() if port is None else SocketWire(port)
    with closing(wire):
        print(f"Demo board: kalscope open {wire.address}", flush=True)
        board, wait = Board(lines, wire), 0.0
        with stop_signals() as stop:
            while not stop.wait(wait):
                wait = board.step()
