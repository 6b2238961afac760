"""The answer of `kalscope tune`, for a channel or for fused sensors: in a few lines, in detail, or as JSON."""

from __future__ import annotations

import json
import math
import textwrap
from collections.abc import Callable, Iterator
from dataclasses import dataclass, is_dataclass, replace
from pathlib import Path
from typing import Any, cast

import numpy as np

from kalscope.analysis import actions
from kalscope.analysis.alternatives import MAX_SAMPLES, fixed_lag
from kalscope.analysis.channel_kinds import default_channel, with_kinds
from kalscope.analysis.correction import MIN_SAMPLES
from kalscope.analysis.diagnostics import (
    Diagnostics,
    diagnose_held_out,
    diagnose_run,
    residual_rows,
    without_residuals,
)
from kalscope.analysis.findings import KEEP, as_sentences
from kalscope.analysis.fused import judge_fusion
from kalscope.analysis.judge import Judgement, judge, needs_noise, with_momentum, with_notch, with_two_speeds
from kalscope.analysis.residuals import Run
from kalscope.cli.tune_options import SPECIFICATIONS, FusionOptions, save
from kalscope.common.numbers import Array
from kalscope.common.progress import OnProgress, Progress
from kalscope.common.text import (
    count,
    duration,
    frequency,
    gate_text,
    lag_in_full,
    lag_text,
    noise_left,
    number,
    percent,
    plural,
    squared,
    trimmed,
)
from kalscope.errors import BadSetting
from kalscope.estimation.fit import estimate
from kalscope.estimation.fusion import estimate_fusion, listed
from kalscope.estimation.hum import behind_notch, cycles_text, find_line
from kalscope.estimation.request import FitResult, Noise, Request, cost_text, find_parameters, shows_no_noise
from kalscope.estimation.result import Estimate
from kalscope.estimation.settings import momentum_gain
from kalscope.estimation.still import find_still_stretch
from kalscope.estimation.two_speeds import clear_two_speeds
from kalscope.filtering.classic import ChainFilter, Notch
from kalscope.filtering.params import FilterParams, scalar
from kalscope.filtering.steady import SteadyState, steady_state
from kalscope.recording import Recording
from kalscope.sources.reading import account
from kalscope.tuning.choose import channels_to_fuse, for_each_sensor, name_of_fused, sensor_named, units_of
from kalscope.tuning.tuning import ChannelTuning

WIDTH = 96
"""Columns of the page; the lines on how the file was read may be wider."""

MAX_NAME = 24
"""Characters of a sensor's name."""

_WORDS = {"flat": "any ratio fits", "bad_unit": "numbers out of range", "copies": "two sensors move alike"}
"""Verdicts whose code does not explain itself."""


USELESS = ("constant", "too_few", "bad_unit")
"""Reasons of a filter that only passes the signal on."""

CHOSEN = "chosen"
"""The verdict without an estimate: the pair follows from the options."""

# The answer: the filter, what it means, and how far to trust it.


@dataclass(frozen=True)
class Answer:
    """What `kalscope tune` says about one channel, or about sensors that are fused."""

    recording: Recording
    """Where the channels are."""
    sensors: tuple[str, ...]
    """The channel, or the channels that are fused."""
    unit: str
    """The unit of the filtered value, "" where unknown."""
    request: Request
    """What the user wants and knows."""
    result: FitResult
    """The filter or why there is none."""
    range: Estimate
    """The estimate whose intervals say what the record allows."""
    judgement: Judgement
    """Whether the filter fits, and what to do next; `held_out` is of a pair found in the first half."""

    @property
    def fuses(self) -> bool:
        """Whether it is about several sensors."""
        return len(self.sensors) > 1

    @property
    def name(self) -> str:
        """What is filtered."""
        return " + ".join(self.sensors)

    @property
    def z(self) -> Array:
        """Its readings, shape (n, sensors)."""
        return self.recording.values[:, [self.recording.index(name) for name in self.sensors]]

    @property
    def sample_period(self) -> float | None:
        """Nominal sample period, s; None where unknown."""
        return self.recording.sample_period

    @property
    def notch(self) -> Notch | None:
        """The notch before the filter; None where there is none."""
        return None if self.result.chain is None else self.result.chain.notch

    @property
    def steady(self) -> SteadyState | None:
        """The settled filter, of sensors while all answer; None without a filter."""
        params, chain = self.result.params, self.result.chain
        if params is not None and chain is not None:
            run = ChainFilter(chain, params)
            return run.settled(run.run(self.z[:, 0]), self.sample_period)
        return None if params is None else steady_state(params.as_single, self.sample_period)

    @property
    def useless(self) -> bool:
        """Whether there is no filter, or one that only passes the signal on."""
        return self.result.params is None or self.result.reason in USELESS

    @property
    def verdict(self) -> str:
        """The verdict of the estimate, or "chosen" where the pair needed none."""
        return CHOSEN if self.result.estimate is None else str(self.result.estimate.verdict)

    @property
    def verdict_words(self) -> str:
        """The verdict as it is shown."""
        return _WORDS.get(self.verdict) or self.verdict.replace("_", " ")


