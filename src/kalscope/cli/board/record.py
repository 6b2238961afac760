"""`kalscope record`: what a board sends into a CSV, without a dashboard, until told to stop."""

from __future__ import annotations

import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TextIO

import typer

from kalscope.common.text import count, number
from kalscope.errors import BadDevice, BadSetting

if TYPE_CHECKING:
    from kalscope.sources.live.live_source import LiveSource
    from kalscope.sources.live.live_status import LiveStatus
    from kalscope.sources.recorder.recorder import Recorder

LOST = 1
"""Exit status where the disk did not take all lines."""
LOOK_S = 0.1
"""Pause between two looks at the recording, s."""
_SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK")


def record_command(
    port: Annotated[
        str,
        typer.Argument(metavar="PORT", help='"/dev/ttyACM0", "COM3@9600", "socket://host:port"; 115200 baud else.'),
    ],
    output: Annotated[Path, typer.Option("-o", "--output", metavar="FILE.csv", help="A new file to record into.")],
    seconds: Annotated[
        str | None, typer.Option("--seconds", metavar="NUMBER", help="Stop after so many seconds.")
    ] = None,
    lines: Annotated[
        str | None, typer.Option("--lines", metavar="N", help="Stop once at least so many lines are written.")
    ] = None,
    resume: Annotated[
        bool,
        typer.Option("--resume", help="Go on with FILE.csv, a recording that ended or that a crash cut short."),
    ] = False,
    no_reconnect: Annotated[
        bool, typer.Option("--no-reconnect", help="Stop when the board goes away, status 2; else wait for it.")
    ] = False,
    no_reset: Annotated[
        bool, typer.Option("--no-reset", help="Keep DTR and RTS low, so that an Arduino does not start anew.")
    ] = False,
) -> None:
    """Record a board: FILE.csv with every line as it came, FILE.rejects with what is no data.

    Ctrl+C, SIGTERM and SIGHUP end the recording with its account as a last comment: status 0, or 1 where the
    disk did not take all lines.
    """
    from kalscope.sources.live.live_source import LiveSource
    from kalscope.sources.port.port_spec import port_of
    from kalscope.sources.recorder.paths import check_free, existing_parts

    duration = _above_zero("--seconds", seconds)
    most = _above_zero("--lines", lines)
    spec = port_of(port, reset=not no_reset)
    _ = existing_parts(output) if resume else check_free(output)  # before the board is reset for nothing
    live = LiveSource(spec, reconnect=not no_reconnect)
    with _stop_signals() as stop, closing(live):
        live.start(require=True)
        recorder, view = live.record(output, resume=resume), StatusLine(sys.stderr)
        went_away = _watch(live, recorder, stop, view, duration=duration, most=most)
        live.close()  # ends the recording too: the summary is that of a whole file
        view.clear()
    said = summary(recorder)
    with suppress(OSError):  # the terminal may be gone: the recording is whole all the same
        print(said, flush=True)
    if went_away:
        raise BadDevice(f"{spec.text} must stay connected with --no-reconnect (got: {went_away})")
    if recorder.counts.unwritable:
        raise typer.Exit(LOST)


class StatusLine:
    """One line on a terminal that shows the present state; elsewhere one line a change for the worse or better."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self._terminal = stream.isatty()
        self._width = 0
        self._said = ""

    def show(self, status: LiveStatus, recorder: Recorder) -> None:
        """Show how it stands now."""
        troubles = [recorder.trouble, recorder.warning, status.hint]
        troubles += [status.word] if status.word not in ("connected", status.hint) else []
        trouble = "; ".join(" ".join(text.split()) for text in troubles if text)
        counts = recorder.counts
        if self._terminal:
            text = (
                f"{count(counts.written)} lines written, {number(status.lines_per_s)} lines/s,"
                f" {count(counts.rejected)} rejected, {count(counts.dropped)} dropped"
                + (f"; {trouble}" if trouble else "")
            )
            self._write(f"\r{text:<{self._width}}")
            self._width = len(text)
        elif trouble != self._said:
            self._write(f"kalscope: {trouble or 'all right again'}\n")
        self._said = trouble

    def clear(self) -> None:
        """Leave an empty line behind."""
        if self._width:
            self._write(f"\r{' ' * self._width}\r")
            self._width = 0

    def _write(self, text: str) -> None:
        with suppress(OSError):  # a terminal that was closed must not end the recording
            self._stream.write(text)
            self._stream.flush()


def summary(recorder: Recorder) -> str:
    """What was recorded, in one line."""
    counts = recorder.counts
    names = ", ".join(str(path) for path in recorder.paths)
    rejects = f"; see {recorder.rejects_path}" if recorder.rejects_path.exists() else ""
    trouble = f"; {recorder.trouble}" if recorder.trouble else ""
    return f"{names}: {counts}{rejects}{trouble}"


def _watch(
    live: LiveSource,
    recorder: Recorder,
    stop: threading.Event,
    view: StatusLine,
    *,
    duration: float | None,
    most: float | None,
) -> str:
    """Wait for the end; why the port is gone, where that was the end, else ""."""
    end = None if duration is None else time.monotonic() + duration
    while not stop.is_set():
        status = live.status()
        view.show(status, recorder)
        if status.word == "closed" or (status.word != "connected" and not live.reconnect):
            return status.hint or "it went away"
        if most is not None and recorder.counts.written >= most:
            break
        left = LOOK_S if end is None else end - time.monotonic()
        if left <= 0:
            break
        stop.wait(min(left, LOOK_S))
    return ""


@contextmanager
def _stop_signals() -> Iterator[threading.Event]:
    """An event that is set by every polite request to end; the old handlers come back afterwards."""
    stop = threading.Event()
    if threading.current_thread() is not threading.main_thread():
        yield stop  # only the main thread may take signals
        return
    kept = {}
    for name in _SIGNALS:
        number = getattr(signal, name, None)
        # Whoever runs us with nohup has SIGHUP ignored, and means it.
        if number is not None and signal.getsignal(number) is not signal.SIG_IGN:
            kept[number] = signal.signal(number, lambda *_: stop.set())
    try:
        yield stop
    finally:
        for number, handler in kept.items():
            signal.signal(number, handler)


def _above_zero(option: str, text: str | None) -> float | None:
    if text is None:
        return None
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0.0 < value < float("inf"):
        raise BadSetting(f"{option} must be a number above 0 (got {text!r})")
    return value
