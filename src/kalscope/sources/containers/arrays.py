"""Named arrays, as MATLAB, HDF5 and TDMS files hold them: those of one group and length are channels."""

from __future__ import annotations

import logging
import math
import struct
import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np

from kalscope.common.files import require_memory_for_numbers
from kalscope.common.numbers import Array
from kalscope.common.progress import Progress
from kalscope.errors import BadFile
from kalscope.sources.containers.table import MAX_COLUMNS, MAX_NUMBERS, Part, Table, choose_part, load_library

# Named arrays, as MATLAB, HDF5 and TDMS files hold them: those of one group and one length form a table.


_RATES = frozenset(
    (
        "fs",
        "fsamp",
        "sr",
        "srate",
        "rate",
        "sfreq",
        "samplerate",
        "samplingrate",
        "samplefrequency",
        "samplingfrequency",
        "samplefreq",
        "samplingfreq",
    )
)
_PERIODS = frozenset(("dt", "ts", "sampleperiod", "samplingperiod", "sampletime", "samplingtime", "sampleinterval"))
"""Names of scalars, lower case without separators, that give the sample rate in Hz or the period in s."""
_MAX_PERIOD = 1e6
"""Longest sample period in s; a larger number is a date, or something else."""


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


def is_numeric(dtype: Any) -> bool:
    """True for whole and real numbers and flags."""
    return np.dtype(dtype).kind in "iufb"


def period_from(name: str, value: float) -> float | None:
    """Sample period in s, if a number of this name gives it: fs, sample_rate in Hz, dt, Ts in s."""
    word = "".join(c for c in name.lower() if c.isalnum()).removesuffix("hz")
    if not 0.0 < value < float("inf"):
        return None
    period = 1.0 / value if word in _RATES else value if word in _PERIODS else None
    return period if period is not None and period <= _MAX_PERIOD else None


def read_arrays(
    items: Sequence[Item],
    scalars: Sequence[tuple[str, str, float]],
    wanted: str | None,
    name: str,
    note: str,
    progress: Progress,
) -> Table:
    """The requested part: the arrays of one group with the same number of samples.

    Args:
        items: The arrays of the file.
        scalars: (group, name, value) of its scalars, which may include the sample rate.
        wanted: `ReadOptions.part`.
        name: The file.
        note: What it is: "a MATLAB file".
        progress: Reports the arrays as they are read.

    Raises:
        BadFile: there are no arrays of numbers, or too many numbers.
        BadSetting: there is no such part.
    """
    groups = _grouped(items)
    many = {group for group, *_ in groups if sum(group == other for other, *_ in groups) > 1}
    parts = [
        Part(_part_name(group, found, alone=group not in many), n, sum(_width(item, n) for item in found))
        for (group, n, _), found in groups.items()
    ]
    chosen, said = choose_part(parts, wanted, name, "group of arrays of one length")
    (group, n, _), found = list(groups.items())[chosen]
    if group:  # a time array in the file itself applies to the group as well
        found = [*groups.get(("", n, None), []), *found]
    width = sum(_width(item, n) for item in found)
    if width > MAX_COLUMNS or n * width > MAX_NUMBERS:
        raise BadFile(
            f"{name} must hold at most {MAX_COLUMNS} columns and {MAX_NUMBERS} numbers a part (got {n} × {width})"
        )
    require_memory_for_numbers(n * width, name)
    names: list[str] = []
    units: list[str] = []
    columns: list[Array] = []
    for i, item in enumerate(found):
        progress(i / len(found), "reading")
        array = np.asarray(item.load(), dtype=np.float64)
        if array.shape != item.shape:
            raise ValueError(f"{item.name} is not as large as announced")
        array = array.reshape(n, -1) if array.shape[0] == n else array.T
        width = array.shape[1]
        names += [item.name if width == 1 else f"{item.name}[{k}]" for k in range(width)]
        units += [item.unit] * width
        columns += [np.ascontiguousarray(array[:, k]) for k in range(width)]
    period = next((item.period for item in found if item.period is not None), None)
    start = next((item.start for item in found if item.start is not None), None)
    given = [period_from(key, value) for outer in _outer(group) for other, key, value in scalars if other == outer]
    period = next((one for one in (period, *given) if one is not None), None)
    return Table(tuple(names), tuple(units), tuple(columns), start=start, period=period, notes=(note, *said))


def _outer(group: str) -> list[str]:
    """A group and all groups that contain it, `run/imu`, `run` and the file itself; `run.imu` in MATLAB."""
    ends = [i for i, mark in enumerate(group) if mark in "/."]
    return [group[:end] for end in (len(group), *reversed(ends))] + [""]


def _part_name(group: str, found: list[Item], *, alone: bool) -> str:
    if alone and group:
        return group
    return f"{group}/{found[0].name}" if group else found[0].name


