"""The table of a fleet as arrays, one entry per device: what the answer is computed from."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from kalscope.common.array import Array, Mask
from kalscope.common.text import count
from kalscope.estimation.fleet.losses import WIDTH, Losses, losses_of
from kalscope.filtering.params import FilterParams
from kalscope.tuning.fleet.store.begun import TABLE
from kalscope.tuning.fleet.store.left import unpacked
from kalscope.tuning.fleet.store.row import LEFT, UNREAD
from kalscope.tuning.fleet.store.table import read_table


@dataclass(frozen=True)
class Devices:
    """The rows of a table, arrays of shape (rows,), NaN where there is nothing."""

    ids: list[str]
    """Name of each recording."""
    channels: list[str]
    """Its channel."""
    units: list[str]
    """Its unit."""
    rate_hz: Array
    """Sample rate, Hz."""
    q: Array
    """Process-noise variance, unit²."""
    r: Array
    """Measurement-noise variance, unit²."""
    q_interval: tuple[Array, Array]
    """The q that each record allows, 95 %, unit²."""
    r_interval: tuple[Array, Array]
    """The r that each record allows."""
    momentum: Array
    """Momentum, sample periods."""
    reasons: Counter[str]
    """Why rows have no q and r, and how many for each reason."""
    left: Array | None = None
    """What the fits stored to compute what each loses by a filter for all, shape (rows, WIDTH); None in a finished
    table."""
    failed: int = 0
    """Rows that could not be read or fitted; the verdicts of others without q and r say what is missing."""

    def __len__(self) -> int:
        return len(self.ids)

    @property
    def counted(self) -> str:
        """The rows, how many have q and r, and how many failed: all that is shown says it in these words."""
        without = self.reasons.total()
        parts = ((len(self) - without, "with q and r"), (without - self.failed, "without"), (self.failed, "failed"))
        said = ", ".join(f"{count(n)} {what}" for n, what in parts if n)
        return f"{count(len(self))} {'row' if len(self) == 1 else 'rows'}: {said}"

    @property
    def usable(self) -> Mask:
        """Where q and r are both above 0."""
        return (self.q > 0.0) & (self.r > 0.0)

    @cached_property
    def channel(self) -> str:
        """The most common channel of those with q and r, "signal" without any."""
        return self._usual(self.channels) or "signal"

    @cached_property
    def unit(self) -> str:
        """Their most common unit."""
        return self._usual(self.units)

    @property
    def sample_period(self) -> float | None:
        """The median sample period of those with q and r, s; None where none is known."""
        known = self.rate_hz[self.usable & np.isfinite(self.rate_hz)]
        return 1.0 / float(np.median(known)) if len(known) else None

    @property
    def rates_differ(self) -> bool:
        """Whether some rates differ by more than a tenth from the median: one q per sample does not suit them."""
        known = self.rate_hz[self.usable & np.isfinite(self.rate_hz)]
        return bool(len(known)) and bool(np.any(np.abs(known / np.median(known) - 1.0) > 0.1))

    def losses(self, params: FilterParams) -> Losses:
        """What each loses by a filter for all."""
        nothing = np.full((len(self), WIDTH), np.nan)
        return losses_of(nothing if self.left is None else self.left, params)

    def name(self, i: int) -> str:
        """The recording, with its channel where that is not the usual one."""
        return self.ids[i] if self.channels[i] == self.channel else f"{self.ids[i]} {self.channels[i]}"

    def _usual(self, texts: list[str]) -> str:
        common = Counter(text for text, usable in zip(texts, self.usable, strict=True) if usable).most_common(1)
        return common[0][0] if common else ""


def read_devices(folder: Path) -> Devices:
    """The table in the folder of a fleet."""
    return devices_of(read_table(folder / TABLE))


def devices_of(table: Any) -> Devices:
    """A pyarrow Table with the columns of a fleet as arrays."""

    def numbers(name: str) -> Array:
        return np.asarray(table[name].to_numpy(), dtype=np.float64)

    return Devices(
        ids=table["id"].to_pylist(),
        channels=table["channel"].to_pylist(),
        units=table["unit"].to_pylist(),
        rate_hz=numbers("rate_hz"),
        q=numbers("q"),
        r=numbers("r"),
        q_interval=(numbers("q_low"), numbers("q_high")),
        r_interval=(numbers("r_low"), numbers("r_high")),
        momentum=numbers("momentum"),
        reasons=Counter(reason for reason in table["reason"].to_pylist() if reason),
        left=unpacked(table[LEFT].to_pylist()) if LEFT in table.column_names else None,
        failed=sum(verdict in UNREAD for verdict in table["verdict"].to_pylist()),
    )
