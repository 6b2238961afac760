"""A growing store of samples whose views cost nothing and never change."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from kalscope.common.array import Array

_FIRST_SIZE = 1 << 14
_ROOM = 4
"""Old samples leave memory all at once, when `keep / _ROOM` more than `keep` have arrived."""


class SampleStore:
    """Time and values of the last samples, at least `keep` of them once that many have arrived.

    Rows are only ever written after the last one. When the arrays are full, or old rows leave, the rows go
    to new arrays: views of the old ones stay as they are. One writer at a time.
    """

    def __init__(self, channels: int, keep: int) -> None:
        """Begin with no rows; `keep` >= 1."""
        self.keep = keep
        self.first: int = 0
        """Number of the first row that is kept, counted from the first that ever arrived."""
        self._most = keep + max(keep // _ROOM, 1)
        self._time = np.empty(min(_FIRST_SIZE, self._most))
        # One channel after the other in memory: each is filtered and drawn by itself.
        self._values = np.empty((channels, self._time.size))
        self._used: int = 0

    def __len__(self) -> int:
        return self._used

    @property
    def end(self) -> int:
        """Rows that ever arrived."""
        return self.first + self._used

    def append(self, time: Sequence[float] | Array, values: Sequence[Sequence[float]] | Array) -> None:
        """Add rows.

        Args:
            time: Times, shape (n,).
            values: One row of values per time, shape (n, channels).
        """
        done = 0
        while done < len(time):
            if self._used == self._time.size:
                self._make_room()
            count = min(len(time) - done, self._time.size - self._used)
            new = slice(self._used, self._used + count)
            self._time[new] = time[done : done + count]
            self._values[:, new] = np.asarray(values[done : done + count], dtype=np.float64).T
            self._used += count
            done += count

    def widened(self, channels: int, keep: int) -> SampleStore:
        """A store of these rows with more channels, which have no values up to now; this one stays as it is."""
        leave = max(self._used - keep, 0)
        time, values = self._time[leave : self._used], self._values[:, leave : self._used].T
        missing = np.full((len(time), channels - len(self._values)), np.nan)
        wider = SampleStore(channels, keep)
        wider.append(time, np.hstack([values, missing]))
        wider.first = self.first + leave
        return wider

    def views(self) -> tuple[Array, Array]:
        """Time, shape (n,), and values, shape (n, channels), of what is kept; neither can be written."""
        time, values = self._time[: self._used], self._values[:, : self._used].T
        time.flags.writeable = values.flags.writeable = False
        return time, values

    def _make_room(self) -> None:
        size = self._time.size
        leave = max(self._used - self.keep, 0) if size == self._most else 0
        kept = slice(leave, self._used)
        room = self._most if leave else min(2 * size, self._most)
        time, values = np.empty(room), np.empty((len(self._values), room))
        count = self._used - leave
        time[:count], values[:, :count] = self._time[kept], self._values[:, kept]
        self._time, self._values, self._used = time, values, count
        self.first += leave
