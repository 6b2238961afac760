"""The answer of a fleet: one filter for all devices, what each loses by it, which differ from the others.

It is written when a run ends. The dashboard reads it again: any program may have written it, so that it is
checked, and refused with one line.
"""

from __future__ import annotations

import json
import math
import os
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from html import escape
from pathlib import Path
from typing import Annotated, Any

import msgspec
import numpy as np

from kalscope.common.charts import document, markup_of_table
from kalscope.common.files import atomic_file, write_atomic
from kalscope.common.numbers import Array, Indices, Mask
from kalscope.common.progress import OnProgress
from kalscope.common.text import (
    THIN_SPACE,
    count,
    decibels,
    duration,
    escaped,
    lag_in_full,
    lag_text,
    noise_left,
    number,
    percent,
    squared,
    trimmed,
)
from kalscope.errors import BadFile, BadSetting
from kalscope.estimation import pool as pooling
from kalscope.estimation.fit import params_for_specification
from kalscope.estimation.request import Request
from kalscope.filtering.params import MAX_MOMENTUM, MAX_VARIANCE, FilterParams
from kalscope.filtering.steady import steady_state
from kalscope.fleet import store
from kalscope.fleet.read import FleetOptions, Piece, Unit, read_block
from kalscope.fleet.store import pa, pq
from kalscope.recording import Recording
from kalscope.sources.grammar.read_options import ReadOptions
from kalscope.sources.reading.recording_file import read_recording
from kalscope.tuning.file import dumps
from kalscope.tuning.tuning import ChannelTuning, Tuning

WITHIN = 0.1
"""Growth of the prediction error up to which a device counts as served."""
EXPECTED = 0.05
"""Devices that chance alone names as unlike the others, in each quantity: one in twenty fleets."""
CLOCKS = 1e-4
"""Share by which the rates of equal devices may differ: crystals, and stamps with few digits."""
QUANTITIES = {"r": "r", "q": "q", "rate_hz": "sample rate"}
"""The quantities in which devices are compared, and their names for the user."""
LOST = ("lag_loss_samples", "noise_loss_db", "error_growth")
"""Columns of what a device loses by the filter for all, in the order of `Losses`."""
_LEAST, _MOST = math.ulp(0.0), float(np.finfo(np.float64).max)
RANGES = {
    **dict.fromkeys(("rate_hz", "gate"), (_LEAST, _MOST)),
    **dict.fromkeys(("q", "r"), (0.0, MAX_VARIANCE)),
    **dict.fromkeys(("q_low", "q_high", "r_low", "r_high"), (0.0, math.inf)),
    "momentum": (0.0, MAX_MOMENTUM),
}
"""Columns of numbers, and what they may hold: any program may have written the table."""
MAX_JSON_BYTES = 10_000_000
"""Bytes of fleet.json, at most: with all its lists it has less than one million."""
MAX_LISTED = 1000
"""Devices of a list in fleet.json; the table has all."""
MAX_NAMED = 5
"""Reasons and devices that are printed; the table has all."""


