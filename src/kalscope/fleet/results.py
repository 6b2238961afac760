"""The folder of a fleet, finished or not: arrays to look at, and the recordings to open again.

Any program may have written its tables: they are checked once, here, and refused with one line.
"""

from __future__ import annotations

import json
import math
import os
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from kalscope.common.numbers import Array, Mask
from kalscope.common.progress import OnProgress
from kalscope.errors import BadFile, KalscopeError
from kalscope.estimation.pool import Pool, fit_pool, share_served
from kalscope.filtering.params import MAX_MOMENTUM, MAX_VARIANCE, FilterParams
from kalscope.fleet.answer import WITHIN, Devices, devices_of
from kalscope.fleet.find import Piece, Unit
from kalscope.fleet.read import read_block
from kalscope.fleet.store import (
    COLUMNS,
    FINISHED,
    MAX_TEXT_BYTES,
    NOTE,
    POOL,
    SUMMARY,
    TABLE,
    RunNote,
    library,
    part_files,
    pool_from,
    read_json,
    read_note,
    schema,
    units_of,
)
from kalscope.recording import Recording
from kalscope.sources.grammar.read_options import ReadOptions
from kalscope.sources.reading.recording_file import read_recording
from kalscope.tuning.tuning import ChannelTuning, Tuning

MAX_ROWS = 5_000_000
"""Rows of a table, at most: one of a million devices needs about 1 GB of memory."""
MAX_BYTES = 2 << 30
"""Bytes of its columns, at most."""
MAX_GROUPS = 100_000
"""Row groups of a file, at most."""
CLOCKS_NS = 2_000_000_000
"""By how much the clocks of a file system and of the driver may differ, ns."""


@dataclass(frozen=True)
class SharedFilter:
    """One filter for all."""

    params: FilterParams
    """The filter."""
    ratio_interval: tuple[float, float]
    """The q/r that the fleet allows, 95 %."""
    how: str
    """How it was chosen, in a few words."""


@dataclass(frozen=True, eq=False)
class Fleet:
    """A fleet, its arrays of shape (rows,); compared by identity."""

    folder: Path
    """Its folder."""
    devices: Devices
    """The table; q and r are NaN where they are not variances."""
    gates: Array
    """Outlier gate of each on v²/s, NaN where it is off."""
    verdicts: tuple[str, ...]
    """Verdict of each."""
    sources: tuple[str, ...]
    """Where each recording is, see `Row.source`."""
    reasons: tuple[str, ...]
    """Why a row has no q and r; "" where it has."""
    shared: SharedFilter | None
    """One filter for all; None where there is none, or not yet."""
    growth: Array
    """By which share the error of predicting unseen samples is larger with the filter for all, see `Losses`."""
    distance: Array
    """Distance of each from the others in r or q, whichever is larger, standard deviations; NaN where unknown."""
    outlier: Mask
    """Which differ from the others in r or q."""
    note: RunNote
    """The note of the run."""
    done: int | None
    """Files or row groups done; None where the run is finished."""

    def __len__(self) -> int:
        return len(self.devices)

    @property
    def served(self) -> float:
        """Share of the judged devices whose prediction error grows by at most a tenth, 0 … 1."""
        return share_served(self.growth, WITHIN)


