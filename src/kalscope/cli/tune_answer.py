"""The answer of `kalscope tune` for one channel: in a few lines, in detail, or as JSON."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from typing import Any, cast

import numpy as np

from kalscope.analysis import actions
from kalscope.analysis.actions import Action, ChooseFilter
from kalscope.analysis.correction import MIN_SAMPLES
from kalscope.analysis.diagnostics import Diagnostics, diagnose_held_out, diagnose_run, expected_nis
from kalscope.analysis.estimators import WITHOUT_NUMBERS, compare_methods, comparison, is_within
from kalscope.analysis.findings import as_sentences
from kalscope.analysis.judge import Judgement, advice_words, judge, needs_noise
from kalscope.analysis.residuals import Run
from kalscope.cli.tune_options import SPECIFICATIONS
from kalscope.common.numbers import Array
from kalscope.common.progress import Progress
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
    plural,
    squared,
    trimmed,
)
from kalscope.estimation.fit import estimate
from kalscope.estimation.request import METHOD_NAMES, Found, Noise, Request, find_parameters, shows_no_noise
from kalscope.estimation.result import Estimate
from kalscope.estimation.still import find_still_stretch
from kalscope.estimation.verdict import gain_of, lag_of
from kalscope.filtering.params import FilterParams, scalar
from kalscope.filtering.steady import SteadyState, steady_state
from kalscope.recording import Recording
from kalscope.sources.reading import account

# Advice as options: what to add to the same `kalscope tune`, or leave out, to do what a piece of advice says.


TARGET_OPTIONS = {name: option for option, (name, _) in SPECIFICATIONS.items()}
"""The option of each target of `find_parameters`."""


def option_for(action: actions.Action | None, answer: Answer, recording: Recording) -> str:
    """The option that does it for this channel; "" where no option does, as for a new recording."""
    without = _without(answer)
    match action:
        case actions.AllowMomentum():
            words = ["--momentum auto", *without]
        case actions.SetSpikesAside():
            words = ["--robust", *without]
        case actions.EstimateAgain():
            words = without
        case actions.SetGate(sigma):
            words = ["--gate off" if sigma is None else f"--gate {sigma * sigma:.4g}"]
        case actions.UseStillStretch(first, last):
            words = [f"--still {still_text(recording, first, last)}"]
        case actions.SetRatio(ratio):
            words = [f"--ratio {ratio:.3g}"]
        case actions.Scale(q_factor, r_factor):
            words = _scaled(answer, q_factor, r_factor)
        case actions.GiveNoise():
            words = ["--still FROM:TO or --sigma STD"]
        case actions.ChooseFilter():
            words = [example(answer)]
        case actions.UnsetStart() | actions.RecordLonger() | None:
            words = []
    return " ".join(words)


def _without(answer: Answer) -> list[str]:
    """The options that keep q, r or momentum from being estimated: they must be left out."""
    asked = answer.request
    noise = asked.noise
    given = [
        *(TARGET_OPTIONS[name] for name in asked.target),
        *(["--ratio"] if asked.ratio is not None else []),
        *(["--overshoot"] if asked.overshoot is not None else []),
        *(f"--{name}" for name in ("still", "sigma", "density", "r") if getattr(noise, name) is not None),
        *(["--method"] if asked.method != "ml" else []),
    ]
    return [f"without {', '.join(given)}"] if given else []


def _scaled(answer: Answer, q_factor: float, r_factor: float) -> list[str]:
    """Both variances times their factor, as options of `kalscope open` and `filter`, which take them."""
    params = answer.found.params
    if params is None:
        return []
    q, r = params.q * q_factor, float(params.r) * r_factor
    return [f"--q {q:.4g} --r {r:.4g} of kalscope open and filter"]


def still_text(recording: Recording, first: int, last: int) -> str:
    """Samples `first` … `last` − 1 as FROM:TO, in as few digits as select the same ones."""
    time = recording.time
    for digits in range(3, 18):
        start, end = (f"{float(time[at]):.{digits}g}" for at in (first, last - 1))
        inside = ((time >= float(start)) & (time <= float(end))).nonzero()[0]
        if len(inside) and (inside[0], inside[-1]) == (first, last - 1):
            return f"{start}:{end}"
    return f"{float(time[first])!r}:{float(time[last - 1])!r}"


def example(answer: Answer) -> str:
    """An option that chooses a filter for any record: a lag of five samples where ms suit it, or a gain."""
    lag = math.nan if answer.sample_period is None else 5e3 * answer.sample_period
    return f"--lag-ms {lag:.4g}" if 0.01 <= lag < 1e4 else "--gain 0.2"


# The answer of `kalscope tune --json`: everything, in values that JSON can hold.


def as_plain(answer: Answer, recording: Recording) -> dict[str, Any]:
    """The answer in values that JSON can hold: None for what is missing, "inf" for infinity, never NaN."""
    params, limits, judged = answer.found.params, answer.range, answer.judgement
    return finite(
        {
            "channel": answer.channel,
            "unit": answer.unit,
            "samples": answer.samples,
            "missing": answer.missing,
            "sample_period": answer.sample_period,
            **_pair(params),
            "verdict": answer.verdict,
            "message": answer.found.message,
            "how": answer.found.how,
            "ratio_interval": limits.ratio_interval,
            "gain_interval": limits.gain_interval,
            "lag_interval": limits.lag_interval,
            "momentum_interval": limits.momentum_interval,
            "prediction_gain": limits.prediction_gain,
            "set_aside": _set_aside(answer.found.estimate),
            "steady": None if answer.steady is None else asdict(answer.steady),
            "opinions": [_opinion(one, answer.opinions[0]) for one in answer.opinions],
            "advice": None if judged.residuals is None else advice_words(judged),
            "judgement": _judgement(answer, recording),
            "residuals": _tested(judged.residuals),
            "held_out": _tested(judged.held_out),
        }
    )


def _pair(params: FilterParams | None) -> dict[str, Any]:
    names = ("q", "r", "ratio", "momentum", "gate")
    return {name: None if params is None else getattr(params, name) for name in names}


def _set_aside(fit: Estimate | None) -> dict[str, Any] | None:
    """The samples that the spike-proof fit set aside, and the fit to all of them; None where it was not used."""
    if fit is None or fit.outliers is None:
        return None
    plain = {"q": fit.plain_q, "r": fit.plain_r, "momentum": fit.plain_momentum}
    return {"samples": fit.outliers.nonzero()[0].tolist(), "share": fit.outlier_share, "plain": plain}


def _opinion(one: Estimate, best: Estimate) -> dict[str, Any]:
    names = ("method", "q", "r", "ratio", "q_se", "r_se", "loglik", "verdict", "message")
    values = {name: getattr(one, name) for name in names}
    ratio = float(one.ratio)
    values |= {"name": METHOD_NAMES[one.method], "gain": gain_of(ratio), "lag_samples": lag_of(ratio)}
    return {**values, "within_interval": is_within(one, best)}


def _judgement(answer: Answer, recording: Recording) -> dict[str, Any]:
    judged = answer.judgement
    advice = [
        {"text": one.text, "action": _action(one.action), "option": option_for(one.action, answer, recording)}
        for one in judged.findings
    ]
    return {"status": judged.status, "headline": judged.headline, "advice": advice}


def _action(action: Action | None) -> dict[str, Any] | None:
    return None if action is None else {"name": type(action).__name__, **asdict(action)}


def _tested(judged: Diagnostics | None) -> dict[str, Any] | None:
    if judged is None:
        return None
    names = (
        *("n", "advice", "nis", "nis_low", "nis_high", "r1", "r1_bound", "ljung_box", "ljung_box_p"),
        *("spikes", "spikes_expected", "jumps", "variance_ratio", "variance_ratio_p", "q_factor", "r_factor"),
    )
    return {name: getattr(judged, name) for name in names}


def finite(value: Any) -> Any:
    """The value without numbers that JSON cannot hold; numpy types become Python's."""
    if isinstance(value, dict):
        return {key: finite(item) for key, item in cast("dict[str, Any]", value).items()}
    if isinstance(value, list | tuple):
        return [finite(item) for item in cast("list[Any]", value)]
    if isinstance(value, float):
        number = float(value)
        return None if math.isnan(number) else number if math.isfinite(number) else str(number)
    return finite(value.tolist()) if hasattr(value, "tolist") else value


