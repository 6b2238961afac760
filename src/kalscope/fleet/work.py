"""What a worker does: fit the recordings of a batch, each within its time limit, and write a part."""

from __future__ import annotations

import errno
import faulthandler
import math
import threading
import time
from collections.abc import Generator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from kalscope.common.numbers import Array, Indices, Mask
from kalscope.common.text import program
from kalscope.errors import BadSetting, KalscopeError, describe
from kalscope.estimation.many import Series, estimate_many, fitted_ratios, pair_intervals, series_of
from kalscope.estimation.pool import Pool, held_out, loss_inputs, pool_of
from kalscope.estimation.request import Found, Request, find_parameters
from kalscope.filtering.filter import kalman_filter
from kalscope.filtering.params import FilterParams
from kalscope.filtering.steady import steady_state
from kalscope.fleet.find import Unit
from kalscope.fleet.read import Block, Channel, FleetOptions, Question, channels_of, read_block, read_file
from kalscope.fleet.store import FAILED, LOCK, Row, loss_cells, part_path, write_part
from kalscope.recording import Recording
from kalscope.sources.grammar.read_options import ReadOptions

MAX_SECONDS = 10.0
"""A batch that takes longer ends after its current unit; the others are distributed to idle workers."""
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
_running: dict[BinaryIO, float] = {}
"""The batches of this process, one for each of its threads: their notes, and when the unit must have ended."""
_changing = threading.Lock()


@dataclass(frozen=True)
class Fitted:
    """The results for some recordings."""

    rows: list[Row]
    """A row for each channel."""
    pool: Pool
    """What all of them contribute to one filter for all."""
    again: bool = False
    """Whether one failed for a reason other than its content: the next run tries it again."""


@dataclass(frozen=True)
class Done:
    """What a task reports to the driver; the rows themselves are in the part."""

    units: int
    """Units done, from the first on; the others of the batch were not started."""
    rows: int
    """Rows written."""
    again: int
    """Units that the next run tries again."""


class TimedOut(Exception):
    """A unit of the batch has ended an earlier worker; the note names it."""


def run_batch(units: Sequence[Unit], options: FleetOptions, folder: str) -> Done:
    """Fit the units of a batch and write their part.

    Args:
        units: The batch; at least the first is done.
        options: The options.
        folder: Of the results, under the path that the worker has for it.

    Raises:
        BadSetting: the worker does not see the folder, or has another version.
        TimedOut: an earlier attempt at the batch was ended by its time limit.
        OSError: the part cannot be written.
    """
    if not (Path(folder) / LOCK).exists():
        raise BadSetting(f"-o must name a folder that every worker of --cluster sees (got {folder!r})")
    if options.program != program():
        raise BadSetting(f"every worker of --cluster must have {options.program} (got {program()})")
    end, fingerprint = time.monotonic() + MAX_SECONDS, options.fingerprint()
    if fingerprint not in _compiled:  # before the clock of a unit runs: it may take longer than most fits
        _compiled.add(fingerprint)
        z = np.random.default_rng(1).normal(size=(200, 1))
        recording = Recording(np.arange(200.0), ("x",), ("",), np.cumsum(z, axis=0) + z[::-1], 1.0)
        fit_each([Channel("", recording, "x")], options.question)
    keys, fitted = [unit.key(fingerprint) for unit in units], dict[str, Fitted]()
    with _note(Path(folder), keys) as note:
        for unit, key in zip(units, keys, strict=True):
            with time_limited(note, key, time_limit(unit.size, options.device_limit)):
                fitted[key] = fit_unit(unit, options)
            if time.monotonic() > end:
                break
    again = [key for key, one in fitted.items() if one.again]
    write_part(Path(folder), {key: (one.rows, one.pool) for key, one in fitted.items()}, again)
    return Done(len(fitted), sum(len(one.rows) for one in fitted.values()), len(again))


