"""`kalscope filter`: a recording, or lines on stdin, through the filter."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from kalscope.cli.options import Delimiter, GapsChoice, Missing, SamplePeriod, TimeColumnChoice, TimeUnit
from kalscope.errors import BadSetting
from kalscope.sources.lines.read_options import options_from_text

if TYPE_CHECKING:
    from kalscope.filtering.params import FilterParams
    from kalscope.recording import Recording
    from kalscope.sources.lines.read_options import ReadOptions
from kalscope.cli.console import bounded_lines, number_from_option, number_option, open_stdout, say, write_output


def filter_command(
    source: Annotated[
        str,
        typer.Argument(
            metavar="SOURCE",
            help='A file, "demo", "sample:NAME", "synthetic:SHAPE?…"; or "-": answer stdin line by line.',
        ),
    ],
    config: Annotated[
        Path | None, typer.Option("--config", metavar="FILE", help="Tuning file with q and r.")
    ] = None,
    q: Annotated[str | None, number_option("--q", "Process-noise variance a sample, unit².")] = None,
    r: Annotated[str | None, number_option("--r", "Measurement-noise variance, unit².")] = None,
    p0: Annotated[str | None, number_option("--p0", 'Start variance, unit², or "diffuse".')] = None,
    x0: Annotated[str | None, number_option("--x0", 'Start value, or "first": the first sample.')] = None,
    gate: Annotated[str | None, number_option("--gate", 'Outlier gate on v²/s, such as 9, or "off".')] = None,
    channel: Annotated[
        str | None, typer.Option("--channel", metavar="NAME", help="Filter this channel only.")
    ] = None,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="FILE", help="Write to this file.")
    ] = None,
    sample_period: SamplePeriod = None,
    delimiter: Delimiter = None,
    time_column: TimeColumnChoice = None,
    time_unit: TimeUnit = None,
    missing: Missing = None,
    gaps: GapsChoice = None,
    report: Annotated[
        bool, typer.Option("--report", help="Tell on stderr how SOURCE was read, every line accounted for.")
    ] = False,
) -> None:
    """Filter a recording: a CSV of time, raw and filtered signal and variance.

    --q, --r, --p0, --x0 and --gate outrank --config. With none of them q and r are guessed from the signal.
    With "-" each line on stdin is answered by one line on stdout: empty for a missing sample, which the filter
    predicts over, and for a remark (# % //), which is no sample.
    """
    from kalscope.export.filtered_csv import filtered_csv_chunks
    from kalscope.sources.readers.account import account, overruled
    from kalscope.tuning.choose import params_for, params_for_stdin

    given = _given(q=q, r=r, p0=p0, x0=x0, gate=gate)
    period = None if sample_period is None else number_from_option("--sample-period", sample_period)
    options = options_from_text(delimiter, time_column, time_unit, missing or (), gaps)
    if source == "-":
        _refuse_with_stdin(report=report, output=output)
        _filter_stdin(*params_for_stdin(config, given, channel, period), options)
        return
    recording = _read(source, options, period, output)
    params, notes = params_for(recording, config, given, channel)
    write_output(filtered_csv_chunks(recording, params), output)
    if report:
        sys.stderr.write(account(recording))
    if period is not None:
        notes = [*filter(None, [overruled(recording)]), *notes]
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
    from kalscope.cli.progress_line import ProgressLine

    if output is not None and output.exists() and os.path.exists(source) and output.samefile(source):
        raise BadSetting(f"-o must be another file than SOURCE (got {source!r} twice)")
    with ProgressLine(sys.stderr) as line:
        progress = line.part(os.path.basename(source), 0, 1)
        return open_source(source, options, sample_period=period, progress=progress)


def _given(**texts: str | None) -> dict[str, float | None]:
    """The parameters that the command line gives, by name; None is an automatic start."""
    words = {"p0": "diffuse", "x0": "first", "gate": "off"}
    return {
        name: None if text == words.get(name) else number_from_option(f"--{name}", text, words.get(name))
        for name, text in texts.items()
        if text is not None
    }


def _filter_stdin(params: FilterParams | list[FilterParams], notes: list[str], options: ReadOptions) -> None:
    """Answer each line at once: whoever writes them may wait for the answer."""
    from kalscope.cli.line_filter import LineFilter
    from kalscope.sources.lines.line_parser import LineParser, comma_line

    for note in notes:
        say(f"note: {note}")
    lines, parser = LineFilter(params), LineParser(options)
    with open_stdout() as out:
        for line in bounded_lines(sys.stdin.buffer):
            answer, note = lines.answer(comma_line(parser, line))
            out.write(f"{answer}\n".encode())
            out.flush()
            if note:
                say(note)