def answers_for(
    recording: Recording, channels: tuple[str, ...] | str | None, options: FusionOptions, show: OnProgress
) -> list[Answer]:
    """The answers for these channels, None = the default one, or for the sensors that are to be fused.

    Raises:
        BadSetting: no such channels, two units, options that contradict each other, or a target out of reach.
    """
    if options.fuse is not None:
        return [answer_for_fusion(recording, options, Progress(show))]
    names = channels if isinstance(channels, tuple) else (channels or default_channel(recording),)
    request = options.request(recording)

    def progress_of(i: int) -> Progress:
        whole = Progress(lambda fraction, text: show(fraction, f"{names[i]}: {text}"))
        return whole.part(i / len(names), (i + 1) / len(names))

    return [answer_for(recording, name, request, progress_of(i), options.gate) for i, name in enumerate(names)]


def answer_for(
    recording: Recording, channel: str, request: Request, progress: Progress, gate: float | None = None
) -> Answer:
    """Find and judge the pair of one channel.

    Args:
        recording: where the channel is.
        channel: its name.
        request: what the user wants and knows.
        progress: where progress is reported.
        gate: outlier gate on v²/s in place of the one that is found; NaN = off, None = as found.

    Raises:
        BadSetting: contradictory or out-of-range targets.
    """
    z, dt, period = recording.channel(channel), _steps(recording), recording.sample_period
    unit = recording.units[recording.index(channel)]
    result = find_parameters(z, request, dt=dt, sample_period=period, progress=progress.part(0.0, 0.4))
    result = replace(result, params=_with_gate(result.params, gate))
    assert result.params is not None
    line = find_line(z, dt) if request.notch is None else None
    request = replace(request, notch=None)
    z = z if result.chain is None or result.chain.notch is None else behind_notch(z, result.chain.notch)
    momentum = "auto" if result.params.momentum else 0.0
    allowed = result.estimate or estimate(z, dt=dt, momentum=momentum, robust=request.robust)
    progress(0.6, "judging the answer")
    fitted = result.estimate is not None and result.reason in ("best_fit", CHOSEN)
    residuals = diagnose_run(Run.of_samples(z, result.params, dt), fitted=fitted)
    held_out = _held_out(z, dt, period, result.reason, request, progress.part(0.7, 1.0))
    still = find_still_stretch(z, dt) if needs_noise(result.estimate) else None
    judgement = judge(residuals, held_out, result.estimate, result.request, still, unit)
    one = result.params
    if not request.goal and judgement.tone != "good" and one.fast is None and result.chain is None:
        best = estimate(z, dt=dt, robust=request.robust)
        judgement = with_two_speeds(judgement, clear_two_speeds(best, z, np.empty(0) if dt is None else dt))
    if _without(request) and not request.goal and not one.momentum:
        best = estimate(z, dt=dt, robust=request.robust)
        gain = momentum_gain(z, dt, one, best)
        judgement = with_momentum(judgement, float(best.momentum), gain)
    judgement = with_notch(judgement, line, period)
    return Answer(recording, (channel,), unit, request, result, allowed, judgement)