def fit_unit(unit: Unit, options: FleetOptions) -> Fitted:
    """The result of a unit: the rows of its channels, or one with the reason why there are none."""
    try:
        if unit.pieces[0].groups:
            fitted = fit_block(read_block(unit, options.reading), options)
        else:
            fitted = fit_each(read_file(unit, options), options.question)
    except Exception as error:  # one bad file must not end the others
        return _lost(lost_row(unit), error)
    return replace(fitted, rows=[replace(row, source=unit.source) for row in fitted.rows])


def lost_row(unit: Unit, reason: str = "", verdict: str = FAILED) -> Row:
    """The row of a unit that could not be read."""
    name = unit.id if unit.span is None else f"{unit.data_set}ids up to {unit.span[1]}"
    return Row(id=name, channel=unit.channel or "", verdict=verdict, reason=reason, source=unit.source)


def _lost(row: Row, error: Exception) -> Fitted:
    """A recording that could not be read or fitted, because of this error."""
    text = describe(error) if isinstance(error, KalscopeError | OSError) else f"{type(error).__name__}: {error}"
    return Fitted([replace(row, reason=" ".join(text.split()))], Pool.empty(), may_pass(error))


def may_pass(error: BaseException | None) -> bool:
    """Whether the cause is outside of the recording: a permission, a disk, the memory, a missing library."""
    while error is not None:
        if isinstance(error, MemoryError | ImportError):
            return True
        # Readers of a broken file raise OSError without a number, or with that of an invalid position in it.
        if isinstance(error, OSError) and error.errno not in (None, errno.EINVAL):
            return True
        error = error.__cause__ or error.__context__
    return False


def _joined(several: Sequence[Fitted]) -> Fitted:
    pool = Pool.empty()
    for one in several:
        pool = pool + one.pool
    return Fitted([row for one in several for row in one.rows], pool, any(one.again for one in several))


def fit_each(channels: Sequence[Channel], question: Question) -> Fitted:
    """Fit some channels, one after the other. One that cannot be fitted gives a row with the reason."""
    several: list[Fitted] = []
    for channel in channels:
        start = time.thread_time()
        recording = channel.recording
        row = Row(
            id=channel.id,
            channel=channel.name,
            unit=recording.units[recording.index(channel.name)],
            samples=len(recording),
            rate_hz=None if recording.sample_period is None else 1.0 / recording.sample_period,
            rejected_lines=recording.report.rejected,
        )
        try:
            fitted = _fit(channel, row, question)
        except Exception as error:  # whatever is wrong with one recording, the others go on
            fitted = _lost(row, error)
        several.append(
            replace(fitted, rows=[replace(one, seconds=time.thread_time() - start) for one in fitted.rows])
        )
    return _joined(several)


def _fit(channel: Channel, row: Row, question: Question) -> Fitted:
    recording = channel.recording
    z, dt = recording.channel(channel.name), recording.steps() if recording.gaps == "dt" else None
    result = find_parameters(z, question.request(recording), dt=dt, sample_period=recording.sample_period)
    estimate = result.estimate
    outliers = None if estimate is None else estimate.outliers
    many = series_of([z if outliers is None else np.where(outliers, np.nan, z)], None if dt is None else [dt])
    return Fitted([_filled(row, z, dt, many, result, question.gate)], pool_of(many))


