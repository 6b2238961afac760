"""The answer of `kalscope tune --fuse`: the fused filter, what each sensor adds, and the tuning file."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from kalscope.analysis.fused import judge_fusion
from kalscope.analysis.judge import Judgement
from kalscope.cli.tune_answer import between, momentum_and_gate, wrapped
from kalscope.cli.tune_options import FusionOptions, save
from kalscope.common.numbers import Array
from kalscope.common.progress import Progress
from kalscope.common.text import (
    count,
    decibels,
    lag_in_full,
    number,
    percent,
    squared,
    trimmed,
)
from kalscope.errors import BadSetting
from kalscope.estimation.fit import params_for_specification
from kalscope.estimation.fusion import estimate_fusion, listed
from kalscope.estimation.request import Noise, Request
from kalscope.estimation.result import Estimate
from kalscope.filtering.params import FilterParams
from kalscope.filtering.steady import SteadyState, steady_state
from kalscope.recording import Recording
from kalscope.tuning.choose import channels_to_fuse, for_each_sensor, name_of_fused, sensor_named, units_of
from kalscope.tuning.tuning import ChannelTuning

NOTHING_FOUND = (
    "Next: give the noise of a sensor (--sigma a=0.4), or choose a filter by its lag or its cut-off (--lag-ms, "
    "--cutoff-hz)"
)
"""What to do where the record leaves q or r open."""

NEAR = 2.0
"""A q that differs by less than this factor filters much the same."""

MAX_NAME = 24
"""Characters of a sensor's name in the table."""


@dataclass(frozen=True)
class FusionAnswer:
    """What `kalscope tune --fuse` says."""

    sensors: tuple[str, ...]
    """The fused channels."""
    units: tuple[str, ...]
    """The unit of each, "" where unknown."""
    unit: str
    """The unit of the fused value: theirs, or that of the reference."""
    rows: int
    """Rows of the recording."""
    readings: tuple[int, ...]
    """Readings of each sensor."""
    sample_period: float | None
    """Nominal sample period, s; None where unknown."""
    request: Request
    """What was asked for."""
    estimate: Estimate
    """What maximum likelihood found."""
    params: FilterParams | None
    """The filter: the estimate, or the one that meets the target; None where there is none."""
    how: str
    """How it was found, for the tuning file."""
    steady: SteadyState | None
    """The settled filter while all sensors answer; None without a filter."""
    verdict: Judgement | None
    """What the fusion is worth, and which sensor to look at; None without a filter."""


def answer_fusion(recording: Recording, options: FusionOptions, progress: Progress) -> FusionAnswer:
    """Find and judge the filter that fuses channels of a recording.

    Raises:
        BadSetting: no such channels, two units, options that contradict each other, or a target out of reach.
    """
    sensors, reference = _sensors(recording, options)
    units = {name: units_of(recording)[name] for name in sensors}
    request = _request_of(options, recording)
    z = recording.values[:, [recording.index(name) for name in sensors]]
    dt = recording.steps() if recording.gaps == "dt" else None
    known = _known_noise(options, recording, sensors)

    def fitted(z: Array, dt: Array | None, progress: Progress) -> tuple[Estimate, FilterParams | None]:
        """The estimate, and the filter that is asked for."""
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
        return fit, _with_gate(_at_goal(fit, request, recording.sample_period), options.gate)

    fit, params = fitted(z, dt, progress.part(0.0, 0.5))
    verdict = None
    if params is not None:
        judging = progress.part(0.5, 1.0)
        verdict = judge_fusion(
            z,
            replace(fit, params=params),
            dt,
            names=sensors,
            unit=units[reference or sensors[0]],
            sample_period=recording.sample_period,
            fit=lambda half, steps: fitted(half, steps, judging)[1] or params,
        )
    return FusionAnswer(
        sensors=sensors,
        units=tuple(units.values()),
        unit=units[reference or sensors[0]],
        rows=len(z),
        readings=tuple(np.isfinite(z).sum(axis=0).tolist()),
        sample_period=recording.sample_period,
        request=request,
        estimate=fit,
        params=params,
        how=_how(options, request),
        steady=None if params is None else steady_state(params.as_single, recording.sample_period),
        verdict=verdict,
    )


