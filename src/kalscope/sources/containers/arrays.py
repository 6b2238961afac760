"""Named arrays, as NumPy, MATLAB, HDF5, TDMS, Parquet and EDF files hold them: those of one length are channels."""

from __future__ import annotations

import io
import logging
import math
import pickle
import re
import struct
import zipfile
import zlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, cast

import numpy as np

from kalscope.common.files import require_memory_for_numbers, temporary_folder
from kalscope.common.numbers import Array
from kalscope.common.progress import Progress
from kalscope.errors import BadFile
from kalscope.sources.containers.table import (
    MAX_COLUMNS,
    MAX_NUMBERS,
    Part,
    Table,
    choose_part,
    convert_apart,
    load_library,
    refuse_part,
)
from kalscope.sources.grammar.timestamps import parse_calendar

# Named arrays, as MATLAB, HDF5 and TDMS files hold them: those of one group and one length form a table.


_RATES = re.compile("fs|fsamp|sr|s?rate|sfreq|sampl(e|ing)(rate|freq(uency)?)")
_PERIODS = re.compile("dt|ts|sampl(e|ing)(period|time)|sampleinterval")
"""Names of scalars, lower case without separators, that give the sample rate in Hz or the period in s."""


@dataclass(frozen=True)
class Item:
    """One array of a file, before it is read."""

    name: str
    """Its name within its group."""
    group: str
    """Name of its group; "" for the file itself."""
    shape: tuple[int, ...]
    """One or two dimensions."""
    load: Callable[[], Any]
    """Reads it."""
    unit: str = ""
    """Its unit; "" where none is given."""
    period: float | None = None
    """Its sample period in s; None where it has none of its own."""
    start: float | None = None
    """Time of its first sample in s since 1970."""


@dataclass
class Found:
    """What the arrays of a file are, before they are read."""

    items: list[Item] = field(default_factory=list[Item])
    """The arrays."""
    scalars: list[tuple[str, str, float]] = field(default_factory=list[tuple[str, str, float]])
    """(group, name, value) of single numbers, which may include the sample rate."""
    what: str = "group of arrays of one length"
    """What a part of the file is called."""

    def add(self, key: str, group: str, array: Any, unit: str = "", period: float | None = None) -> None:
        """Add an array, or a dataset that is one: each field of a table, which may hold several columns, is one."""
        dtype, shape = array.dtype, tuple(int(n) for n in array.shape or ())
        size = math.prod(shape)
        if dtype.names and len(shape) == 1:
            fields = [(name, dtype[name].base, (*shape, *dtype[name].shape)) for name in dtype.names]
            group = f"{group}/{key}" if group and key else group or key
        else:
            fields = [(key, dtype, shape)]
        for name, kind, sizes in fields:
            if not is_numeric(kind) or size == 0:
                continue
            if size == 1 and not dtype.names:
                self.scalars.append((group, name, float(_numbers_of(array[()]).reshape(-1)[0])))
            elif 1 <= len(sizes) <= 2:
                what = name if dtype.names else ()
                self.items.append(Item(name, group, sizes, partial(array.__getitem__, what), unit, period))


def is_numeric(dtype: Any) -> bool:
    """True for whole and real numbers, flags and stamps."""
    return np.dtype(dtype).kind in "iufbM"


def _numbers_of(array: Any) -> Array:
    """Numbers; stamps as µs since 1970."""
    array = np.asarray(array)
    if array.dtype.kind == "M":
        return np.where(np.isnat(array), np.nan, (array - np.datetime64(0, "us")) / np.timedelta64(1, "us"))
    return array.astype(np.float64)


def period_from(name: str, value: float) -> float | None:
    """Sample period in s, if a number of this name gives it: fs, sample_rate in Hz, dt, Ts in s."""
    word = "".join(c for c in name.lower() if c.isalnum()).removesuffix("hz")
    if not 0.0 < value < float("inf"):
        return None
    period = 1.0 / value if _RATES.fullmatch(word) else value if _PERIODS.fullmatch(word) else None
    return period if period is not None and period <= 1e6 else None  # a larger number is a date