# The answer of `kalscope tune` in at most six lines: the reading, the filter, how sure it is, what to do next.


MAX_LINES = 6
"""Lines of the summary of a recording with one tuned channel, besides one or two on what it was read as; those on
its reading may be wider than a page."""


def reading_lines(recording: Recording) -> list[str]:
    """How the recording was read: one line that a program can parse, what was assumed, and large losses."""
    warnings = account.warnings(recording)
    said = [f"Warning: {'. '.join(warnings)}."] if warnings else []
    return [
        f"{recording.title or recording.source}: {account.summary(recording)}",
        *account.read_as(recording),
        *said,
    ]


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


# The whole answer of `kalscope tune` for one channel: the pair, what it means, and how far to trust it.


CHOSEN = "chosen"
"""The verdict without an estimate: the pair follows from the options."""


@dataclass(frozen=True)
class Answer:
    """What `kalscope tune` says about one channel."""

    channel: str
    """Name of the channel."""
    unit: str
    """Its unit, "" where unknown."""
    samples: int
    """Samples, missing ones included."""
    missing: int
    """Missing ones among them."""
    sample_period: float | None
    """Nominal sample period, s; None where unknown."""
    request: Request
    """What the user asked for."""
    found: Found
    """The pair or why there is none."""
    opinions: tuple[Estimate, ...]
    """All methods side by side, maximum likelihood first."""
    steady: SteadyState | None
    """The settled filter; None without a pair."""
    judgement: Judgement
    """Whether the pair fits, and what to do next; `held_out` is of a pair found in the first half."""

    @property
    def verdict(self) -> str:
        """The verdict of the estimate, or "chosen" where the pair needed none."""
        return CHOSEN if self.found.estimate is None else str(self.found.estimate.verdict)

    @property
    def range(self) -> Estimate:
        """The estimate whose intervals say what the record allows."""
        return self.found.estimate or self.opinions[0]

    @property
    def momentum(self) -> float:
        """Momentum of the answer in sample periods, with or without a pair; 0 without."""
        if self.found.params is not None:
            return self.found.params.momentum
        return 0.0 if self.found.estimate is None else self.found.estimate.momentum


