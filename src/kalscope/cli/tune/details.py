"""What `kalscope tune --details` adds: how the pair was found, what it does, second opinions, tests."""

from __future__ import annotations

import math
from collections.abc import Iterator

from kalscope.analysis.diagnostics import expected_nis
from kalscope.analysis.estimators import WITHOUT_NUMBERS, comparison, is_within
from kalscope.analysis.findings import as_sentences
from kalscope.analysis.judge import advice_words
from kalscope.cli.tune.answer import CHOSEN, Answer
from kalscope.cli.tune.words import VERDICT_WORDS, between, wrapped
from kalscope.common.text import (
    correlation,
    count,
    decibels,
    duration,
    frequency,
    gate_text,
    lag_in_full,
    number,
    percent,
    squared,
    trimmed,
)
from kalscope.estimation.finding import METHOD_NAMES
from kalscope.estimation.result import Estimate
from kalscope.estimation.verdict.conclude import lag_of
from kalscope.filtering.arrays import scalar
from kalscope.filtering.params import FilterParams
from kalscope.filtering.steady_state import SteadyState, steady_state


def details_of(answer: Answer) -> str:
    """All that the summary of one channel leaves out, as one text."""
    parts = (_pair(answer), _meaning(answer), _opinions(answer), _trust(answer))
    return "\n\n".join("\n".join(lines) for part in parts if (lines := list(part))) + "\n"


def _pair(answer: Answer) -> Iterator[str]:
    params, unit = answer.found.params, squared(answer.unit)
    missing = f", {count(answer.missing)} of them missing" if answer.missing else ""
    yield f"samples            {count(answer.samples)}{missing}"
    if params is not None:
        q, r, ratio = params.q, float(params.r), params.ratio
        yield f"process noise      q = {trimmed(q, 4)} {unit}"
        sigma = f"σ = {number(math.sqrt(r))} {answer.unit or 'unit'}"
        yield f"measurement noise  r = {trimmed(r, 4)} {unit}   ({sigma})"
        yield f"ratio            q/r = {number(ratio)}"
        if tau := params.momentum:
            yield f"momentum           τ = {trimmed(tau, 4)} samples{_seconds(tau, answer.sample_period)}"
        if params.gate is not None:
            yield f"outlier gate         = {gate_text(params.gate)}"
        yield f"how: {answer.found.how}"
    yield ""
    yield from wrapped(answer.found.message)


def _seconds(tau: float, period: float | None) -> str:
    return "" if period is None else f"   ({duration(tau * period)})"


def _meaning(answer: Answer) -> Iterator[str]:
    if answer.steady is not None and answer.found.params is not None:
        yield "What this filter does"
        yield from _steady_lines(answer.steady, answer.found.params, answer.sample_period)
    yield from wrapped(f"The record allows (95 %): {_interval(answer)}.")
    if answer.judgement.status == "as_chosen":
        yield from wrapped(answer.judgement.headline)


def _steady_lines(steady: SteadyState, params: FilterParams, period: float | None) -> Iterator[str]:
    yield f"  gain             {number(steady.gain)}"
    yield f"  lag (delay)      {lag_in_full(steady.lag_samples, period)}"
    if overshoot := steady.overshoot:
        yield f"  overshoot (step) {percent(overshoot)}"
    yield f"  noise reduction  {decibels(steady.noise_reduction_db)}"
    yield f"  cut-off (−3 dB)  {_cutoff(params, period)}"
    yield f"  settling to 1 %  {lag_in_full(steady.settle_samples, period)}"


def _cutoff(params: FilterParams, period: float | None) -> str:
    hertz = scalar(steady_state(params, period or 1.0).cutoff_hz)
    if math.isnan(hertz):
        return "none: it attenuates no frequency by 3 dB"
    return frequency(hertz) if period else f"{number(hertz)} × the sample rate"


def _interval(answer: Answer) -> str:
    limits = answer.range
    low, high = limits.ratio_interval
    if (low, high) == (0.0, math.inf):
        return "any q/r; it sets no limits"
    least, most = limits.gain_interval
    short, long = limits.lag_interval
    gain, lag = between(least, most, largest=1.0), between(short, long)
    period = answer.sample_period
    seconds = "" if period is None else f" ({between(short * period, long * period, words=duration)})"
    return f"q/r {between(low, high)}, gain {gain}, lag {lag} samples{seconds}"


def _opinions(answer: Answer) -> Iterator[str]:
    without = " without momentum" if answer.momentum else ""
    yield f"Compare estimators{without} (q and r in {squared(answer.unit)}, lag in samples)"
    yield _row("method", "q", "r", "lag", "in 95 %", "verdict")
    for one in answer.opinions:
        yield _row(METHOD_NAMES[one.method], *_cells(one, answer.opinions[0]), VERDICT_WORDS[str(one.verdict)])
    yield from wrapped(comparison(answer.opinions, answer.momentum))


def _cells(one: Estimate, best: Estimate) -> tuple[str, str, str, str]:
    if one.verdict in WITHOUT_NUMBERS:
        return "–", "–", "–", "–"
    inside = {True: "yes", False: "no", None: "–"}[is_within(one, best)]
    return number(one.q), number(one.r), number(lag_of(one.ratio)), inside


def _row(method: str, q: str, r: str, lag: str, inside: str, verdict: str) -> str:
    return f"  {method:<32}{q:>12}{r:>12}{lag:>11}{inside:>9}  {verdict}"


def _trust(answer: Answer) -> Iterator[str]:
    judged, held = answer.judgement.residuals, answer.judgement.held_out
    if judged is None:
        return
    yield from wrapped(f"Advice: {as_sentences(advice_words(answer.judgement))}")
    if answer.judgement.status != "too_few":
        jumps = f", {judged.jumps} of them jumps that stay" if judged.jumps else ""
        spikes = f"{judged.spikes} beyond 4 σ{jumps} (chance: {number(judged.spikes_expected, 2)})"
        white = f"lag-1 autocorrelation {correlation(judged.r1)} (white: within ±{correlation(judged.r1_bound)})"
        yield from wrapped(f"Residuals: {white}; {spikes}.")
    if held is None:
        yield "Held-out test: not possible, one half of the record has too little data."
        return
    band = f"{number(held.nis)}, expected {expected_nis(held)}"
    test = "On the second half" if answer.verdict == CHOSEN else "Tuned on the first half, judged on the second"
    yield from wrapped(f"{test}: NIS {band}: {answer.judgement.second_half}.")
