"""What a worker does: fit the recordings of a batch, each within its time limit."""

from __future__ import annotations

import faulthandler
import hashlib
import math
import threading
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from kalscope.analysis.channel_kinds import default_channel
from kalscope.common.numbers import Array, Indices, Mask
from kalscope.common.text import first_sentence, program
from kalscope.errors import BadFile, BadSetting, KalscopeError, describe
from kalscope.estimation.fit import estimate
from kalscope.estimation.many import Series, estimate_many, fitted_ratios, pair_intervals, series_of
from kalscope.estimation.pool import Pool, held_out, loss_inputs, pool_of
from kalscope.estimation.request import Request, find_parameters
from kalscope.filtering.steady import steady_state
from kalscope.fleet.read import Block, FleetOptions, Unit, read_block
from kalscope.fleet.store import FAILED, STORE, Row, Stored, stored
from kalscope.recording import Recording
from kalscope.sources.grammar.read_options import ReadOptions
from kalscope.sources.reading.recording_file import read_recording

MAX_SECONDS = 10.0
"""A batch that takes longer ends after its current unit; the others are distributed to idle workers."""
DEVICE_LIMIT_S = 120.0
"""Longest time for a unit of up to FULL_BYTES, s."""
FULL_BYTES = 16 << 20
"""A larger unit has more time, in proportion to its bytes."""
CHOSEN = "chosen"
"""Verdict where the filter follows from the options alone."""
PLAIN = (Request(momentum=0.0, robust=False), Request(momentum=0.0))
"""The questions that `estimate_many` answers in one compiled call: without spikes set aside, and with."""
_TIMEOUT = b"Timeout ("
"""How `faulthandler` begins its report."""
_compiled: set[str] = set()
"""The options for which this process has compiled the fits."""
_one_batch = threading.Lock()
"""Held by the thread whose batch this process does: a process has one clock."""


class Fitted(NamedTuple):
    """The results for some recordings."""

    rows: list[Row]
    """A row for each channel."""
    pool: Pool
    """What all of them contribute to one filter for all."""


class TimedOut(Exception):
    """A unit of the batch has ended an earlier worker; the note names it."""


def run_batch(units: Sequence[Unit], options: FleetOptions, folder: str) -> list[Stored]:
    """Fit the units of a batch, from the first on; the last ones are left out where it takes long.

    A unit that takes too long ends its process, wherever it hangs, and a note names it. A thread of C does it
    without the lock of the interpreter, which a compiled loop may hold for ever.

    Args:
        units: The batch; at least the first is done.
        options: The options.
        folder: Of the results, under the path that the worker has for it: for the note.

    Raises:
        BadSetting: the worker does not see the folder, or has another version.
        TimedOut: an earlier attempt was ended by its time limit: a scheduler tries a batch again by itself.
        OSError: the note cannot be written.
    """
    if not (Path(folder) / STORE).exists():
        raise BadSetting(f"-o must name a folder that every worker of --cluster sees (got {folder!r})")
    if options.program != program():
        raise BadSetting(f"every worker of --cluster must have {options.program} (got {program()})")
    end, fingerprint = time.monotonic() + MAX_SECONDS, options.fingerprint()
    keys, done = [unit.key(fingerprint) for unit in units], list[Stored]()
    path = note_path(Path(folder), keys)
    if noted_unit(path)[1]:
        raise TimedOut
    if fingerprint not in _compiled:  # before the clock of a unit runs: it may take longer than most fits
        _compiled.add(fingerprint)
        z = np.random.default_rng(1).normal(size=(200, 1))
        recording = Recording(np.arange(200.0), ("x",), ("",), np.cumsum(z, axis=0) + z[::-1], 1.0)
        fit_each("", recording, replace(options, channel=None))
    with _one_batch, path.open("wb", buffering=0) as note:
        for unit, key in zip(units, keys, strict=True):
            note.seek(0)
            note.truncate()
            note.write(f"{key}\n".encode())
            faulthandler.dump_traceback_later(time_limit(unit.size), exit=True, file=note)
            fitted = fit_unit(unit, options)
            faulthandler.cancel_dump_traceback_later()
            done.append(stored(key, *fitted))
            if time.monotonic() > end:
                break
    path.unlink()
    return done