class FleetReader:
    """Reads a folder again and again; of a running fleet only the parts that are new. One thread at a time."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder.absolute()
        self._parts: dict[Path, tuple[Any, frozenset[str]]] = {}

    def read(self) -> Fleet:
        """The fleet as it is now.

        Raises:
            BadFile: the folder is not that of a fleet, or a file in it is not valid.
            BadSetting: pyarrow is missing.
        """
        library("pyarrow")
        folder, note = self._folder, read_note(self._folder)
        answer, written = folder / SUMMARY, folder / NOTE
        finished = (folder / TABLE).is_file() and answer.is_file()  # a run writes its answer after the table
        if finished and (not written.exists() or answer.stat().st_mtime_ns >= written.stat().st_mtime_ns):
            self._parts.clear()
            return _fleet(folder, checked_table(folder / TABLE), _saved_filter(answer), note, None)
        table, pool, done = self._merged(note)
        fit = fit_pool(pool) if note.pooled and pool.devices else None
        shared = None
        if fit is not None and fit.params is not None:
            shared = SharedFilter(fit.params, fit.ratio_interval, "pooled maximum likelihood so far")
        return _fleet(folder, table, shared, note, done)

    def _merged(self, note: RunNote) -> tuple[Any, Pool, int]:
        """All parts of the present options so far: rows, pool, number of units; a later row replaces an earlier."""
        for path in part_files(self._folder):
            if path not in self._parts and path.stat().st_mtime_ns >= note.since - CLOCKS_NS:
                keys = units_of(path)
                if keys is not None:
                    self._parts[path] = checked_table(path, part=True), frozenset(keys)
        if not self._parts:
            raise BadFile(
                f"{str(self._folder)!r} must be the folder of a fleet, -o of kalscope fleet (got no {TABLE} and no"
                " part of one; where a run has just begun, try again)"
            )
        if sum(len(rows) for rows, _ in self._parts.values()) > MAX_ROWS:
            raise BadFile(f"{str(self._folder)!r} must hold at most {MAX_ROWS} rows (got more)")
        table = library("pyarrow").concat_tables([rows for rows, _ in self._parts.values()])
        names = zip(table["id"].to_pylist(), table["channel"].to_pylist(), strict=True)
        last = {name: i for i, name in enumerate(names)}
        read = {
            name for name, channel in last if channel
        }  # a row without a channel is a failure, tried again since
        table = table.take(sorted(i for (name, channel), i in last.items() if channel or name not in read))
        pool = Pool.empty()
        for cell in table[POOL].drop_null().to_pylist():
            pool = pool + _checked_pool(cell)
        return table, pool, len({key for _, keys in self._parts.values() for key in keys})


@cache
def _reader_of(folder: Path) -> FleetReader:
    return FleetReader(folder)


def read_fleet(folder: Path, *, whole: bool) -> Fleet:
    """The fleet of a folder as it is now, see `FleetReader.read`; on one thread.

    Args:
        folder: Its folder.
        whole: Read all of it; else only what is new since it was read last, if it was.
    """
    if whole:
        _reader_of.cache_clear()
    return _reader_of(folder.absolute()).read()


def checked_table(path: Path, *, part: bool = False) -> Any:
    """The table, or a part with its pools, as a pyarrow Table of the known columns and types; no text is missing.

    Raises:
        BadFile: it is not such a table, or one that would fill the memory.
    """
    pa, parquet = library("pyarrow"), library("pyarrow.parquet")
    known = schema(COLUMNS if part else FINISHED)
    known = known.append(pa.field(POOL, pa.binary())) if part else known
    texts = [one.name for one in known if pa.types.is_string(one.type)]
    try:
        file = parquet.ParquetFile(path, memory_map=False, read_dictionary=texts)
        rows, groups = file.metadata.num_rows, range(file.metadata.num_row_groups)
        size = sum(file.metadata.row_group(i).total_byte_size for i in groups)
        if rows > MAX_ROWS or size > MAX_BYTES:
            raise ValueError(f"{rows} rows of {size} bytes; at most {MAX_ROWS} rows and {MAX_BYTES} bytes")
        missing = [name for name in known.names if name not in file.schema_arrow.names]
        if missing:
            raise ValueError(f"no column {missing[0]}; an older Kalscope may have written it: run the fleet again")
        table = file.read(columns=known.names)
        columns = [_text(table[one.name]) if one.name in texts else table[one.name].cast(one.type) for one in known]
        return pa.table(columns, schema=known)
    except (pa.ArrowException, OSError, ValueError, TypeError, KeyError, OverflowError) as error:
        lines = str(error).splitlines() or [type(error).__name__]
        raise BadFile(f"{str(path)!r} must be a table of kalscope fleet (got {lines[0][:200]})") from None


def _text(column: Any) -> Any:
    """A column of texts, each short; a text that many rows share is checked once, before it is expanded."""
    pa, compute = library("pyarrow"), library("pyarrow.compute")
    for chunk in column.chunks:
        words = chunk.dictionary if pa.types.is_dictionary(column.type) else chunk
        longest = compute.max(compute.binary_length(words)).as_py() if len(words) else 0
        if (longest or 0) > MAX_TEXT_BYTES:
            raise ValueError(f"a text of {longest} bytes, at most {MAX_TEXT_BYTES}")
    return compute.fill_null(column.cast(pa.string()), "")


def _checked_pool(cell: bytes) -> Pool:
    try:
        pool = pool_from(cell)
    except (ValueError, OverflowError, IndexError):
        raise BadFile("a part of the fleet must hold sums of its likelihood (got other bytes)") from None
    return pool if pool.devices > 0 and not np.isnan(pool.sums).any() else Pool.empty()


def _saved_filter(path: Path) -> SharedFilter | None:
    """The filter for all in the answer of a finished run."""
    one = read_json(path).get("one_filter")
    if one is None:
        return None
    try:
        low, high = (math.nan if end is None else float(end) for end in one["ratio_interval"])
        params = FilterParams(float(one["q"]), float(one["r"]), momentum=float(one["momentum"]))
        if not (params.q > 0.0 and float(params.r) > 0.0):
            raise ValueError("q and r must be above 0")
        return SharedFilter(params, (low, high), str(one["how"])[:200])
    except (KeyError, TypeError, ValueError, OverflowError, KalscopeError):
        raise BadFile(f"one_filter in {str(path)!r} must hold q and r above 0 (got {str(one)[:100]})") from None


def _fleet(folder: Path, table: Any, shared: SharedFilter | None, note: RunNote, done: int | None) -> Fleet:
    def numbers(name: str, low: float, high: float) -> Array:
        """A column, NaN in place of numbers that are out of range."""
        values = np.asarray(table[name].to_numpy(), dtype=np.float64)
        return np.where((values >= low) & (values <= high), values, math.nan)

    least, most = math.ulp(0.0), float(np.finfo(np.float64).max)
    devices = replace(
        devices_of(table),
        rate_hz=numbers("rate_hz", least, most),
        q=numbers("q", 0.0, MAX_VARIANCE),
        r=numbers("r", 0.0, MAX_VARIANCE),
        momentum=numbers("momentum", 0.0, MAX_MOMENTUM),
    )
    compared = [devices.outliers(name) for name in ("r", "q")]
    outlier = np.zeros(len(devices), dtype=bool)
    outlier[np.concatenate([one.devices for one in compared])] = True
    growth = np.full(len(devices), math.nan)
    if shared is not None and devices.loss_inputs is not None:
        growth = devices.losses(shared.params).error
    elif shared is not None:
        growth = numbers("error_growth", -1.0 + 1e-12, most)
    return Fleet(
        folder=folder,
        devices=devices,
        gates=numbers("gate", least, most),
        verdicts=tuple(table["verdict"].to_pylist()),
        sources=tuple(table["source"].to_pylist()),
        reasons=tuple(table["reason"].to_pylist()),
        shared=shared,
        growth=growth,
        distance=np.fmax(*(np.abs(one.z) for one in compared)),
        outlier=outlier,
        note=note,
        done=done,
    )


@dataclass(frozen=True)
class DeviceSource:
    """Where the recording of a row is and how the fleet read it."""

    id: str
    """Name of the device."""
    source: str
    """See `Row.source`."""
    reading: ReadOptions
    """How the fleet read it."""
    sample_period: float | None
    """Sample period in s that the fleet was given; None = by its stamps."""


def source_of(fleet: Fleet, i: int) -> DeviceSource:
    """Where the recording of row `i` is."""
    return DeviceSource(fleet.devices.ids[i], fleet.sources[i], fleet.note.reading, fleet.note.sample_period)


def reopen(
    device: DeviceSource, options: ReadOptions | None = None, *, progress: OnProgress | None = None
) -> Recording:
    """Read the recording of a row as the fleet read it.

    Args:
        device: Where it is.
        options: How to read it; None = as the fleet did.
        progress: See `read_recording`; a data set has none.

    Raises:
        BadFile: it is not where it was when the fleet was read, or cannot be read.
        BadSetting: an option does not suit it.
    """
    reading, period = device.reading if options is None else options, device.sample_period
    if not device.source.startswith("["):
        return read_recording(_existing(device.source), reading, sample_period=period, progress=progress)
    return read_block(_unit(device), reading, only=device.id).recording(0, reading, period)


def device_tuning(fleet: Fleet, i: int) -> Tuning:
    """The filter that was fitted to this device.

    Raises:
        BadSetting: it has none.
    """
    devices, momentum, gate = fleet.devices, float(fleet.devices.momentum[i]), float(fleet.gates[i])
    return _tuning(
        fleet,
        i,
        q=float(devices.q[i]),
        r=float(devices.r[i]),
        how="its own fit in the fleet",
        gate=None if math.isnan(gate) else gate,
        momentum=0.0 if math.isnan(momentum) else momentum,
        period=1.0 / float(devices.rate_hz[i]) if devices.rate_hz[i] > 0.0 else None,
    )


def shared_tuning(fleet: Fleet, i: int) -> Tuning | None:
    """The filter for all on the channel of this device; None where there is none."""
    shared = fleet.shared
    if shared is None:
        return None
    q, r, momentum = shared.params.q, float(shared.params.r), shared.params.momentum
    return _tuning(fleet, i, q=q, r=r, how=shared.how, momentum=momentum, period=fleet.devices.sample_period)


def _tuning(fleet: Fleet, i: int, *, period: float | None, **values: Any) -> Tuning:
    channel = ChannelTuning(fleet.devices.channels[i], fleet.devices.units[i], **values)
    return Tuning((channel,), sample_period=period)


def _existing(path: str) -> str:
    """A path, checked to be that of a file."""
    if not (os.path.isabs(path) and os.path.isfile(path)):
        raise BadFile(f"the recording must be where the fleet found it (got no file at {path[:300]!r})")
    return path


def _unit(device: DeviceSource) -> Unit:
    """The row groups that a source names."""
    try:
        data_set, files = json.loads(device.source)
        pieces = tuple(Piece(_existing(str(path)), groups=_groups(runs)) for path, runs in files)
        if not (pieces and all(piece.groups for piece in pieces)):
            raise ValueError("no row group")
    except (ValueError, TypeError, RecursionError) as error:
        if isinstance(error, BadFile):
            raise
        name, source = device.id[:80], device.source[:80]
        raise BadFile(f"the source of {name!r} must name row groups (got {source!r})") from None
    if data_set is None:
        return Unit(device.id, pieces)
    return Unit(device.id, pieces, span=(None, None), data_set=str(data_set))


def _groups(runs: Any) -> tuple[int, ...]:
    """The numbers in some runs, each with its first and its last; above those of the run before."""
    numbers: list[int] = []
    for first, last in runs:
        least = numbers[-1] + 1 if numbers else 0
        if not (isinstance(first, int) and isinstance(last, int) and least <= first <= last < MAX_GROUPS):
            raise ValueError("row groups must be ascending whole numbers")
        numbers += range(first, last + 1)
    return tuple(numbers)
