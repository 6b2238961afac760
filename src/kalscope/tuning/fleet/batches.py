"""Which units make up a batch, and which batch is next, even when workers die: no Dask, no files.

A batch is one task and one part. Batches are laid out over the whole fleet in the order of the table, and what an
earlier run has finished is taken out of them, so that a part never reaches beyond its batch and the table can be
merged batch by batch.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

MAX_BATCH_BYTES = 64 << 20
"""Most bytes of a batch of several units: with them a worker needs about 0.5 GB."""
MIN_BATCH_BYTES = 256 << 10
"""Least bytes, so that a task takes much longer than its share of the scheduler, 2 ms."""
MAX_UNITS = 2000
"""Most units of a batch: empty files have no bytes."""
BATCHES = 1000
"""Batches of a large fleet: a kill loses a thousandth of the work for each worker."""
MAX_IN_FLIGHT = 2000
"""Most tasks that the scheduler knows at a time, however large the fleet is."""
MAX_DEATHS = 2
"""Workers that may die over a batch before it is a suspect, and over a unit that is then read alone."""


def batch_bytes(total: int) -> int:
    """Bytes of a batch for a fleet of `total` bytes."""
    return min(max(total // BATCHES, MIN_BATCH_BYTES), MAX_BATCH_BYTES)


def lay_out(sizes: Sequence[int]) -> list[range]:
    """The batches of a fleet, as ranges of its units.

    Args:
        sizes: Bytes of each unit, in the order of the table.
    """
    limit, first, filled = batch_bytes(sum(sizes)), 0, 0
    batches: list[range] = []
    for i, size in enumerate(sizes):
        if i > first and (filled + size > limit or i - first >= MAX_UNITS):
            batches.append(range(first, i))
            first, filled = i, 0
        filled += size
    return [*batches, range(first, len(sizes))] if sizes else []


def window(threads: int) -> int:
    """Tasks in flight on this many threads: one that runs and one that waits for each."""
    return min(max(2 * threads, 4), MAX_IN_FLIGHT)


@dataclass(frozen=True)
class Batch:
    """Units that one task does."""

    units: tuple[int, ...]
    """Their indices in the fleet, ascending."""
    deaths: int = 0
    """How many workers died over it."""

    def halves(self) -> list[Batch]:
        """Two batches with the same units and deaths, or one where there is only one unit."""
        middle = len(self.units) // 2
        parts = (self.units[:middle], self.units[middle:])
        return [Batch(part, min(self.deaths, MAX_DEATHS)) for part in parts if part]


@dataclass
class Dispatcher:
    """Gives out batches until each unit is done or lost.

    A worker that dies ends other batches too, so the first death is not counted against a batch. After the second a
    batch is halved and tried with nothing else in flight: if a worker dies then, that batch has killed it.
    """

    waiting: deque[Batch]
    """Those that are not suspects."""
    suspects: deque[Batch] = field(default_factory=deque[Batch])
    """Those over which two workers or more have died."""
    running: set[Batch] = field(default_factory=set[Batch])
    """Those in flight."""
    lost: list[int] = field(default_factory=list[int])
    """Units that kill every worker, since `lost` was last emptied."""

    @classmethod
    def of(cls, batches: Iterable[Sequence[int]]) -> Dispatcher:
        """With batches of these units, the empty ones left out."""
        return cls(deque(Batch(tuple(units)) for units in batches if units))

    @property
    def active(self) -> bool:
        """Whether anything is left to do."""
        return bool(self.waiting or self.suspects or self.running)

    def next(self) -> Batch | None:
        """The next batch, now in flight; None where none may begin before another has ended."""
        if self.waiting:
            batch = self.waiting.popleft()
        elif self.suspects and not self.running:
            batch = self.suspects.popleft()
        else:
            return None
        self.running.add(batch)
        return batch

    def finished(self, batch: Batch, left: Sequence[int] = ()) -> None:
        """A batch has ended; the units `left` were not begun in its time and go to several workers, in halves."""
        self.running.discard(batch)
        if left:
            self.waiting.extendleft(reversed(Batch(tuple(left), batch.deaths).halves()))

    def returned(self, batch: Batch) -> None:
        """A batch came back as it was, for example because the scheduler was lost and found again."""
        self.running.discard(batch)
        self.waiting.append(batch)

    def died(self, batch: Batch) -> None:
        """The worker of a batch has died."""
        self.running.discard(batch)
        after = Batch(batch.units, batch.deaths + 1)
        if after.deaths < MAX_DEATHS:
            self.waiting.append(after)
        elif len(after.units) > 1:
            self.suspects.extend(after.halves())
        elif batch.deaths <= MAX_DEATHS:  # a unit that was not alone, or only once
            self.suspects.append(after)
        else:
            self.lost.extend(after.units)