def time_limit(size: int) -> float:
    """Longest time for a unit of `size` bytes, s."""
    return min(DEVICE_LIMIT_S * max(1.0, size / FULL_BYTES), threading.TIMEOUT_MAX)


def note_path(folder: Path, keys: Sequence[str]) -> Path:
    """The note of a batch, there while it is being done: it names the unit."""
    return folder / f".{hashlib.sha256(''.join(keys).encode()).hexdigest()[:32]}.note"


def noted_unit(path: Path) -> tuple[str, bool]:
    """The unit at which the last attempt at a batch ended, "" where none is known; and whether it took too long."""
    with suppress(OSError):
        key, _, report = path.read_bytes().partition(b"\n")
        return key.decode("ascii", "replace"), report.startswith(_TIMEOUT)
    return "", False


def fit_unit(unit: Unit, options: FleetOptions) -> Fitted:
    """The result of a unit: the rows of its channels, or one with the reason why there are none."""
    try:
        if unit.reason:
            raise BadFile(unit.reason)
        if unit.span is None:
            path, period = unit.pieces[0].path, options.sample_period
            rows, pool = fit_each(unit.id, read_recording(path, options.reading, sample_period=period), options)
        else:
            rows, pool = fit_block(read_block(unit, options.reading), options)
    except Exception as error:  # one bad file must not end the others
        rows, pool = [lost_row(unit, error)], Pool.empty()
    return Fitted([replace(row, source=unit.source) for row in rows], pool)


def lost_row(unit: Unit, why: str | Exception, verdict: str = FAILED) -> Row:
    """The row of a unit that could not be read."""
    name = unit.id if unit.span is None else f"{unit.data_set}ids up to {unit.span[1]}"
    return Row(id=name, verdict=verdict, reason=_reason(why), source=unit.source)


def _reason(why: str | Exception) -> str:
    if isinstance(why, Exception):
        why = describe(why) if isinstance(why, KalscopeError | OSError) else f"{type(why).__name__}: {why}"
    return " ".join(why.split())


def fit_each(name: str, recording: Recording, options: FleetOptions) -> Fitted:
    """Fit the channels of the recording with this name; one that fails has a row that says why.

    Raises:
        BadSetting: it has no such channel.
    """
    chosen = default_channel(recording) if options.channel is None else options.channel
    rows, pool = list[Row](), Pool.empty()
    for channel in recording.names if options.every else (chosen,):
        start = time.thread_time()
        row = Row(
            id=name,
            channel=channel,
            unit=recording.units[recording.index(channel)],
            samples=len(recording),
            rate_hz=None if recording.sample_period is None else 1.0 / recording.sample_period,
            rejected_lines=recording.report.rejected,
        )
        try:
            row, one = _fit(recording, row, options)
            pool = pool + one
        except Exception as error:  # whatever is wrong with one recording, the others go on
            row = replace(row, reason=_reason(error))
        rows.append(replace(row, seconds=time.thread_time() - start))
    return Fitted(rows, pool)


def _fit(recording: Recording, row: Row, options: FleetOptions) -> tuple[Row, Pool]:
    """The row with the result of its fit, and what it contributes to one filter for all."""
    z, dt = recording.channel(row.channel), recording.steps() if recording.gaps == "dt" else None
    options.check_period(recording.sample_period)
    result = find_parameters(z, options.request, dt=dt, sample_period=recording.sample_period)
    found = result.estimate
    params = result.params if found is None else found.params  # a setting is not what this recording shows
    outliers = None if found is None else found.outliers
    many = series_of([z if outliers is None else np.where(outliers, np.nan, z)], None if dt is None else [dt])
    row = replace(row, verdict=CHOSEN if found is None else str(found.verdict))
    if params is None:
        message = result.message if found is None else found.message
        return replace(row, reason=first_sentence(message)), pool_of(many)
    ratio, tau = fitted_ratios(many, many.starts[1:]), 0.0
    if found is not None:
        ratio, tau = np.array([params.q / float(params.r)]), params.momentum
        q_low, q_high, r_low, r_high = pair_intervals(found, z, np.empty(0) if dt is None else dt)
        spikes = 0 if outliers is None else int(np.count_nonzero(outliers))
        row = replace(row, q_low=q_low, q_high=q_high, r_low=r_low, r_high=r_high, spikes=spikes)
    growth = held_out(many, momentum=np.array([tau > 0.0]))
    if options.gate is not None:
        params = replace(params, gate=None if math.isnan(options.gate) else options.gate)
    row = replace(
        row,
        q=params.q,
        r=float(params.r),
        momentum=params.momentum,
        gate=params.gate,
        lag_samples=steady_state(params).lag_samples,
        loss_inputs=loss_inputs(ratio, np.array([tau]), growth).astype("<f4").tobytes(),
    )
    return row, pool_of(many)


