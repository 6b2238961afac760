"""`kalscope calibrate`: let a board that runs the exported sketch measure its own noise."""

from __future__ import annotations

import time
from contextlib import closing
from typing import TYPE_CHECKING, Annotated

import typer

from kalscope.cli.console import CHECK_FAILED, progress_line, say
from kalscope.cli.options import number_option
from kalscope.common.progress import Progress
from kalscope.common.stopping import said_at_stop, stop_signals
from kalscope.common.text import plain
from kalscope.errors import BadDevice, Cancelled
from kalscope.sources.port.transports.registry import address_examples

if TYPE_CHECKING:
    from kalscope.export.board.measuring import Measurement
    from kalscope.sources.live.live_source import LiveSource

MIN_SAMPLES = 3
"""Samples from which a board counts as started."""
START_S = 10.0
"""Seconds within which a board must have sent them, or the time that it measures if that is longer."""


def calibrate_command(
    port: Annotated[
        str,
        typer.Argument(metavar="PORT", help=f"{address_examples()}; default 115200 baud."),
    ],
    seconds: Annotated[float, number_option("Measure for this many seconds.")] = 10.0,
    channel: Annotated[
        str | None, typer.Option("--channel", metavar="NAME", help="Measure only this channel; default: all.")
    ] = None,
    keep: Annotated[
        bool, typer.Option("--keep", help="Store the measured values on the board for its next starts.")
    ] = False,
    no_reset: Annotated[
        bool, typer.Option("--no-reset", help="Keep DTR and RTS low, so that an Arduino does not restart.")
    ] = False,
) -> None:
    """Let a board measure its own noise r.

    Its input must not change during the measurement. The result is compared with the same samples computed here.

    The sketch on it must be exported with --calibration. Exit status 1 if the board refused; it then keeps its
    values.
    """
    from kalscope.export.board.measuring import set_kept
    from kalscope.sources.live.live_source import LiveSource
    from kalscope.sources.port.port_spec import port_of

    live = LiveSource(port_of(port, reset=not no_reset), reconnect=False)
    with closing(live):
        live.start(require=True)
        found = _measured(live, channel, seconds)
        for one in found:  # before anything else can fail: the board uses it
            print(*map(plain, _lines(one)), sep="\n", flush=True)
        refused = [one for one in found if not _is_measured(one)]
        kept = keep and not refused
        if kept:
            with said_at_stop(lambda: "the board may or may not have stored its values"):
                set_kept(live, kept=True)
    if len(refused) < len(found):
        print(_afterwards(kept=kept, wanted=keep))
    if refused:
        raise typer.Exit(CHECK_FAILED)


def _measured(live: LiveSource, channel: str | None, seconds: float) -> tuple[Measurement, ...]:
    """What the board measured; ends the command if it was stopped."""
    from kalscope.export.board.measuring import measure

    with stop_signals() as stop, progress_line() as report:
        progress = Progress(report, stop.is_set)
        try:
            _wait_for_samples(live, progress, max(START_S, seconds))
            return measure(live, channel, seconds, progress)
        except Cancelled as error:
            say(f"{error}")
            raise typer.Exit(stop.status) from None


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


def _is_measured(one: Measurement) -> bool:
    from kalscope.export.board.calibration import Calibrated

    return isinstance(one.answer, Calibrated)


def _lines(one: Measurement) -> list[str]:
    """What a board found of one channel, under the name that it has there; the remark has been checked."""
    from kalscope.export.board.calibration import Calibrated
    from kalscope.export.board.measured_words import compared_text, found_text, refusal_text

    if isinstance(one.answer, Calibrated):
        return [f"{one.answer.name}: {found_text(one.answer, '')}", f"  {compared_text(one, '')}"]
    return [f"{one.answer.name}: {refusal_text(one.answer)}"]


def _afterwards(*, kept: bool, wanted: bool) -> str:
    if kept:
        return "Kept: the board uses these values from its next start."
    if wanted:
        return "Not kept, because not all channels were measured."
    return "Not kept: after a reset the board uses the values of its export. --keep stores these."