def _sensors(recording: Recording, options: FusionOptions) -> tuple[tuple[str, ...], str | None]:
    """The channels to fuse, and the reference among them, if one is named."""
    reference = options.reference
    mixed = options.sensor_gains and reference is not None
    sensors = channels_to_fuse(units_of(recording), options.fuse or "", mixed_units=mixed)
    return sensors, None if reference is None else sensor_named(sensors, "--reference", reference)


def _at_goal(fit: Estimate, request: Request, period: float | None) -> FilterParams | None:
    """The filter with the q and momentum that meet the target while all sensors answer; as found without a target.

    A target needs no q of the record: the noises of the sensors are enough.
    """
    if not request.goal:
        return fit.params
    params = fit.params
    if params is None and np.all(fit.r > 0.0):
        params = FilterParams(1.0, fit.r, offset=fit.offset, gain=fit.gain)
    if params is None:
        return None
    r = float(params.as_single.r)
    if request.ratio is not None:
        return replace(params, q=request.ratio * r, momentum=0.0)
    momentum = 0.0 if request.momentum == "auto" else request.momentum
    met = params_for_specification(
        r, **request.target, sample_period=period, momentum=momentum, overshoot=request.overshoot
    )
    if not met.q:
        raise BadSetting("the target must leave q above 0: ask for less smoothing (got q = 0)")
    return replace(params, q=met.q, momentum=met.momentum)


def _with_gate(params: FilterParams | None, gate: float | None) -> FilterParams | None:
    if params is None or gate is None:
        return params
    return replace(params, gate=None if math.isnan(gate) else gate)


def _how(options: FusionOptions, request: Request) -> str:
    """How the filter was found, for the tuning file."""
    known = (options.r, options.sigma, options.density) != (None, None, None)
    origin = "r given" if known else "r from a still stretch" if options.still is not None else ""
    parts = [part for part in (request.goal, origin) if part]
    return ", ".join(["fused", *parts, *([] if request.goal else ["maximum likelihood"])])


def _known_noise(options: FusionOptions, recording: Recording, sensors: tuple[str, ...]) -> list[float]:
    """The r of each sensor that is known, unit²; NaN where it is to be estimated.

    Raises:
        BadSetting: an option names another sensor, or a sensor shows no still stretch.
    """
    if options.sensor_noise is not None:
        option, given = options.sensor_noise
        values = for_each_sensor(sensors, option, given)
        return [value * value if option == "--sigma" else value for value in values]
    dt = recording.steps() if recording.gaps == "dt" else None
    noise = options.request(recording).noise
    known = [noise.resolve(recording.channel(name), dt) for name in sensors]
    return [math.nan if one is None else one[0] for one in known]


def _request_of(options: FusionOptions, recording: Recording) -> Request:
    """The target, momentum and robustness that were asked for; without noise: each sensor has its own.

    Raises:
        BadSetting: an option that a fusion cannot have.
    """
    if options.method != "ml":
        raise BadSetting(
            f"--method must be ml with --fuse, the only one for several sensors (got {options.method})"
        )
    request = replace(options, r=None, sigma=None).request(recording)
    request = replace(request, noise=Noise())
    request.checked_momentum()
    return request


def summary_of(answer: FusionAnswer) -> list[str]:
    """The lines of the answer, the verdict first."""
    fit, params, verdict = answer.estimate, answer.params, answer.verdict
    if params is None or verdict is None:
        choose = [NOTHING_FOUND] if fit.verdict in ("no_noise", "no_movement") else []
        return _page(_nothing(answer), fit.message, *fit.notes, *choose)
    lines = _page(verdict.headline, verdict.second_half, _filter(answer, params))
    lines += list(_table(answer, params, verdict))
    notes = [*(one.text for one in verdict.findings), *_about_fit(answer, params), *fit.notes]
    return lines + _page(*notes, _next(answer, params, verdict))


