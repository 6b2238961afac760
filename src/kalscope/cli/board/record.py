"""`kalscope record`: write what a board sends to a CSV file, without a dashboard, until stopped."""

from __future__ import annotations

import re
import sys
import time
from contextlib import closing, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from kalscope.cli.console import CHECK_FAILED, TerminalLine, say
from kalscope.cli.options import number_option
from kalscope.common.stopping import stop_signals
from kalscope.common.text import count, number, one_line, plain
from kalscope.errors import BadDevice
from kalscope.sources.port.transports.registry import address_examples

if TYPE_CHECKING:
    import threading

    from kalscope.sources.live.live_source import LiveSource
    from kalscope.sources.live.live_status import LiveStatus
    from kalscope.sources.recorder.recorder import Recorder

MAX_CLOSE_S = 1.0
"""Longest wait for an attempt to connect that is under way when the recording is to end, s."""
KEPT_SAMPLES = 10_000
"""Samples that stay in memory: the file has them all, and nothing is drawn."""
POLL_INTERVAL_S = 0.1
"""Pause between two checks of the recording, s."""
_COUNTS = re.compile(r"\d[\d\s,.]*")
"""Counts in a message, which may grow while the problem stays the same."""


def record_command(
    port: Annotated[
        str,
        typer.Argument(metavar="PORT", help=f"{address_examples()}; default 115200 baud."),
    ],
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
    no_reset: Annotated[
        bool, typer.Option("--no-reset", help="Keep DTR and RTS low, so that an Arduino does not restart.")
    ] = False,
) -> None:
    """Record what a board sends, without the dashboard.

    FILE.csv gets every line as received, FILE.rejects the lines that are not data.

    Ctrl+C, SIGTERM and SIGHUP end the recording and write a summary as its last comment: exit status 0, or 1 if not
    all lines are on the disk, because it was full or another program removed them.
    """
    from kalscope.sources.live.live_source import LiveSource
    from kalscope.sources.port.port_spec import port_of
    from kalscope.sources.recorder.paths import check_free, existing_parts

    spec = port_of(port, reset=not no_reset)
    _ = existing_parts(output) if resume else check_free(output)  # before the board is reset for nothing
    live = LiveSource(spec, reconnect=not no_reconnect, keep=KEPT_SAMPLES)
    with closing(live):
        live.open()
        recorder, view = None, StatusLine()

        def kept() -> str:
            return one_line(summary(recorder)) if recorder else "nothing was recorded"

        with stop_signals(kept) as stop:
            recorder = live.record(output, resume=resume)  # before the first byte is read
            live.start()
            disconnected = _wait_for_end(live, recorder, stop, view, seconds=seconds, lines=lines)
            live.close(MAX_CLOSE_S)  # ends the recording too: the summary is that of a whole file
            view.clear()
    with suppress(OSError):  # the terminal may be gone: the recording is whole all the same
        print(plain(summary(recorder)), flush=True)
    if disconnected:
        raise BadDevice(f"recording ended, because {spec.text} disconnected ({disconnected})")
    if recorder.counts.unwritable or recorder.counts.removed:
        raise typer.Exit(CHECK_FAILED)


class StatusLine(TerminalLine):
    """The present state on one line of a terminal; elsewhere a new line for each problem and its end."""

    def __init__(self) -> None:
        super().__init__(sys.stderr)
        self._problem = ""

    def update(self, status: LiveStatus, recorder: Recorder) -> None:
        """Show the state as it is now."""
        problems = [recorder.error, recorder.warning, status.hint]
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
    *,
    seconds: float | None,
    lines: float | None,
) -> str:
    """Wait until the recording is to end; the reason if that is a disconnect, else ""."""
    end = None if seconds is None else time.monotonic() + seconds
    while not stop.is_set():
        status = live.status()
        view.update(status, recorder)
        if status.word == "closed" or (status.word != "connected" and not live.reconnect):
            return status.hint or "it disconnected"
        if lines is not None and recorder.counts.written >= lines:
            break
        left = POLL_INTERVAL_S if end is None else end - time.monotonic()
        if left <= 0:
            break
        stop.wait(min(left, POLL_INTERVAL_S))
    return ""