def _steps(recording: Recording) -> Array | None:
    return recording.steps() if recording.gaps == "dt" else None


def _with_gate(params: FilterParams | None, gate: float | None) -> FilterParams | None:
    if params is None or gate is None:
        return params
    return replace(params, gate=None if math.isnan(gate) else gate)


def _held_out(
    z: Array, dt: Array | None, period: float | None, reason: str, request: Request, progress: Progress
) -> Diagnostics | None:
    """The same question to the first half alone, its answer judged on the second half."""
    half = len(z) // 2
    known = request.noise.resolve(z, dt)  # a still stretch may lie in the second half: it is knowledge, not a fit
    if known:
        request = replace(request, noise=Noise(r=known[0]))
    elif shows_no_noise(z[:half]):
        return None
    steps = None if dt is None else dt[:half]
    found = find_parameters(z[:half], request, dt=steps, sample_period=period, progress=progress)
    same = found.reason == reason and reason not in USELESS
    judged = diagnose_held_out(z, found.params, dt) if found.params and same else None
    return judged if judged is not None and judged.n >= MIN_SAMPLES else None


def answer_for_fusion(recording: Recording, options: FusionOptions, progress: Progress) -> Answer:
    """Find and judge the filter that fuses channels of a recording; BadSetting as in `answers_for`."""
    units, given = units_of(recording), options.reference
    mixed = options.sensor_gains and given is not None
    sensors = channels_to_fuse(units, options.fuse or "", mixed_units=mixed)
    reference = None if given is None else sensor_named(sensors, "--reference", given)
    request = replace(options, r=None, sigma=None).request(recording)
    known, request = _known_noise(options, recording, sensors), replace(request, noise=Noise())
    request.checked_momentum()

    def fitted(z: Array, dt: Array | None, progress: Progress) -> tuple[Estimate, FilterParams | None]:
        """The estimate, and the filter that the user wants."""
        fit = estimate_fusion(
            z,
            dt=dt,
            names=sensors,
            momentum=0.0 if request.goal else request.momentum,
            robust=request.robust,
            gains=options.sensor_gains,
            reference=reference,
            known_r=known,
            progress=progress,
        )
        return fit, _with_gate(_at_goal(fit, request, recording), options.gate)

    z, dt = recording.values[:, [recording.index(name) for name in sensors]], _steps(recording)
    fit, params = fitted(z, dt, progress.part(0.0, 0.5))
    unit, judging, message = units[reference or sensors[0]], progress.part(0.5, 1.0), fit.message
    if params is None:
        judgement = judge(None, estimate=fit)
    else:
        judgement = judge_fusion(
            z,
            replace(fit, params=params),
            dt,
            unit=unit,
            sample_period=recording.sample_period,
            fit=lambda half, steps: fitted(half, steps, judging)[1] or params,
        )
        message = f"While all sensors answer, the filter has {request.goal}." if request.goal else message
    noise = (options.r, options.sigma, options.density) != (None, None, None)
    origin = "r given" if noise else "r from a still stretch" if options.still is not None else ""
    how = ", ".join(filter(None, ("fused", request.goal, origin, "" if request.goal else "maximum likelihood")))
    return Answer(recording, sensors, unit, request, FitResult(params, how, message, fit, request), fit, judgement)


def _known_noise(options: FusionOptions, recording: Recording, sensors: tuple[str, ...]) -> list[float]:
    """The r of each sensor that is known, unit²; NaN where it is to be estimated.

    Raises:
        BadSetting: an option names another sensor, or a sensor shows no still stretch.
    """
    if options.sensor_noise is not None:
        option, given = options.sensor_noise
        values = for_each_sensor(sensors, option, given)
        return [value * value if option == "--sigma" else value for value in values]
    noise, dt = options.request(recording).noise, _steps(recording)
    known = [noise.resolve(recording.channel(name), dt) for name in sensors]
    return [math.nan if one is None else one[0] for one in known]


