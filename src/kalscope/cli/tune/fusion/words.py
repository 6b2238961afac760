"""What `kalscope tune --fuse` prints: what the fusion is worth, the filter, a table of the sensors, notes."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from kalscope.analysis.fused import FusionJudgement
from kalscope.cli.tune.fusion.answer import FusionAnswer
from kalscope.cli.tune.words import between, wrapped
from kalscope.common.array import Array
from kalscope.common.text import (
    count,
    decibels,
    gate_text,
    lag_in_full,
    number,
    percent,
    squared,
    trimmed,
)
from kalscope.estimation.fusion.words import listed
from kalscope.filtering.params import FilterParams

NOTHING_FOUND = (
    "Next: give the noise of a sensor (--sigma a=0.4), or choose a filter by its lag or its cut-off (--lag-ms, "
    "--cutoff-hz)"
)
"""What to do where the record leaves q or r open."""

NEAR = 2.0
"""A q that differs by less than this factor filters much the same."""

MAX_NAME = 24
"""Characters of a sensor's name in the table."""


def summary_of(answer: FusionAnswer) -> list[str]:
    """The lines of the answer, the verdict first."""
    found, params, verdict = answer.estimate, answer.params, answer.verdict
    if params is None or verdict is None:
        choose = [NOTHING_FOUND] if found.verdict in ("no_noise", "no_movement") else []
        return _page(_nothing(answer), found.message, *found.notes, *choose)
    lines = _page(verdict.headline, verdict.second_half, _filter(answer, params)) + list(
        _table(answer, params, verdict)
    )
    notes = [*(one.text for one in verdict.findings), *_about_fit(answer, params), *found.notes]
    return lines + _page(*notes, _next(answer, params, verdict))


def details_of(answer: FusionAnswer) -> list[str]:
    """What `--details` adds: how it was found, and what the record allows."""
    found = answer.estimate
    of_fit = (
        "" if answer.request.goal else f" {found.message}"
    )  # which says how the fit settles, not what was chosen
    lines = ["", *wrapped(f"How: {answer.how}.{of_fit}"), "", "Where a sensor fails:"]
    for one in () if answer.verdict is None else answer.verdict.sensors:
        lines += wrapped("  " + " ".join(one.if_it_fails))
    lines += ["", "The record allows (95 %):"]
    q = between(*found.q_interval.tolist())
    lines.append(f"  q {q} {squared(answer.unit)}")
    for i, name in enumerate(answer.sensors):
        offset = " to ".join(number(end) for end in found.offset_interval[i].tolist())
        gain = " to ".join(number(end) for end in found.gain_interval[i].tolist())
        lines += wrapped(
            f"  {name}: r {between(*found.r_interval[i].tolist())} {squared(answer.units[i])}, offset {offset}"
            f"{f' {answer.units[i]}' if answer.units[i] else ''}{f', gain {gain}' if _has_gains(answer) else ''}; "
            f"{count(answer.readings[i])} readings of {count(answer.rows)}"
        )
    return lines


def _about_fit(answer: FusionAnswer, params: FilterParams) -> Iterator[str]:
    """What a goal costs, and that the record leaves a parameter open; nothing where it is the best fit."""
    found, goal = answer.estimate, answer.request.goal
    if goal:
        yield f"You chose {goal}{_beside_fit(found.q / params.q)}"
    if found.verdict != "ok" and not (goal and found.verdict == "no_movement"):
        yield found.message


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


def _next(answer: FusionAnswer, params: FilterParams, verdict: FusionJudgement) -> str:
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
    tau, period = params.momentum, answer.sample_period
    momentum = f"momentum {lag_in_full(tau, period)}" if tau else "no momentum"
    gate = "no gate" if params.gate is None else f"gate {gate_text(params.gate)}"
    text = f"q = {trimmed(params.q, 4)} {squared(answer.unit)}, {momentum}, {gate}"
    steady = answer.steady
    if steady is None:
        return text
    noise = decibels(-steady.noise_reduction_db)
    over = f", overshoot {percent(steady.overshoot)}" if steady.overshoot else ""
    lag = lag_in_full(steady.lag_samples, period)
    return f"{text}; while all answer: lag {lag}, noise {noise} of their mean{over}"


def _table(answer: FusionAnswer, params: FilterParams, verdict: FusionJudgement) -> Iterator[str]:
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
