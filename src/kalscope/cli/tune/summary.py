"""The answer of `kalscope tune` in at most six lines: the reading, the filter, how sure it is, what to do next."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterator

from kalscope.analysis.actions import ChooseFilter
from kalscope.analysis.findings import as_sentences
from kalscope.cli.tune.advice import example, option_for
from kalscope.cli.tune.answer import CHOSEN, Answer
from kalscope.cli.tune.words import VERDICT_WORDS, WIDTH, between, momentum_and_gate, wrapped
from kalscope.common.text import decibels, duration, lag_in_full, percent, plural, squared, trimmed
from kalscope.recording import Recording
from kalscope.sources.readers import account

MAX_LINES = 6
"""Lines of the summary of a recording with one tuned channel; those on its reading may be wider than a page."""


def reading_lines(recording: Recording) -> list[str]:
    """How the recording was read: one line that a program can parse, and one more for large losses."""
    lines = [f"{recording.title or recording.source}: {account.summary(recording)}"]
    warnings = account.warnings(recording)
    return [*lines, f"Warning: {'. '.join(warnings)}."] if warnings else lines


def summary_of(answer: Answer, recording: Recording, lines: int) -> list[str]:
    """The channel in at most `lines` lines of the page, 4 or more; the last advice is cut where it is too long."""
    said = [_filter(answer), *_effect(answer), answer.judgement.headline]
    page = [line for one in said for line in wrapped(one)]
    for text in _next(answer, recording):
        if (room := lines - len(page)) > 0:
            page += textwrap.wrap(text, WIDTH, max_lines=room, placeholder=" … (--details)", break_on_hyphens=False)
    return page


def _filter(answer: Answer) -> str:
    params, name = answer.found.params, answer.channel
    if params is None:
        return f"{name}: no q and r to recommend ({VERDICT_WORDS[answer.verdict]})"
    q, r, unit = trimmed(params.q, 4), trimmed(float(params.r), 4), squared(answer.unit)
    aside = _aside(answer)
    spikes = f", {plural(aside, 'spike')} set aside" if aside else ""
    return f"{name}: q = {q}, r = {r} {unit}, {momentum_and_gate(params, answer.sample_period)}{spikes}"


def _aside(answer: Answer) -> int:
    """How many samples the fit set aside as spikes."""
    fit = answer.found.estimate
    return 0 if fit is None or fit.outliers is None else int(fit.outliers.sum())


def _effect(answer: Answer) -> Iterator[str]:
    steady, period = answer.steady, answer.sample_period
    if steady is None:
        return
    samples, over = steady.lag_samples, steady.overshoot
    lag = lag_in_full(samples, period).removesuffix(")")
    bracket = f"; {_allowed(answer)})" if "(" in lag else f" ({_allowed(answer)})"
    noise = decibels(-steady.noise_reduction_db)
    yield f"lag {lag}{bracket}, noise {noise}, {f'overshoot {percent(over)}' if over else 'no overshoot'}"


def _allowed(answer: Answer) -> str:
    """The lags that the record allows, or favours where the lag was chosen."""
    if answer.range.ratio_interval == (0.0, math.inf):
        return "the record allows any"
    short, long = answer.range.lag_interval
    period = answer.sample_period
    words = between(short, long) if period is None else between(short * period, long * period, words=duration)
    return f"the record favours {words}" if answer.verdict == CHOSEN else f"95 %: {words}"


def _next(answer: Answer, recording: Recording) -> Iterator[str]:
    """What to do, most urgent first: with a pair at least how to save it, without one how to choose a filter."""
    if answer.found.params is None and account.warnings(recording):
        yield "Next: fix how the file is read first; the rest holds for the samples that could be read"
    advice = answer.judgement.findings
    for one in advice:
        option = option_for(one.action, answer, recording)
        how = f", {'' if option.startswith('without') else 'with '}{option}" if option else ""
        said = as_sentences(one.text) if ". " in one.text else one.text
        yield f"{'Note' if one.action is None else 'Next'}{how}: {said}"
    if answer.found.params is None and not any(isinstance(one.action, ChooseFilter) for one in advice):
        yield f"Next, with {example(answer)}: choose a filter by its lag, its cut-off or its gain"
    elif not advice and _aside(answer):
        yield (
            "Next: nothing to correct if the spikes are errors; if they belong to the signal, such as heartbeats, "
            "--no-robust keeps them"
        )
    elif not advice:
        yield "Next: nothing to correct; -o tuning.toml saves it, --details shows more"