def details_of(answer: FusionAnswer) -> list[str]:
    """What `--details` adds: how it was found, and what the record allows."""
    fit = answer.estimate
    of_fit = "" if answer.request.goal else f" {fit.message}"  # which says how the fit settles, not what was chosen
    lines = ["", *wrapped(f"How: {answer.how}.{of_fit}"), "", "Where a sensor fails:"]
    for one in () if answer.verdict is None else answer.verdict.sensors:
        lines += wrapped("  " + " ".join(one.if_it_fails))
    lines += ["", "The record allows (95 %):"]
    q = between(*fit.q_interval.tolist())
    lines.append(f"  q {q} {squared(answer.unit)}")
    for i, name in enumerate(answer.sensors):
        offset = " to ".join(number(end) for end in fit.offset_interval[i].tolist())
        gain = " to ".join(number(end) for end in fit.gain_interval[i].tolist())
        lines += wrapped(
            f"  {name}: r {between(*fit.r_interval[i].tolist())} {squared(answer.units[i])}, offset {offset}"
            f"{f' {answer.units[i]}' if answer.units[i] else ''}{f', gain {gain}' if _has_gains(answer) else ''}; "
            f"{count(answer.readings[i])} readings of {count(answer.rows)}"
        )
    return lines


def _about_fit(answer: FusionAnswer, params: FilterParams) -> Iterator[str]:
    """What a goal costs, and that the record leaves a parameter open; nothing where it is the best fit."""
    fit, goal = answer.estimate, answer.request.goal
    if goal:
        yield f"You chose {goal}{_beside_fit(fit.q / params.q)}"
    if fit.verdict != "ok" and not (goal and fit.verdict == "no_movement"):
        yield fit.message


def _beside_fit(factor: float) -> str:
    """How a chosen filter differs from the best fit, whose q is `factor` times as large."""
    if factor == 0.0:
        return ". In this record no movement can be identified at all."
    if 1.0 / NEAR < factor < NEAR:
        return ", which is near the best statistical fit."
    if factor > 1.0:
        return f". The best statistical fit would follow faster (q {number(factor, 2)} × larger)."
    return f". The best statistical fit would follow more slowly (q {number(1.0 / factor, 2)} × smaller)."


def _nothing(answer: FusionAnswer) -> str:
    return f"{' + '.join(answer.sensors)}: no filter to recommend ({answer.estimate.verdict.replace('_', ' ')})"


def _next(answer: FusionAnswer, params: FilterParams, verdict: Judgement) -> str:
    """What to do: look at a sensor that disagrees, set a gate, or keep the filter."""
    odd = [one for one in verdict.sensors if {"drift", "noise", "stuck"} & set(one.faults)]
    if odd:
        text = f"Next: look at {listed([one.name for one in odd])}"
        if any("drift" in one.faults for one in odd) and not _has_gains(answer):
            return f"{text}; sensors of different scales seem to drift too: --sensor-gains"
        compare = "; try --fuse without one of them to see what it contributes"
        return f"{text}{compare if len(answer.sensors) > 2 else ''}"
    shared = () if verdict.shared is None else verdict.shared.sensors
    if shared and len(shared) < len(answer.sensors):
        return f"Next: try --fuse without {' or without '.join(answer.sensors[i] for i in shared)}"
    if shared and not answer.request.goal:
        return "Next: choose a longer lag (--lag-ms)"
    if params.gate is None and any("spikes" in one.faults for one in verdict.sensors):
        return "Next, with --gate 16: reject readings beyond 4 σ"
    return "Next: -o tuning.toml saves it for kalscope filter, report and export; --details shows more"


def _page(*texts: str) -> list[str]:
    return [line for text in texts for line in wrapped(text)]


def _filter(answer: FusionAnswer, params: FilterParams) -> str:
    period = answer.sample_period
    text = f"q = {trimmed(params.q, 4)} {squared(answer.unit)}, {momentum_and_gate(params, period)}"
    steady = answer.steady
    if steady is None:
        return text
    noise = decibels(-steady.noise_reduction_db)
    over = f", overshoot {percent(steady.overshoot)}" if steady.overshoot else ""
    lag = lag_in_full(steady.lag_samples, period)
    return f"{text}; while all answer: lag {lag}, noise {noise} of their mean{over}"