def _at_goal(fit: Estimate, request: Request, recording: Recording) -> FilterParams | None:
    """The filter with the q and momentum that meet the target while all sensors answer; as found without a target.

    A target needs no q of the record: the noises of the sensors are enough.
    """
    params = fit.params
    if not request.goal:
        return params
    if params is None and np.all(fit.r > 0.0):
        params = FilterParams(1.0, fit.r, offset=fit.offset, gain=fit.gain)
    if params is None:
        return None
    single = replace(request, noise=Noise(r=float(params.as_single.r)))
    met = find_parameters(recording.values[:, 0], single, sample_period=recording.sample_period).params
    return met and replace(params, q=met.q, momentum=met.momentum)


# The options that do what a piece of advice says: what to add to the same `kalscope tune`, or leave out.


TARGET_OPTIONS = {name: option for option, (name, _) in SPECIFICATIONS.items()}
"""The option of each target of `find_parameters`."""


def option_for(action: actions.Action | None, answer: Answer) -> str:
    """The option that does it for this channel; "" where no option does, as for a new recording."""
    without, params = _without(answer.request), answer.result.params
    match action:
        case actions.SetSpikesAside():
            words = ["--robust", *without]
        case actions.EstimateAgain() | actions.AddMomentum():
            words = without
        case actions.SetGate(sigma):
            words = ["--gate off" if sigma is None else f"--gate {sigma * sigma:.4g}"]
        case actions.AddTwoSpeeds():
            words = ["--two-speeds", *without]
        case actions.AddNotch():
            words = ["--notch auto", *without]
        case actions.UseStillStretch():
            words = ["--still auto"]
        case actions.Scale(q_factor, r_factor) if params is not None:
            q, r = params.q * q_factor, float(params.r) * r_factor
            words = [f"--q {q:.4g} --r {r:.4g} of kalscope open and filter"]
        case actions.GiveNoise():
            words = ["--still FROM:TO or --sigma STD"]
        case actions.ChooseFilter():
            words = [example(answer)]
        case _:
            words = []
    return " ".join(words)


def _without(request: Request) -> list[str]:
    """The options that keep q, r or momentum from being estimated: they must be left out."""
    noises = [name for name in ("still", "sigma", "density", "r") if getattr(request.noise, name) is not None]
    given = [
        *(TARGET_OPTIONS[name] for name in request.target),
        *(f"--{name}" for name in ("ratio", "overshoot") if getattr(request, name) is not None),
        *(f"--{name}" for name in noises),
        *(["--momentum"] if request.momentum != "auto" else []),
    ]
    return [f"without {', '.join(given)}"] if given else []


def example(answer: Answer) -> str:
    """An option that chooses another filter: the next setting's lag, else that of five samples, or its gain."""
    name = "strong" if answer.result.reason == "medium" else "medium"
    samples = next((one.lag_samples for one in answer.result.costs if one.name == name), 5.0)
    if answer.sample_period is None:
        return f"--gain {1.0 / (1.0 + samples):.3g}"
    lag = 1e3 * samples * answer.sample_period
    return f"--lag-ms {lag:.0f}" if lag >= 1e4 else f"--lag-ms {lag:.4g}"


# The page: how the file was read, the filter, how sure it is, what to do next; with --details all that is known.


def page_of(answers: list[Answer], details: bool) -> str:
    """The summary of each answer, and its details below it; then the other channels."""
    recording = answers[0].recording
    pages = [[*summary_of(one), *(["", *details_of(one)] if details else [])] for one in answers]
    others = [name for name in recording.names if name not in {name for one in answers for name in one.sensors}]
    if others:
        words = f"Other channels (--channel, --all): {', '.join(with_kinds(recording, others))}"
        pages[-1] += wrapped(words) if details else [textwrap.shorten(words, WIDTH, placeholder=" …")]
    between = f"\n{'-' * WIDTH}\n" if details else "\n\n"
    return "\n".join(reading_lines(recording)) + "\n" + between.join(map("\n".join, pages)) + "\n"


