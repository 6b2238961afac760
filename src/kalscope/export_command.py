"""`kalscope export`: a tuning file becomes the files of a target, in a folder or on stdout."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from kalscope.errors import BadSetting

if TYPE_CHECKING:
    from kalscope.recording import Recording
    from kalscope.tuning import Tuning

CHOICES = "arduino, c, python, matlab, json, ros2, platformio, esphome, bachagas, kalmanjs"
"""The targets that write something; said here too, so that --help need not import the filter."""

UNO_COUNTS = 1023.0
"""Largest value of analogRead() on an Uno: the signal, where none is known."""


def export_command(
    tuning: Annotated[Path, typer.Argument(metavar="TUNING", help="Tuning file with q and r.")],
    target: Annotated[str, typer.Option("--to", metavar="TARGET", help=f"One of {CHOICES}.")],
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="DIR", help="Folder to write to; else the main file on stdout."),
    ] = None,
    channel: Annotated[str | None, typer.Option("--channel", metavar="NAME", help="Else all channels.")] = None,
    vectors: Annotated[
        str | None,
        typer.Option("--vectors", metavar="SOURCE", help="Add groundtruth.csv: this recording, filtered."),
    ] = None,
    sample_period: Annotated[
        str | None,
        typer.Option("--sample-period", metavar="NUMBER", help="Of the device, s: q is carried over to it."),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Write over files that are there.")] = False,
) -> None:
    """Export the tuned filter for the device or the program that is to run it."""
    from kalscope import cli
    from kalscope.export import carried_over, export_tuning
    from kalscope.sources import open_source
    from kalscope.tuning import load_tuning

    if vectors is not None and output is None:
        raise BadSetting("--vectors needs -o, the folder to write to (got none)")
    tuned = load_tuning(tuning)
    if sample_period is not None:
        tuned = carried_over(tuned, cli._number("--sample-period", sample_period))
    recording = None if vectors is None else open_source(vectors)
    files = export_tuning(tuned, target, channel=channel, vectors=recording)
    for message in [*_other_rate(recording, tuned), *limits_of(tuned, channel, target)]:
        cli._say(f"note: {message}")
    if output is None:
        (main, text), *others = files.items()
        cli._write(iter([text]), None)
        if others:
            cli._say(f"note: {main}; with -o DIR also {', '.join(name for name, _ in others)}")
        return
    written = write_files(files, output, force=force)
    cli._write((f"{path}\n" for path in written), None)


def _other_rate(vectors: Recording | None, tuning: Tuning) -> list[str]:
    """A sentence where the test vectors come from a recording of another sample period."""
    from kalscope.tuning import same_period

    period = None if vectors is None else vectors.sample_period
    if period is None or tuning.sample_period is None or same_period(period, tuning.sample_period):
        return []
    return [
        f"the test vectors filter one row a step as the device will; their rows are {period:.6g} s apart, the"
        f" tuning is for {tuning.sample_period:.6g} s"
    ]


def limits_of(
    tuning: Tuning, channel: str | None, target: str, level: Callable[[str], float] = lambda _: UNO_COUNTS
) -> list[str]:
    """What differs where a target computes in float32, a sentence each.

    Args:
        tuning: What is exported.
        channel: Of it only this one; None = all.
        target: A name of `kalscope.export.TARGETS`.
        level: Largest size of the signal of a channel, unit, by its name.
    """
    from kalscope.export.device_limits import FLOAT32_TARGETS, device_limits

    if target not in FLOAT32_TARGETS:
        return []

    chosen = tuning.channels if channel is None else (tuning.channel(channel),)
    said = [
        limit.message
        for one in chosen
        for limit in device_limits(
            one.params,
            level=level(one.name),
            sample_period=tuning.sample_period,
            channels=len(chosen),
            constant_gain=FLOAT32_TARGETS[target],
        )
    ]
    return list(dict.fromkeys(said))


def write_files(files: dict[str, str], folder: Path, *, force: bool = False) -> list[Path]:
    """Write the files of an export into a folder, which is made if it is missing; each whole or not at all.

    Args:
        files: Texts by file name, as `export_tuning` gives them.
        folder: Where to.
        force: Replace files that are there.

    Returns:
        What was written, as paths in `folder`.

    Raises:
        BadSetting: A name leads out of the folder; or a file is there and `force` is off: none is written then.
        OSError: The folder or a file cannot be written; files before it are.
    """
    from kalscope.atomic import check_inside, write_atomic

    targets = {name: check_inside(name, folder) for name in files}
    there = [name for name, path in targets.items() if path.exists()]
    if there and not force:
        raise BadSetting(f"-o must be a folder without {', '.join(there)}, or give --force (got {str(folder)!r})")
    folder.mkdir(parents=True, exist_ok=True)
    for name, path in targets.items():
        write_atomic(path, files[name].encode())
    return [folder / name for name in files]