def answer_for(
    recording: Recording, channel: str, request: Request, progress: Progress, gate: float | None = None
) -> Answer:
    """Find and judge the pair of one channel.

    Args:
        recording: where the channel is.
        channel: its name.
        request: what is asked for.
        progress: where progress is reported.
        gate: outlier gate on v²/s in place of the one that is found; NaN = off, None = as found.

    Raises:
        BadSetting: contradictory or out-of-range targets.
    """
    z, period = recording.channel(channel), recording.sample_period
    unit = recording.units[recording.index(channel)]
    dt = recording.steps() if recording.gaps == "dt" else None
    found = find_parameters(z, request, dt=dt, sample_period=period, progress=progress.part(0.0, 0.3))
    found = _with_gate(found, gate)
    opinions = compare_methods(_without_spikes(z, dt, request, found), dt, progress=progress.part(0.3, 0.7))
    progress(0.7, "judging the answer")
    residuals = held_out = None
    if found.params is not None:
        residuals = diagnose_run(Run.of_samples(z, found.params, dt), fitted=found.estimate is not None)
        held_out = _held_out(z, dt, period, request, progress.part(0.8, 1.0))
    return Answer(
        channel=channel,
        unit=unit,
        samples=len(z),
        missing=int(np.count_nonzero(np.isnan(z))),
        sample_period=period,
        request=request,
        found=found,
        opinions=opinions,
        steady=None if found.params is None else steady_state(found.params, period),
        judgement=judge(
            residuals,
            held_out,
            found.estimate,
            request,
            still=find_still_stretch(z, dt) if needs_noise(found.estimate) else None,
            unit=unit,
        ),
    )