def reading_lines(recording: Recording) -> list[str]:
    """How the recording was read: one line that a program can parse, what was assumed, and large losses."""
    lines = [f"{recording.title or recording.source}: {account.summary(recording)}", *account.read_as(recording)]
    warnings = account.warnings(recording)
    return [*lines, f"Warning: {'. '.join(warnings)}."] if warnings else lines


def summary_of(answer: Answer) -> list[str]:
    """The answer in lines of the page."""
    judged = answer.judgement
    second = judged.second_half if answer.fuses else ""
    headline = answer.result.message if answer.useless and not answer.fuses else judged.headline
    texts = [_filter(answer), *_effect(answer), headline, *_costs(answer), second]
    page = [line for text in texts for line in wrapped(text)]
    page += _table(answer) if judged.sensors else []
    return page + [line for text in _next(answer) for line in wrapped(text)]


def wrapped(text: str) -> list[str]:
    """The text in lines of the page; options, numbers and percentages stay whole."""
    lines = textwrap.wrap(text.replace(" %", "\u00a0%"), WIDTH, break_long_words=False, break_on_hyphens=False)
    return [line.replace("\u00a0", " ") for line in lines]


def between(low: float, high: float, largest: float = math.inf, words: Callable[[float], str] = number) -> str:
    """A range from 0 … `largest` in words: "2.4 to 6.2", "up to 6.2", "2.4 or more", "any"."""
    if low == 0.0:
        return "any" if high >= largest else f"up to {words(high)}"
    return f"{words(low)} or more" if high >= largest else f"{words(low)} to {words(high)}"


def _filter(answer: Answer) -> str:
    params, period, fit = answer.result.params, answer.sample_period, answer.result.estimate
    if params is None:
        return f"{answer.name}: no q and r to recommend ({answer.verdict_words})"
    r = "" if answer.fuses else f", r = {trimmed(float(params.r), 4)}"
    momentum = f"momentum {lag_in_full(params.momentum, period)}" if params.momentum else "no momentum"
    if params.fast is not None:
        spikes = f", {percent(params.spikes)} spikes" if params.spikes else ""
        momentum = f"{trimmed(params.fast, 3)} × q while it moves{spikes}"
    gate = "no gate" if params.gate is None else f"gate {gate_text(params.gate)}"
    aside = 0 if fit is None or fit.outliers is None else int(fit.outliers.sum())
    spikes = f", {plural(aside, 'spike')} set aside" if aside else ""
    notch = "" if answer.notch is None else f", notch at {cycles_text(answer.notch.frequency, period)}"
    return f"{answer.name}: q = {trimmed(params.q, 4)}{r} {squared(answer.unit)}, {momentum}, {gate}{spikes}{notch}"


def _effect(answer: Answer) -> Iterator[str]:
    steady, params = answer.steady, answer.result.params
    if steady is None:
        return
    lag = lag_in_full(steady.lag_samples, answer.sample_period).removesuffix(")")
    bracket = f"; {_allowed(answer)})" if "(" in lag else f" ({_allowed(answer)})"
    left = f"noise left {noise_left(steady.noise_reduction_db)}{' of their mean' if answer.fuses else ''}"
    overshoot = f"overshoot {percent(steady.overshoot)}" if steady.overshoot else "no overshoot"
    if params is not None and params.fast is not None:
        moving = steady_state(params.moving, answer.sample_period)
        text = lag_text(moving.lag_samples, answer.sample_period)
        yield f"at rest lag {lag}), {left}; moving lag {text}, noise left {noise_left(moving.noise_reduction_db)}"
        return
    lost = f", movement lost {percent(answer.result.lost)}" if answer.result.costs else ""
    yield f"lag {lag}{bracket}, {left}, {overshoot}{lost}"


def _costs(answer: Answer) -> Iterator[str]:
    """What the settings cost, in one line; what the filter loses is with its effect."""
    named = [one for one in answer.result.costs if one.name]
    if named:
        texts = "; ".join(f"{one.name} {cost_text(one, answer.sample_period)}" for one in named)
        first, *more = texts.replace(" and loses", ", loses").split("; ")
        brief = [one.replace(" of the noise", "").replace(" of the movement", "") for one in more]
        yield f"By lag: {'; '.join([first, *brief])}"


