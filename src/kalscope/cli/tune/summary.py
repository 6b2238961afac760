"""The answer of `kalscope tune` in at most six lines: the reading, the filter, how sure it is, what to do next."""

from __future__ import annotations

import math
from collections.abc import Iterator

from kalscope.analysis.actions import ChooseFilter
from kalscope.cli.tune.advice import example, option_for
from kalscope.cli.tune.answer import CHOSEN, Answer
from kalscope.cli.tune.words import VERDICT_WORDS, between
from kalscope.common.text import decibels, duration, lag_in_full, percent, squared, trimmed
from kalscope.filtering.arrays import scalar
from kalscope.recording import Recording
from kalscope.sources.readers import account

MAX_LINES = 6
"""Lines of the summary of a recording with one tuned channel."""


def reading_lines(recording: Recording) -> list[str]:
    """How the recording was read: one line, for a program to take, and one more where much could not be."""
    lines = [f"{recording.title or recording.source}: {account.summary(recording)}"]
    warnings = account.warnings(recording)
    return [*lines, f"Warning: {'. '.join(warnings)}."] if warnings else lines


def summary_of(answer: Answer, recording: Recording, lines: int) -> list[str]:
    """The channel in at most so many lines, 4 or more."""
    said = [_filter(answer), *_effect(answer), _sure(answer)]
    return [*said, *list(_next(answer, recording))[: lines - len(said)]]


def _filter(answer: Answer) -> str:
    params, name = answer.found.params, answer.channel
    if params is None:
        return f"{name}: no q and r to recommend ({VERDICT_WORDS[answer.verdict]})"
    q, r, unit = trimmed(scalar(params.q), 4), trimmed(scalar(params.r), 4), squared(answer.unit)
    return f"{name}: q = {q}, r = {r} {unit}, {_momentum(answer)}, {_gate(answer)}"


def _momentum(answer: Answer) -> str:
    tau = 0.0 if answer.found.params is None else scalar(answer.found.params.momentum)
    return f"momentum {lag_in_full(tau, answer.sample_period)}" if tau else "no momentum"


def _gate(answer: Answer) -> str:
    gate = None if answer.found.params is None else answer.found.params.gate
    return "no gate" if gate is None else f"gate {trimmed(scalar(gate) ** 0.5)} σ"


def _effect(answer: Answer) -> Iterator[str]:
    steady, period = answer.steady, answer.sample_period
    if steady is not None:
        lag = lag_in_full(scalar(steady.lag_samples), period)
        over = scalar(steady.overshoot)
        beyond = f"overshoots a step by {percent(over)}" if over else "does not overshoot"
        noise = decibels(scalar(steady.noise_reduction_db))
        yield f"It lags a ramp by {lag}, reduces white noise by {noise} and {beyond}."


def _sure(answer: Answer) -> str:
    return f"{answer.judgement.headline} {_allowed(answer)}"


def _allowed(answer: Answer) -> str:
    """Which lags the record allows, and whether a chosen one is among them."""
    if tuple(map(scalar, answer.range.ratio_interval)) == (0.0, math.inf):
        return "The record allows any lag."
    short, long = (scalar(end) for end in answer.range.lag_interval)
    period = answer.sample_period
    words = f"{between(short, long)} samples"
    if period is not None:
        words = between(short * period, long * period, words=duration)
    return f"The record allows a lag of {words} (95 %){_chosen(answer, short, long)}."


def _chosen(answer: Answer, short: float, long: float) -> str:
    if answer.verdict != CHOSEN or answer.steady is None or answer.momentum:
        return ""
    lag = scalar(answer.steady.lag_samples)
    return ": you chose more" if lag > long else ": you chose less" if lag < short else ": you chose one of them"


def _next(answer: Answer, recording: Recording) -> Iterator[str]:
    """What to do, most urgent first: with a pair at least that it can be kept, without one a command that works."""
    if answer.found.params is None and account.warnings(recording):
        yield "Next: mend the reading first; the rest holds for the samples that could be read"
    advice = answer.judgement.advice
    for one in advice:
        option = option_for(one.action, answer, recording)
        yield f"Next: {one.text}{f' ({option})' if option else ''}"
    if answer.found.params is None and not any(isinstance(one.action, ChooseFilter) for one in advice):
        yield f"Next: choose a filter, for example {example(answer, recording)}"
    elif not advice:
        yield "Next: nothing to correct; -o tuning.toml keeps it, --details says more"
