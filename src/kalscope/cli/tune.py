"""`kalscope tune`: its options and what is done with the answers."""

from __future__ import annotations

import shutil
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from kalscope.cli.options import SamplePeriod, read_options, with_options
from kalscope.cli.tune_options import NO_FUSION, FusionOptions
from kalscope.common.files import temporary_folder
from kalscope.errors import BadSetting
from kalscope.sources.grammar.read_options import DEFAULTS, ReadOptions

if TYPE_CHECKING:
    from kalscope.recording import Recording


@with_options(reading=read_options, options=FusionOptions)
def tune_command(
    source: Annotated[
        str,
        typer.Argument(
            metavar="SOURCE", help='A file, "demo", "sample:NAME", "synthetic:SHAPE?…"; or "-": all of stdin.'
        ),
    ],
    channel: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Channel to tune; default: the first that measures something."),
    ] = None,
    every: Annotated[bool, typer.Option("--all", help="Tune every channel.")] = False,
    options: FusionOptions = NO_FUSION,
    sample_period: SamplePeriod = None,
    reading: ReadOptions = DEFAULTS,
    details: Annotated[
        bool, typer.Option("--details", help="Also print how it was found, what the record allows, and the tests.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print everything as one JSON object.")] = False,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="FILE", help="Save the tuning to this file.")
    ] = None,
) -> None:
    """Find q and r for a recording, and say why.

    By estimation, for a given lag, cut-off or noise reduction, or from known noise.
    """
    from kalscope.catalogue import open_source
    from kalscope.cli import tune_answer
    from kalscope.cli.console import progress_line, report_compiling, say, write_output
    from kalscope.sources.reading.account import sample_period_conflict

    report_compiling()
    if every and channel is not None:
        raise BadSetting(f"--all must be used without --channel (got --channel {channel!r})")
    options.refuse_others(channel, every)
    recording = (_stdin if source == "-" else open_source)(source, reading, sample_period=sample_period)
    notes = [sample_period_conflict(recording)] if sample_period is not None else []
    with progress_line() as show:
        answers = tune_answer.answers_for(recording, recording.names if every else channel, options, show)
    if output is not None:
        notes += tune_answer.save_answers(answers, output)
    text = tune_answer.json_of(answers, every) if as_json else tune_answer.page_of(answers, details)
    write_output(iter([text]), None)
    for note in filter(None, notes):
        say(f"note: {note}")


def _stdin(source: str, reading: ReadOptions, *, sample_period: float | None) -> Recording:
    """What comes on stdin until it ends, read as a file of text."""
    from kalscope.sources.reading.recording_file import read_recording

    with temporary_folder() as folder:
        path = folder / "stdin"
        with path.open("wb") as file:
            shutil.copyfileobj(sys.stdin.buffer, file)
        recording = read_recording(path, reading, sample_period=sample_period)
    return replace(recording, source=source, title="stdin")