def _allowed(answer: Answer) -> str:
    """The lags that the record allows, or favours where the lag was chosen."""
    if answer.fuses:
        return "while all sensors answer"
    if answer.range.ratio_interval == (0.0, math.inf):
        return "the record allows any"
    return f"{'95 %:' if answer.result.reason == 'best_fit' else 'the record favours'} {_lags(answer)}"


def _lags(answer: Answer) -> str:
    """The lags that the record allows, s; samples where the sample period is not known."""
    late, period = 0.0 if answer.notch is None else answer.notch.lag, answer.sample_period
    low, high = (lag + late for lag in answer.range.lag_interval)
    return between(low, high) if period is None else between(low * period, high * period, words=duration)


def _table(answer: Answer) -> Iterator[str]:
    """A row a sensor: noise, offset, gain, share, and what is left without it."""
    params = answer.result.params
    if params is None:
        return
    rows = [("sensor", "noise σ", "r", "offset", "gain", "share", "error alone", "without it")]
    for i, (one, unit) in enumerate(zip(answer.judgement.sensors, _units(answer), strict=True)):
        r = float(params.sensor_r[i])
        rows.append(
            (
                textwrap.shorten(one.name, MAX_NAME, placeholder="…"),
                _with_unit(math.sqrt(r), unit),
                f"{number(r)} {squared(unit)}",
                _with_unit(float(params.offset[i]), unit),
                number(float(params.gain[i])),
                percent(one.share),
                _with_unit(one.error, answer.unit),
                _with_unit(one.error_without, answer.unit),
            )
        )
    yield from _columns(*rows)


def _with_unit(value: float, unit: str) -> str:
    return f"{number(value)} {unit}".rstrip()


def _units(answer: Answer) -> list[str]:
    units = units_of(answer.recording)
    return [units[name] for name in answer.sensors]


def _next(answer: Answer) -> Iterator[str]:
    """What to do, most urgent first: with a filter at least how to save it, without one how to choose it."""
    params, advice = answer.result.params, answer.judgement.findings
    if answer.useless and account.warnings(answer.recording):
        yield "Next: fix how the file is read first; the rest holds for the samples that could be read"
    for one in advice:
        option = option_for(one.action, answer)
        how = f", {'' if option.startswith('without') else 'with '}{option}" if option else ""
        text = as_sentences(one.text) if ". " in one.text else one.text
        yield f"{'Next' if one.action or text.casefold().startswith(KEEP) else 'Note'}{how}: {text}"
    about = list(_about_sensors(answer)) if answer.fuses else []
    yield from about
    due = [one for one in advice if one.action or not answer.fuses]  # that a sensor was silent leaves nothing to do
    if params is not None and not due and not any(text.startswith("Next") for text in about):
        nothing = "nothing to correct; " if not advice and answer.verdict in ("ok", CHOSEN) else ""
        fit = answer.result.estimate
        if fit is not None and fit.outliers is not None and fit.outliers.any():
            nothing += "--no-robust keeps spikes that belong to the signal, such as heartbeats; "
        yield f"Next: {nothing}-o tuning.toml saves it, --details shows more"


def _about_sensors(answer: Answer) -> Iterator[str]:
    """What the record leaves open, and which sensors to look at."""
    fit, params, sensors = answer.range, answer.result.params, answer.judgement.sensors
    if params is not None and fit.verdict != "ok" and not (answer.request.goal and fit.verdict == "no_movement"):
        yield f"Note: {fit.message}"
    yield from (f"Note: {note}" for note in fit.notes)
    odd = [one for one in sensors if {"drift", "noise", "stuck"} & set(one.faults)]
    if odd:
        scales = any("drift" in one.faults for one in odd) and bool(np.all(fit.gain == 1.0))
        compare = "; try --fuse without one of them to see what it contributes" if len(sensors) > 2 else ""
        more = "; sensors of different scales seem to drift too: --sensor-gains" if scales else compare
        yield f"Next: look at {listed([one.name for one in odd])}{more}"