def _grouped(items: Sequence[Item]) -> dict[tuple[str, int, float | None], list[Item]]:
    """The arrays of each group, number of samples and period; scalars and images are left out.

    The period is None where the arrays of the group have one period at most: those without one share it.
    """
    lengths = {(item.group, max(item.shape)) for item in items if _is_vector(item.shape)}
    sized = [(item, n) for item in items if (n := _samples(item, lengths)) > 1]
    periods: dict[tuple[str, int], set[float]] = {}
    for item, n in sized:
        periods.setdefault((item.group, n), set()).update(() if item.period is None else (item.period,))
    groups: dict[tuple[str, int, float | None], list[Item]] = {}
    for item, n in sized:
        period = item.period if len(periods[item.group, n]) > 1 else None
        groups.setdefault((item.group, n, period), []).append(item)
    return groups


def _is_vector(shape: tuple[int, ...]) -> bool:
    return len(shape) == 1 or (len(shape) == 2 and 1 in shape)


def _samples(item: Item, lengths: set[tuple[str, int]]) -> int:
    """Samples of an array: along the axis that is as long as a vector beside it, else along the longer one."""
    if not 1 <= len(item.shape) <= 2 or 0 in item.shape:
        return 0
    if _is_vector(item.shape):
        return max(item.shape)
    fitting = [n for n in item.shape if (item.group, n) in lengths]
    n = fitting[0] if fitting else max(item.shape)
    return n if _width(item, n) <= MAX_COLUMNS else 0


def _width(item: Item, n: int) -> int:
    total = 1
    for size in item.shape:
        total *= size
    return total // n


# HDF5 files, read by h5py: the datasets of one length in a group. Nothing outside the file is read.


_MAX_DATASETS = 2000
_MAX_DEPTH = 12
_UNITS = ("unit", "units", "Unit", "Units", "UNITS", "unit_string", "NI_UnitDescription")


def read_hdf5(path: Path, name: str, part: str | None, progress: Progress) -> Table:
    """Read the datasets of an HDF5 file: vectors, matrices, tables of fields.

    Raises:
        BadFile: it holds no numbers or too many.
        BadSetting: there is no such part.
    """
    h5py = load_library("h5py", "h5py", name, "an HDF5 file")
    with h5py.File(str(path), "r") as file:
        items: list[Item] = []
        scalars: list[tuple[str, str, float]] = []
        for group, key, node in _nodes(h5py, file):
            progress(0.1, "reading")
            if key:
                _take(group, key, node, items, scalars, progress)
            else:
                scalars += [(group, name, value) for name, value in _numbers(node)]
        return read_arrays(items, scalars, part, name, "an HDF5 file", progress.part(0.2, 1.0))


def _nodes(h5py: Any, file: Any) -> Iterator[tuple[str, str, Any]]:
    """(group, "", its node) of all groups, (group, name, dataset) of the datasets in the file itself."""
    waiting, count = [("", file, 0)], 0
    while waiting and count < _MAX_DATASETS:
        group, node, depth = waiting.pop(0)
        yield group, "", node
        for key in node:
            # Hard links only: any other link may lead out of the file, or back into the same group.
            if not isinstance(node.get(key, getlink=True), h5py.HardLink) or key.startswith("#"):
                continue
            child = node[key]
            if isinstance(child, h5py.Group):
                if depth < _MAX_DEPTH:
                    waiting.append((f"{group}/{key}" if group else key, child, depth + 1))
            elif isinstance(child, h5py.Dataset) and not child.is_virtual and child.external is None:
                count += 1
                yield group, key, child


def _take(
    group: str,
    key: str,
    dataset: Any,
    items: list[Item],
    scalars: list[tuple[str, str, float]],
    progress: Progress,
) -> None:
    if _text(dataset.attrs.get("MATLAB_class")) in ("char", "cell", "function_handle"):
        return
    dtype, shape = dataset.dtype, tuple(int(n) for n in dataset.shape or ())
    unit = next((text for word in _UNITS if (text := _text(dataset.attrs.get(word)))), "")
    period = next((period for name, value in _numbers(dataset) if (period := period_from(name, value))), None)
    if dtype.names:
        _take_fields(f"{group}/{key}" if group else key, dataset, shape, items, progress)
    elif is_numeric(dtype):
        if int(np.prod(shape, dtype=np.float64)) == 1:
            scalars.append((group, key, float(np.asarray(dataset[()]).reshape(-1)[0])))
        elif 1 <= len(shape) <= 2:
            items.append(Item(key, group, shape, _loader(dataset, (), shape, progress), unit, period))


def _loader(dataset: Any, what: Any, shape: tuple[int, ...], progress: Progress) -> Callable[[], Any]:
    """Reads a dataset, or one of its fields, and counts its numbers before: any part of them may be packed."""

    def load() -> Any:
        progress.unpack(8 * math.prod(shape))
        return dataset[what]

    return load


