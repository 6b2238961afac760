"""The commands for boards: `kalscope ports`, `record`, `calibrate` and `demo-board`."""

from __future__ import annotations

import json
import math
import re
import sys
import time
from contextlib import closing, suppress
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from kalscope.cli.console import CHECK_FAILED, TerminalLine, progress_line, say
from kalscope.cli.options import number_option
from kalscope.common.progress import Progress
from kalscope.common.stopping import message_at_stop, stop_signals
from kalscope.common.text import escaped, number, one_line, plain
from kalscope.errors import BadDevice, Cancelled
from kalscope.sources.port.registry import ADDRESS_EXAMPLES
from kalscope.sources.port.serial_port import PortInfo, list_ports

if TYPE_CHECKING:
    import threading

    from kalscope.sources.live.source import LiveSource, LiveStatus
    from kalscope.sources.recorder import Recorder

Port = Annotated[str, typer.Argument(metavar="PORT", help=f"{ADDRESS_EXAMPLES}; default 115200 baud.")]
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
    from kalscope.sources.recorder import check_free

    spec = port_of(port, reset=not no_reset)
    check_free(output)  # before the board is reset for nothing
    live = LiveSource(spec, reconnect=not no_reconnect, keep=KEPT_SAMPLES)
    with closing(live):
        live.open()
        recorder, view = None, StatusLine()
        with stop_signals(lambda: one_line(summary(recorder)) if recorder else "nothing was recorded") as stop:
            recorder = live.record(output)  # before the first byte is read
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
        if self.visible:
            rate = f"{number(status.lines_per_s)} lines/s"
            self.show("; ".join(filter(None, (str(recorder.counts), rate, problem))))
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
        if status.word == "closed":
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
    from kalscope.export.board import NotCalibrated, measure, measured_text, set_kept
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
            print(plain(f"{one.answer.name}: {measured_text(one, '')}"), flush=True)
        refused = sum(isinstance(one.answer, NotCalibrated) for one in measured)
        if keep and not refused:
            with message_at_stop(lambda: "the board may or may not have stored its values"):
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