def details_of(answer: Answer) -> Iterator[str]:
    """What the summary leaves out: how the filter was found, what it does, what the record allows, tests."""
    z, fit, judged, period = answer.z, answer.range, answer.judgement, answer.sample_period
    readings = [f"{count(n)} {name}" for n, name in zip(np.isfinite(z).sum(axis=0), answer.sensors, strict=True)]
    yield f"{count(len(z))} rows, readings: {', '.join(readings)}"
    if answer.result.params is not None:
        yield f"how: {answer.result.how}"
    yield from wrapped(answer.result.message)
    yield from _meaning(answer)
    if answer.result.costs:
        yield ""
        rows = [
            (
                each.name,
                lag_in_full(each.lag_samples, period),
                percent(each.noise_left),
                percent(each.movement_lost),
            )
            for each in answer.result.costs
        ]
        yield from _columns(("setting", "lag (no momentum)", "noise left", "movement lost"), *rows)
    yield ""
    yield from wrapped(f"The record allows (95 %): {_interval(answer)}")
    for i, (name, unit) in enumerate(zip(answer.sensors if answer.fuses else (), _units(answer), strict=False)):
        offset, gain = (
            " to ".join(map(number, ends[i])) for ends in (fit.offset_interval, fit.sensor_gain_interval)
        )
        noise = f"r {between(*fit.r_interval[i])} {squared(unit)}"
        gains = f", gain {gain}" if np.any(fit.gain != 1.0) else ""
        yield from wrapped(f"  {name}: {noise}, {f'offset {offset} {unit}'.rstrip()}{gains}")
    for one in judged.sensors:
        yield from wrapped(" ".join(one.if_it_fails))
    params = None if answer.fuses else answer.result.params
    if params is not None and len(z) <= MAX_SAMPLES:
        best = answer.result.estimate or estimate(z[:, 0], dt=_steps(answer.recording))
        late = fixed_lag(z[:, 0], params, best.params)
        yield from wrapped(late.sentence) if late else ()
    if judged.residuals is not None:
        yield ""
        yield from _columns(("residuals", "measured", "expected (95 %)"), *residual_rows(judged.residuals))
        half = judged.second_half or "not possible, the first half alone gives no such filter"
        yield from wrapped(f"Second half, by a filter that has not seen it: {half}")


def _meaning(answer: Answer) -> Iterator[str]:
    steady, params, period = answer.steady, answer.result.params, answer.sample_period
    if steady is None or params is None:
        return
    yield ""
    yield f"What this filter does{' while all sensors answer' if answer.fuses else ''}"
    hertz = scalar(steady_state(params.as_single, period or 1.0).cutoff_hz)
    cutoff = frequency(hertz) if period else f"{number(hertz)} × the sample rate"
    yield from _columns(
        ("gain", number(steady.gain)),
        ("lag", lag_in_full(steady.lag_samples, period)),
        ("overshoot (step)", percent(steady.overshoot)),
        ("noise left", noise_left(steady.noise_reduction_db)),
        ("cut-off (−3 dB)", "none: it attenuates no frequency by 3 dB" if math.isnan(hertz) else cutoff),
        ("settling to 1 %", lag_in_full(steady.settle_samples, period)),
    )


