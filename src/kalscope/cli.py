"""The headless commands. `run` is the whole program; the dashboard adds its own command to `app`.

What the commands need is imported when they run, so that --help and a slip of the keyboard answer at once.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, BinaryIO

import typer

from kalscope.demo_board import demo_board_command
from kalscope.errors import BadSetting, KalscopeError, describe
from kalscope.export_command import export_command
from kalscope.ports_command import ports_command
from kalscope.record_command import record_command
from kalscope.report_command import report_command
from kalscope.reproduce_command import reproduce_command
from kalscope.sources.command_options import (
    Delimiter,
    GapsChoice,
    Missing,
    SamplePeriod,
    TimeColumnChoice,
    TimeUnit,
    options_from_text,
)
from kalscope.tune_command import tune_command

if TYPE_CHECKING:
    from kalscope.model import FilterParams
    from kalscope.recording import Recording
    from kalscope.sources.read_options import ReadOptions

USER_ERROR = 2
"""Exit status when something the user gave cannot be used; stderr then has one line."""
INTERRUPTED = 130
"""Exit status after Ctrl-C, as a shell counts it."""
LONGEST_LINE = 65_536
"""Bytes of one line on stdin, hundreds of channels; a longer one is no line of numbers."""

app = typer.Typer(
    name="kalscope",
    help="Kalscope, an oscilloscope for the scalar Kalman noise filter.",
    add_completion=False,
    rich_markup_mode=None,  # plain help: importing rich takes longer than all the rest
    pretty_exceptions_enable=False,
)


app.command("tune")(tune_command)
app.command("export")(export_command)
app.command("reproduce")(reproduce_command)
app.command("record")(record_command)
app.command("ports")(ports_command)
app.command("demo-board")(demo_board_command)
app.command("report")(report_command)


def run(argv: Sequence[str] | None = None) -> int:
    """Run the program and give its exit status; `argv` without the program's name, None = sys.argv.

    Every mistake of the user ends with status 2 and one line on stderr that begins with "kalscope: ".
    """
    try:
        status = app(args=None if argv is None else list(argv), prog_name="kalscope", standalone_mode=False)
    except typer.Abort:
        return INTERRUPTED
    except Exception as error:
        message = _message(error)
        if message is None:
            raise  # a mistake of ours: the traceback is what we need to see
        _say(message)
        return USER_ERROR
    return status if isinstance(status, int) else 0


def _number_option(name: str, text: str) -> Any:
    return typer.Option(name, metavar="NUMBER", help=text)


def _print_version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version as installed

        print(f"kalscope {installed('kalscope')}")
        raise typer.Exit


@app.callback()
def _program(
    version: Annotated[  # acts in its callback, before a missing command is noticed
        bool,
        typer.Option("--version", help="Show the version and exit.", is_eager=True, callback=_print_version),
    ] = False,
) -> None:
    """Make `filter` a command even while it is the only one."""


@app.command("filter")
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
    q: Annotated[str | None, _number_option("--q", "Process-noise variance a sample, unit².")] = None,
    r: Annotated[str | None, _number_option("--r", "Measurement-noise variance, unit².")] = None,
    p0: Annotated[str | None, _number_option("--p0", 'Start variance, unit², or "diffuse".')] = None,
    x0: Annotated[str | None, _number_option("--x0", 'Start value, or "first": the first sample.')] = None,
    gate: Annotated[str | None, _number_option("--gate", 'Outlier gate on v²/s, such as 9, or "off".')] = None,
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
    from kalscope.filter_choice import params_for, params_for_stdin
    from kalscope.sources.account import account, overruled
    from kalscope.sources.csv_writer import filtered_csv_chunks

    given = _given(q=q, r=r, p0=p0, x0=x0, gate=gate)
    period = None if sample_period is None else _number("--sample-period", sample_period)
    options = options_from_text(delimiter, time_column, time_unit, missing or (), gaps)
    if source == "-":
        _refuse_with_stdin(report=report, output=output)
        _filter_stdin(*params_for_stdin(config, given, channel, period), options)
        return
    recording = _read(source, options, period, output)
    params, notes = params_for(recording, config, given, channel)
    _write(filtered_csv_chunks(recording, params), output)
    if report:
        sys.stderr.write(account(recording))
    if period is not None:
        notes = [*filter(None, [overruled(recording)]), *notes]
    for note in notes:  # last, so that an error is the only line
        _say(f"note: {note}")


def _refuse_with_stdin(*, report: bool, output: Path | None) -> None:
    if report:
        raise BadSetting('--report must be left out where SOURCE is "-": each line is answered as it comes')
    if output is not None:
        raise BadSetting('-o must be left out where SOURCE is "-": the answers go to stdout, line by line')


def _read(source: str, options: ReadOptions, period: float | None, output: Path | None) -> Recording:
    """The recording that is to be filtered into `output`, with progress on a terminal."""
    from kalscope.progress_line import ProgressLine
    from kalscope.sources import open_source

    if output is not None and output.exists() and os.path.exists(source) and output.samefile(source):
        raise BadSetting(f"-o must be another file than SOURCE (got {source!r} twice)")
    with ProgressLine(sys.stderr) as line:
        progress = line.part(os.path.basename(source), 0, 1)
        return open_source(source, options, sample_period=period, progress=progress)


@app.command("bench")
def bench_command(
    as_json: Annotated[bool, typer.Option("--json", help="Print the rows as JSON.")] = False,
    samples: Annotated[
        str | None, typer.Option("--samples", metavar="N", help="Length of the long record; else 10 million.")
    ] = None,
    quick: Annotated[bool, typer.Option("--quick", help="Less work and fewer turns, rougher figures.")] = False,
) -> None:
    """Measure the speed of the filter against numpy, scipy and other Kalman libraries, as ratios."""
    from kalscope.bench_command import bench

    bench(as_json=as_json, samples=samples, quick=quick)


def _given(**texts: str | None) -> dict[str, float | None]:
    """The parameters that the command line gives, by name; None is an automatic start."""
    words = {"p0": "diffuse", "x0": "first", "gate": "off"}
    return {
        name: None if text == words.get(name) else _number(f"--{name}", text, words.get(name))
        for name, text in texts.items()
        if text is not None
    }


def _number(option: str, text: str, word: str | None = None) -> float:
    """The number of an option. Typer's own message does not say what came."""
    try:
        return float(text)
    except ValueError:
        must = "a number" if word is None else f'a number or "{word}"'
        raise BadSetting(f"{option} must be {must} (got {text!r})") from None


