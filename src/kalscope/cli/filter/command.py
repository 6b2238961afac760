"""`kalscope filter`: a recording, or lines on stdin, through the filter."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, BinaryIO

import typer

from kalscope.cli.console import open_stdout, progress_line, say, tell_compiling, write_output
from kalscope.cli.filter.options import params_options
from kalscope.cli.options import SamplePeriod, read_options, text_option, with_options
from kalscope.errors import BadSetting
from kalscope.sources.grammar.read_options import DEFAULTS, ReadOptions

if TYPE_CHECKING:
    from kalscope.cli.filter.line_filter import Filters
    from kalscope.recording import Recording

MAX_LINE_BYTES = 65_536
"""Bytes of one line on stdin, hundreds of channels; a longer one is not a line of numbers."""

_NONE: dict[str, Any] = {}
"""No parameter is given."""


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
    given: dict[str, Any] = _NONE,
    channel: Annotated[str | None, typer.Option(metavar="NAME", help="Filter this channel only.")] = None,
    fuse: Annotated[
        str | None,
        text_option("NAMES", "Fuse these channels, sensors of one quantity; default: those that --config fuses."),
    ] = None,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="FILE", help="Write to this file.")
    ] = None,
    sample_period: SamplePeriod = None,
    reading: ReadOptions = DEFAULTS,
    force: Annotated[bool, typer.Option("--force", help="Overwrite an existing FILE.")] = False,
    report: Annotated[
        bool, typer.Option("--report", help="Print on stderr how SOURCE was read, with a count of every line.")
    ] = False,
) -> None:
    """Filter a recording, or lines on stdin.

    The output is a CSV of time, raw and filtered signal, variance, and with momentum the velocity.

    With --fuse, or where --config has a fusion and no --channel is named, the columns are those of the sensors, the
    fused value and its variance.

    --q, --r, --p0, --x0, --gate and --momentum take precedence over --config. Without q and r they are guessed
    from the signal. With "-" each line on stdin is answered by one line on stdout: empty for a missing sample,
    which the filter predicts over, and for a comment (# % //), which is not a sample.
    """
    from kalscope.common.text import plain
    from kalscope.export.filtered_csv import filtered_csv_chunks
    from kalscope.sources.readers.account import account, sample_period_conflict
    from kalscope.tuning.choose import filters_for, filters_for_stdin, fuses

    tell_compiling()
    fused = fuses(config, given, channel, fuse)  # before anything is read: it refuses contradictions
    if source == "-":
        _refuse_with_stdin(report=report, output=output)
        chosen, notes = filters_for_stdin(config, given, channel, fuse, sample_period)
        of_each = [one.filter for one in chosen]
        _filter_stdin(chosen[0].params if fused else of_each if config else of_each[0], notes, reading)
        return
    recording = _read(source, reading, sample_period, output, force=force)
    chosen, notes = filters_for(recording, config, given, channel, fuse)
    write_output(filtered_csv_chunks(recording, chosen), output)
    if report:
        sys.stderr.write(plain(account(recording)))
    if sample_period is not None:
        notes = [*filter(None, [sample_period_conflict(recording)]), *notes]
    for note in notes:  # last, so that an error is the only line
        say(f"note: {note}")


def _refuse_with_stdin(*, report: bool, output: Path | None) -> None:
    if report:
        raise BadSetting('--report must be left out where SOURCE is "-": each line is answered as it arrives')
    if output is not None:
        raise BadSetting('-o must be left out where SOURCE is "-": the answers go to stdout, line by line')


def _read(
    source: str, options: ReadOptions, period: float | None, output: Path | None, *, force: bool
) -> Recording:
    """The recording that is to be filtered into `output`, with progress on a terminal."""
    from kalscope.catalogue import open_source
    from kalscope.common.files import check_new

    if output is not None and output.exists() and os.path.exists(source) and output.samefile(source):
        raise BadSetting(f"-o must be another file than SOURCE (got {source!r} twice)")
    if output is not None:
        check_new(output, force=force)
    with progress_line() as report:
        return open_source(source, options, sample_period=period, progress=report)


def _filter_stdin(params: Filters, notes: list[str], options: ReadOptions) -> None:
    """Answer each line at once: the program that writes them may wait for the answer."""
    from kalscope.cli.filter.line_filter import LineFilter
    from kalscope.common.stopping import said_at_stop
    from kalscope.common.text import count
    from kalscope.sources.lines.line_parser import LineParser, comma_line

    for note in notes:
        say(f"note: {note}")
    lines, parser = LineFilter(params), LineParser(options)
    with open_stdout() as out, said_at_stop(lambda: f"{count(lines.received)} lines answered"):
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
