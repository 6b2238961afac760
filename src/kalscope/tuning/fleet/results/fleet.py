"""A fleet as arrays, from its folder: the whole table of a finished run, or the parts so far of a running one."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from kalscope.common.array import Array, Mask
from kalscope.errors import BadFile, KalscopeError
from kalscope.estimation.fleet.held_out import share_served
from kalscope.estimation.fleet.pool import Pool
from kalscope.estimation.fleet.pooled import fit_pool
from kalscope.filtering.params import MAX_MOMENTUM, MAX_VARIANCE, FilterParams
from kalscope.tuning.fleet.answer.answer import WITHIN, unlike_in
from kalscope.tuning.fleet.answer.devices import Devices, devices_of
from kalscope.tuning.fleet.libraries import library
from kalscope.tuning.fleet.results.checked import MAX_ROWS, checked_table
from kalscope.tuning.fleet.store.begun import NAME as BEGUN
from kalscope.tuning.fleet.store.begun import SUMMARY, TABLE, Begun, read_begun, read_json
from kalscope.tuning.fleet.store.parts import part_files
from kalscope.tuning.fleet.store.table import POOL, units_of, unpacked

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
    """How it was found, in a few words."""


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
    unlike: Mask
    """Which are unlike the others in r or q."""
    begun: Begun
    """What the run noted when it began."""
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
        folder = self._folder
        begun = read_begun(folder)
        if _is_finished(folder):
            self._parts.clear()
            table = checked_table(folder / TABLE)
            return _fleet(folder, table, _saved_filter(folder), begun, None)
        table, pool, done = self._merged(begun)
        shared = _pooled_filter(pool) if begun.pooled else None
        return _fleet(folder, table, shared, begun, done)

    def _merged(self, begun: Begun) -> tuple[Any, Pool, int]:
        """All parts of the present options so far: rows, pool, number of units; a later row replaces an earlier."""
        for path in part_files(self._folder):
            if path not in self._parts and path.stat().st_mtime_ns >= begun.since - CLOCKS_NS:
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
        for content in table[POOL].drop_null().to_pylist():
            pool = pool + _unpacked(content)
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


def _is_finished(folder: Path) -> bool:
    """Whether the table is that of the last run: a run writes its answer after the table."""
    answer, note = folder / SUMMARY, folder / BEGUN
    if not ((folder / TABLE).is_file() and answer.is_file()):
        return False
    return not note.exists() or answer.stat().st_mtime_ns >= note.stat().st_mtime_ns


def _unpacked(content: bytes) -> Pool:
    try:
        pool = unpacked(content)
    except (ValueError, OverflowError, IndexError):
        raise BadFile("a part of the fleet must hold sums of its likelihood (got other bytes)") from None
    return pool if pool.devices > 0 and not np.isnan(pool.sums).any() else Pool.empty()


def _saved_filter(folder: Path) -> SharedFilter | None:
    """The filter for all that a finished run has found."""
    path = folder / SUMMARY
    one = read_json(path).get("one_filter")
    if one is None:
        return None
    try:
        low, high = (math.nan if end is None else float(end) for end in one["ratio_interval"])
        params = FilterParams(float(one["q"]), float(one["r"]), momentum=float(one["momentum"]))
        return SharedFilter(_usable(params), (low, high), str(one["how"])[:200])
    except (KeyError, TypeError, ValueError, OverflowError, KalscopeError):
        raise BadFile(f"one_filter in {str(path)!r} must hold q and r above 0 (got {str(one)[:100]})") from None


def _usable(params: FilterParams) -> FilterParams:
    if not (params.q > 0.0 and float(params.r) > 0.0):
        raise ValueError("q and r must be above 0")
    return params


def _pooled_filter(pool: Pool) -> SharedFilter | None:
    """The most likely filter for all that is in the pool."""
    if not pool.devices:
        return None
    fit = fit_pool(pool)
    if fit.params is None:
        return None
    return SharedFilter(fit.params, fit.ratio_interval, "pooled maximum likelihood so far")


def _fleet(folder: Path, table: Any, shared: SharedFilter | None, begun: Begun, done: int | None) -> Fleet:
    devices = _plain(devices_of(table))
    compared = [unlike_in(devices, name) for name in ("r", "q")]
    unlike = np.zeros(len(devices), dtype=bool)
    for one in compared:
        unlike[one.devices] = True
    nothing = np.full(len(devices), math.nan)
    gates = np.asarray(table["gate"].to_numpy(), dtype=np.float64)
    return Fleet(
        folder=folder,
        devices=devices,
        gates=np.where((gates > 0.0) & np.isfinite(gates), gates, math.nan),
        verdicts=tuple(table["verdict"].to_pylist()),
        sources=tuple(table["source"].to_pylist()),
        reasons=tuple(table["reason"].to_pylist()),
        shared=shared,
        growth=nothing if shared is None else _growth(devices, table, shared),
        distance=np.fmax(*(np.abs(one.z) for one in compared)),
        unlike=unlike,
        begun=begun,
        done=done,
    )


def _growth(devices: Devices, table: Any, shared: SharedFilter) -> Array:
    """By which share the prediction error of each grows: from a finished table, or from what the fits stored."""
    if devices.left is not None:
        return devices.losses(shared.params).error
    said = np.asarray(table["error_growth"].to_numpy(), dtype=np.float64)
    return np.where(np.isfinite(said) & (said > -1.0), said, math.nan)


def _plain(devices: Devices) -> Devices:
    """The devices with NaN in place of numbers that are out of range."""

    def within(values: Array, most: float) -> Array:
        return np.where((values >= 0.0) & (values <= most), values, math.nan)

    rate = np.where((devices.rate_hz > 0.0) & np.isfinite(devices.rate_hz), devices.rate_hz, math.nan)
    return replace(
        devices,
        rate_hz=rate,
        q=within(devices.q, MAX_VARIANCE),
        r=within(devices.r, MAX_VARIANCE),
        momentum=within(devices.momentum, MAX_MOMENTUM),
    )
