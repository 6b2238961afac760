"""What is printed of a finished fleet, in words."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from kalscope.common.text import (
    THIN_SPACE,
    count,
    decibels,
    duration,
    lag_in_full,
    number,
    percent,
    plural,
    squared,
    trimmed,
)
from kalscope.filtering.arrays import scalar
from kalscope.filtering.steady_state import steady_state
from kalscope.tuning.fleet.answer.answer import WITHIN, Answer, Shared
from kalscope.tuning.fleet.run import Tally
from kalscope.tuning.fleet.store.begun import TABLE, TUNING

MAX_REASONS = 5
"""Reasons that are printed; the table has them all."""
MAX_NAMED = 5
"""Devices that are printed; fleet.json has more."""
NAMES = {"r": "r", "q": "q", "rate_hz": "sample rate"}
"""The quantities in which devices are compared, for the user."""


def summary(answer: Answer, tally: Tally, folder: Path) -> str:
    """How many rows, how many without q and r and why, one filter for all, who is unlike the others, the files."""
    lines = [
        _done(len(answer.devices), tally),
        *_reasons(answer),
        *_filter(answer),
        *_unlike(answer),
        *_changed(answer),
    ]
    files = [f"Table: {folder / TABLE}"] + ([f"tuning: {folder / TUNING}"] if answer.shared else [])
    return "\n".join(map(_harmless, [*lines, "; ".join(files)])) + "\n"


def _harmless(line: str) -> str:
    """A line without what would move the cursor of a terminal: names come from files."""
    return "".join(c if c.isprintable() or c == THIN_SPACE else " " for c in line)


def _done(rows: int, tally: Tally) -> str:
    """How many rows there are, and what this run did for them."""
    if not tally.done:
        return f"{count(rows)} rows: nothing was missing"
    new = f"{count(tally.done)} of {count(tally.units)} files or row groups"
    speed = f" in {duration(tally.seconds)}, {number(tally.rows / tally.seconds)} rows/s" if tally.seconds else ""
    return f"{count(rows)} rows: {new} read{speed}"


def _reasons(answer: Answer) -> Iterator[str]:
    reasons = answer.devices.reasons
    if reasons:
        common = reasons.most_common(MAX_REASONS)
        yield f"{count(reasons.total())} without q and r:"
        yield from (f"  {count(times)} × {reason}" for reason, times in common)
        others = reasons.total() - sum(times for _, times in common)
        if others:
            yield f"  {count(others)} for other reasons"


def _filter(answer: Answer) -> Iterator[str]:
    shared, devices = answer.shared, answer.devices
    if shared is None:
        yield f"No filter for all: {answer.refusal}"
        return
    q, r, unit = (trimmed(scalar(shared.params.q), 4), trimmed(scalar(shared.params.r), 4), squared(devices.unit))
    settled = steady_state(shared.params, devices.sample_period)
    lag = lag_in_full(scalar(settled.lag_samples), devices.sample_period)
    noise = decibels(-scalar(settled.noise_reduction_db))
    yield f"One filter for all: q = {q}, r = {r} {unit}, lag {lag}, noise {noise} ({shared.how})"
    yield from _served(answer, shared)
    if devices.rates_differ:
        yield f"  the sample rates differ: q holds for {duration(devices.sample_period)} a sample"


def _served(answer: Answer, shared: Shared) -> Iterator[str]:
    judged = int(np.isfinite(shared.growth).sum())
    with_momentum = int((answer.devices.usable & (answer.devices.momentum > 0.0)).sum())
    if judged:
        worst = [
            f"{answer.devices.name(i)} +{percent(float(shared.growth[i]))}" for i in shared.not_served[:MAX_NAMED]
        ]
        more = f"; not {', '.join(worst)}{_and_more(len(shared.not_served))}" if worst else ""
        yield (
            f"  for {percent(shared.served)} of {count(judged)} its prediction error is at most {percent(WITHIN)} "
            f"above that of the device's own filter{more}"
        )
    if with_momentum:
        yield f"  {count(with_momentum)} with momentum are not judged: --momentum 0 fits all alike"


def _unlike(answer: Answer) -> Iterator[str]:
    found = {name: one for name, one in answer.unlike.items() if len(one.devices)}
    for name, one in found.items():
        values = getattr(answer.devices, name)
        named = [
            f"{answer.devices.name(i)} ({number(values[i] / math.exp(one.middle))} ×)"
            for i in one.devices[:MAX_NAMED]
        ]
        yield (
            f"Unlike the others in {NAMES[name]}, {trimmed(one.expected)} expected by chance: "
            f"{', '.join(named)}{_and_more(len(one.devices))}"
        )
    if not found and answer.devices.usable.any():
        yield "No device is unlike the others in r, q or sample rate"


def _changed(answer: Answer) -> Iterator[str]:
    for name, one in answer.changed.items():
        devices = [int(i) for i in one.found.changed]
        named = [
            f"{one.name(i)} ({number(one.factor(i))} × from {answer.devices.name(one.since(i))} on)"
            for i in devices[:MAX_NAMED]
        ]
        several = int((one.found.files > 1).sum())
        what = f"{', '.join(named)}{_and_more(len(devices))}" if named else "none"
        yield f"Changed in {name}, of {plural(several, 'device')} with several recordings: {what}"


def _and_more(n: int) -> str:
    return f" and {count(n - MAX_NAMED)} more" if n > MAX_NAMED else ""