def read_arrays(arrays: Found, part: str | None, name: str, note: str, progress: Progress) -> Table:
    """The requested part: the arrays of one group with the same number of samples.

    Args:
        arrays: The arrays of the file.
        part: `ReadOptions.part`.
        name: The file.
        note: What it is: "a MATLAB file".
        progress: Reports the arrays as they are read.

    Raises:
        BadFile: there are no arrays of numbers, or too many numbers.
        BadSetting: there is no such part.
    """
    groups = _grouped(arrays.items)
    many = {group for group, *_ in groups if sum(group == other for other, *_ in groups) > 1}
    parts: list[Part] = []
    for (group, n), found in groups.items():
        label = group if group and group not in many else f"{group}/{found[0].name}".removeprefix("/")
        parts.append(Part(label, n, sum(_width(item, n) for item in found)))
    chosen, said = choose_part(parts, part, name, arrays.what)
    (group, n), found = list(groups.items())[chosen]
    if group:  # a time array in the file itself applies to the group as well
        found = [*groups.get(("", n), []), *found]
    width = sum(_width(item, n) for item in found)
    if width > MAX_COLUMNS or n * width > MAX_NUMBERS:
        most = f"{MAX_COLUMNS} columns and {MAX_NUMBERS} numbers"
        raise BadFile(f"{name} must hold at most {most} a part (got {n} × {width})")
    require_memory_for_numbers(n * width, name)
    names: list[str] = []
    units: list[str] = []
    dates: list[int] = []
    columns: list[Array] = []
    for i, item in enumerate(found):
        progress(i / len(found), "reading")
        progress.unpack(8 * math.prod(item.shape))  # any part of it may be packed
        array = np.asarray(item.load())
        dates += [len(names)] if array.dtype.kind == "M" else []
        array = _numbers_of(array)
        if array.shape != item.shape:
            raise ValueError(f"{item.name} is not as large as announced")
        array = array.reshape(n, -1) if array.shape[0] == n else array.T
        width = array.shape[1]
        names += [item.name if width == 1 or not item.name else f"{item.name}[{k}]" for k in range(width)]
        units += [item.unit] * width
        columns += [np.ascontiguousarray(array[:, k]) for k in range(width)]
    start = next((item.start for item in found if item.start is not None), None)
    periods = [item.period for item in found]
    for outer in _outer(group):
        periods += [period_from(key, value) for other, key, value in arrays.scalars if other == outer]
    period = next((period for period in periods if period is not None), None)
    held = tuple(names), tuple(units), tuple(columns)
    return Table(*held, start=start, period=period, notes=(note, *said), dates=frozenset(dates))


def _outer(group: str) -> list[str]:
    """A group and all groups that contain it, `run/imu`, `run` and the file itself; `run.imu` in MATLAB."""
    ends = [i for i, mark in enumerate(group) if mark in "/."]
    return [group[:end] for end in (len(group), *reversed(ends))] + [""]


def _grouped(items: Sequence[Item]) -> dict[tuple[str, int], list[Item]]:
    """The arrays of each group and number of samples; scalars and images are left out.

    The samples of a matrix are along the axis that is as long as a vector beside it, else along the longer one.
    """
    vectors = {(item.group, max(item.shape)) for item in items if math.prod(item.shape) == max(item.shape)}
    groups: dict[tuple[str, int], list[Item]] = {}
    for item in items:
        n = next((n for n in item.shape if n > 1 and (item.group, n) in vectors), max(item.shape))
        if n > 1 and 0 < _width(item, n) <= MAX_COLUMNS:
            groups.setdefault((item.group, n), []).append(item)
    return groups


def _width(item: Item, n: int) -> int:
    return math.prod(item.shape) // n


# HDF5 files, read by h5py: the datasets of one length in a group. Nothing outside the file is read.


_MAX_DEPTH = 12
_UNITS = ("unit", "units", "Unit", "Units", "UNITS", "unit_string", "NI_UnitDescription")