@dataclass(frozen=True)
class Devices:
    """The rows of a table, arrays of shape (rows,), NaN where there is nothing; see `Row` for the columns."""

    ids: list[str]
    channels: list[str]
    units: list[str]
    rate_hz: Array
    q: Array
    r: Array
    q_low: Array
    q_high: Array
    r_low: Array
    r_high: Array
    momentum: Array
    gate: Array
    verdicts: list[str]
    reasons: list[str]
    sources: list[str] = field(default_factory=list[str])
    loss_inputs: Array = field(default_factory=lambda: np.empty((0, 0)))
    """What the fits stored to compute what each loses by a filter for all, shape (rows, WIDTH); empty where the
    losses are known."""

    def __len__(self) -> int:
        return len(self.ids)

    @cached_property
    def failed(self) -> int:
        """Rows that could not be read or fitted; the verdicts of others without q and r say what is missing."""
        return sum(verdict in (store.FAILED, store.TIMED_OUT) for verdict in self.verdicts)

    @property
    def counted(self) -> str:
        """The rows, how many have q and r, and how many failed: all that is shown says it in these words."""
        without = sum(map(bool, self.reasons))
        parts = ((len(self) - without, "with q and r"), (without - self.failed, "without"), (self.failed, "failed"))
        texts = ", ".join(f"{count(n)} {what}" for n, what in parts if n)
        return f"{count(len(self))} {'row' if len(self) == 1 else 'rows'}: {texts}"

    @property
    def usable(self) -> Mask:
        """Where q and r are both above 0."""
        return (self.q > 0.0) & (self.r > 0.0)

    @cached_property
    def channel(self) -> str:
        """The most common channel of those with q and r, "signal" without any."""
        return self._usual(self.channels) or "signal"

    @cached_property
    def unit(self) -> str:
        """Their most common unit."""
        return self._usual(self.units)

    @property
    def sample_period(self) -> float | None:
        """The median sample period of those with q and r, s; None where none is known."""
        known = self.rate_hz[self.usable & np.isfinite(self.rate_hz)]
        return 1.0 / float(np.median(known)) if len(known) else None

    def logs(self, name: str) -> tuple[Array, tuple[Array, Array]]:
        """Ln of one of QUANTITIES, NaN where there is none, and its interval, unbounded where it is not known."""

        def log(values: Array) -> Array:
            return np.log(np.where(self.usable & (values > 0.0), values, np.nan))

        logs = log(getattr(self, name))
        if name == "rate_hz":
            return logs, (logs - CLOCKS, logs + CLOCKS)
        low, high = (
            np.where(np.isnan(logs), np.nan, log(getattr(self, f"{name}_{end}"))) for end in ("low", "high")
        )
        below = np.where(np.isnan(low), -np.inf, np.minimum(low, logs))
        return logs, (below, np.where(np.isnan(high), np.inf, np.maximum(high, logs)))

    def name(self, i: int) -> str:
        """The recording, with its channel where that is not the usual one."""
        return self.ids[i] if self.channels[i] == self.channel else f"{self.ids[i]} {self.channels[i]}"

    def _usual(self, texts: list[str]) -> str:
        common = Counter(text for text, usable in zip(texts, self.usable, strict=True) if usable).most_common(1)
        return common[0][0] if common else ""


def numbers_of(table: Any, name: str, low: float, high: float) -> Array:
    """A column of a table, NaN in place of numbers that are out of range."""
    values = np.asarray(table[name].to_numpy(), dtype=np.float64)
    return np.where((values >= low) & (values <= high), values, math.nan)


def devices_of(table: Any, inputs: Array | None = None) -> Devices:
    """A pyarrow Table with the columns of a fleet as arrays, and the inputs of `Devices`."""
    names = ("id", "channel", "unit", "verdict", "reason", "source")
    columns: dict[str, Any] = {f"{name}s": table[name].to_pylist() for name in names}
    columns |= {name: numbers_of(table, name, *ends) for name, ends in RANGES.items()}
    return Devices(**columns, loss_inputs=np.empty((0, 0)) if inputs is None else inputs)


@dataclass(frozen=True)
class Shared:
    """One filter for all."""

    params: FilterParams
    """The filter: the most likely one, or the one that meets the goal."""
    ratio_interval: tuple[float, float]
    """The q/r that the fleet allows, 95 %."""
    how: str
    """How it was chosen, in a few words, for the tuning file."""
    losses: pooling.Losses
    """What each device loses by it, NaN for one that could not be judged."""

    @property
    def judged(self) -> int:
        """How many devices could be judged."""
        return int(np.isfinite(self.losses.error).sum())

    @property
    def served(self) -> float:
        """Share of the judged devices whose prediction error grows by at most WITHIN, 0 … 1."""
        return pooling.share_served(self.losses.error, WITHIN)

    @property
    def not_served(self) -> list[int]:
        """The others, the worst first."""
        beyond = np.flatnonzero(self.losses.error > WITHIN)
        return beyond[np.argsort(-self.losses.error[beyond], kind="stable")].tolist()


