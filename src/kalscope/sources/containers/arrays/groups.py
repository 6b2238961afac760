"""Named arrays, as MATLAB, HDF5 and TDMS files hold them: those of one group and one length form a table."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from kalscope.common.array import Array
from kalscope.common.memory import require_memory_for_numbers
from kalscope.common.progress import Progress
from kalscope.errors import BadFile
from kalscope.sources.containers.parts import Part, choose_part
from kalscope.sources.containers.table import MAX_COLUMNS, MAX_NUMBERS, Table

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