def read_hdf5(path: Path, name: str, part: str | None, progress: Progress) -> Table:
    """Read the datasets of an HDF5 file: vectors, matrices, tables of fields.

    Raises:
        BadFile: it holds no numbers or too many.
        BadSetting: there is no such part.
    """
    h5py = load_library("h5py", "h5py", name, "an HDF5 file")
    found = Found()

    def take(place: str, node: Any) -> bool | None:
        progress(0.1, "reading")
        group, _, key = place.rpartition("/")
        if not isinstance(node, h5py.Dataset):
            found.scalars.extend((place, name, value) for name, value in _numbers(node))
        elif "#" in place or node.is_virtual or node.external is not None:
            return None
        elif _text(node.attrs.get("MATLAB_class")) not in ("char", "cell", "function_handle"):
            unit = next((text for word in _UNITS if (text := _text(node.attrs.get(word)))), "")
            periods = (period for name, value in _numbers(node) if (period := period_from(name, value)))
            found.add(key, group, node, unit, next(periods, None))
        return True if len(found.items) > 2000 or place.count("/") > _MAX_DEPTH else None  # True: stop

    with h5py.File(str(path), "r") as file:
        take("", file)
        file.visititems(take)  # by hard links only: any other link may lead out of the file
        return read_arrays(found, part, name, "an HDF5 file", progress.part(0.2, 1.0))


def _numbers(node: Any) -> Iterator[tuple[str, float]]:
    """The attributes that hold a single number."""
    for name in node.attrs:
        value = np.asarray(node.attrs.get(name))
        if value.size == 1 and is_numeric(value.dtype):
            yield str(name), float(value.reshape(-1)[0])


def _text(value: Any) -> str:
    if isinstance(value, bytes):
        return value.decode("utf-8", "replace").strip()
    return value.strip() if isinstance(value, str) else ""


# MATLAB files of version 5 to 7.2, read by SciPy; version 7.3 is HDF5. Nothing in them is ever run.


def read_mat(path: Path, name: str, part: str | None, progress: Progress) -> Table:
    """Read the variables of a MATLAB file: vectors, matrices, the fields of structs.

    Raises:
        BadFile: it holds no numbers or too many.
        BadSetting: there is no such part.
    """
    # The size of a struct says nothing of its fields, and any element may unpack to more than its variable has.
    _count_unpacked(path, progress)
    progress(0.1, "reading")
    found = Found()
    with temporary_folder() as folder:
        convert_apart("mat", path, folder, progress.part(0.1, 0.6))
        held: dict[str, Any] = pickle.loads((folder / "variables.pickle").read_bytes())
    for key, value in held.items():
        _collect(key, "", value, found)
    return read_arrays(found, part, name, "a MATLAB file", progress.part(0.6, 1.0))


def _count_unpacked(path: Path, progress: Progress) -> None:
    """Count what the compressed variables of a file of version 5 unpack to."""
    data = path.read_bytes()
    at, order = 128, "<" if data[126:128] == b"IM" else ">"
    while at + 8 <= len(data):
        kind, size = struct.unpack_from(f"{order}II", data, at)
        unpacker, packed = zlib.decompressobj(), data[at + 8 : at + 8 + size]
        while kind == 15 and packed:  # a compressed variable
            progress(0.0, "reading")
            progress.unpack(len(unpacker.decompress(packed, 1 << 26)))
            packed = unpacker.unconsumed_tail
        at += 8 + size


def _collect(key: str, group: str, value: Any, found: Found, depth: int = 0) -> None:
    if isinstance(value, dict):
        inner = f"{group}.{key}" if group else key
        for name, part in cast("dict[str, Any]", value).items():
            if depth < _MAX_DEPTH:
                _collect(name, inner, part, found, depth + 1)
    else:
        found.add(key, group, np.asarray(value))


# NumPy files: an array, or a zip archive of several. Pickled objects are never loaded.


def read_numpy(path: Path, name: str, part: str | None, progress: Progress) -> Table:
    """Read a .npy or .npz file: vectors, matrices, tables of fields.

    Raises:
        BadFile: it holds no numbers or too many.
        BadSetting: there is no such part.
    """
    found = Found()
    progress(0.0, "reading")
    if not zipfile.is_zipfile(path):
        # A map of the file: an array cannot be larger than it.
        found.add("", "", np.lib.format.open_memmap(path, mode="r"))
        return read_arrays(found, part, name, "a NumPy array", progress)
    with zipfile.ZipFile(path) as archive:
        for info in archive.infolist():
            progress.unpack(info.file_size)
            data = archive.read(info)
            if info.filename.endswith(".npy") and data[:6] == b"\x93NUMPY":
                with suppress(ValueError):  # an array of objects
                    found.add(info.filename.removesuffix(".npy"), "", np.load(io.BytesIO(data), allow_pickle=False))
    return read_arrays(found, part, name, "an archive of NumPy arrays", replace(progress, unpacking=None))


