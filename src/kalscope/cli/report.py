"""`kalscope report`: one page on a recording and its tuning, HTML or PNG."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from kalscope.cli.console import progress_line, say, tell_compiling
from kalscope.cli.options import SamplePeriod, Source, number, number_option, percentage, reads_source
from kalscope.errors import BadSetting
from kalscope.sources.grammar.read_options import DEFAULTS, ReadOptions

if TYPE_CHECKING:
    from kalscope.tuning.tuning import ChannelTuning


@reads_source
def report_command(
    source: Source,
    config: Annotated[Path, typer.Option(metavar="FILE", help="Tuning file with q and r.")],
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="FILE", help="Write to this file: .html or .png.")
    ],
    channel: Annotated[
        str | None, typer.Option(metavar="NAME", help="Default: the one that was on screen.")
    ] = None,
    momentum: Annotated[
        float | None, number_option("In sample periods, in place of that of --config; q and r stay.", number)
    ] = None,
    overshoot: Annotated[
        float | None,
        number_option(
            "Allowed overshoot of a step, percent: sets momentum and q at the lag of --config.", percentage
        ),
    ] = None,
    sample_period: SamplePeriod = None,
    reading: ReadOptions = DEFAULTS,
) -> None:
    """Write a page for the lab book: chart, parameters, what they do, whether they fit, and how to reopen it."""
    from dataclasses import replace

    import numpy as np

    from kalscope.catalogue import open_source
    from kalscope.common.files import write_atomic
    from kalscope.export.report.content import make_report
    from kalscope.export.report.page import as_html
    from kalscope.export.report.picture import as_png
    from kalscope.tuning.choose import adapt_tuning, with_momentum
    from kalscope.tuning.tuning_file import load_tuning

    tell_compiling()
    kind = output.suffix.lower()
    if kind not in (".html", ".htm", ".png"):
        raise BadSetting(f"-o must end with .html or .png (got {str(output)!r})")
    if momentum is not None and overshoot is not None:
        raise BadSetting("--overshoot must stand without --momentum, which follows from it (got both)")
    tuning = load_tuning(config)
    with progress_line() as progress:
        recording = open_source(source, reading, sample_period=sample_period, progress=progress)
    if recording.sample_period is None and tuning.sample_period is not None:
        moments = np.arange(len(recording)) * tuning.sample_period
        recording = replace(recording, time=moments, sample_period=tuning.sample_period)
    chosen, notes = adapt_tuning(recording, tuning, channel=channel)
    selected = channel or (tuning.selected if tuning.selected in chosen else next(iter(chosen)))
    changed = with_momentum(chosen[selected], momentum, overshoot)
    options = [] if changed == chosen[selected] else _options(selected, changed)
    own = tuple(replace(entry, name=name) for name, entry in {**chosen, selected: changed}.items())
    fitted = replace(tuning, channels=own, selected=selected)
    report = make_report(recording, fitted, config=str(config), options=options)
    write_atomic(output, as_png(report) if kind == ".png" else as_html(report).encode())
    for note in notes:
        say(f"note: {note}")


def _options(channel: str, changed: ChannelTuning) -> list[str]:
    """The options of `kalscope open` that change the filter of the tuning file to this one."""
    return ["--channel", channel, "--q", repr(changed.q), "--momentum", repr(changed.momentum)]
