"""`kalscope fleet`: many recordings on Dask, into one folder."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import typer

from kalscope.cli.options import SamplePeriod, read_options, text_option, with_options
from kalscope.cli.tune_options import NOTHING, TuneOptions
from kalscope.errors import BadSetting
from kalscope.recording import Recording
from kalscope.sources.grammar.read_options import DEFAULTS, ReadOptions

if TYPE_CHECKING:
    from kalscope.fleet.results import Tally


@with_options(reading=read_options, question=TuneOptions)
def fleet_command(
    sources: Annotated[
        list[str],
        typer.Argument(metavar="SOURCE…", help="Folders, files, patterns, Parquet data sets, or @LIST of files."),
    ],
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="DIR", help="Folder of the results; a rerun continues there.")
    ],
    cluster: Annotated[
        str | None, text_option("ADDRESS", "Dask scheduler, tcp://HOST:PORT; default: all cores of this machine.")
    ] = None,
    channel: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Channel to tune; default: the first that measures something."),
    ] = None,
    every: Annotated[bool, typer.Option("--all", help="Tune every channel.")] = False,
    question: TuneOptions = NOTHING,
    sample_period: SamplePeriod = None,
    reading: ReadOptions = DEFAULTS,
) -> None:
    """Tune many recordings, on all cores or a Dask cluster.

    Writes a table with one row per recording, also for those that cannot be read, and one filter for all.
    """
    from kalscope.cli.console import TerminalLine, write_output
    from kalscope.common.stopping import message_at_stop
    from kalscope.fleet.store import LIBRARIES, library

    for module in LIBRARIES:
        library(module)
    from kalscope.fleet.read import FleetOptions
    from kalscope.fleet.results import summary
    from kalscope.fleet.run import run_fleet

    if every and channel is not None:
        raise BadSetting(f"--all must be used without --channel (got --channel {channel!r})")
    if question.still not in (None, "auto"):
        raise BadSetting(f"--still must be auto for a fleet, whose recordings differ (got {question.still!r})")
    request = question.request(Recording(np.arange(3.0), ("x",), ("",), np.zeros((3, 1)), 1.0))
    request.checked_momentum()
    options = FleetOptions(request, question.gate, reading, sample_period, channel, every)
    line, kept = TerminalLine(sys.stderr), "what was done is kept"

    def show(tally: Tally) -> None:
        nonlocal kept
        kept = f"{tally.kept + tally.done} of {tally.units} done, all kept"
        line.show(progress_text(tally))

    try:
        line.show("looking for recordings")
        with message_at_stop(lambda: f"{kept}: run the same command again to continue"):
            tally, answer = run_fleet(sources, options, output, cluster, show)
    finally:
        line.clear()
    write_output(iter([summary(answer, tally, output)]), None)


def progress_text(tally: Tally) -> str:
    """How far a run is and the time left, in one line."""
    from kalscope.common.text import count, duration, percent

    finished = tally.kept + tally.done
    text = f"{count(finished)} of {count(tally.units)} done ({percent(finished / tally.units)})"
    if not tally.done:
        return text
    return f"{text}, {duration(tally.seconds * (tally.units - finished) / tally.done)} left"