# LabVIEW TDMS files, read by npTDMS: the channels of a group, with their units and waveform properties.


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
        found = Found()
        for channel in (channel for group in file.groups() for channel in group.channels()):
            n, properties = len(channel), channel.properties
            # Raw data are stored as they are: no channel holds more samples than the file has bytes.
            if not 0 < n <= min(path.stat().st_size, MAX_NUMBERS) or not is_numeric(channel.dtype):
                continue
            step = properties.get("wf_increment")
            period = float(step) if isinstance(step, (int, float)) and 0 < step < np.inf else None
            unit = properties.get("unit_string") or properties.get("NI_UnitDescription") or ""
            stamp = np.asarray(properties.get("wf_start_time"))
            seconds = float(_numbers_of(stamp)) / 1e6 if period and stamp.dtype.kind == "M" else math.nan
            start = seconds if math.isfinite(seconds) else None
            load = partial(channel.__getitem__, slice(None))
            found.items.append(Item(channel.name, channel.group_name, (n,), load, str(unit), period, start))
        return read_arrays(found, part, name, "a TDMS file", progress)


# Parquet files, read by pyarrow: one row per sample, the file gives the column types.


def read_parquet(path: Path, name: str, part: str | None, progress: Progress) -> Table:
    """Read a Parquet file.

    Raises:
        BadFile: it holds no column of numbers, too many rows or columns, or pyarrow is not installed.
        BadSetting: a part is wanted.
    """
    refuse_part(part, name)
    progress(0.0, "reading")
    parquet = load_library("pyarrow.parquet", "pyarrow", name, "a Parquet file")
    types = load_library("pyarrow.types", "pyarrow", name, "a Parquet file")
    with parquet.ParquetFile(str(path)) as file:
        found, rows = Found(), int(file.metadata.num_rows)

        def column(key: str) -> Any:
            one = file.read(columns=[key]).column(0)
            return (one.cast("float64", safe=False) if types.is_decimal(one.type) else one).to_numpy()

        for one in file.schema_arrow:
            is_number = types.is_integer(one.type) or types.is_floating(one.type) or types.is_decimal(one.type)
            if is_number or types.is_timestamp(one.type) or types.is_date(one.type):
                found.items.append(Item(one.name, "", (rows,), partial(column, one.name)))
        return read_arrays(found, None, name, "a Parquet file", progress)


# EDF files of signals of the body: a header of text in fixed places, then records of 16-bit numbers.


_EDF_FIELDS = (16, 80, 8, 8, 8, 8, 8, 80, 8, 32)
"""Characters of label, transducer, unit, physical and digital range, filter, samples a record, reserve."""


def read_edf(path: Path, name: str, part: str | None, progress: Progress) -> Table:
    """Read a continuous EDF or EDF+ file, by the specifications at edfplus.info; annotations are left out.

    Raises:
        BadFile: it holds no signals, too many numbers, or pauses.
        BadSetting: there is no such part.
    """
    progress(0.0, "reading")
    with path.open("rb") as file:
        head = file.read(256).decode("latin-1")
        count = int(head[252:])
        fields = [[file.read(size).decode("latin-1").strip() for _ in range(count)] for size in _EDF_FIELDS]
    if head[192:197] == "EDF+D":
        raise BadFile(f"{name} must be one continuous recording (got EDF+D, whose records may have pauses)")
    begin, seconds = int(head[184:192]), float(head[244:252])
    stamp = parse_calendar(f"{head[168:176]} {head[176:184]}", "dmy")
    start = None if stamp is None else stamp / 1e6
    stops = np.cumsum([0, *map(int, fields[8])]).tolist()
    shape = (path.stat().st_size - begin) // (2 * stops[-1]), stops[-1]
    data = np.memmap(path, "<i2", "r", begin, shape)

    def physical(i: int) -> Array:
        low, high, least, most = (float(field[i]) for field in fields[3:7])
        return (data[:, stops[i] : stops[i + 1]].ravel() - least) * ((high - low) / (most - least)) + low

    found = Found(what="set of signals of one rate")
    for i, (label, unit) in enumerate(zip(fields[0], fields[2], strict=True)):
        if not label.endswith("Annotations"):
            n = stops[i + 1] - stops[i]
            found.items.append(Item(label, "", (n * shape[0],), partial(physical, i), unit, seconds / n, start))
    return read_arrays(found, part, name, "an EDF file", progress)
