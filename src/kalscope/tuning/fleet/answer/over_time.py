"""Successive recordings of one device: which device has changed.

Recordings whose names differ only in a date are of one device: dev7/2024-05-01.csv and dev7/2024-06-01.csv, or
dev7_20240501T0800 and dev7_20240502T0800.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from kalscope.common.array import Array, Indices
from kalscope.estimation.fleet.changes import Changes, changes

_YEAR, _MONTH, _DAY = r"(?:19|20)\d\d", r"(?:0[1-9]|1[0-2])", r"(?:0[1-9]|[12]\d|3[01])"
_TIME = r"(?:[T _-]?(?:[01]\d|2[0-3])[-_.:h]?[0-5]\d(?:[-_.:m]?[0-5]\d)?)?"
_DATE = re.compile(rf"(?<!\d)(?:{_YEAR}([-_.]){_MONTH}(?:\1{_DAY}{_TIME})?|{_YEAR}{_MONTH}{_DAY}{_TIME})(?!\d)")
"""2024-05, 2024-05-01, 20240501, each day with or without the time of day."""


@dataclass(frozen=True)
class OverTime:
    """Which devices have changed in one quantity."""

    rows: Indices
    """The rows of the table whose names hold a date."""
    found: Changes
    """The changes found; its files are indices into `rows`."""

    def name(self, device: int) -> str:
        """The device: its names without the date and the kind of file."""
        name = re.sub(r"\.\w{1,8}$", "", str(self.found.device[device]).split("\n")[0])
        return re.sub(r"/+", "/", name).strip("/-_. ") or "one device"

    def since(self, device: int) -> int:
        """The row of the table from which on a device has changed."""
        return int(self.rows[self.found.step_at[device]])

    def factor(self, device: int) -> float:
        """How many times as large the quantity has become."""
        return float(np.exp(self.found.step[device]))


def split_date(name: str) -> tuple[str, str] | None:
    """The name of the device and the digits of the date of a recording; None without a date."""
    dates = list(_DATE.finditer(name))
    if not dates:
        return None
    last = dates[-1]  # a folder of the year may come before
    return name[: last.start()] + name[last.end() :], re.sub(r"\D", "", last.group()).ljust(14, "0")


def over_time(ids: list[str], channels: list[str], logs: Array, interval: tuple[Array, Array]) -> OverTime | None:
    """Which devices have changed; None where no device has two recordings.

    Args:
        ids: Name of each recording.
        channels: Its channel.
        logs: ln of the quantity, NaN where there is none, shape (rows,).
        interval: Its 95 % interval, two arrays of shape (rows,).
    """
    rows: list[int] = []
    names: list[str] = []
    dates: list[str] = []
    for i, known in enumerate(np.isfinite(logs).tolist()):
        part = split_date(ids[i]) if known else None
        if part is not None:
            rows.append(i)
            names.append(f"{part[0]}\n{channels[i]}")
            dates.append(part[1])
    if len(set(names)) == len(names):
        return None
    places = np.array(rows, np.intp)
    low, high = interval
    found = changes(logs[places], (low[places], high[places]), np.array(names, dtype=object), np.array(dates))
    return OverTime(places, found)