def fit_block(block: Block, options: FleetOptions) -> Fitted:
    """Fit the recordings of a data set, in one compiled call those that need nothing but q and r."""
    steps, rows, pool = _plain_steps(block, options), dict[int, list[Row]](), Pool.empty()
    plain = np.flatnonzero(np.isfinite(steps))
    if len(plain):
        fitted, pool = _fit_plain(block, steps, plain, options)
        rows = {i: [row] for i, row in zip(plain.tolist(), fitted, strict=True)}
    for i in np.flatnonzero(np.isnan(steps)).tolist():
        try:
            recording = block.recording(i, options.reading, options.sample_period)
            rows[i], one = fit_each(block.ids[i], recording, options)
            pool = pool + one
        except Exception as error:  # whatever is wrong with one recording, the others go on
            rows[i] = [Row(id=block.ids[i], reason=_reason(error))]
    return Fitted([row for i in sorted(rows) for row in rows[i]], pool)


def _plain_steps(block: Block, options: FleetOptions) -> Array:
    """The sample period in s of each recording that `_fit_plain` may take; NaN for the others."""
    reading, names = options.reading, block.table.names
    one_channel = block.table.time == 1 and options.channel in (None, names[0])
    as_stamped = (
        replace(reading, time_column=None, time_unit=None) == ReadOptions() and options.sample_period is None
    )
    if not (one_channel and as_stamped and options.gate is None and options.request in PLAIN):
        return np.full(len(block.ids), math.nan)
    infinite: Mask = np.logical_or.reduceat(np.isinf(block.table.columns[0]), block.starts[:-1])
    return np.where(infinite, math.nan, block.even_steps())


def _fit_plain(block: Block, steps: Array, chosen: Indices, options: FleetOptions) -> Fitted:
    """Fit the chosen recordings, one channel each with even stamps, in one compiled call."""
    start, request = time.thread_time(), options.request
    values, sizes = block.table.columns[0], np.diff(block.starts)
    if len(chosen) < len(sizes):
        values = np.concatenate([values[block.starts[i] : block.starts[i + 1]] for i in chosen])
    starts = np.concatenate(([0], np.cumsum(sizes[chosen]))).astype(np.int64)
    many = Series(np.require(values, np.float64, ["C", "W"]), starts, np.empty(0))
    table = estimate_many(many, request.robust)
    cleaned = many
    if len(table.set_aside):
        cleaned = replace(many, values=values.copy())
        cleaned.values[table.set_aside] = math.nan
    ratio = np.where(table.usable, table.ratio, math.nan)
    inputs = loss_inputs(ratio, np.zeros(len(ratio)), held_out(cleaned)).astype("<f4")
    pool, seconds = pool_of(cleaned), (time.thread_time() - start) / len(chosen)
    names = ("q", "r", "q_low", "q_high", "r_low", "r_high", "lag_samples")
    pairs = (table.q, table.r, *table.q_interval, *table.r_interval, table.lag_samples)
    numbers: list[list[float]] = np.stack(pairs, axis=1).tolist()
    channel, unit, rows = block.table.names[0], block.table.units[0], list[Row]()
    places: list[int] = chosen.tolist()
    for i, (place, verdict) in enumerate(zip(places, map(str, table.verdict), strict=True)):
        known: dict[str, Any] = {"samples": int(sizes[place]), "rate_hz": 1.0 / float(steps[place])}
        if table.usable[i]:
            known |= dict(zip(names, numbers[i], strict=True))
            gate = float(table.gate[i]) ** 2 if table.gate[i] < math.inf else None
            known |= {"momentum": 0.0, "gate": gate, "spikes": int(table.spikes[i])}
            known["loss_inputs"] = inputs[i].tobytes()
        else:
            known["reason"] = first_sentence(estimate(many.one(i)[0], robust=request.robust).message)
        rows.append(Row(block.ids[place], channel, unit, verdict=verdict, seconds=seconds, **known))
    return Fitted(rows, pool)