def _filter_stdin(params: FilterParams | list[FilterParams], notes: list[str], options: ReadOptions) -> None:
    """Answer each line at once: whoever writes them may wait for the answer."""
    from kalscope.line_filter import LineFilter
    from kalscope.sources.line_parser import LineParser, comma_line

    for note in notes:
        _say(f"note: {note}")
    lines, parser = LineFilter(params), LineParser(options)
    with _stdout() as out:
        for line in _lines(sys.stdin.buffer):
            answer, note = lines.answer(comma_line(parser, line))
            out.write(f"{answer}\n".encode())
            out.flush()
            if note:
                _say(note)


def _lines(stream: BinaryIO) -> Iterator[bytes]:
    while line := stream.readline(LONGEST_LINE):
        if len(line) < LONGEST_LINE or line.endswith(b"\n"):
            yield line
            continue
        while (rest := stream.readline(LONGEST_LINE)) and not rest.endswith(b"\n"):
            pass
        yield line[:60] + b" and so on"  # the rest was dropped, so it must not read as numbers


def _write(chunks: Iterator[str], output: Path | None) -> None:
    from kalscope.atomic import atomic_file

    with _stdout() if output is None else atomic_file(output) as file:
        for chunk in chunks:
            file.write(chunk.encode("utf-8", "replace"))


@contextmanager
def _stdout() -> Iterator[BinaryIO]:
    """Standard output as bytes (Windows would add carriage returns), quiet when its reader goes away."""
    try:
        yield sys.stdout.buffer
        sys.stdout.buffer.flush()
    except OSError as error:
        # What is left in the buffer would raise once more when Python ends, where nobody can catch it.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if isinstance(error, BrokenPipeError):  # `kalscope filter … | head` has all it wants
            raise typer.Exit(0) from None
        raise


def _say(message: str) -> None:
    print(f"kalscope: {' '.join(message.split())}", file=sys.stderr, flush=True)


def _message(error: Exception) -> str | None:
    """What to tell the user; None for an exception that is not theirs to mend."""
    if isinstance(error, KalscopeError | OSError):
        return describe(error)
    # Typer's usage errors; it brought its own copy of click's classes in 0.2x, the method is common to both.
    usage = getattr(error, "format_message", None)
    return str(usage()) if callable(usage) else None


if __name__ == "__main__":
    sys.exit(run())
