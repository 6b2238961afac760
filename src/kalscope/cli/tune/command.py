"""`kalscope tune`: the printed answer, and the tuning file."""

from __future__ import annotations

import json
import textwrap
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from kalscope.cli.options import SamplePeriod, Source, read_options, with_options
from kalscope.cli.tune.fusion.options import NONE, FusionOptions, fusion_options
from kalscope.cli.tune.options import NOTHING, TuneOptions, tune_options
from kalscope.errors import BadSetting
from kalscope.sources.grammar.read_options import DEFAULTS, ReadOptions

if TYPE_CHECKING:
    from kalscope.cli.tune.answer import Answer
    from kalscope.recording import Recording

MAX_OTHERS = 24
"""Maximum number of other channels that are named; a car sends hundreds."""


@with_options(reading=read_options, asked=tune_options, fusing=fusion_options)
def tune_command(
    source: Source,
    channel: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Channel to tune; default: the first that measures something."),
    ] = None,
    every: Annotated[bool, typer.Option("--all", help="Tune every channel.")] = False,
    asked: TuneOptions = NOTHING,
    fusing: FusionOptions = NONE,
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
    from kalscope.sources.readers.account import sample_period_conflict

    tell_compiling()
    if every and channel is not None:
        raise BadSetting(f"--all must be used without --channel (got --channel {channel!r})")
    fusing.refuse_others(channel, every)
    recording = open_source(source, reading, sample_period=sample_period)
    notes = [sample_period_conflict(recording)] if sample_period is not None else []
    if fusing.names is not None:
        text, more = _fused(recording, asked, fusing, (details, as_json), output)
    else:
        names = recording.names if every else (channel or default_channel(recording),)
        answers = _answers(recording, names, asked)
        more = [] if output is None else _save(recording, answers, output)
        text = _json(recording, answers, every) if as_json else _text(recording, answers, details)
    write_output(iter([text]), None)
    for note in filter(None, [*notes, *more]):
        say(f"note: {note}")


def _fused(
    recording: Recording, asked: TuneOptions, fusing: FusionOptions, form: tuple[bool, bool], output: Path | None
) -> tuple[str, list[str]]:
    """The answer on fused channels as text, with details, or as JSON; saved, and notes on that."""
    from kalscope.cli.tune.fusion.command import json_of, save_fusion, text_of, tune_fusion

    details, as_json = form
    answer = tune_fusion(recording, asked, fusing)
    notes = [] if output is None else save_fusion(recording, answer, output)
    return json_of(recording, answer) if as_json else text_of(recording, answer, details), notes


def _answers(recording: Recording, names: tuple[str, ...], asked: TuneOptions) -> list[Answer]:
    """The answers of the channels, with progress on a terminal."""
    from kalscope.cli.console import progress_line
    from kalscope.cli.tune.answer import answer_for
    from kalscope.common.progress import Progress

    request = asked.request(recording)
    with progress_line() as show:

        def progress_of(i: int) -> Progress:
            whole = Progress(lambda fraction, text: show(fraction, f"{names[i]}: {text}"))
            return whole.part(i / len(names), (i + 1) / len(names))

        return [answer_for(recording, name, request, progress_of(i), asked.gate) for i, name in enumerate(names)]


def _text(recording: Recording, answers: list[Answer], details: bool) -> str:
    """The summary of each channel, and its details below it; the other channels where a line is left for them."""
    from kalscope.cli.tune.details import details_of
    from kalscope.cli.tune.summary import MAX_LINES, reading_lines, summary_of
    from kalscope.cli.tune.words import WIDTH

    head = reading_lines(recording)
    summaries = [summary_of(answer, recording, MAX_LINES - len(head)) for answer in answers]
    others = _others(recording, answers)
    room = len(answers) == 1 and len(head) + len(summaries[0]) < MAX_LINES
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


def _json(recording: Recording, answers: list[Answer], every: bool) -> str:
    """One object: the channel's own, or with --all one that holds a list of them."""
    from kalscope.cli.tune.plain import as_plain, finite
    from kalscope.sources.readers import account

    reading = finite(account.as_plain(recording))
    head = {"source": recording.source, "sha256": recording.sha256, "reading": reading}
    plain = [as_plain(answer, recording) for answer in answers]
    whole = {**head, "channels": plain} if every else {**head, **plain[0]}
    return json.dumps(whole, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def _save(recording: Recording, answers: list[Answer], output: Path) -> list[str]:
    """Save the tuning of the channels that have a pair; returns notes about it for the user."""
    from kalscope.cli.tune.saved import kept_channels, replaced_chains, saved_before
    from kalscope.cli.tune.words import VERDICT_WORDS
    from kalscope.sources.readers import account
    from kalscope.tuning.tuning import ChannelTuning, Tuning
    from kalscope.tuning.tuning_file import save_tuning

    found = [
        ChannelTuning(
            one.channel,
            one.unit,
            one.found.params.q,
            float(one.found.params.r),
            how=one.found.how,
            gate=one.found.params.gate,
            momentum=one.found.params.momentum,
        )
        for one in answers
        if one.found.params is not None
    ]
    without = [f"{one.channel}: {VERDICT_WORDS[one.verdict]}" for one in answers if one.found.params is None]
    if not found:
        lost = "".join(f"{sentence}. " for sentence in account.warnings(recording))
        none = f"-o needs a usable q and r, and the record gives none ({'; '.join(without)})"
        raise BadSetting(f"{lost}{none}: {_instead(answers[0])}")
    notes = [f"left out of the tuning: {'; '.join(without)}"] if without else []
    before = saved_before(recording, output)
    notes += replaced_chains({one.name for one in found}, before)
    kept = kept_channels(recording, {one.channel for one in answers}, before)
    if kept:
        notes.append(f"kept as they were in the tuning: {', '.join(one.name for one in kept)}")
    channels = sorted([*kept, *found], key=lambda one: recording.names.index(one.name))
    fusion = None if before is None else before.fusion
    tuning = Tuning.of(recording, channels, selected=found[0].name, fusion=fusion)
    save_tuning(tuning, output)
    return notes


def _instead(answer: Answer) -> str:
    """What to do without a pair, in a few words."""
    first = {"no_noise": "give r (--still, --sigma)", "irregular": "take --method ml"}
    return (
        f"{first.get(answer.verdict, 'record while it moves')} or choose a filter (--lag-ms, --cutoff-hz, --gain)"
    )