def _without_spikes(z: Array, dt: Array | None, request: Request, found: Found) -> Array:
    """The samples that the second opinions and the range of the record are to be found in: those of the answer."""
    fit = found.estimate
    if fit is None and request.robust is not False:  # the filter was chosen
        fit = estimate(z, dt=dt, momentum=0.0, robust=request.robust)
    if fit is None or fit.outliers is None or fit.verdict == "too_many_outliers":
        return z
    return np.where(fit.outliers, np.nan, z)


def _with_gate(found: Found, gate: float | None) -> Found:
    if gate is None or found.params is None:
        return found
    return replace(found, params=replace(found.params, gate=None if math.isnan(gate) else gate))


def _held_out(
    z: Array, dt: Array | None, period: float | None, request: Request, progress: Progress
) -> Diagnostics | None:
    """The same question to the first half alone, its answer judged on the second half."""
    half = z[: len(z) // 2]
    known = request.noise.resolve(z, dt)  # a still stretch may lie in the second half: it is knowledge, not a fit
    if known:
        request = replace(request, noise=Noise(r=known[0]))
    elif shows_no_noise(half):
        return None
    half_dt = None if dt is None else dt[: len(half)]
    params = find_parameters(half, request, dt=half_dt, sample_period=period, progress=progress).params
    if params is None:
        return None
    judged = diagnose_held_out(z, params, dt)
    return judged if judged.n >= MIN_SAMPLES else None


# Words that the summary and the details of `kalscope tune` share.


WIDTH = 96
"""Columns of the page."""

VERDICT_WORDS = {
    CHOSEN: "chosen",
    "ok": "ok",
    "no_noise": "r → 0: no noise seen",
    "no_movement": "q → 0: no movement seen",
    "flat": "vague: any ratio fits",
    "too_few": "too few samples",
    "constant": "all readings equal",
    "bad_unit": "numbers out of range",
    "irregular": "needs regular sampling",
    "not_converged": "not converged",
    "too_many_outliers": "too many spikes",
    "below_resolution": "noise below the rounding step",
    "only_spikes": "r → 0 except for spikes",
}
"""Verdicts as they are shown in a table."""


def between(low: float, high: float, largest: float = math.inf, words: Callable[[float], str] = number) -> str:
    """A range from 0 … `largest` in words: "2.4 to 6.2", "up to 6.2", "2.4 or more", "any"."""
    if low == 0.0:
        return "any" if high >= largest else f"up to {words(high)}"
    return f"{words(low)} or more" if high >= largest else f"{words(low)} to {words(high)}"


def wrapped(text: str) -> list[str]:
    """The text in lines of the page; options and numbers stay whole."""
    return textwrap.wrap(text, WIDTH, break_long_words=False, break_on_hyphens=False)


def momentum_and_gate(params: FilterParams, period: float | None) -> str:
    """What a filter has beside its variances."""
    momentum = f"momentum {lag_in_full(params.momentum, period)}" if params.momentum else "no momentum"
    return f"{momentum}, {'no gate' if params.gate is None else f'gate {gate_text(params.gate)}'}"


# What `kalscope tune --details` adds: how the pair was found, what it does, second opinions, tests.


def details_of(answer: Answer) -> str:
    """All that the summary of one channel leaves out, as one text."""
    parts = (_details_pair(answer), _meaning(answer), _opinions(answer), _trust(answer))
    return "\n\n".join("\n".join(lines) for part in parts if (lines := list(part))) + "\n"


def _details_pair(answer: Answer) -> Iterator[str]:
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
