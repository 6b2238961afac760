"""LabVIEW TDMS files, read by npTDMS: the channels of a group, with their units and waveform properties."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from kalscope.common.array import Array
from kalscope.common.progress import Progress
from kalscope.sources.containers.arrays.groups import Item, is_numeric, read_arrays
from kalscope.sources.containers.library import load_library
from kalscope.sources.containers.table import MAX_NUMBERS, Table

_EPOCH = np.datetime64(0, "us")


def read_tdms(path: Path, name: str, part: str | None, progress: Progress) -> Table:
    """Read a TDMS file.

    Raises:
        BadFile: it holds no numbers or too many.
        BadSetting: there is no such part.
    """
    nptdms = load_library("nptdms", "npTDMS", name, "a TDMS file")
    nptdms.log.log_manager.set_level(logging.CRITICAL)  # else it prints warnings about a file to the terminal
    # An open file, not its path: else npTDMS would trust an index file beside it.
    with path.open("rb") as raw, nptdms.TdmsFile.open(raw) as file:
        items = list(_items(file, path.stat().st_size))
        return read_arrays(items, (), part, name, "a TDMS file", progress)


def _items(file: Any, size: int) -> Iterator[Item]:
    for group in file.groups():
        for channel in group.channels():
            n, properties = len(channel), channel.properties
            # Raw data are stored as they are: no channel holds more samples than the file has bytes.
            if not 0 < n <= min(size, MAX_NUMBERS):
                continue
            is_time = channel.dtype.kind == "M"
            if not is_time and not is_numeric(channel.dtype):
                continue
            step = properties.get("wf_increment")
            period = float(step) if isinstance(step, (int, float)) and 0 < step < np.inf else None
            unit = properties.get("unit_string") or properties.get("NI_UnitDescription") or ""
            start = _seconds(properties.get("wf_start_time")) if period is not None else None
            yield Item(channel.name, group.name, (n,), _loader(channel, is_time=is_time), str(unit), period, start)


def _loader(channel: Any, *, is_time: bool) -> Any:
    def load() -> Array:
        data = channel[:]
        # Stamps as seconds since 1970, recognised as the time by their name and size.
        return (data - _EPOCH) / np.timedelta64(1, "s") if is_time else data

    return load


def _seconds(stamp: Any) -> float | None:
    try:
        seconds = float((stamp - _EPOCH) / np.timedelta64(1, "s"))
    except (TypeError, ValueError):  # no stamp
        return None
    return seconds if np.isfinite(seconds) else None
