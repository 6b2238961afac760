"""`kalscope tune`: the options, the printed answer, and the tuning file."""

from __future__ import annotations

import json
import math
import textwrap
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from kalscope.cli.options import SamplePeriod, Source, number_option, number_or, percentage, reads_source
from kalscope.errors import BadSetting
from kalscope.sources.grammar.read_options import DEFAULTS, ReadOptions

if TYPE_CHECKING:
    from kalscope.cli.tune.answer import Answer, TuneRequest
    from kalscope.recording import Recording
    from kalscope.tuning.tuning import ChannelTuning

Given = dict[str, float]
"""The options with a number that were given, by name."""

FOR_LAMBDA = ("--lag-ms", "--cutoff-hz", "--noise-reduction-db", "--gain", "--ratio")
FOR_NOISE = ("--still", "--sigma", "--density", "--r")
SPECIFICATIONS = {
    "--lag-ms": ("lag_s", 1e-3),
    "--cutoff-hz": ("cutoff_hz", 1.0),
    "--noise-reduction-db": ("noise_reduction_db", 1.0),
    "--gain": ("gain", 1.0),
}
"""The options that specify the filter: the word of `find_parameters`, and its value over that of the option."""

MAX_OTHERS = 24
"""Channels beside the tuned one that are named; a car sends hundreds."""


@reads_source
def tune_command(
    source: Source,
    channel: Annotated[
        str | None, typer.Option(metavar="NAME", help="Else the first that measures something.")
    ] = None,
    every: Annotated[bool, typer.Option("--all", help="Tune every channel.")] = False,
    method: Annotated[
        str | None, typer.Option(metavar="NAME", help="ml (default), em, moments, als or allan.")
    ] = None,
    lag_ms: Annotated[float | None, number_option("Wanted: lag behind a ramp, ms.")] = None,
    cutoff_hz: Annotated[float | None, number_option("Wanted: −3 dB frequency, Hz.")] = None,
    noise_reduction_db: Annotated[float | None, number_option("Wanted: white noise less, dB.")] = None,
    gain: Annotated[float | None, number_option("Wanted: steady gain, 0 to 1.")] = None,
    overshoot: Annotated[
        float | None, number_option("Allowed with one of these: percent beyond a step; gives momentum.", percentage)
    ] = None,
    ratio: Annotated[float | None, number_option("Wanted: q/r, such as 0.01; r is estimated.")] = None,
    still: Annotated[
        str | None,
        typer.Option(
            metavar="FROM:TO",
            help="Constant input from … to, s (sample numbers without time): gives r.",
        ),
    ] = None,
    sigma: Annotated[float | None, number_option("Data sheet: RMS noise, unit; gives r.")] = None,
    density: Annotated[float | None, number_option("Data sheet: noise density, unit/√Hz; gives r.")] = None,
    bandwidth_hz: Annotated[float | None, number_option("Noise bandwidth for --density, Hz.")] = None,
    r: Annotated[float | None, number_option("Known measurement-noise variance, unit²; q is estimated.")] = None,
    momentum: Annotated[
        float | None,
        number_option(
            'Sample periods that the signal keeps its direction, or "auto" (default).', number_or("auto")
        ),
    ] = None,
    sample_period: SamplePeriod = None,
    reading: ReadOptions = DEFAULTS,
    as_json: Annotated[bool, typer.Option("--json", help="Print everything as one JSON object.")] = False,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="FILE", help="Save the tuning to this file.")
    ] = None,
) -> None:
    """Find q and r for a recording and say why: by estimation, by a specified lag or cut-off, or by known noise."""
    from kalscope.analysis.channel_kinds import default_channel
    from kalscope.catalogue import open_source
    from kalscope.cli.console import say, write_output
    from kalscope.sources.readers.account import sample_period_conflict

    numbers = {
        "--lag-ms": lag_ms,
        "--cutoff-hz": cutoff_hz,
        "--noise-reduction-db": noise_reduction_db,
        "--gain": gain,
        "--overshoot": overshoot,
        "--ratio": ratio,
        "--sigma": sigma,
        "--density": density,
        "--bandwidth-hz": bandwidth_hz,
        "--r": r,
        "--sample-period": sample_period,
    }
    given = {name: value for name, value in numbers.items() if value is not None}
    _refuse_contradictions(given, method, still, channel, every)
    recording = open_source(source, reading, sample_period=sample_period)
    request = _request(given, method or "ml", still, recording)
    if momentum is not None and not math.isnan(momentum):
        request = replace(request, momentum=momentum)
    answers = _answers(recording, recording.names if every else (channel or default_channel(recording),), request)
    notes = [sample_period_conflict(recording)] if "--sample-period" in given else []
    notes += [] if output is None else _save(recording, answers, output)
    write_output(iter([_json(recording, answers, every) if as_json else _text(recording, answers)]), None)
    for note in filter(None, notes):
        say(f"note: {note}")