def _filled(row: Row, z: Array, dt: Array | None, many: Series, result: Found, gate: float | None) -> Row:
    """The row with the result of its fit.

    Args:
        row: What is known of the recording.
        z: The samples, shape (n,).
        dt: Nominal sample periods before each; None = 1 each.
        many: The same without the spikes.
        result: The result.
        gate: Outlier gate in place of the estimated one; NaN = off, None = as estimated.
    """
    estimate, params = result.estimate, result.params
    verdict = CHOSEN if estimate is None else str(estimate.verdict)
    if params is None:
        return replace(row, verdict=verdict, reason=first_sentence(result.message))
    ratio, tau = fitted_ratios(many, many.starts[1:]), 0.0
    if estimate is not None:
        ratio, tau = np.array([params.q / float(params.r)]), params.momentum
        q_low, q_high, r_low, r_high = pair_intervals(estimate, z, np.empty(0) if dt is None else dt)
        spikes = 0 if estimate.outliers is None else int(np.count_nonzero(estimate.outliers))
        row = replace(row, q_low=q_low, q_high=q_high, r_low=r_low, r_high=r_high, spikes=spikes)
    growth = held_out(many, momentum=np.array([tau > 0.0]))
    if gate is not None:
        params = replace(params, gate=None if math.isnan(gate) else gate)
    return replace(
        row,
        q=params.q,
        r=float(params.r),
        momentum=params.momentum,
        gate=None if params.gate is None else params.gate,
        lag_samples=steady_state(params).lag_samples,
        verdict=verdict,
        nis=mean_nis(z, params, dt),
        left=loss_cells(loss_inputs(ratio, np.array([tau]), growth))[0],
    )


def mean_nis(z: Array, params: FilterParams, dt: Array | None = None) -> float | None:
    """The mean of v²/s over the samples that the filter takes; None where there is none."""
    result = kalman_filter(z, params, dt)
    taken = (result.k > 0.0) & np.isfinite(result.innovation) & np.isfinite(result.s) & (result.s > 0.0)
    scored = result.innovation[taken] ** 2 / result.s[taken]
    return float(scored.mean()) if len(scored) else None


def first_sentence(text: str) -> str:
    """The text up to its first full stop, without it."""
    return text.split(". ", 1)[0].rstrip(".")


def fit_block(block: Block, options: FleetOptions) -> Fitted:
    """Fit recordings in row groups, in one compiled call those that need nothing but q and r."""
    steps = _plain_steps(block, options)
    known = np.isfinite(steps)
    plain = _fit_plain(block, steps, np.flatnonzero(known), options) if known.any() else _joined([])
    if known.all():
        return plain
    others = {int(i): _fit_recording(block, int(i), options) for i in np.flatnonzero(~known)}
    whole, rest = _joined([plain, *others.values()]), iter(plain.rows)
    rows = [others[i].rows if i in others else [next(rest)] for i in range(len(known))]
    return replace(whole, rows=[row for several in rows for row in several])


def _fit_recording(block: Block, i: int, options: FleetOptions) -> Fitted:
    """One recording, in the same way as a file."""
    try:
        recording = block.recording(i, options.reading, options.sample_period)
        return fit_each(channels_of(recording, block.ids[i], options), options.question)
    except Exception as error:  # whatever is wrong with one recording, the others go on
        return _lost(Row(id=block.ids[i]), error)


def _plain_steps(block: Block, options: FleetOptions) -> Array:
    """The sample period in s of each recording that `_fit_plain` may take; NaN for the others."""
    reading, names = options.reading, block.table.names
    one_channel = len(names) == 1 and options.channel in (None, names[0])
    as_stamped = (
        replace(reading, time_column=None, time_unit=None) == ReadOptions() and options.sample_period is None
    )
    if not (one_channel and as_stamped and options.question.gate is None and options.request in PLAIN):
        return np.full(len(block.ids), math.nan)
    infinite: Mask = np.logical_or.reduceat(np.isinf(block.table.columns[0]), block.starts[:-1])
    return np.where(infinite, math.nan, block.even_steps())


