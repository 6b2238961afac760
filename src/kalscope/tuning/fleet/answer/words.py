"""The text that is printed for a finished fleet."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from kalscope.common.array import Array
from kalscope.common.text import (
    THIN_SPACE,
    count,
    decibels,
    duration,
    lag_in_full,
    lag_text,
    number,
    percent,
    plural,
    squared,
    trimmed,
)
from kalscope.estimation.fleet.losses import Losses
from kalscope.filtering.steady_state import steady_state
from kalscope.tuning.fleet.answer.answer import WITHIN, Answer, Shared
from kalscope.tuning.fleet.answer.devices import Devices
from kalscope.tuning.fleet.run import Tally
from kalscope.tuning.fleet.store.begun import TABLE, TUNING

MAX_REASONS = 5
"""Reasons that are printed; the table has them all."""
MAX_NAMED = 5
"""Devices that are printed; fleet.json has more."""
NAMES = {"r": "r", "q": "q", "rate_hz": "sample rate"}
"""The quantities in which devices are compared, for the user."""


def summary(answer: Answer, tally: Tally, folder: Path) -> str:
    """How many rows, how many without q and r and why, one filter for all, the devices unlike others, the files."""
    lines = [
        f"{answer.devices.counted}; {_done(tally)}",
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


def _done(tally: Tally) -> str:
    """What this run did."""
    if not tally.done:
        return "nothing was missing"
    new = f"{count(tally.done)} of {count(tally.units)} files or row groups"
    speed = f" in {duration(tally.seconds)}, {number(tally.rows / tally.seconds)} rows/s" if tally.seconds else ""
    return f"{new} done{speed}"


def _reasons(answer: Answer) -> Iterator[str]:
    reasons = answer.devices.reasons
    if reasons:
        common = reasons.most_common(MAX_REASONS)
        yield "Why not all have q and r:"
        yield from (f"  {count(times)} × {reason}" for reason, times in common)
        others = reasons.total() - sum(times for _, times in common)
        if others:
            yield f"  {count(others)} for other reasons"


def _filter(answer: Answer) -> Iterator[str]:
    shared, devices = answer.shared, answer.devices
    if shared is None:
        yield f"No filter for all: {answer.refusal}"
        return
    q, r, unit = (trimmed(shared.params.q, 4), trimmed(float(shared.params.r), 4), squared(devices.unit))
    settled = steady_state(shared.params, devices.sample_period)
    lag = lag_in_full(settled.lag_samples, devices.sample_period)
    noise = decibels(-settled.noise_reduction_db)
    yield f"One filter for all: q = {q}, r = {r} {unit}, lag {lag}, noise {noise} ({shared.how})"
    yield from _served(answer, shared)
    if devices.rates_differ:
        yield f"  the sample rates differ: q holds for {duration(devices.sample_period)} a sample"


def _served(answer: Answer, shared: Shared) -> Iterator[str]:
    """How many devices it suits, and what it costs them."""
    devices = answer.devices
    if shared.judged:
        worst = [
            f"{devices.name(i)} ({', '.join(_lost(devices, shared.losses, i))})"
            for i in map(int, shared.not_served[:MAX_NAMED])
        ]
        more = f"; not {', '.join(worst)}{_and_more(len(shared.not_served))}" if worst else ""
        yield (
            f"  for {percent(shared.served)} of {count(shared.judged)} its prediction error on unseen samples is "
            f"at most {percent(WITHIN)} above that of the device's own filter{more}"
        )
        yield from _usual_loss(devices, shared.losses)
    elif shared.params.momentum > 0.0:
        yield "  what each device loses is only tried without momentum"


def _lost(devices: Devices, losses: Losses, i: int) -> list[str]:
    """What one device loses."""
    period = 1.0 / float(devices.rate_hz[i]) if devices.rate_hz[i] > 0.0 else None
    lag, noise = float(losses.lag_samples[i]), float(losses.noise_db[i])
    said = [f"error {_signed(percent(float(losses.error[i])))}"]
    if math.isfinite(lag):
        said.append(f"lag {_signed(lag_text(lag, period))}")
    return [*said, f"noise {_signed(decibels(noise))}"] if math.isfinite(noise) else said


def _usual_loss(devices: Devices, losses: Losses) -> Iterator[str]:
    """What nine of ten devices lose, at the median sample rate."""
    said: list[str] = []
    texts: tuple[tuple[str, Array, Callable[[float], str]], ...] = (
        ("error", losses.error, percent),
        ("lag", losses.lag_samples, lambda value: lag_text(value, devices.sample_period)),
        ("noise", losses.noise_db, decibels),
    )
    for name, values, text in texts:
        known = values[np.isfinite(values)]
        if len(known):
            low, high = np.percentile(known, (5.0, 95.0)).tolist()
            said.append(f"{name} {_signed(text(low))} to {_signed(text(high))}")
    yield f"  nine of ten devices, against their own filters: {', '.join(said)}"


def _signed(text: str) -> str:
    return text if text.startswith(("−", "-")) else f"+{text}"


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