def _refuse_contradictions(
    given: Given, method: str | None, still: str | None, channel: str | None, every: bool
) -> None:
    named = [*given, *([] if still is None else ["--still"])]
    for group, must in ((FOR_LAMBDA, "decide q/r"), (FOR_NOISE, "give r")):
        several = [name for name in group if name in named]
        if len(several) > 1:
            raise BadSetting(f"only one of {', '.join(group)} can {must} (got {' and '.join(several)})")
    if "--overshoot" in given and not any(name in given for name in SPECIFICATIONS):
        raise BadSetting(f"--overshoot needs one of {', '.join(SPECIFICATIONS)} (got none)")
    if ("--density" in given) != ("--bandwidth-hz" in given):
        alone = "--density" if "--density" in given else "--bandwidth-hz"
        raise BadSetting(f"--density and --bandwidth-hz must be given together (got only {alone})")
    deciding = [name for name in (*FOR_LAMBDA, *FOR_NOISE) if name in named]
    if method not in (None, "ml") and deciding:
        raise BadSetting(f"--method {method} must stand without {deciding[0]}, which decides instead (got both)")
    if every and channel is not None:
        raise BadSetting(f"--all must stand without --channel (got --channel {channel!r})")


def _request(given: Given, method: str, still: str | None, recording: Recording) -> TuneRequest:
    """The options in the words of `find_parameters`."""
    from kalscope.cli.tune.answer import TuneRequest
    from kalscope.estimation.finding import Noise

    specified = [name for name in SPECIFICATIONS if name in given]
    for name in specified:
        if name in ("--lag-ms", "--cutoff-hz") and recording.sample_period is None:
            raise BadSetting(f"{name} needs the time between two samples: give --sample-period (got none)")
    target = {SPECIFICATIONS[name][0]: given[name] * SPECIFICATIONS[name][1] for name in specified}
    noise = Noise(
        r=given.get("--r"),
        sigma=given.get("--sigma"),
        density=given.get("--density"),
        bandwidth_hz=given.get("--bandwidth-hz"),
        still=None if still is None else still_samples(recording, still),
    )
    return TuneRequest(method, target, given.get("--ratio"), noise, overshoot=given.get("--overshoot"))


def _answers(recording: Recording, names: tuple[str, ...], request: TuneRequest) -> list[Answer]:
    """The answers of the channels, with progress on a terminal."""
    from kalscope.cli.console import progress_line
    from kalscope.cli.tune.answer import answer_for
    from kalscope.common.progress import Progress

    with progress_line() as show:

        def progress_of(i: int) -> Progress:
            whole = Progress(lambda fraction, text: show(fraction, f"{names[i]}: {text}"))
            return whole.part(i / len(names), (i + 1) / len(names))

        return [answer_for(recording, name, request, progress_of(i)) for i, name in enumerate(names)]