@dataclass(frozen=True)
class RunNote:
    """How the recordings of a fleet were read: they are opened again in the same way."""

    reading: ReadOptions
    """How files are read."""
    sample_period: Annotated[float, msgspec.Meta(gt=0.0)] | None
    """Sample period in s in place of that of the recordings."""


@dataclass(frozen=True, eq=False)
class Fleet:
    """A fleet and its answer, arrays of shape (rows,); compared by identity."""

    folder: Path
    """Its folder."""
    devices: Devices
    """The table; q and r are NaN where they are not variances."""
    shared: Shared | None
    """One filter for all; None where there is none, and `refusal` says why."""
    refusal: str
    """Why there is no such filter; "" where there is one."""
    note: RunNote
    """How its recordings were read."""

    def __len__(self) -> int:
        return len(self.devices)

    @cached_property
    def outliers(self) -> dict[str, pooling.Outliers]:
        """Which devices differ from the others in each of QUANTITIES."""
        return {name: pooling.outliers(*self.devices.logs(name), EXPECTED) for name in QUANTITIES}

    @cached_property
    def outlier(self) -> Mask:
        """Which differ from the others in r or q."""
        named = np.concatenate([self.outliers[name].devices for name in ("r", "q")])
        return np.isin(np.arange(len(self)), named)

    @cached_property
    def distance(self) -> Array:
        """Distance of each from the others in r or q, whichever is larger, standard deviations; NaN: unknown."""
        return np.fmax(*(np.abs(self.outliers[name].z) for name in ("r", "q")))

    @property
    def growth(self) -> Array:
        """By which share the error of predicting unseen samples is larger with the filter for all, see `Losses`."""
        return np.full(len(self), math.nan) if self.shared is None else self.shared.losses.error


def answer_for(devices: Devices, pool: pooling.Pool, options: FleetOptions, folder: Path) -> Fleet:
    """The fleet with its answer.

    Args:
        devices: Its table.
        pool: What all recordings contribute to one filter without momentum.
        options: What was estimated of each recording; a goal holds for the filter of all too.
        folder: Of the results.
    """
    shared, refusal = None, ""
    try:
        options.check_period(devices.sample_period)
        shared = _shared_filter(devices, pool, options.request)
    except BadSetting as error:
        refusal = str(error)
    return Fleet(folder, devices, shared, refusal, RunNote(options.reading, options.sample_period))


def _shared_filter(devices: Devices, pool: pooling.Pool, request: Request) -> Shared:
    """One filter for all, the most likely one or that of a goal. Raises BadSetting where there is none."""
    momentum = 0.0
    if request.target:
        tau = request.checked_momentum() or 0.0
        wanted = params_for_specification(
            1.0, **request.target, sample_period=devices.sample_period, momentum=tau, overshoot=request.overshoot
        )
        fit, how, momentum = pooling.pool_at(pool, wanted.ratio), request.goal, wanted.momentum
    elif request.ratio is not None:
        fit, how = pooling.pool_at(pool, request.ratio), request.goal
    else:
        fit, how = pooling.fit_pool(pool), "pooled maximum likelihood"
    if fit.params is None:
        got = "r = 0" if fit.q > 0.0 else "q = 0"
        raise BadSetting(f"q and r of all must both be above 0 (got {got}): a goal such as --lag-ms 50 gives both")
    params = FilterParams(fit.q, fit.r, momentum=momentum)
    return Shared(params, fit.ratio_interval, how, pooling.losses_of(devices.loss_inputs, params))


@dataclass(frozen=True)
class SavedFilter:
    """The filter for all in fleet.json; None for a number that is not finite."""

    q: Annotated[float, msgspec.Meta(gt=0.0)]
    r: Annotated[float, msgspec.Meta(gt=0.0)]
    momentum: float
    ratio_interval: tuple[float | None, float | None]
    """The q/r that the fleet allows, 95 %."""
    how: str
    """How it was chosen, in a few words."""