def _take_fields(group: str, dataset: Any, shape: tuple[int, ...], items: list[Item], progress: Progress) -> None:
    """The fields of a table, as pandas and PyTables write it; a field may itself hold several columns."""
    for field in dataset.dtype.names if len(shape) == 1 else ():
        base, inner = dataset.dtype[field].base, dataset.dtype[field].shape
        if is_numeric(base) and len(inner) <= 1:
            stamps = field == "index" and _text(dataset.attrs.get("index_kind")).startswith("datetime")
            load = _loader(dataset, field, (*shape, *inner), progress)
            items.append(Item("time" if stamps else str(field), group, (*shape, *inner), load))


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


# MATLAB files: up to version 7.2 by SciPy, version 7.3, which is HDF5, by h5py. Nothing in them is ever run.


_MAT_MAX_DEPTH = 8
_MAX_STRUCTS = 256
"""Structs of one array that are read."""
_COMPRESSED = 15
"""Type of an element of a file of version 5 that holds a compressed variable."""
_PIECE = 1 << 22
"""Bytes that are read and unpacked at once to count them."""
_VERSION_73 = b"MATLAB 7.3"
_WHOLE = tuple(f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64))
_CLASSES = frozenset(("double", "single", "logical", "struct", *_WHOLE))
"""Classes of variables that may hold numbers; cells, text, functions and objects are left unread."""


def read_mat(path: Path, name: str, part: str | None, progress: Progress) -> Table:
    """Read the variables of a MATLAB file: vectors, matrices, the fields of structs.

    Raises:
        BadFile: it holds no numbers or too many.
        BadSetting: there is no such part.
    """
    with path.open("rb") as file:
        if file.read(len(_VERSION_73)) == _VERSION_73:
            return read_hdf5(path, name, part, progress)
    matlab = load_library("scipy.io", "scipy", name, "a MATLAB file")
    listed = cast("list[tuple[str, tuple[int, ...], str]]", matlab.whosmat(str(path)))
    wanted = [key for key, _, kind in listed if kind in _CLASSES]
    size = sum(int(np.prod([min(n, MAX_NUMBERS) for n in shape], dtype=np.float64)) for _, shape, _ in listed)
    if size > MAX_NUMBERS:
        raise BadFile(f"{name} must hold at most {MAX_NUMBERS} numbers (got {size})")
    # The size of a struct says nothing of its fields, and any element may unpack to more than its variable has.
    _count_unpacked(path, progress)
    require_memory_for_numbers(size, name)
    progress(0.1, "reading")
    held = matlab.loadmat(str(path), variable_names=wanted, simplify_cells=True)
    items: list[Item] = []
    scalars: list[tuple[str, str, float]] = []
    for key in wanted:
        if key in held:
            _collect(key, "", held[key], items, scalars)
    return read_arrays(items, scalars, part, name, "a MATLAB file", progress.part(0.6, 1.0))


def _count_unpacked(path: Path, progress: Progress) -> None:
    """Count what the compressed variables of a file of version 5 unpack to."""
    with path.open("rb") as file:
        head = file.read(128)
        if 0 in head[:4]:  # version 4 compresses nothing
            return
        order = "<" if head[126:128] == b"IM" else ">"
        while len(tag := file.read(8)) == 8:
            kind, size = struct.unpack(f"{order}II", tag)
            if kind != _COMPRESSED:
                file.seek(size, 1)
                continue
            unpacker = zlib.decompressobj()
            while packed := file.read(min(size, _PIECE)):
                size -= len(packed)
                while packed:
                    progress(0.0, "reading")
                    progress.unpack(len(unpacker.decompress(packed, _PIECE)))
                    packed = unpacker.unconsumed_tail


def _collect(
    key: str, group: str, value: Any, items: list[Item], scalars: list[tuple[str, str, float]], depth: int = 0
) -> None:
    if isinstance(value, dict):
        inner = f"{group}.{key}" if group else key
        for name, part in cast("dict[str, Any]", value).items():
            if depth < _MAT_MAX_DEPTH:
                _collect(name, inner, part, items, scalars, depth + 1)
        return
    array = np.asarray(value)
    if array.dtype == object and array.ndim == 1:  # an array of structs: each is a group of its own
        for i, part in enumerate(array[:_MAX_STRUCTS]):
            if isinstance(part, dict):
                _collect(f"{key}[{i}]", group, part, items, scalars, depth + 1)
        return
    if not is_numeric(array.dtype):
        return
    if array.size == 1:
        scalars.append((group, key, float(array.reshape(-1)[0])))
    elif 1 <= array.ndim <= 2:
        items.append(Item(key, group, array.shape, lambda: array))


# LabVIEW TDMS files, read by npTDMS: the channels of a group, with their units and waveform properties.


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
            yield Item(
                channel.name, group.name, (n,), _tdms_loader(channel, is_time=is_time), str(unit), period, start
            )


def _tdms_loader(channel: Any, *, is_time: bool) -> Any:
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