def still_samples(recording: Recording, text: str) -> tuple[int, int]:
    """The samples of "FROM:TO" in s of the recording's time, both ends included: the first, and one past the last.

    Raises:
        BadSetting: not two rising numbers, no sample between them, or time steps back between them.
    """
    try:
        first, last = (float(part) for part in text.split(":"))
    except ValueError:
        first, last = math.nan, math.nan
    if not first < last:
        raise BadSetting(f"--still must be FROM:TO, two rising numbers such as 2:5.5 (got {text!r})")
    inside = ((recording.time >= first) & (recording.time <= last)).nonzero()[0]
    unit = " s" if recording.sample_period is not None else ""
    if len(inside) == 0:
        low, high = float(recording.time.min()), float(recording.time.max())
        raise BadSetting(f"--still must lie in the recording, {low:.12g}:{high:.12g}{unit} (got {text!r})")
    start, stop = int(inside[0]), int(inside[-1]) + 1
    if stop - start > len(inside):
        raise BadSetting(f"--still must be one stretch, but time steps back in it (got {text!r})")
    return start, stop


def _text(recording: Recording, answers: list[Answer]) -> str:
    from kalscope.analysis.channel_kinds import with_kinds
    from kalscope.cli.tune.page import WIDTH, reading_text, text_of

    pages = reading_text(recording)
    pages += f"\n{'-' * WIDTH}\n".join(text_of(answer, recording) for answer in answers)
    others = [name for name in recording.names if name not in {answer.channel for answer in answers}]
    if others:
        words = ", ".join(with_kinds(recording, others[:MAX_OTHERS]))
        rest = f" and {len(others) - MAX_OTHERS} more" if len(others) > MAX_OTHERS else ""
        more = textwrap.wrap(f"Other channels (--channel, --all): {words}{rest}", WIDTH)
        pages += "\n" + "\n".join(more) + "\n"
    return pages


def _json(recording: Recording, answers: list[Answer], every: bool) -> str:
    """One object: the channel's own, or with --all one that holds a list of them."""
    from kalscope.cli.tune.answer import as_plain, finite
    from kalscope.sources.readers import account

    reading = finite(account.as_plain(recording))
    head = {"source": recording.source, "sha256": recording.sha256, "reading": reading}
    plain = [as_plain(answer) for answer in answers]
    whole = {**head, "channels": plain} if every else {**head, **plain[0]}
    return json.dumps(whole, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def _save(recording: Recording, answers: list[Answer], output: Path) -> list[str]:
    """Save the tuning of the channels that have a pair; returns notes about it for the user."""
    from kalscope.cli.tune.page import VERDICT_WORDS
    from kalscope.filtering.arrays import scalar
    from kalscope.sources.readers import account
    from kalscope.tuning.tuning import ChannelTuning, Tuning, save_tuning

    found = [
        ChannelTuning(
            one.channel,
            one.unit,
            scalar(one.found.params.q),
            scalar(one.found.params.r),
            how=one.found.how,
            momentum=scalar(one.found.params.momentum),
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
    kept = _kept(recording, {one.channel for one in answers}, output)
    if kept:
        notes.append(f"kept as they were in the tuning: {', '.join(one.name for one in kept)}")
    channels = sorted([*kept, *found], key=lambda one: recording.names.index(one.name))
    tuning = Tuning(
        tuple(channels),
        source=recording.source,
        source_name=recording.title,
        sha256=recording.sha256,
        sample_period=recording.sample_period,
        selected=found[0].name,
    )
    save_tuning(tuning, output)
    return notes


def _instead(answer: Answer) -> str:
    """What to do without a pair, in a few words."""
    first = {"no_noise": "give r (--still, --sigma)", "irregular": "take --method ml"}
    return (
        f"{first.get(answer.verdict, 'record while it moves')} or choose a filter (--lag-ms, --cutoff-hz, --gain)"
    )


def _kept(recording: Recording, tuned: set[str], output: Path) -> list[ChannelTuning]:
    """Other channels that a tuning file of this recording already holds: they were tuned before."""
    from kalscope.errors import BadFile
    from kalscope.tuning.tuning import load_tuning

    try:
        before = load_tuning(output) if output.is_file() else None
    except BadFile:
        return []  # save_tuning says what is wrong with it
    if before is None or before.sha256 != recording.sha256 or before.sample_period != recording.sample_period:
        return []
    return [one for one in before.channels if one.name in recording.names and one.name not in tuned]
