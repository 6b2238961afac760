"""What `kalscope tune --fuse` prints: what the fusion is worth, the filter, a table of the sensors, notes."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from kalscope.cli.tune.fusion.answer import Errors, FusionAnswer
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
from kalscope.filtering.arrays import scalar
from kalscope.filtering.fusion.params import FusionParams

MAX_NAME = 24
"""Characters of a sensor's name in the table."""


def summary_of(answer: FusionAnswer) -> list[str]:
    """The lines of the answer, the verdict first."""
    if answer.params is None or answer.errors is None:
        return [
            line
            for text in (_nothing(answer), answer.estimate.message, *answer.estimate.notes, _instead())
            for line in wrapped(text)
        ]
    said = [_worth(answer, answer.errors), _filter(answer, answer.params)]
    lines = [line for text in said for line in wrapped(text)]
    lines += [*_table(answer, answer.params, answer.errors)]
    notes = [
        *answer.estimate.notes,
        "Next: -o tuning.toml keeps it, kalscope filter --config tuning.toml fuses with it",
    ]
    return lines + [line for text in notes for line in wrapped(text)]


def details_of(answer: FusionAnswer) -> list[str]:
    """What `--details` adds: how it was found, and what the record allows."""
    found = answer.estimate
    lines = ["", *wrapped(f"How: {answer.how}. {found.message}"), "", "The record allows (95 %):"]
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


def _nothing(answer: FusionAnswer) -> str:
    return f"{' + '.join(answer.sensors)}: no filter to recommend ({answer.estimate.verdict.replace('_', ' ')})"


def _instead() -> str:
    return "Next: give the noise of a sensor (--sigma a=0.4), or choose a filter (--lag-ms, --cutoff-hz, --gain)"


def _worth(answer: FusionAnswer, errors: Errors) -> str:
    """How much better than the best sensor alone."""
    best = int(np.nanargmin(errors.alone))
    alone, name, unit = float(errors.alone[best]), answer.sensors[best], _after(answer.unit)
    share = 1.0 - errors.fused / alone if alone else 0.0
    start = f"{' + '.join(answer.sensors)} fused: error {number(errors.fused)}{unit} (1 σ, predicted)"
    return f"{start}, {percent(share)} below that of {name} alone ({number(alone)}{unit}), the best of them"


def _filter(answer: FusionAnswer, params: FusionParams) -> str:
    tau, period = params.momentum, answer.sample_period
    momentum = f"momentum {lag_in_full(tau, period)}" if tau else "no momentum"
    gate = "no gate" if params.gate is None else f"gate {gate_text(params.gate)}"
    text = f"q = {trimmed(params.q, 4)} {squared(answer.unit)}, {momentum}, {gate}"
    steady = answer.steady
    if steady is None:
        return text
    noise = decibels(-scalar(steady.noise_reduction_db))
    over = f", overshoot {percent(scalar(steady.overshoot))}" if scalar(steady.overshoot) else ""
    lag = lag_in_full(scalar(steady.lag_samples), period)
    return f"{text}; while all answer: lag {lag}, noise {noise} of their mean{over}"


def _table(answer: FusionAnswer, params: FusionParams, errors: Errors) -> Iterator[str]:
    """A row a sensor: noise, offset, share, and what is left without it."""
    gains = _has_gains(answer)
    head = ("sensor", "noise σ", "r", "offset", *(("gain",) if gains else ()), "share", "alone", "without it")
    rows: list[tuple[str, ...]] = [head]
    for i, name in enumerate(answer.sensors):
        unit = _after(answer.units[i])
        rows.append(
            (
                name if len(name) <= MAX_NAME else f"{name[: MAX_NAME - 1]}…",
                f"{number(math.sqrt(float(params.r[i])))}{unit}",
                f"{number(float(params.r[i]))} {squared(answer.units[i])}",
                f"{number(float(params.offset[i]))}{unit}",
                *((number(float(params.gain[i])),) if gains else ()),
                percent(float(params.shares[i])),
                f"{number(float(errors.alone[i]))}{_after(answer.unit)}",
                f"{number(float(errors.without[i]))}{_after(answer.unit)}",
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
