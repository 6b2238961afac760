"""MATLAB files: up to version 7.2 by SciPy, version 7.3, which is HDF5, by h5py. Nothing in them is ever run."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path
from typing import Any, cast

import numpy as np

from kalscope.common.memory import require_memory_for_numbers
from kalscope.common.progress import Progress
from kalscope.errors import BadFile
from kalscope.sources.containers.arrays.groups import Item, is_numeric, read_arrays
from kalscope.sources.containers.arrays.hdf5 import read_hdf5
from kalscope.sources.containers.library import load_library
from kalscope.sources.containers.table import MAX_NUMBERS, Table

_MAX_DEPTH = 8
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
            if depth < _MAX_DEPTH:
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
