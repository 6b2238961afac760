"""`kalscope filter`: a recording, or lines on stdin, through the filter."""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any, BinaryIO

import typer

from kalscope.cli.console import open_stdout, progress_line, report_compiling, say, write_output
from kalscope.cli.options import (
    SamplePeriod,
    number,
    number_option,
    number_or,
    number_or_each,
    option_group,
    read_options,
    text_option,
    with_options,
)
from kalscope.common.text import plural
from kalscope.errors import BadSetting
from kalscope.filtering.filter import Filter
from kalscope.sources.grammar.cells import is_comment, parse_number
from kalscope.sources.grammar.read_options import DEFAULTS, ReadOptions

# The parameters of the filter as options of `kalscope filter`.


def _parameters(chain: str | None = None, **numbers: Any) -> dict[str, Any]:
    """Fields of ChannelTuning by name; NaN is the word for an automatic start or no gate, which is None there."""
    given = {
        name: None if isinstance(value, float) and math.isnan(value) else value for name, value in numbers.items()
    }
    if chain is not None:
        from kalscope.tuning.tuning import typed_chain

        given["chain"] = typed_chain(chain)
    return given


params_options = option_group(
    {
        "q": number_option("Process-noise variance per sample, unit².", number),
        "r": number_option(
            "Measurement-noise variance, unit²; of fused sensors also each: a=4,b=9.", number_or_each(number)
        ),
        "p0": number_option('Initial variance, unit², or "diffuse".', number_or("diffuse")),
        "x0": number_option('Initial value, or "first": the first sample.', number_or("first")),
        "gate": number_option('Outlier gate on v²/s, such as 9, or "off".', number_or("off")),
        "momentum": number_option("How long the signal keeps its direction, in sample periods.", number),
        "fast": number_option("Two speeds: q is this many times larger while the signal moves.", number),
        "spikes": number_option("With --fast: probability that a reading is a spike, such as 0.01.", number),
        "chain": text_option("FILTERS", 'Filters to run, such as "median 5, kalman" or "one-euro 0.02 0.7 0.1".'),
    },
    _parameters,
)
"""The options in place of the parameter `given` of the command; see `with_options`."""


# The filter as a pipe: one line of numbers in, one line of filtered numbers out. No input or output here.


class LineFilter:
    """Answers each line of comma-separated channels with the filtered values, in the same order, or with one.

    A cell without a number (empty, "nan") is a missing sample: its channel predicts, its answer is empty. Fused
    channels have one answer, empty where all of them are missing. A line that cannot be read is a missing sample of
    all channels; a comment (# % //) is not a sample, and its answer is empty.
    """

    def __init__(self, filters: Filter | Sequence[Filter], sensors: int = 1) -> None:
        """Start the filters, with the first readable line.

        Args:
            filters: One for as many channels as that line has, or one for each group of channels.
            sensors: How many channels in a row each of them fuses.
        """
        self._filters, self._sensors = filters, sensors
        self._streams = [one.stream() for one in filters] if isinstance(filters, Sequence) else []
        self.received = 0
        """Lines received so far."""

    def answer(self, line: str) -> tuple[str, str]:
        """Take one line, with or without its newline.

        Returns:
            (answer, note): the filtered values, "" for a line without any; and for a line that cannot be read
            one sentence about it, else "".
        """
        self.received += 1
        text = line.strip().lstrip("\ufeff")  # PowerShell begins a pipe with a BOM
        if is_comment(text):
            return "", ""
        if not text:
            return self._miss(), ""
        values = [parse_number(cell.strip()) for cell in text.split(",")]
        samples = [value for value in values if value is not None]
        if len(samples) < len(values):
            return self._miss(), self._note("numbers with commas between them", text)
        if not isinstance(self._filters, Sequence) and not self._streams:
            self._streams = [self._filters.stream() for _ in samples]
        if len(samples) != self._channels:
            return self._miss(), self._note(plural(self._channels, "number"), text)
        return self._update(samples), ""

    @property
    def _channels(self) -> int:
        return self._sensors * len(self._streams)

    def _miss(self) -> str:
        self._update([math.nan] * self._channels)
        return ""

    def _note(self, must: str, text: str) -> str:
        return f"line {self.received} must hold {must} (got {text[:60]!r}): taken as missing"

    def _update(self, samples: Sequence[float]) -> str:
        m = self._sensors
        groups = [samples[i : i + m] for i in range(0, len(samples), m)]
        filtered = [
            float(stream.update(group if m > 1 else group[0]))
            for stream, group in zip(self._streams, groups, strict=True)
        ]
        return ",".join(
            "" if all(map(math.isnan, group)) else repr(x) for group, x in zip(groups, filtered, strict=True)
        )


# `kalscope filter`: a recording, or lines on stdin, through the filter.


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

    --q, --r, --p0, --x0, --gate and --momentum take precedence over --config. Without q and r they are those
    that `kalscope tune` finds. With "-" each line on stdin is answered by one line on stdout: empty for a missing
    sample, which the filter predicts over, and for a comment (# % //), which is not a sample.
    """
    from kalscope.catalogue import open_source
    from kalscope.common.files import check_new
    from kalscope.common.text import plain
    from kalscope.export.csv import filtered_csv_chunks
    from kalscope.sources.reading.account import account, sample_period_conflict
    from kalscope.tuning.choose import filters_for

    report_compiling()
    if source == "-":
        if report or output is not None:
            option = "--report" if report else "-o"
            raise BadSetting(f'{option} must be left out where SOURCE is "-": each line is answered as it arrives')
        chosen, notes = filters_for(None, config, given, channel, fuse, sample_period)
        filters = [one.filter for one in chosen]
        lines = LineFilter(filters if config else filters[0], len(chosen[0].sensors) or 1)
        _filter_stdin(lines, notes, reading)
        return
    if output is not None:
        if output.exists() and os.path.exists(source) and output.samefile(source):
            raise BadSetting(f"-o must be another file than SOURCE (got {source!r} twice)")
        check_new(output, force=force)
    with progress_line() as show:
        recording = open_source(source, reading, sample_period=sample_period, progress=show)
    chosen, notes = filters_for(recording, config, given, channel, fuse)
    write_output(filtered_csv_chunks(recording, chosen), output)
    if report:
        sys.stderr.write(plain(account(recording)))
    if sample_period is not None:
        notes = [*filter(None, [sample_period_conflict(recording)]), *notes]
    for note in notes:  # last, so that an error is the only line
        say(f"note: {note}")


def _filter_stdin(lines: LineFilter, notes: list[str], options: ReadOptions) -> None:
    """Answer each line at once: the program that writes them may wait for the answer."""
    from kalscope.common.stopping import message_at_stop
    from kalscope.common.text import count
    from kalscope.sources.reading.line_parser import LineParser, comma_line

    for note in notes:
        say(f"note: {note}")
    parser = LineParser(options)
    with open_stdout() as out, message_at_stop(lambda: f"{count(lines.received)} lines answered"):
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