def _table(answer: FusionAnswer, params: FilterParams, verdict: Judgement) -> Iterator[str]:
    """A row a sensor: noise, offset, share, and what is left without it."""
    gains = _has_gains(answer)
    head = ("sensor", "noise σ", "r", "offset", *(("gain",) if gains else ()), "share", "error alone", "without it")
    rows: list[tuple[str, ...]] = [head]
    for i, name in enumerate(answer.sensors):
        unit = _after(answer.units[i])
        rows.append(
            (
                name if len(name) <= MAX_NAME else f"{name[: MAX_NAME - 1]}…",
                f"{number(math.sqrt(float(params.sensor_r[i])))}{unit}",
                f"{number(float(params.sensor_r[i]))} {squared(answer.units[i])}",
                f"{number(float(params.offset[i]))}{unit}",
                *((number(float(params.gain[i])),) if gains else ()),
                percent(float(params.shares[i])),
                f"{number(verdict.sensors[i].error)}{_after(answer.unit)}",
                f"{number(verdict.sensors[i].error_without)}{_after(answer.unit)}",
            )
        )
    yield from _aligned(rows)


def _aligned(rows: Sequence[Sequence[str]]) -> Iterator[str]:
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for first, *rest in rows:
        yield f"  {first:<{widths[0]}}" + "".join(
            f"  {cell:>{w}}" for cell, w in zip(rest, widths[1:], strict=True)
        )


def _has_gains(answer: FusionAnswer) -> bool:
    gain: Array = answer.estimate.gain
    return bool(np.any(gain != 1.0))


def _after(unit: str) -> str:
    return f" {unit}" if unit else ""


def as_plain(answer: FusionAnswer) -> dict[str, Any]:
    """The answer as one object of JSON."""
    fit, params, verdict = answer.estimate, answer.params, answer.verdict
    sensors = [
        {
            "name": name,
            "unit": answer.units[i],
            "readings": answer.readings[i],
            "r": None if params is None else float(params.sensor_r[i]),
            "offset": None if params is None else float(params.offset[i]),
            "gain": None if params is None else float(params.gain[i]),
            "share": None if params is None else float(params.shares[i]),
            "r_interval": fit.r_interval[i].tolist(),
            "offset_interval": fit.offset_interval[i].tolist(),
            "gain_interval": fit.gain_interval[i].tolist(),
            "spikes": fit.spikes[i].tolist(),
            "judgement": None if verdict is None else _sensor(verdict.sensors[i]),
        }
        for i, name in enumerate(answer.sensors)
    ]
    return {
        "fused": list(answer.sensors),
        "unit": answer.unit,
        "rows": answer.rows,
        "sample_period": answer.sample_period,
        **{name: None if params is None else getattr(params, name) for name in ("q", "momentum", "gate")},
        "verdict": fit.verdict,
        "message": fit.message,
        "shared_noise": _shared(fit),
        "notes": list(fit.notes),
        "how": answer.how,
        "q_interval": fit.q_interval.tolist(),
        "loglik": fit.loglik,
        "steady": None if answer.steady is None else asdict(answer.steady),
        "error": None if verdict is None else verdict.error,
        "held_out": None if verdict is None or verdict.prediction is None else asdict(verdict.prediction),
        "judgement": [] if verdict is None else list(verdict.sentences),
        "sensors": sensors,
    }


def save_fusion(recording: Recording, answer: FusionAnswer, output: Path) -> list[str]:
    """Save the fusion, and for each sensor the single filter with its noise; returns notes for the user."""
    params = answer.params
    if params is None:
        raise BadSetting(
            f"-o needs a usable q and r of each sensor, and the record gives none: {answer.estimate.message}"
        )
    fusion = ChannelTuning.of_params(name_of_fused(recording), answer.unit, params, answer.how, answer.sensors)
    single = [
        ChannelTuning(
            name, unit, params.q * gain * gain, r, how=answer.how, gate=params.gate, momentum=params.momentum
        )
        for name, unit, r, gain in zip(answer.sensors, answer.units, fusion.r, fusion.gain, strict=True)
    ]
    return save(recording, single, set(answer.sensors), output, fusion)


def _shared(found: Estimate) -> dict[str, Any] | None:
    one = found.shared
    return one and {"sensors": [found.names[i] for i in one.sensors], "correlation": one.correlation}


def _sensor(one: Judgement) -> dict[str, Any]:
    names = (
        *("name", "share", "answered", "error", "error_without", "shares_without", "pull"),
        *("drift", "noise_ratio", "spikes", "stuck", "silent", "faults"),
    )
    sentences = [*(fault.text for fault in one.findings), *one.if_it_fails]
    return {**{name: getattr(one, name) for name in names}, "sentences": sentences}
