"""`kalscope export`: a tuning file becomes the files of a target, in a folder or on stdout."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from kalscope.cli.options import number_option, reads_source
from kalscope.errors import BadSetting
from kalscope.sources.grammar.read_options import DEFAULTS, ReadOptions

if TYPE_CHECKING:
    from kalscope.recording import Recording
    from kalscope.tuning.tuning import Tuning


def _list_targets(target: str) -> str:
    """Print the targets, each with what it is, where they are asked for; else the target as it is."""
    if target != "list":
        return target
    from kalscope.cli.console import write_output
    from kalscope.export.registry import TARGETS

    write_output((f"{name:24}{each.what}\n" for name, each in TARGETS.items()), None)
    raise typer.Exit


@reads_source
def export_command(
    tuning: Annotated[Path, typer.Argument(metavar="TUNING", help="Tuning file with q and r.")],
    target: Annotated[
        str,
        typer.Option(
            "--to",
            metavar="TARGET",
            callback=_list_targets,
            is_eager=True,
            help="Such as arduino or esphome; list explains each.",
        ),
    ],
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="DIR", help="Folder to write to; default: the main file on stdout."),
    ] = None,
    channel: Annotated[
        str | None,
        typer.Option(
            metavar="NAME", help="Export this channel only; default: the fusion if there is one, else all."
        ),
    ] = None,
    vectors: Annotated[
        str | None, typer.Option(metavar="SOURCE", help="Add groundtruth.csv: this recording, filtered.")
    ] = None,
    sample_period: Annotated[
        float | None, number_option("Sample period of the device, s; rescales q and momentum.")
    ] = None,
    calibration: Annotated[
        bool, typer.Option("--calibration", help="Write a sketch that can measure r on command (arduino).")
    ] = False,
    minimal: Annotated[
        bool, typer.Option("--minimal", help="Write a sketch without commands: filter and loop only (arduino).")
    ] = False,
    force: Annotated[bool, typer.Option("--force", help="Overwrite existing files.")] = False,
    reading: ReadOptions = DEFAULTS,
) -> None:
    """Write a tuned filter as code for a device or a program."""
    from kalscope.catalogue import open_source
    from kalscope.cli.console import say
    from kalscope.export.registry import export_tuning, limits_of
    from kalscope.tuning.file import load_tuning
    from kalscope.tuning.tuning import rescaled_to_period

    if vectors is not None and output is None:
        raise BadSetting("--vectors needs -o, the folder to write to (got none)")
    if vectors is None and reading != DEFAULTS:
        raise BadSetting("options about reading need --vectors, the file to be read (got none)")
    tuned = load_tuning(tuning).only(channel)
    if sample_period is not None:
        tuned = rescaled_to_period(tuned, sample_period)
    recording = None if vectors is None else open_source(vectors, reading)
    files = export_tuning(tuned, target, vectors=recording, calibration=calibration, minimal=minimal)
    if tuned.fusion is not None:
        fused = ", ".join(tuned.fusion.sensors)
        say(f"note: this is the filter that fuses {fused}; --channel NAME exports that of one channel")
    for message in (*_other_rate(recording, tuned), *limits_of(tuned, target)):
        say(f"note: {message}")
    _write(files, output, force=force)


def _write(files: dict[str, str], output: Path | None, *, force: bool) -> None:
    """Write the files to the folder, and their paths to stdout; without a folder, the main file to stdout."""
    from kalscope.cli.console import say, write_output
    from kalscope.export.registry import sketch_name, write_files

    if output is None:
        (main, text), *others = files.items()
        write_output(iter([text]), None)
        if others:
            say(f"note: {main}; with -o DIR also {', '.join(name for name, _ in others)}")
        return
    written = write_files(files, output, force=force)
    sketch = sketch_name(files)
    if sketch and output.resolve().name != sketch:
        say(f"note: the Arduino IDE opens a sketch only from a folder of its name, as with -o {output / sketch}")
    write_output((f"{path}\n" for path in written), None)


def _other_rate(vectors: Recording | None, tuning: Tuning) -> list[str]:
    """A sentence where the test vectors come from a recording of another sample period."""
    from kalscope.tuning.tuning import same_period

    period = None if vectors is None else vectors.sample_period
    if period is None or tuning.sample_period is None or same_period(period, tuning.sample_period):
        return []
    return [
        f"the test vectors filter one row per step as the device will; their rows are {period:.6g} s apart, the"
        f" tuning is for {tuning.sample_period:.6g} s"
    ]
