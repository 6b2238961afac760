"""The commands that write HTML: `report` and `page` for a recording and its tuning, `reproduce` for the papers."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from kalscope.cli.console import CHECK_FAILED, progress_line, report_compiling, say, write_output
from kalscope.cli.options import SamplePeriod, Source, reads_source
from kalscope.errors import BadSetting
from kalscope.sources.grammar.read_options import DEFAULTS, ReadOptions

if TYPE_CHECKING:
    from kalscope.papers.reproduction import Reproduction
    from kalscope.recording import Recording


# `kalscope report`: one page of HTML on a recording and its tuning.


@reads_source
def report_command(
    source: Source,
    config: Annotated[Path, typer.Option(metavar="FILE", help="Tuning file with q and r.")],
    output: Annotated[Path, typer.Option("-o", "--output", metavar="FILE", help="Write to this file: .html.")],
    channel: Annotated[
        str | None,
        typer.Option(
            metavar="NAME", help="Channel to report; default: the fusion in --config, else its selected channel."
        ),
    ] = None,
    sample_period: SamplePeriod = None,
    reading: ReadOptions = DEFAULTS,
    force: Annotated[bool, typer.Option("--force", help="Overwrite an existing FILE.")] = False,
) -> None:
    """Write a one-page report of a tuned recording.

    It shows the chart, the parameters, what they do, whether they fit, and the command that reopens it.
    """
    from dataclasses import replace

    from kalscope.common.files import write_atomic
    from kalscope.export.report import as_html, make_report
    from kalscope.tuning.choose import adapt_tuning, filters_for
    from kalscope.tuning.file import load_tuning

    tuning = load_tuning(config)
    fused = tuning.fusion is not None and channel is None
    recording = _opened(source, reading, sample_period, tuning.sample_period, output, force)
    if fused:
        (fusion,), notes = filters_for(recording, config, {})
        report = make_report(recording, tuning, fusion=fusion, config=str(config))
    else:
        chosen, notes = adapt_tuning(recording, tuning, channel=channel)
        entries = tuple(replace(entry, name=name) for name, entry in chosen.items())
        selected = channel or (tuning.selected if tuning.selected in chosen else entries[0].name)
        report = make_report(recording, replace(tuning, channels=entries, selected=selected), config=str(config))
    write_atomic(output, as_html(report).encode())
    for note in notes:
        say(f"note: {note}")


def _opened(
    source: str, reading: ReadOptions, given: float | None, tuned: float | None, output: Path, force: bool
) -> Recording:
    """The recording for a page; one that does not know its sample period takes that of its tuning."""
    from dataclasses import replace

    import numpy as np

    from kalscope.catalogue import open_source
    from kalscope.common.files import check_new

    report_compiling()
    if output.suffix.lower() not in (".html", ".htm"):
        raise BadSetting(f"-o must end with .html (got {str(output)!r})")
    check_new(output, force=force)
    with progress_line() as progress:
        recording = open_source(source, reading, sample_period=given, progress=progress)
    if recording.sample_period is not None or tuned is None:
        return recording
    return replace(recording, time=np.arange(len(recording)) * tuned, sample_period=tuned)


# `kalscope page`: a recording with its filter and sliders, for somebody who has not installed anything.


@reads_source
def page_command(
    source: Source,
    output: Annotated[Path, typer.Option("-o", "--output", metavar="FILE", help="Write to this file: .html.")],
    config: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Tuning file with q and r; default: what tune finds."),
    ] = None,
    channel: Annotated[str | None, typer.Option(metavar="NAME", help="Show this channel only.")] = None,
    sample_period: SamplePeriod = None,
    reading: ReadOptions = DEFAULTS,
    force: Annotated[bool, typer.Option("--force", help="Overwrite an existing FILE.")] = False,
) -> None:
    """Write a page with the recording, its filter and sliders, which opens in any browser.

    The page needs no program and no network: whoever opens it can change q, r, p0 and momentum and copy the code.
    """
    from kalscope.analysis.channel_kinds import default_channel
    from kalscope.common.files import write_atomic
    from kalscope.export.page import make_page
    from kalscope.tuning.choose import filters_for
    from kalscope.tuning.file import load_tuning

    tuned = None if config is None else load_tuning(config)
    recording = _opened(source, reading, sample_period, tuned and tuned.sample_period, output, force)
    filters, notes = filters_for(recording, config, {}, channel)
    selected = (tuned and tuned.selected) or default_channel(recording)
    write_atomic(output, make_page(recording, filters, selected).encode())
    for note in notes:
        say(f"note: {note}")


# `kalscope reproduce`: the source documents' figures and tables as one page, and its numbers as JSON.


def reproduce_command(
    output: Annotated[Path, typer.Option("-o", "--output", metavar="DIR", help="Folder to write into.")],
    as_json: Annotated[bool, typer.Option("--json", help="Print the numbers as JSON, not as a table.")] = False,
    force: Annotated[bool, typer.Option("--force", help="Overwrite existing files.")] = False,
) -> None:
    """Reproduce the results of the three source documents.

    Writes their tables and figures to index.html and results.json in DIR.

    Exit status 1 if a reproduced number is outside its tolerance.
    """
    from kalscope.common.files import check_new, make_folder, write_atomic
    from kalscope.papers.reproduction import reproduce

    page, numbers = output / "index.html", output / "results.json"
    check_new(page, numbers, force=force)
    make_folder(output)  # before the work, so that a failure is immediate
    with progress_line() as progress:
        done = reproduce(progress=progress)
    write_atomic(numbers, done.json.encode())
    write_atomic(page, done.html.encode())
    write_output(iter([done.json if as_json else summary(done, output)]), None)
    if done.failed:
        names = "; ".join(map(str, done.failed))
        say(f"{len(done.failed)} of {len(done.checks)} numbers are outside their tolerance: {names}")
        raise typer.Exit(CHECK_FAILED)


def summary(done: Reproduction, folder: Path) -> str:
    """Table 1 and the path of the page, as text."""
    from kalscope.common.text import one_line

    lines = [f"{'R':>6} {'Q':>6} {'printed':>10} {'simulated':>10} {'theory':>10}"]
    for row in done.results["noise_reducer"]["table_1"]:
        numbers = " ".join(f"{row[key]:10.4f}" for key in ("printed", "simulated", "theoretical"))
        lines.append(f"{row['r']:6g} {row['q']:6g} {numbers}")
    within = len(done.checks) - len(done.failed)
    lines.append(f"{within} of {len(done.checks)} reproduced numbers are within their tolerance.")
    lines.append(f"Page: {one_line(str(folder / 'index.html'))}")
    return "\n".join(lines) + "\n"
