"""Commands on pages of the site, run while it is built: their output and pictures are those of this version.

A block that begins with ```sh run holds commands of kalscope, one that begins with ```python run a program; the
site shows below it what it prints. A command that ends with & runs beside the others until the page is done, and
the next one waits for its first line. A line ![…](tuning.toml) draws the recording of that tuning file: raw,
filtered and, where it is known, the truth, with a page on which q can be dragged; a line ![…](sample:…) or
![…](synthetic:…) draws that recording with the filter of 0.1.0 and the first answer. The blocks of a page share an
empty folder, its programs their names.
"""

from __future__ import annotations

import contextlib
import io
import os
import re
import shlex
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from kalscope import FilterParams, Recording, kalman_filter, load_tuning, open_source, steady_state
from kalscope.analysis.channel_kinds import default_channel
from kalscope.cli.app import run
from kalscope.common.charts import Line, Panel, draw_svg, raw_and_filtered
from kalscope.common.numbers import Array
from kalscope.common.text import first_sentence, lag_text, number, percent
from kalscope.estimation.request import find_parameters
from kalscope.estimation.settings import noise_left
from kalscope.export.page import make_page

BLOCK = re.compile(r"^```(sh|python) run\n(.*?)^```$", re.MULTILINE | re.DOTALL)
PICTURE = re.compile(r"^!\[([^\]]*)\]\((\w+\.toml)\)$", re.MULTILINE)
BEFORE_AND_AFTER = re.compile(r"^!\[([^\]]*)\]\(((?:sample|synthetic):\S+)\)$", re.MULTILINE)
SPEED = re.compile(r" in [^,\n]+, [^,\n]+ rows/s[^\n]*")
"""What depends on the machine that builds the site."""
PROGRAM = (sys.executable, "-m", "kalscope.cli")
APART = ("fleet",)
"""Commands that start worker processes: each worker would start like this process, by building the site."""
PAGES: dict[str, str] = {}
"""Pages with sliders, by their paths in the site."""
DRAWN = 500
"""Samples drawn in a picture."""


def on_page_markdown(markdown: str, **_: object) -> str:
    """Called by mkdocs."""
    return with_answers(markdown)


def on_post_build(config: Any, **_: object) -> None:
    """Called by mkdocs: writes the pages with sliders, and the one that reads tables."""
    for name, text in {"try.html": make_page(), **PAGES}.items():
        path = Path(config.site_dir, name)
        path.parent.mkdir(exist_ok=True)
        path.write_text(text, encoding="utf-8")


def with_answers(markdown: str) -> str:
    """The page with the output of each block below it, and its pictures.

    Raises:
        RuntimeError: A command has failed.
    """
    names: dict[str, Any] = {}
    with contextlib.ExitStack() as beside:

        def answered(block: re.Match[str]) -> str:
            language, text = block[1], block[2]
            printed = answers(text, beside) if language == "sh" else program(text, names)
            return f"```{language}\n{text}```\n\n```text\n{printed}```" if printed else f"```{language}\n{text}```"

        beside.enter_context(contextlib.chdir(beside.enter_context(tempfile.TemporaryDirectory())))
        page = BLOCK.sub(answered, markdown)
        page = PICTURE.sub(lambda found: picture(Path(found[2]), found[1]), page)
        return BEFORE_AND_AFTER.sub(lambda found: before_and_after(found[2], found[1]), page)


def program(text: str, names: dict[str, Any]) -> str:
    """What a Python program prints; `names` are those of the programs before it on the page."""
    with contextlib.redirect_stdout(io.StringIO()) as out:
        exec(compile(text, "page", "exec"), names)
    return out.getvalue()


def answers(block: str, beside: contextlib.ExitStack) -> str:
    """What the commands of a block print; a backslash at its end continues a command."""
    printed = ""
    for line in block.replace("\\\n", "").splitlines():  # as a shell joins them
        name, *arguments = shlex.split(line, comments=True)
        if name != "kalscope":
            raise RuntimeError(f"a command of a page must be kalscope (got {line})")
        if arguments[-1] == "&":
            printed += _beside(arguments[:-1], beside)
        else:
            status, out, err = _in_a_process(arguments) if arguments[0] in APART else _here(arguments)
            if status:
                raise RuntimeError(f"{line} ended with {status}: {err}")
            printed += SPEED.sub(" in …", out)
    return printed


def _here(arguments: list[str]) -> tuple[int, str, str]:
    """Status, output and errors of a command, run in this process because starting another takes two seconds."""
    out, err = (io.TextIOWrapper(io.BytesIO(), "utf-8", write_through=True) for _ in range(2))
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        status = run(arguments)
    return status, said(out), said(err)