@dataclass(frozen=True)
class Summary:
    """The answer for programs, fleet.json."""

    one_filter: SavedFilter | None
    why_not: str
    """Why there is none."""
    unlike: dict[str, list[str]]
    """The devices that are unlike the others in each of QUANTITIES, the most unlike first, MAX_LISTED at most."""
    note: RunNote


def save_answer(fleet: Fleet, table: Any, place: store.Store) -> None:
    """Write the table with what each device loses, fleet.json for programs and the tuning of the filter for all.

    Each is written whole or not at all. Without a filter for all there is no tuning file.

    Raises:
        OSError: The folder cannot be written; the files are unchanged.
        BadSetting: there is a tuning file that no fleet wrote; the files are unchanged.
    """
    folder, devices, shared, one = place.folder, fleet.devices, fleet.shared, None
    place.check_tuning()
    if shared is not None:
        for name, values in zip(
            LOST, (shared.losses.lag_samples, shared.losses.noise_db, fleet.growth), strict=True
        ):
            column = pa.array(values, pa.float64(), mask=~np.isfinite(values))
            table = table.set_column(table.column_names.index(name), name, column)
        pair = shared.params.q, float(shared.params.r)
        one = SavedFilter(*pair, shared.params.momentum, shared.ratio_interval, shared.how)
    unlike = {name: [devices.name(i) for i in one.devices[:MAX_LISTED]] for name, one in fleet.outliers.items()}
    plain = msgspec.json.format(msgspec.json.encode(Summary(one, fleet.refusal, unlike, fleet.note)), indent=1)
    (folder / store.SUMMARY).unlink(missing_ok=True)  # it must not stand beside another table
    with atomic_file(folder / store.TABLE) as file:
        pq.write_table(table, file, compression="zstd")
    write_atomic(folder / store.SUMMARY, (escaped(plain.decode()) + "\n").encode())
    if shared is None:
        (folder / store.TUNING).unlink(missing_ok=True)
        return
    served = f", serves {percent(shared.served)} of {count(shared.judged)} within {percent(WITHIN)}"
    how = f"one filter for a fleet, {shared.how}{served if shared.judged else ''}"
    tuning = _tuning(devices.channel, devices.unit, shared.params, how, devices.sample_period)
    content = dumps(replace(tuning, source_name=f"fleet of {len(devices)}")).encode()
    place.note_tuning(content)
    write_atomic(folder / store.TUNING, content)


def _tuning(channel: str, unit: str, params: FilterParams, how: str, period: float | None) -> Tuning:
    q, r, gate, momentum = params.q, float(params.r), params.gate, params.momentum
    return Tuning(
        (ChannelTuning(channel, unit, q, r, how=how, gate=gate, momentum=momentum),), sample_period=period
    )


@dataclass
class Tally:
    """What a run has done so far."""

    units: int
    """Units of the fleet."""
    kept: int
    """Units that an earlier run had done."""
    done: int = 0
    """Units done."""
    seconds: float = 0.0
    """How long the batches took, s."""


def summary(fleet: Fleet, tally: Tally, folder: Path) -> str:
    """How many rows, how many without q and r and why, one filter for all, the devices that differ, the files."""
    done = f"{count(tally.done)} of {count(tally.units)} files or row groups done in {duration(tally.seconds)}"
    files = f"Table: {folder / store.TABLE}{f'; tuning: {folder / store.TUNING}' if fleet.shared else ''}"
    lines = [f"{fleet.devices.counted}; {done if tally.done else 'nothing was missing'}", *_lines(fleet), files]
    return "".join(f"{_printable(line)}\n" for line in lines)


def _printable(line: str) -> str:
    """Names come from files, and might move the cursor of a terminal."""
    return "".join(c if c.isprintable() or c == THIN_SPACE else " " for c in line)


def answer_lines(fleet: Fleet) -> list[str]:
    """How many rows, and what the summary says about them, each line plain."""
    return [f"{fleet.devices.counted}.", *(_printable(line.strip()) for line in _lines(fleet))]