def _fit_plain(block: Block, steps: Array, chosen: Indices, options: FleetOptions) -> Fitted:
    """Fit the chosen recordings, one channel each with even stamps, in one compiled call."""
    start, request = time.thread_time(), options.request or PLAIN[0]
    values, sizes = block.table.columns[0], np.diff(block.starts)
    if len(chosen) < len(sizes):
        values = np.concatenate([values[block.starts[i] : block.starts[i + 1]] for i in chosen])
    starts = np.concatenate(([0], np.cumsum(sizes[chosen]))).astype(np.int64)
    many = Series(values, starts, np.empty(0))
    table = estimate_many(many, robust=request.robust)
    cleaned = many
    if len(table.set_aside):
        cleaned = replace(many, values=values.copy())
        cleaned.values[table.set_aside] = math.nan
    ratio = np.where(table.usable, table.ratio, math.nan)
    cells = loss_cells(loss_inputs(ratio, np.zeros(len(ratio)), held_out(cleaned)))
    pool, seconds = pool_of(cleaned), (time.thread_time() - start) / len(chosen)
    heads = zip(
        [block.ids[int(i)] for i in chosen],
        sizes[chosen].tolist(),
        steps[chosen].tolist(),
        map(str, table.verdict),
        strict=True,
    )
    pairs = (table.q, table.r, *table.q_interval, *table.r_interval, table.lag_samples)
    numbers: list[list[float]] = np.stack(pairs, axis=1).tolist()
    channel, unit, rows = block.table.names[0], block.table.units[0], list[Row]()
    for i, (name, n, step, verdict) in enumerate(heads):
        known: dict[str, Any] = {"samples": n, "rate_hz": 1.0 / step, "verdict": verdict, "seconds": seconds}
        if table.usable[i]:
            q, r, q_low, q_high, r_low, r_high, lag = numbers[i]
            gate = float(table.gate[i]) ** 2 if table.gate[i] < math.inf else None
            # The scale of the likelihood's maximum makes the mean of v²/s one; a floor of r or a gate does not.
            exact = verdict != "below_resolution" and not table.spikes[i]
            nis = 1.0 if exact else mean_nis(many.one(i)[0], FilterParams(q, r, gate=gate))
            known |= {"q": q, "r": r, "q_low": q_low, "q_high": q_high, "r_low": r_low, "r_high": r_high}
            known |= {"momentum": 0.0, "gate": gate, "lag_samples": lag, "nis": nis, "left": cells[i]}
            known["spikes"] = int(table.spikes[i])
        else:
            known["reason"] = first_sentence(find_parameters(many.one(i)[0], request).message)
        rows.append(Row(name, channel, unit, **known))
    return Fitted(rows, pool)


# A unit that takes too long ends its process, wherever it hangs, and a note names it. A thread of C does it without
# the lock of the interpreter, which a compiled loop may hold for ever.


def time_limit(size: int, device_limit: float) -> float:
    """Longest time for a unit of `size` bytes, s."""
    return device_limit * max(1.0, size / FULL_BYTES)


def timed_out_unit(folder: Path, keys: Sequence[str]) -> str | None:
    """The unit that took too long in the last attempt at a batch; None where it ended in another way."""
    with suppress(OSError):
        key, _, report = part_path(folder, keys, ".note").read_bytes().partition(b"\n")
        if report.startswith(_TIMEOUT):
            return key.decode()
    return None


@contextmanager
def _note(folder: Path, keys: Sequence[str]) -> Generator[BinaryIO]:
    """The note about the unit of a batch that is being done, there until the block ends.

    Raises:
        TimedOut: an earlier attempt has written it: a scheduler tries a batch again by itself.
        OSError: the note cannot be written.
    """
    if timed_out_unit(folder, keys) is not None:
        raise TimedOut
    path = part_path(folder, keys, ".note")
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        with path.open("wb", buffering=0) as note:
            yield note
    finally:
        path.unlink(missing_ok=True)


@contextmanager
def time_limited(note: BinaryIO, key: str, seconds: float) -> Generator[None]:
    """End this process if the block, the unit with this key, takes longer."""
    note.seek(0)
    note.truncate()
    note.write(f"{key}\n".encode())
    with _changing:
        _running[note] = time.monotonic() + seconds
        _start_clock()
    try:
        yield
    finally:
        with _changing:
            del _running[note]
            _start_clock()


def _start_clock() -> None:
    """Wait for the next of the deadlines; a process has one clock."""
    if not _running:
        faulthandler.cancel_dump_traceback_later()
        return
    note = min(_running, key=_running.__getitem__)
    seconds = min(max(_running[note] - time.monotonic(), 1e-3), threading.TIMEOUT_MAX)
    faulthandler.dump_traceback_later(seconds, exit=True, file=note)
