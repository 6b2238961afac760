"""Turn a long table, one named value per row, into channels: those that share their stamps are one part."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from kalscope.common.array import Array
from kalscope.errors import BadFile
from kalscope.sources.containers.parts import Part, choose_part
from kalscope.sources.layout.columns import Column, distinct_names
from kalscope.sources.layout.long_table import UNIT_NAMES
from kalscope.sources.layout.sniffer import Layout
from kalscope.sources.readers.assemble import Reading
from kalscope.sources.readers.csv_rows import Tally

_MAX_LISTED = 4
_MIN_SHARED = 0.5
"""Share of the stamps of the shorter of two series that the other has as well, where both belong to one part."""


def is_long(layout: Layout) -> bool:
    """True where rows hold one value each, beside its name."""
    return any(column.role == "series" for column in layout.columns)


def widened(table: list[Array], tally: Tally, layout: Layout, part: str | None, name: str) -> Reading:
    """One part of a long table, a column for each name.

    Args:
        table: Its columns, each of shape (rows,), with the index of the name in the first "series" one.
        tally: The account of its lines, with the names.
        layout: What its columns are.
        part: `ReadOptions.part`: a name.
        name: The file.

    Raises:
        BadFile: no name has a number.
        BadSetting: there is no such part.
    """
    codes = table[next(i for i, column in enumerate(layout.columns) if column.role == "series")]
    values = table[layout.channels[0]]
    stamps = _counted(codes) if layout.time is None else table[layout.time.index]
    known = [code for code in range(len(tally.series)) if np.isfinite(values[codes == code]).any()]
    groups = _groups({code: np.unique(stamps[codes == code]) for code in known})
    described = _described(tally.series, layout)
    names = [_listed([described[code].name for code in group]) for group in groups]
    for one, group in zip(names, groups, strict=True):
        part = one if part in {described[code].name for code in group} else part
    parts = [Part(one, len(times), len(group)) for one, (group, times) in zip(names, groups.items(), strict=True)]
    if not parts:
        raise BadFile(f"{name} must hold a named value that is a number (got {len(tally.series)} names without)")
    chosen, notes = choose_part(parts, part, name, "set of names")
    group, times = list(groups.items())[chosen]
    silent = [described[code].name for code in range(len(tally.series)) if code not in known]
    if silent:
        more = f" and {len(silent) - 8} more" if len(silent) > 8 else ""
        notes = (*notes, f"names without numbers: {', '.join(silent[:8])}{more}")
    data = {0: times}
    for k, code in enumerate(group, 1):
        here = codes == code
        data[k] = np.full(len(times), np.nan)
        data[k][np.searchsorted(times, stamps[here])] = values[here]
    columns = [Column("time", role="time" if layout.time is not None else "text"), *(described[i] for i in group)]
    for i, one in enumerate(distinct_names([column.name for column in columns[1:]]), 1):
        columns[i] = replace(columns[i], name=one)
    time = None if layout.time is None else replace(layout.time, index=0, parts=())
    if time is None:
        columns, data = columns[1:], {i - 1: column for i, column in data.items() if i}
    return Reading(
        data,
        tally,
        replace(layout, columns=tuple(columns), time=time, notes=(*layout.notes, *notes)),
        layout.period,
    )


def _listed(names: list[str]) -> str:
    return ", ".join(names[:_MAX_LISTED]) + (f" and {len(names) - _MAX_LISTED} more" if names[_MAX_LISTED:] else "")


def _counted(codes: Array) -> Array:
    """Without stamps the first values of all names belong together, then the second ones, and so on."""
    stamps = np.zeros(len(codes))
    for code in np.unique(codes[np.isfinite(codes)]):
        here = codes == code
        stamps[here] = np.arange(np.count_nonzero(here))
    return stamps


def _groups(stamps: dict[int, NDArray[np.float64]]) -> dict[tuple[int, ...], Array]:
    """The names that share most of their stamps, with all their stamps; those with most stamps first."""
    groups: list[tuple[list[int], Array]] = []
    for code in sorted(stamps, key=lambda code: (-len(stamps[code]), code)):
        own = stamps[code]
        for i, (members, times) in enumerate(groups):
            if np.isin(own, times, assume_unique=True).mean() >= _MIN_SHARED:
                members.append(code)
                groups[i] = (members, np.union1d(times, own))
                break
        else:
            groups.append(([code], own))
    return {tuple(sorted(members)): times for members, times in groups}


def _described(series: tuple[tuple[str, ...], ...], layout: Layout) -> list[Column]:
    """Name and unit of each series: of the parts of its name only those that differ between series."""
    columns = [column.name.lower() for column in layout.columns if column.role == "series"]
    naming = [i for i, column in enumerate(columns) if column not in UNIT_NAMES]
    telling = [i for i in naming if len({key[i] for key in series}) > 1]
    telling = telling or [i for i in naming if "field" in columns[i]] or naming
    order = sorted(telling, key=lambda i: "field" in columns[i])  # measurement and tags, then the field
    units = [i for i, column in enumerate(columns) if column in UNIT_NAMES]
    return [Column(".".join(key[i] for i in order), "".join(key[i] for i in units)) for key in series]