def answer_page(fleet: Fleet, head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """The answer and a table of devices as one HTML page."""
    text = "".join(f"<p>{escape(line)}</p>" for line in answer_lines(fleet))
    more = f"<p>{count(len(fleet) - len(rows))} more rows are in the table.</p>" if len(rows) < len(fleet) else ""
    style = "body { font: 15px sans-serif; margin: 2em } td, th { padding: 0.1em 0.8em; text-align: left }"
    return document(fleet.folder.name, style, f"<h1>Fleet</h1>{text}{markup_of_table(head, rows)}{more}")


def table_as_csv(fleet: Fleet) -> bytes:
    """The whole table as CSV, in which no text is a formula for a spreadsheet."""
    table, out = store.checked_table(fleet.folder / store.TABLE), pa.BufferOutputStream()
    texts = [name for name in table.column_names if pa.types.is_string(table[name].type)]
    for name in texts:
        plain = store.pc.replace_substring_regex(table[name], "^([=+@-])", r"'\1")
        table = table.set_column(table.column_names.index(name), name, plain)
    store.library("pyarrow.csv").write_csv(table, out)
    return out.getvalue().to_pybytes()


def _lines(fleet: Fleet) -> Iterator[str]:
    devices, reasons = fleet.devices, Counter(filter(None, fleet.devices.reasons))
    if reasons:
        common = reasons.most_common(MAX_NAMED)
        yield "Why not all have q and r:"
        yield from (f"  {count(times)} × {reason}" for reason, times in common)
        if others := reasons.total() - sum(times for _, times in common):
            yield f"  {count(others)} for other reasons"
    if fleet.shared is None:
        yield f"No filter for all: {fleet.refusal}"
    else:
        yield from _filter_lines(devices, fleet.shared)
    if devices.usable.any() and not any(len(one.devices) for one in fleet.outliers.values()):
        yield "No device is unlike the others in r, q or sample rate"
    for quantity, one in fleet.outliers.items():
        if len(one.devices):
            factors = getattr(devices, quantity) / math.exp(one.middle)
            named = _named(devices, one.devices, lambda i: f"{number(factors[i])} ×")  # noqa: B023
            chance = trimmed(one.expected)
            yield f"Unlike the others in {QUANTITIES[quantity]}, {chance} expected by chance: {named}"


def _filter_lines(devices: Devices, shared: Shared) -> Iterator[str]:
    """The filter for all, how many devices it suits, and what it costs them."""
    period, losses = devices.sample_period, shared.losses
    q, r = trimmed(shared.params.q, 4), trimmed(float(shared.params.r), 4)
    settled = steady_state(shared.params, period)
    lag, left = lag_in_full(settled.lag_samples, period), noise_left(settled.noise_reduction_db)
    does = f"lag {lag}, noise left {left} ({shared.how})"
    yield f"One filter for all: q = {q}, r = {r} {squared(devices.unit)}, {does}"
    if shared.judged:
        worst = _named(devices, shared.not_served, lambda i: _signed(percent(losses.error[i])))
        yield (
            f"  for {percent(shared.served)} of {count(shared.judged)} its prediction error on unseen samples is "
            f"at most {percent(WITHIN)} above that of the device's own filter{worst and f'; not {worst}'}"
        )
    usual: list[str] = []
    kinds = {"error": (losses.error, percent), "lag": (losses.lag_samples, partial(lag_text, period=period))}
    for name, (values, text) in (kinds | {"noise": (losses.noise_db, decibels)}).items():
        if np.isfinite(values).any():
            low, high = np.nanpercentile(values, (5.0, 95.0)).tolist()
            usual.append(f"{name} {_signed(text(low))} to {_signed(text(high))}")
    if usual:
        yield f"  nine of ten devices, against their own filters: {', '.join(usual)}"


def _signed(text: str) -> str:
    return text if text.startswith(("−", "-")) else f"+{text}"


def _named(devices: Devices, rows: Sequence[int] | Indices, text: Callable[[int], str]) -> str:
    """The first of these devices, each with its text, and how many more there are."""
    named = ", ".join(f"{devices.name(int(i))} ({text(int(i))})" for i in rows[:MAX_NAMED])
    return named + (f" and {count(len(rows) - MAX_NAMED)} more" if len(rows) > MAX_NAMED else "")


def read_fleet(folder: Path) -> Fleet:
    """The finished fleet of a folder.

    Raises:
        BadFile: the folder is not that of a finished fleet, or a file in it is not valid.
    """
    folder = folder.absolute()
    answer = folder / store.SUMMARY
    try:
        if answer.stat().st_size > MAX_JSON_BYTES:
            raise ValueError(f"more than {MAX_JSON_BYTES} bytes")
        read = msgspec.json.decode(answer.read_bytes(), type=Summary)
    except FileNotFoundError:
        raise BadFile(
            f"{str(folder)!r} must be the folder of a finished fleet, -o of kalscope fleet (got no {answer.name};"
            " the same command continues a run that was stopped)"
        ) from None
    except (OSError, ValueError, RecursionError) as error:
        raise BadFile(f"{str(answer)!r} must be written by kalscope fleet (got {str(error)[:100]})") from None
    table, shared, saved = store.checked_table(folder / store.TABLE), None, read.one_filter
    devices = devices_of(table)
    if saved is not None:
        low, high = (math.nan if end is None else end for end in saved.ratio_interval)
        ends = {"error_growth": (math.nextafter(-1.0, 0.0), math.inf)}
        losses = (numbers_of(table, name, *ends.get(name, (-math.inf, math.inf))) for name in LOST)
        params = FilterParams(saved.q, saved.r, momentum=saved.momentum)
        shared = Shared(params, (low, high), saved.how[:200], pooling.Losses(*losses))
    return Fleet(folder, devices, shared, read.why_not, read.note)


def reopen(
    name: str,
    source: str,
    note: RunNote,
    options: ReadOptions | None = None,
    *,
    progress: OnProgress | None = None,
) -> Recording:
    """Read the recording of a row as the fleet read it.

    Args:
        name: Of the device.
        source: Where it is, see `Row.source`.
        note: Of the run.
        options: How to read it; None = as the fleet did.
        progress: See `read_recording`; a data set has none.

    Raises:
        BadFile: it is not where it was when the fleet was read, or cannot be read.
        BadSetting: an option does not suit it.
    """
    reading, period = note.reading if options is None else options, note.sample_period
    if not source.startswith("["):
        return read_recording(_existing(source), reading, sample_period=period, progress=progress)
    try:
        data_set, paths = json.loads(source)
        pieces = tuple(Piece(_existing(str(path))) for path in paths)
    except (ValueError, TypeError, RecursionError) as error:
        if isinstance(error, BadFile):
            raise
        raise BadFile(f"the source of {name[:80]!r} must name Parquet files (got {source[:80]!r})") from None
    return read_block(Unit(name, pieces, data_set=str(data_set)), reading, name).recording(0, reading, period)


def _existing(path: str) -> str:
    """A path, checked to be that of a file."""
    if not (os.path.isabs(path) and os.path.isfile(path)):
        raise BadFile(f"the recording must be where the fleet found it (got no file at {path[:300]!r})")
    return path


def device_tuning(fleet: Fleet, i: int) -> Tuning:
    """The filter that was fitted to this device, on its channel.

    Raises:
        BadSetting: the device has none.
    """
    devices, channel = fleet.devices, (fleet.devices.channels[i], fleet.devices.units[i])
    numbers = (devices.q, devices.r, devices.momentum, devices.gate, devices.rate_hz)
    q, r, momentum, gate, rate = (None if math.isnan(one[i]) else float(one[i]) for one in numbers)
    if q is None or r is None:
        raise BadSetting(f"the device must have q and r (got none: {devices.reasons[i]})")
    params = FilterParams(q, r, momentum=momentum or 0.0, gate=gate)
    return _tuning(*channel, params, "its own fit in the fleet", rate and 1.0 / rate)
