"""Commands on pages of the site, run while it is built: their answers and pictures are those of this version.

A block that begins with ```sh run holds commands of kalscope; the site shows what they print below it. A line
![…](tuning.toml) draws the recording of that tuning file: raw, filtered and, where it is known, the truth. The
commands of a page share an empty folder.
"""

from __future__ import annotations

import contextlib
import io
import re
import shlex
import tempfile
from pathlib import Path

import numpy as np

from kalscope import Recording, kalman_filter, load_tuning, open_source
from kalscope.cli.app import run
from kalscope.common.array import Array
from kalscope.common.charts import Line, Panel, draw_svg, raw_and_filtered
from kalscope.common.text import number

BLOCK = re.compile(r"^```sh run\n(.*?)^```$", re.MULTILINE | re.DOTALL)
PICTURE = re.compile(r"^!\[([^\]]*)\]\((\w+\.toml)\)$", re.MULTILINE)
DRAWN = 500
"""Samples of a picture."""


def on_page_markdown(markdown: str, **_: object) -> str:
    """What mkdocs asks of a hook."""
    return with_answers(markdown)


def with_answers(markdown: str) -> str:
    """The page with the answer of each block below it, and its pictures.

    Raises:
        RuntimeError: A command has failed.
    """
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        page = BLOCK.sub(lambda block: f"```sh\n{block[1]}```\n\n```text\n{answers(block[1])}```", markdown)
        return PICTURE.sub(lambda found: picture(Path(found[2]), found[1]), page)


def answers(block: str) -> str:
    """What the commands of a block print; a backslash at its end continues a command."""
    printed = ""
    for line in block.replace("\\\n", " ").splitlines():
        program, *arguments = shlex.split(line, comments=True)
        out, err = (io.TextIOWrapper(io.BytesIO(), "utf-8", write_through=True) for _ in range(2))
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            status = run(arguments)
        if program != "kalscope" or status:
            raise RuntimeError(f"{line} ended with {status}: {said(err)}")
        printed += said(out)
    return printed


def said(stream: io.TextIOWrapper) -> str:
    """What was written."""
    stream.seek(0)
    return stream.read()


def picture(tuning_file: Path, name: str) -> str:
    """The first samples of the recording of a tuning file, as an <svg> element."""
    tuning = load_tuning(tuning_file)
    recording, one = open_source(tuning.source), tuning.channels[0]
    at = recording.index(one.name)
    raw, filtered = recording.values[:, at], kalman_filter(recording.values[:, at], one.params).x
    truth = None if recording.truth is None else recording.truth[:, at]
    low, high = np.nanpercentile(raw[:DRAWN], [1, 99])
    room = 0.2 * (high - low)
    panel = Panel(
        title="" if truth is None else _errors(raw, filtered, truth),
        lines=_lines(recording, raw, filtered, truth),
        x_label="time (s)",
        y_label="value",
        y_range=(float(low - room), float(high + room)),
    )
    drawn = draw_svg([panel], name, height=300).replace("\n", " ")  # Markdown ends HTML at an empty line
    return f"<figure>{drawn}</figure>"


def _lines(recording: Recording, raw: Array, filtered: Array, truth: Array | None) -> tuple[Line, ...]:
    time = np.arange(len(raw), dtype=float) if recording.time is None else recording.time
    drawn = raw_and_filtered(time[:DRAWN], raw[:DRAWN], filtered[:DRAWN])
    return drawn if truth is None else (*drawn, Line(time[:DRAWN], truth[:DRAWN], "truth", "truth"))


def _errors(raw: Array, filtered: Array, truth: Array) -> str:
    """How far both are from the truth over the whole recording."""
    errors = (number(float(np.sqrt(np.nanmean((curve - truth) ** 2))), 3) for curve in (raw, filtered))
    return "RMS distance from the truth: raw {}, filtered {}".format(*errors)
