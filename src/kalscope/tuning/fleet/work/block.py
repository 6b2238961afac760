"""The fit of the recordings in some row groups: in one compiled call where they need nothing but the fit."""

from __future__ import annotations

import math
import time
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from kalscope.common.array import Array, Indices, Mask
from kalscope.errors import BadFile, KalscopeError
from kalscope.estimation.finding import Request, find_parameters
from kalscope.estimation.fleet.held_out import held_out
from kalscope.estimation.fleet.losses import left_by
from kalscope.estimation.fleet.many.estimate_many import estimate_many
from kalscope.estimation.fleet.many.series import Series as Many
from kalscope.estimation.fleet.many.table import EstimateTable
from kalscope.estimation.fleet.pool import Pool, pool_of
from kalscope.filtering.params import FilterParams
from kalscope.sources.grammar.read_options import ReadOptions
from kalscope.tuning.fleet.recordings.unit import Unit
from kalscope.tuning.fleet.store.left import packed
from kalscope.tuning.fleet.store.row import Row
from kalscope.tuning.fleet.work.asked import Asked, Question, any_recording
from kalscope.tuning.fleet.work.fit import Fitted, first_sentence, fit_each, mean_nis
from kalscope.tuning.fleet.work.read import channels_of
from kalscope.tuning.fleet.work.row_groups import Block, read_block

PLAIN = (Request(momentum=0.0, robust=False), Request(momentum=0.0))
"""The questions that `estimate_many` answers in one compiled call: without spikes set aside, and with."""

NUMBERS = ("q", "r", "q_low", "q_high", "r_low", "r_high", "lag_samples")
"""The fields of a row that the compiled call gives."""


def fit_block(unit: Unit, asked: Asked) -> Fitted:
    """Fit the recordings of a unit that is made of row groups.

    Raises:
        BadFile: they cannot be read, or hold no channel.
        BadSetting: there is no such time column.
    """
    block = read_block(unit, asked.reading)
    if block is None:
        if unit.span is not None:  # a footer may cut its ids: no id lies between two of them
            return Fitted([], Pool.empty())
        raise BadFile("the row groups must hold at least one row (got none)")
    steps = _plain_steps(block, asked)
    known = np.isfinite(steps)
    plain = (
        _fit_plain(block, steps, np.flatnonzero(known), asked.question, unit.source)
        if known.any()
        else Fitted([], Pool.empty())
    )
    if known.all():
        return plain
    rows: list[Row] = []
    pool, again, rest = plain.pool, plain.again, iter(plain.rows)
    for i, is_plain in enumerate(known.tolist()):
        if is_plain:
            rows.append(next(rest))
            continue
        one = _fit_recording(block, i, asked)
        rows += one.rows
        pool, again = pool + one.pool, again or one.again
    return Fitted(rows, pool, again)


def _fit_recording(block: Block, i: int, asked: Asked) -> Fitted:
    """One recording, in the same way as a file."""
    try:
        recording = block.recording(i, asked.reading, asked.sample_period)
        return fit_each(channels_of(recording, block.ids[i], None, asked), asked.question)
    except Exception as error:  # whatever is wrong with one recording, the others go on
        return Fitted.lost(Row(id=block.ids[i]), error)


def _plain_steps(block: Block, asked: Asked) -> Array:
    """The sample period in s of each recording that `_fit_plain` may take; NaN for the others."""
    reading = asked.reading
    one_channel = len(block.columns.names) == 1 and asked.channel in (None, block.columns.names[0])
    as_stamped = replace(reading, time_column=None, time_unit=None) == ReadOptions() and asked.sample_period is None
    if not (one_channel and as_stamped and is_plain(asked.question)):
        return np.full(len(block.ids), math.nan)
    infinite: Mask = np.logical_or.reduceat(np.isinf(block.columns.values[0]), block.starts[:-1])
    return np.where(infinite, math.nan, block.even_steps())


def is_plain(question: Question) -> bool:
    """Whether nothing is asked but q and r, without momentum."""
    try:
        return question.gate is None and question.request(any_recording()) in PLAIN
    except KalscopeError:  # a still stretch from … to
        return False


def _fit_plain(block: Block, steps: Array, chosen: Indices, question: Question, source: str) -> Fitted:
    """Fit the chosen recordings, one channel each with even stamps, in one compiled call."""
    begun, request = time.thread_time(), question.request(any_recording())
    values, sizes = block.columns.values[0], np.diff(block.starts)
    if len(chosen) < len(sizes):
        values = np.concatenate([values[block.starts[i] : block.starts[i + 1]] for i in chosen])
    starts = np.concatenate(([0], np.cumsum(sizes[chosen])))
    many = Many(values, starts.astype(np.int64), np.empty(0))
    table = estimate_many(many, robust=request.robust)
    used = many.values
    if len(table.set_aside):
        used = used.copy()
        used[table.set_aside] = math.nan
    cleaned = Many(used, many.starts, many.steps)
    pool, left = pool_of(cleaned), _left(cleaned, table)
    seconds = (time.thread_time() - begun) / len(chosen)
    channel, unit = block.columns.names[0], block.columns.units[0]
    names = [block.ids[int(i)] for i in chosen]
    heads = zip(names, sizes[chosen].tolist(), steps[chosen].tolist(), map(str, table.verdict), strict=True)
    pairs = (table.q, table.r, *table.q_interval, *table.r_interval, table.lag_samples)
    numbers: list[list[float]] = np.stack(pairs, axis=1).tolist()
    rows: list[Row] = []
    for (name, n, step, verdict), found, usable in zip(heads, numbers, table.usable, strict=True):
        head = partial(Row, name, channel, unit, n, 1.0 / step, verdict=verdict, seconds=seconds, source=source)
        if usable:
            i = len(rows)
            known: dict[str, Any] = dict(zip(NUMBERS, found, strict=True))
            gate = float(table.gate[i]) ** 2 if table.gate[i] < math.inf else None
            # The scale of the likelihood's maximum makes the mean of v²/s one; a floor of r or a gate does not.
            exact = verdict != "below_resolution" and not table.spikes[i]
            nis = 1.0 if exact else _nis(many, i, FilterParams(found[0], found[1], gate=gate))
            known |= {"momentum": 0.0, "gate": gate, "spikes": int(table.spikes[i]), "nis": nis, "left": left[i]}
            rows.append(head(**known))
        else:
            message = find_parameters(many.one(len(rows))[0], request).message
            rows.append(head(reason=first_sentence(message)))
    return Fitted(rows, pool)


def _left(many: Many, table: EstimateTable) -> list[bytes | None]:
    """What the loss of each device by a filter for all is computed from; None for one without q and r."""
    own = np.where(table.usable, table.ratio, math.nan)
    return packed(left_by(own, np.zeros(len(own)), held_out(many)))


def _nis(many: Many, i: int, params: FilterParams) -> float | None:
    return mean_nis(many.one(i)[0], params, None)
