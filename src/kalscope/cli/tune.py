"""`kalscope tune`: the printed answer, and the tuning file."""

from __future__ import annotations

import json
import textwrap
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from kalscope.cli.options import SamplePeriod, Source, read_options, with_options
from kalscope.cli.tune_options import NO_FUSION, NOTHING, TuneOptions, fusion_options, tune_options
from kalscope.errors import BadSetting
from kalscope.sources.grammar.read_options import DEFAULTS, ReadOptions

if TYPE_CHECKING:
    from kalscope.cli.tune_answer import Answer
    from kalscope.recording import Recording

MAX_OTHERS = 24
"""Maximum number of other channels that are named; a car sends hundreds."""


@with_options(reading=read_options, options=tune_options, fusing=fusion_options)
def tune_command(
    source: Source,
    channel: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Channel to tune; default: the first that measures something."),
    ] = None,
    every: Annotated[bool, typer.Option("--all", help="Tune every channel.")] = False,
    options: TuneOptions = NOTHING,
    fusing: dict[str, Any] = NO_FUSION,
    sample_period: SamplePeriod = None,
    reading: ReadOptions = DEFAULTS,
    details: Annotated[
        bool, typer.Option("--details", help="Also print how it was found, the tests and four other methods.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print everything as one JSON object.")] = False,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="FILE", help="Save the tuning to this file.")
    ] = None,
) -> None:
    """Find q and r for a recording, and say why.

    By estimation, for a given lag, cut-off or noise reduction, or from known noise.
    """
    from kalscope.analysis.channel_kinds import default_channel
    from kalscope.catalogue import open_source
    from kalscope.cli.console import say, tell_compiling, write_output
    from kalscope.sources.reading.account import sample_period_conflict

    tell_compiling()
    if every and channel is not None:
        raise BadSetting(f"--all must be used without --channel (got --channel {channel!r})")
    options = replace(options, **fusing)
    options.refuse_others(channel, every)
    recording = open_source(source, reading, sample_period=sample_period)
    notes = [sample_period_conflict(recording)] if sample_period is not None else []
    if options.fuse is not None:
        from kalscope.cli import tune_fusion
        from kalscope.cli.console import progress_line
        from kalscope.cli.tune_answer import reading_lines
        from kalscope.common.progress import Progress

        with progress_line() as show:
            answer = tune_fusion.answer_fusion(recording, options, Progress(show))
        more = [] if output is None else tune_fusion.save_fusion(recording, answer, output)
        lines = [*tune_fusion.summary_of(answer), *(tune_fusion.details_of(answer) if details else [])]
        text = "\n".join([*reading_lines(recording), *lines]) + "\n"
        whole = tune_fusion.as_plain(answer) if as_json else {}
    else:
        names = recording.names if every else (channel or default_channel(recording),)
        answers = _answers(recording, names, options)
        more = [] if output is None else _save(recording, answers, output)
        text = _text(recording, answers, details)
        whole = _plain(recording, answers, every) if as_json else {}
    if as_json:
        text = _json(recording, whole)
    write_output(iter([text]), None)
    for note in filter(None, [*notes, *more]):
        say(f"note: {note}")


def _answers(recording: Recording, names: tuple[str, ...], options: TuneOptions) -> list[Answer]:
    """The answers of the channels, with progress on a terminal."""
    from kalscope.cli.console import progress_line
    from kalscope.cli.tune_answer import answer_for
    from kalscope.common.progress import Progress

    request = options.request(recording)
    with progress_line() as show:

        def progress_of(i: int) -> Progress:
            whole = Progress(lambda fraction, text: show(fraction, f"{names[i]}: {text}"))
            return whole.part(i / len(names), (i + 1) / len(names))

        return [answer_for(recording, name, request, progress_of(i), options.gate) for i, name in enumerate(names)]


def _text(recording: Recording, answers: list[Answer], details: bool) -> str:
    """The summary of each channel, and its details below it; the other channels where a line is left for them."""
    from kalscope.cli.tune_answer import MAX_LINES, WIDTH, details_of, reading_lines, summary_of
    from kalscope.sources.reading import account

    head = reading_lines(recording)
    lines = MAX_LINES - len(head) + len(account.read_as(recording))
    summaries = [summary_of(answer, recording, lines) for answer in answers]
    others = _others(recording, answers)
    room = len(answers) == 1 and len(summaries[0]) < lines
    if others and (room or details):
        summaries[-1].append(others if details else textwrap.shorten(others, WIDTH, placeholder=" …"))
    if details:
        summaries = [
            [*lines, "", *details_of(answer).splitlines()] for lines, answer in zip(summaries, answers, strict=True)
        ]
    between = f"\n{'-' * WIDTH}\n" if details else "\n\n"
    return "\n".join(head) + "\n" + between.join("\n".join(lines) for lines in summaries) + "\n"


def _others(recording: Recording, answers: list[Answer]) -> str:
    """The channels that were not tuned, and what they are; "" where there are none."""
    from kalscope.analysis.channel_kinds import with_kinds

    others = [name for name in recording.names if name not in {answer.channel for answer in answers}]
    words = ", ".join(with_kinds(recording, others[:MAX_OTHERS]))
    rest = f" and {len(others) - MAX_OTHERS} more" if len(others) > MAX_OTHERS else ""
    return f"Other channels (--channel, --all): {words}{rest}" if others else ""


def _plain(recording: Recording, answers: list[Answer], every: bool) -> dict[str, Any]:
    """One object: the channel's own, or with --all one that holds a list of them."""
    from kalscope.cli.tune_answer import as_plain

    plain = [as_plain(answer, recording) for answer in answers]
    return {"channels": plain} if every else plain[0]


def _json(recording: Recording, answer: dict[str, Any]) -> str:
    """The answer after what was read."""
    from kalscope.cli.tune_answer import finite
    from kalscope.sources.reading import account

    head = {"source": recording.source, "sha256": recording.sha256, "reading": account.as_plain(recording)}
    return json.dumps(finite({**head, **answer}), indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def _save(recording: Recording, answers: list[Answer], output: Path) -> list[str]:
    """Save the tuning of the channels that have a pair; returns notes about it for the user."""
    from kalscope.cli.tune_answer import VERDICT_WORDS
    from kalscope.cli.tune_options import save
    from kalscope.sources.reading import account
    from kalscope.tuning.tuning import ChannelTuning

    found = [
        ChannelTuning.of_params(one.channel, one.unit, one.found.params, one.found.how)
        for one in answers
        if one.found.params is not None
    ]
    without = [f"{one.channel}: {VERDICT_WORDS[one.verdict]}" for one in answers if one.found.params is None]
    if not found:
        lost = "".join(f"{sentence}. " for sentence in account.warnings(recording))
        none = f"-o needs a usable q and r, and the record gives none ({'; '.join(without)})"
        raise BadSetting(f"{lost}{none}: {_instead(answers[0])}")
    notes = [f"left out of the tuning: {'; '.join(without)}"] if without else []
    return notes + save(recording, found, {one.channel for one in answers}, output)


def _instead(answer: Answer) -> str:
    """What to do without a pair, in a few words."""
    first = {"no_noise": "give r (--still, --sigma)", "irregular": "take --method ml"}
    return (
        f"{first.get(answer.verdict, 'record while it moves')} or choose a filter (--lag-ms, --cutoff-hz, --gain)"
    )
