"""The open fleet: its arrays, how its devices are sorted and coloured."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import islice
from typing import TYPE_CHECKING

import numpy as np

from kalscope.common.array import Array, Indices
from kalscope.common.text import trimmed

if TYPE_CHECKING:
    from kalscope.fleet.results import Fleet

MAX_ROWS = 12
"""Devices in the table; the file has them all."""
MAX_DECADES = 12.0
"""Decades of q or r up to which the map covers all devices; in a wider fleet 1 % lie on each of its edges."""


def _descending(values: Array) -> Indices:
    """The indices of the numbers, the largest first; NaN left out."""
    known = np.flatnonzero(~np.isnan(values))
    return known[np.argsort(-values[known], kind="stable")]


ORDERS: Mapping[str, Callable[[Fleet], Indices]] = {
    "most unlike the others": lambda fleet: _descending(fleet.distance),
    "largest loss": lambda fleet: _descending(fleet.growth),
    "largest r": lambda fleet: _descending(fleet.devices.r),
    "smallest r": lambda fleet: _descending(-fleet.devices.r),
    "largest q": lambda fleet: _descending(fleet.devices.q),
    "smallest q": lambda fleet: _descending(-fleet.devices.q),
    "without q and r": lambda fleet: np.flatnonzero([bool(reason) for reason in fleet.reasons]),
}
"""How the devices may be sorted."""


def loss_text(growth: float) -> str:
    """By which share the prediction error grows, to 0.1 %: smaller differences are chance."""
    return f"{trimmed(round(100.0 * growth, 1) + 0.0)} %"


COLOURS = ("loss", "verdict")
"""What the devices may be coloured by."""


@dataclass(frozen=True, eq=False)
class OpenFleet:
    """A fleet and how it is shown; compared by identity."""

    fleet: Fleet
    """Its arrays."""
    order: str = next(iter(ORDERS))
    """How its devices are sorted, one of ORDERS."""
    colour: str = COLOURS[0]
    """What they are coloured by, one of COLOURS."""
    at_shared: bool = False
    """Whether a device is opened at the filter for all; else at its own."""
    find: str = ""
    """What the names of the devices in the table contain, in any letter case; "" = all."""
    picked: int | None = None
    """The row whose point in the map was clicked; a second click opens it."""

    @cached_property
    def rows(self) -> list[int]:
        """The rows of the table whose names contain `find`: first those that its order ranks, then the others."""
        order = ORDERS[self.order](self.fleet)
        if not self.find:
            return order[:MAX_ROWS].tolist()
        devices, wanted = self.fleet.devices, self.find.casefold()
        rest = np.setdiff1d(np.arange(len(devices)), order)
        found = (i for i in np.concatenate([order, rest]).tolist() if wanted in devices.name(i).casefold())
        return list(islice(found, MAX_ROWS))

    @cached_property
    def corners(self) -> tuple[tuple[float, float], ...]:
        """Pairs of q and r, unit², between which the devices lie; none where no device has both above 0."""
        devices, shared = self.fleet.devices, self.fleet.shared
        logs = [np.log10(values[devices.usable]) for values in (devices.q, devices.r)]
        if not len(logs[0]):
            return ()
        wide = any(float(np.ptp(one)) > MAX_DECADES for one in logs)
        ends = [np.quantile(one, (0.01, 0.99) if wide else (0.0, 1.0)) for one in logs]
        pairs = [(10.0 ** float(q), 10.0 ** float(r)) for q, r in zip(*ends, strict=True)]
        if shared is not None:
            pairs.append((shared.params.q, float(shared.params.r)))
        return tuple(pairs)
