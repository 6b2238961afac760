"""`kalscope filter`: a recording, or lines on stdin, through the filter."""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, BinaryIO

import typer

from kalscope.cli.console import open_stdout, progress_line, say, tell_compiling, write_output
from kalscope.cli.options import SamplePeriod, number, number_option, number_or, read_options, with_options
from kalscope.errors import BadSetting
from kalscope.sources.grammar.read_options import DEFAULTS, ReadOptions

if TYPE_CHECKING:
    from kalscope.filtering.params import FilterParams
    from kalscope.recording import Recording

MAX_LINE_BYTES = 65_536
"""Bytes of one line on stdin, hundreds of channels; a longer one is no line of numbers."""

Given = dict[str, float | None]
"""Parameters by name, those that were given; None is an automatic start."""

NOTHING: Given = {}


def params_options(
    q: Annotated[float | None, number_option("Process-noise variance per sample, unit².", number)] = None,
    r: Annotated[float | None, number_option("Measurement-noise variance, unit².", number)] = None,
    p0: Annotated[
        float | None, number_option('Initial variance, unit², or "diffuse".', number_or("diffuse"))
    ] = None,
    x0: Annotated[
        float | None, number_option('Initial value, or "first": the first sample.', number_or("first"))
    ] = None,
    gate: Annotated[
        float | None, number_option('Outlier gate on v²/s, such as 9, or "off".', number_or("off"))
    ] = None,
    momentum: Annotated[
        float | None, number_option("How long the signal keeps its direction, in sample periods.", number)
    ] = None,
) -> Given:
    """The options in place of the parameter `given` of the command; see `with_options`."""
    options = {"q": q, "r": r, "p0": p0, "x0": x0, "gate": gate, "momentum": momentum}
    # NaN is the word for an automatic start, which the filter's parameters write as None.
    return {name: None if math.isnan(value) else value for name, value in options.items() if value is not None}


@with_options(reading=read_options, given=params_options)
def filter_command(
    source: Annotated[
        str,
        typer.Argument(
            metavar="SOURCE",
            help='A file, "demo", "sample:NAME", "synthetic:SHAPE?…"; or "-": answer stdin line by line.',
        ),
    ],
    config: Annotated[Path | None, typer.Option(metavar="FILE", help="Tuning file with q and r.")] = None,
    given: Given = NOTHING,
    channel: Annotated[str | None, typer.Option(metavar="NAME", help="Filter this channel only.")] = None,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="FILE", help="Write to this file.")
    ] = None,
    sample_period: SamplePeriod = None,
    reading: ReadOptions = DEFAULTS,
    report: Annotated[
        bool, typer.Option("--report", help="Report on stderr how SOURCE was read, every line accounted for.")
    ] = False,
) -> None:
    """Filter a recording: a CSV of time, raw and filtered signal, variance, and with momentum the velocity.

    --q, --r, --p0, --x0, --gate and --momentum take precedence over --config. Without q and r they are guessed
    from the signal. With "-" each line on stdin is answered by one line on stdout: empty for a missing sample,
    which the filter predicts over, and for a comment (# % //), which is no sample.
    """
    from kalscope.export.filtered_csv import filtered_csv_chunks
    from kalscope.sources.readers.account import account, sample_period_conflict
    from kalscope.tuning.choose import params_for, params_for_stdin

    tell_compiling()
    if source == "-":
        _refuse_with_stdin(report=report, output=output)
        _filter_stdin(*params_for_stdin(config, given, channel, sample_period), reading)
        return
    recording = _read(source, reading, sample_period, output)
    params, notes = params_for(recording, config, given, channel)
    write_output(filtered_csv_chunks(recording, params), output)
    if report:
        sys.stderr.write(account(recording))
    if sample_period is not None:
        notes = [*filter(None, [sample_period_conflict(recording)]), *notes]
    for note in notes:  # last, so that an error is the only line
        say(f"note: {note}")


def _refuse_with_stdin(*, report: bool, output: Path | None) -> None:
    if report:
        raise BadSetting('--report must be left out where SOURCE is "-": each line is answered as it comes')
    if output is not None:
        raise BadSetting('-o must be left out where SOURCE is "-": the answers go to stdout, line by line')


def _read(source: str, options: ReadOptions, period: float | None, output: Path | None) -> Recording:
    """The recording that is to be filtered into `output`, with progress on a terminal."""
    from kalscope.catalogue import open_source

    if output is not None and output.exists() and os.path.exists(source) and output.samefile(source):
        raise BadSetting(f"-o must be another file than SOURCE (got {source!r} twice)")
    with progress_line() as report:
        return open_source(source, options, sample_period=period, progress=report)


def _filter_stdin(params: FilterParams | list[FilterParams], notes: list[str], options: ReadOptions) -> None:
    """Answer each line at once: the program that writes them may wait for the answer."""
    from kalscope.cli.filter.line_filter import LineFilter
    from kalscope.sources.lines.line_parser import LineParser, comma_line

    for note in notes:
        say(f"note: {note}")
    lines, parser = LineFilter(params), LineParser(options)
    with open_stdout() as out:
        for line in _bounded_lines(sys.stdin.buffer):
            answer, note = lines.answer(comma_line(parser, line))
            out.write(f"{answer}\n".encode())
            out.flush()
            if note:
                say(note)


def _bounded_lines(stream: BinaryIO) -> Iterator[bytes]:
    """The lines of a stream, none longer than MAX_LINE_BYTES."""
    while line := stream.readline(MAX_LINE_BYTES):
        if len(line) < MAX_LINE_BYTES or line.endswith(b"\n"):
            yield line
            continue
        while (rest := stream.readline(MAX_LINE_BYTES)) and not rest.endswith(b"\n"):
            pass
        yield line[:60] + b" and so on"  # the rest was dropped, so it must not read as numbers
