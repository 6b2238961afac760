"""`kalscope fleet`: many recordings on Dask, into one folder."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from kalscope.cli.options import SamplePeriod, number_option, read_options, text_option, with_options
from kalscope.cli.tune_options import NOTHING, TuneOptions
from kalscope.errors import BadSetting
from kalscope.sources.grammar.read_options import DEFAULTS, ReadOptions

if TYPE_CHECKING:
    from kalscope.estimation.pool import Pool
    from kalscope.fleet.run import Tally


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
    row_groups: Annotated[
        bool, typer.Option("--row-groups", help="Each row group of a Parquet file is a recording of its own.")
    ] = False,
    device_limit: Annotated[
        float | None,
        number_option("Longest time for one device in s, more for a file above 16 MiB; default: 120."),
    ] = None,
    question: TuneOptions = NOTHING,
    sample_period: SamplePeriod = None,
    reading: ReadOptions = DEFAULTS,
) -> None:
    """Tune many recordings, on all cores or a Dask cluster.

    Writes a table with one row per recording, also for those that cannot be read, and one filter for all.
    """
    from kalscope.cli.console import TerminalLine, say, write_output
    from kalscope.common.stopping import said_at_stop
    from kalscope.common.text import count
    from kalscope.fleet.answer import Answer, answer_for, devices_of, save_answer, summary
    from kalscope.fleet.read import DEVICE_LIMIT_S, FleetOptions, any_recording
    from kalscope.fleet.run import run_fleet
    from kalscope.fleet.store import LIBRARIES, check_tuning, library

    if every and channel is not None:
        raise BadSetting(f"--all must be used without --channel (got --channel {channel!r})")
    for module in LIBRARIES:
        library(module)
    options = FleetOptions(
        question, reading, sample_period, channel, every, row_groups, device_limit or DEVICE_LIMIT_S
    )
    if question.still is None:  # a stretch lies in each recording or not
        question.request(any_recording()).checked_momentum()
    check_tuning(output)
    answers, line = list[Answer](), TerminalLine(sys.stderr)
    latest: Tally | None = None

    def show(tally: Tally) -> None:
        nonlocal latest
        latest = tally
        line.show(progress_text(tally))

    def on_files(files: int) -> None:
        line.show(f"looking for recordings: {count(files)} found")

    def finish(table: Any, pool: Pool) -> None:
        answers.append(answer_for(devices_of(table), pool, question))
        save_answer(answers[0], table, output)

    try:
        with said_at_stop(lambda: kept_text(latest)):
            tally = run_fleet(sources, options, output, cluster, show, finish, on_files)
    finally:
        line.clear()
    write_output(iter([summary(answers[0], tally, output)]), None)
    if tally.again:
        say(
            f"{tally.again} of {tally.units} files or row groups failed for a reason that may pass, such as access,"
            " memory or time: run the same command to retry"
        )


def kept_text(tally: Tally | None) -> str:
    """What is kept of a run that was stopped, and how to continue; None where no batch was started."""
    done = "what was done is kept"
    if tally is not None:
        done = f"{tally.kept + tally.done} of {tally.units} done, all kept"
    return f"{done}: run the same command again to continue"


def progress_text(tally: Tally) -> str:
    """How far a run is, how fast, and the time left, in one line."""
    from kalscope.common.text import count, duration, number, percent

    if tally.bytes:
        done_now, todo = tally.done_bytes, tally.bytes - tally.kept_bytes - tally.done_bytes
    else:
        done_now, todo = tally.done, tally.units - tally.kept - tally.done
    share = 1.0 - todo / (tally.bytes or tally.units)
    done = f"{count(tally.kept + tally.done)} of {count(tally.units)} done ({percent(share)})"
    if not tally.seconds or not tally.done:
        return done
    left = duration(tally.seconds * todo / done_now) if done_now else ""
    return f"{done}, {number(tally.rows / tally.seconds)} rows/s{f', {left} left' if left else ''}"
