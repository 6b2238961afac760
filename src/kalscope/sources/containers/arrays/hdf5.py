"""HDF5 files, read by h5py: the datasets of one length in a group. Nothing outside the file is read."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from kalscope.common.progress import Progress
from kalscope.sources.containers.arrays.groups import Item, is_numeric, period_from, read_arrays
from kalscope.sources.containers.library import load_library
from kalscope.sources.containers.table import Table

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