def _columns(*rows: tuple[str, ...]) -> Iterator[str]:
    """Rows of cells in columns."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        yield "  " + "  ".join(f"{cell:<{width}}" for cell, width in zip(row, widths, strict=True)).rstrip()


def _interval(answer: Answer) -> str:
    limits = answer.range
    if answer.fuses:
        return f"q {between(*limits.q_interval)} {squared(answer.unit)}"
    if limits.ratio_interval == (0.0, math.inf):
        return "any q/r; it sets no limits"
    gain, lag = between(*limits.gain_interval, largest=1.0), between(*limits.lag_interval)
    seconds = "" if answer.sample_period is None else f" ({_lags(answer)})"
    return f"q/r {between(*limits.ratio_interval)}, gain {gain}, lag {lag} samples{seconds}"


# Everything, in values that JSON can hold, under the names that Python has for it.


def json_of(answers: list[Answer], every: bool) -> str:
    """One object: the answer after what was read, with --all a list of answers."""
    recording, plain = answers[0].recording, [as_plain(answer) for answer in answers]
    head = {"source": recording.source, "sha256": recording.sha256, "reading": account.as_plain(recording)}
    whole = finite(head | ({"channels": plain} if every else plain[0]))
    return json.dumps(whole, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def as_plain(answer: Answer) -> dict[str, Any]:
    """The estimate, the filter, what it does, and the judgement with the option of each finding."""
    fit, params, judged, z = answer.range, answer.result.params, answer.judgement, answer.z
    spikes = fit.spikes if answer.fuses else None if fit.outliers is None else fit.outliers.nonzero()[0]
    tests = {name: getattr(judged, name) for name in ("residuals", "held_out")}
    tests = {name: one and without_residuals(one) for name, one in tests.items()}
    names = "q r momentum gate offset gain shares" if answer.fuses else "q r ratio momentum gate fast spikes"
    advice = [
        {"text": one.text, "action": type(one.action).__name__, "option": option_for(one.action, answer)}
        for one in judged.findings
    ]
    return {
        **vars(fit),
        "outliers": spikes,
        **{name: None if params is None else getattr(params, name) for name in names.split()},
        **({} if answer.fuses else {"notch": answer.notch}),
        **({"fused": answer.sensors} if answer.fuses else {"channel": answer.name}),
        "unit": answer.unit,
        "sample_period": answer.sample_period,
        "samples": len(z),
        "missing": int(np.isnan(z).sum()),
        "verdict": answer.verdict,
        "message": answer.result.message,
        "how": answer.result.how,
        "reason": answer.result.reason,
        "movement_lost": answer.result.lost,
        "costs": answer.result.costs,
        "steady": answer.steady,
        "judgement": replace(judged, **tests),
        "advice": advice,
    }


def finite(value: Any) -> Any:
    """The value without numbers that JSON cannot hold; dataclasses and types of numpy become plain ones."""
    if is_dataclass(value):
        return finite(vars(value))
    if isinstance(value, dict):
        return {key: finite(item) for key, item in cast("dict[str, Any]", value).items()}
    if isinstance(value, list | tuple):
        return [finite(item) for item in cast("list[Any]", value)]
    if isinstance(value, float):
        number = float(value)
        return None if math.isnan(number) else number if math.isfinite(number) else str(number)
    return finite(value.tolist()) if hasattr(value, "tolist") else value


# The tuning file.


def save_answers(answers: list[Answer], output: Path) -> list[str]:
    """Save the filters that were found, and those of each fused sensor by itself; returns notes for the user."""
    recording, fusion, tunings = answers[0].recording, None, list[ChannelTuning]()
    for one in answers:
        params, how = one.result.params, one.result.how
        if params is not None and one.fuses:
            fusion = ChannelTuning.of_params(name_of_fused(recording), one.unit, params, how, one.sensors)
            scales = zip(one.sensors, _units(one), fusion.r, fusion.gain, strict=True)
            for name, unit, r, gain in scales:
                single = replace(params, q=params.q * gain * gain, r=r, offset=0.0, gain=1.0)
                tunings.append(ChannelTuning.of_params(name, unit, single, how))
        elif not one.useless and params is not None:
            tuning = ChannelTuning.of_params(one.name, one.unit, params, how)
            tunings.append(replace(tuning, chain=one.result.chain))
    without = "; ".join(f"{one.name}: {one.verdict_words}" for one in answers if one.useless)
    if not tunings:
        lost = "".join(f"{sentence}. " for sentence in account.warnings(recording))
        advice = (
            "give r (--still, --sigma), record while it moves, or choose a filter (--lag-ms, --cutoff-hz, --gain)"
        )
        advice = answers[0].result.message if answers[0].fuses else advice
        raise BadSetting(f"{lost}-o needs a usable q and r, and the record gives none ({without}): {advice}")
    notes = [f"left out of the tuning: {without}"] if without else []
    return notes + save(recording, tunings, {name for one in answers for name in one.sensors}, output, fusion)