def _in_a_process(arguments: list[str]) -> tuple[int, str, str]:
    """Status, output and errors of a command in a process of its own."""
    done = subprocess.run([*PROGRAM, *arguments], check=False, capture_output=True, text=True)
    return done.returncode, done.stdout, done.stderr


def _beside(arguments: list[str], until: contextlib.ExitStack) -> str:
    """Start a command that runs until the page is done; its first line."""
    env = os.environ | {"PYTHONUNBUFFERED": "1"}
    started = subprocess.Popen([*PROGRAM, *arguments], stdout=subprocess.PIPE, text=True, env=env)
    until.callback(started.communicate)
    until.callback(started.terminate)
    assert started.stdout is not None
    return started.stdout.readline()


def said(stream: io.TextIOWrapper) -> str:
    """What was written."""
    stream.seek(0)
    return stream.read()


def before_and_after(source: str, name: str) -> str:
    """The first samples of a recording with the filter that it began with until 0.1.0 and with the first answer."""
    recording = open_source(source)
    at, period = recording.index(default_channel(recording)), recording.sample_period
    raw, truth = recording.values[:, at], None if recording.truth is None else recording.truth[:, at]
    found, r = find_parameters(raw, sample_period=period), float(np.nanvar(np.diff(raw))) / 2.0
    assert found.params is not None
    filters = {"until 0.1.0": FilterParams(q=r / 100.0, r=r), "first answer": found.params}
    curves = {label: kalman_filter(raw, params).x for label, params in filters.items()}
    texts = [
        f"{label[:1].upper()}{label[1:]}: a lag of {lag_text(steady_state(params).lag_samples, period)} leaves "
        f"{percent(noise_left(params))} of the noise."
        for label, params in filters.items()
    ]
    texts += [] if truth is None else [f"{_errors(truth, {'raw': raw, **curves})}."]
    time = recording.time[:DRAWN]
    lines = [Line(time, raw[:DRAWN], "raw", "raw")]
    lines += [
        Line(time, x[:DRAWN], label, style) for style, (label, x) in zip(("s1", "s2"), curves.items(), strict=True)
    ]
    lines += [] if truth is None else [Line(time, truth[:DRAWN], "truth", "truth")]
    y_label = " ".join(filter(None, (recording.names[at], recording.units[at])))
    panel = Panel(title=name, lines=tuple(lines), x_label="time (s)" if period else "samples", y_label=y_label)
    return f"{_figure(panel, name)}\n\n{' '.join(texts)} {first_sentence(found.message)}."


def picture(tuning_file: Path, name: str) -> str:
    """The first samples of the recording of a tuning file, as an <svg> element."""
    tuning = load_tuning(tuning_file)
    recording, one = open_source(tuning.source), tuning.channels[0]
    at = recording.index(one.name)
    raw, filtered = recording.values[:, at], kalman_filter(recording.values[:, at], one.params).x
    truth = None if recording.truth is None else recording.truth[:, at]
    low, high = np.nanpercentile(raw[:DRAWN], [1, 99])
    margin = 0.2 * (high - low)
    panel = Panel(
        title="" if truth is None else _errors(truth, {"raw": raw, "filtered": filtered}),
        lines=_lines(recording, raw, filtered, truth),
        x_label="time (s)",
        y_label="value",
        y_range=(float(low - margin), float(high + margin)),
    )
    page = f"pages/{tuning_file.stem}-{len(PAGES) + 1}.html"
    PAGES[page] = make_page(recording, [one])
    return f'{_figure(panel, name)}\n\n<a href="../{page}">Drag q, r and momentum of this recording.</a>'


def _figure(panel: Panel, name: str) -> str:
    drawn = draw_svg([panel], name, height=300).replace("\n", " ")  # Markdown ends HTML at an empty line
    return f"<figure>{drawn}</figure>"


def _lines(recording: Recording, raw: Array, filtered: Array, truth: Array | None) -> tuple[Line, ...]:
    time = np.arange(len(raw), dtype=float) if recording.time is None else recording.time
    drawn = raw_and_filtered(time[:DRAWN], raw[:DRAWN], filtered[:DRAWN])
    return drawn if truth is None else (*drawn, Line(time[:DRAWN], truth[:DRAWN], "truth", "truth"))


def _errors(truth: Array, curves: dict[str, Array]) -> str:
    """How far each is from the truth over the whole recording."""
    errors = {label: float(np.sqrt(np.nanmean((curve - truth) ** 2))) for label, curve in curves.items()}
    texts = (f"{label} {number(error, 3)}" for label, error in errors.items())
    return f"RMS distance from the truth: {', '.join(texts)}"
