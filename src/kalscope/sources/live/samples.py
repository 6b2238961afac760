"""The samples of a live source: a growing store, the names of the channels, when each sample was taken."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from kalscope.common.numbers import Array
from kalscope.recording import ReadReport, Recording
from kalscope.sources.grammar.cells import SECONDS_PER_UNIT
from kalscope.sources.grammar.timestamps import TimeColumn
from kalscope.sources.live.lines import LineCounts
from kalscope.sources.port.registry import PortSpec
from kalscope.sources.reading.axis import unit_by_magnitude
from kalscope.sources.reading.line_reader import LineEvent
from kalscope.sources.reading.sniffer import Layout

# A growing store of samples whose views cost nothing and never change.


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
        self._used: int = 0
        self._most = keep + max(keep // _ROOM, 1)
        # Time, then one channel after the other in memory: each is filtered and drawn by itself.
        self._data = np.empty((1 + channels, 0))

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
        if not len(time):
            return
        new = np.vstack((time, np.transpose(values)))
        used = self._used + new.shape[1]
        if used > self._data.shape[1]:
            leave = used - self.keep if used > self._most else 0
            new = np.hstack((self._data[:, : self._used], new))[:, leave:]
            used, self._used, self.first = used - leave, 0, self.first + leave
            self._data = np.empty((len(new), self._most if leave else min(2 * used, self._most)))
        self._data[:, self._used : used] = new
        self._used = used

    def widened(self, channels: int, keep: int) -> SampleStore:
        """A store of these rows with more channels, which have no values up to now; this one stays as it is."""
        time, values = self.views()
        wider, new = SampleStore(channels, keep), channels - values.shape[1]
        wider.first = self.first
        wider.append(time, np.pad(values, ((0, 0), (0, new)), constant_values=np.nan))
        return wider

    def views(self) -> tuple[Array, Array]:
        """Time, shape (n,), and values, shape (n, channels), of what is kept; neither can be written."""
        time, values = self._data[0, : self._used], self._data[1:, : self._used].T
        time.flags.writeable = values.flags.writeable = False
        return time, values


# When the samples of a stream were taken: by the stamps of the board if it sends any, else by their arrival.
#
# A board restarts and its counter with it, a counter wraps, a stamp is damaged on the wire: the time that
# comes out never steps back, and after a pause it is the true time again.


_TICK = 1e-6
"""Least step of host time, s."""


@dataclass(frozen=True)
class ArrivedRow:
    """A row whose time is to be found."""

    host: float
    """Monotonic time of its arrival, s."""
    stamp: float
    """Stamp of the board as it was parsed; NaN where there is none."""
    values: tuple[float, ...]
    """The channels."""


class LiveTime:
    """Time of each row, from 0 at the first one."""

    def __init__(self, column: TimeColumn | None, file_period: float = 0.0) -> None:
        """Begin with the first row.

        Args:
            column: Describes the stamps; None where there are none.
            file_period: Of a file, whose lines may come much later, or faster, than they were written: time from
                row to row where it has no stamps, s. 0 for a board.
        """
        self._turn_s = 0.0 if column is None else column.turn_s
        self._file_period = file_period
        # Calendar stamps and clocks are parsed to µs.
        unit = "" if column is None else column.unit if column.kind == "number" else "us"
        self._scale = SECONDS_PER_UNIT.get(
            unit
        )  # s in one unit of the stamps; None where the board does not name it
        self._pending: list[ArrivedRow] | None = None if column is None or self._scale else []
        self._time: float | None = None  # of the last row
        self._host = 0.0
        self._stamp = math.nan  # in s, of the last row whose stamp was accepted
        self._offset = 0.0  # time of a row is its stamp plus this
        self._doubted = self._broken = False
        self._steps: deque[float] = deque(maxlen=4096)

    def interrupt(self) -> None:
        """Note an interruption before the next row."""
        self._broken = True

    def place(self, rows: Sequence[ArrivedRow]) -> tuple[list[float], list[tuple[float, ...]]]:
        """Times and values of the rows, with one row of NaN for each interruption.

        The first rows are kept until the unit of their stamps is known.
        """
        times: list[float] = []
        values: list[tuple[float, ...]] = []
        if self._pending is not None:
            self._pending += rows
            if not self._is_scale_known(self._pending):
                return times, values
            rows, self._pending = self._pending, None
        for row in rows:
            last = self._time
            time = self._next(row)
            if self._broken and last is not None:
                times.append(last + min(self.period or (time - last) / 2, (time - last) / 2))
                values.append((math.nan,) * len(row.values))
            elif last is not None:
                self._steps.append(time - last)
            self._broken = False
            times.append(time)
            values.append(row.values)
        return times, values

    @property
    def period(self) -> float | None:
        """Median step of the last 4096 in s; None before there is one that is not 0.

        Where the stamps are so coarse that the steps are only 0, 1 and 2 of their unit, and where lines are stamped
        as they arrive, in bursts, it is the mean step without pauses.
        """
        steps = np.array(self._steps)
        if not steps.any():
            return None
        median = float(np.median(steps))
        if self._scale and median > 10 * self._scale:
            return median
        longest = 5 * max(median, self._scale) if self._scale else max(0.5, 20 * steps.mean())
        return float(steps[steps <= longest].mean()) or median or None

    def _is_scale_known(self, rows: Sequence[ArrivedRow]) -> bool:
        """Whether it was found what one unit of the stamps is, or that they are not a time."""
        host, stamps = rows[-1].host - rows[0].host, np.array([row.stamp for row in rows])
        if len(rows) < 2 or (host < 0.2 and len(rows) < 64):  # a replay may come much faster than it was sampled
            return False
        span = float(stamps[-1] - stamps[0])
        if span > 0 and self._file_period:
            self._scale = SECONDS_PER_UNIT[unit_by_magnitude(stamps[np.isfinite(stamps)])]
        elif span > 0 and host > 0:  # by the clock of this computer
            units = [SECONDS_PER_UNIT[unit] for unit in ("s", "ms", "us", "ns")]
            self._scale = min(units, key=lambda scale: abs(math.log(span * scale / host)))
        return True

    def _next(self, row: ArrivedRow) -> float:
        """Time of the next row."""
        last, waited, self._host = self._time, max(row.host - self._host, 0.0), row.host
        if last is None:
            self._time = 0.0
            if self._scale is not None and math.isfinite(row.stamp):
                self._stamp = row.stamp * self._scale
                self._offset = -self._stamp
        elif self._scale is None:
            self._time = last + (self._file_period or max(waited, _TICK))
        else:
            self._time = max(self._by_stamp(last, row.stamp * self._scale, waited), last)
        return self._time or 0.0

    def _by_stamp(self, last: float, stamp: float, waited: float) -> float:
        """Time by the stamp, in s, where it can be trusted, else by the host's time since the last row."""
        if not math.isfinite(stamp):
            return last if self._file_period else last + waited
        turn = self._turn(stamp, waited)
        step = stamp - self._stamp + turn
        if self._file_period:
            trusted, doubtful = not step < 0, False  # a step back begins another record, which follows at once
            restart = last + (self.period or _TICK)
        else:
            # An interruption must last as long by both clocks, else the board has restarted.
            alike = not self._broken or abs(step - waited) <= 0.25 + 0.05 * waited
            trusted, doubtful = 0 <= step <= 30 * waited + 10 and alike, not (self._broken or self._doubted)
            restart = last + max(waited, _TICK)
        if not trusted and doubtful:
            self._doubted = True  # damaged, unless the next one agrees
            return last + waited
        # From a restart on the stamps count from its row, whatever they were before.
        self._offset = self._offset + turn if trusted else restart - stamp
        self._stamp, self._doubted = stamp, False
        return stamp + self._offset

    def _turn(self, stamp: float, waited: float) -> float:
        """Seconds of a full turn of the clock or the counter, where a step back is a wrap; else 0."""
        step = stamp - self._stamp
        if self._turn_s:
            return self._turn_s if step < -self._turn_s / 2 else 0.0
        turn = 2.0**32 * (self._scale or 1.0)  # that of micros() takes 72 minutes
        wraps = step < 0 <= stamp and not self._file_period and abs(step + turn - waited) <= 1.0 + 0.5 * waited
        return turn if wraps else 0.0


# The samples of a live source: the names of their channels, their times, and a view of all of them.
#
# Not thread-safe: the owner holds a lock around each call.


MAX_NUMBERS = 1 << 25
"""Most numbers of one board that are sure to be kept, 256 MiB: with more than 32 channels, fewer samples each."""


@dataclass(frozen=True)
class Snapshot:
    """All samples so far. It never changes, and costs the same however much is kept."""

    recording: Recording
    """Time from the first sample, in s, and values; its arrays are views that cannot be written."""
    first: int
    """Number of its first sample, counted from the first one of this generation; earlier ones left memory."""
    generation: int
    """Changes when the channels change: their names, units or count."""
    version: int
    """Increases when samples are added: the number of those that ever arrived."""


def gathered(rows: Sequence[ArrivedRow]) -> list[ArrivedRow]:
    """Merge rows of one variable each, from one read and one stamp of the board, into rows of all variables."""
    merged: list[ArrivedRow] = []
    for new in rows:
        row = merged[-1] if merged else new
        alike = row.stamp == new.stamp or (math.isnan(row.stamp) and math.isnan(new.stamp))
        pairs = [*zip(row.values, new.values, strict=True)]
        if merged and alike and all(math.isnan(old) or math.isnan(value) for old, value in pairs):
            merged[-1] = replace(row, values=tuple(value if math.isnan(old) else old for old, value in pairs))
        else:
            merged.append(new)
    return merged


class LiveSamples:
    """The samples of one board, of the layout that it sends now."""

    def __init__(self, spec: PortSpec, keep: int, rate: float | None = None, unit: str | None = None) -> None:
        """Prepare.

        Args:
            spec: The port, named in the Recording.
            keep: The least number of samples kept per channel.
            rate: Rows a second of a file without times; None = 1.
            unit: Unit of numeric stamps, as the user gives it; None = the column's.
        """
        self._spec, self._keep, self._unit = spec, keep, unit
        self._file_period = 1.0 / (rate or 1.0)
        self.kept = False
        """Whether the lines come from a file: their time of arrival then means nothing."""
        self.time = LiveTime(None)
        """When the samples were taken."""
        self.store = SampleStore(0, 1)
        """The samples of this generation."""
        self.generation = 0
        """As in `Snapshot`."""
        self._layout: Layout | None = None
        self._names: tuple[str, ...] = ()
        self._units: tuple[str, ...] = ()
        self._snapshot: Snapshot | None = None
        self._period: float | None = None

    def snapshot(self, counts: LineCounts) -> Snapshot | None:
        """All that is kept, with the line counts so far; the same object while nothing was added."""
        store, known = self.store, self._snapshot
        if not len(store):
            return None
        if known is not None and (known.version, known.generation) == (store.end, self.generation):
            return known
        notes = self._layout.notes if self._layout else ()
        report = ReadReport(counts.received, counts.accepted, counts.rejected, comments=counts.dropped, notes=notes)
        period, url = self.time.period, self._spec.url
        # What is derived from the period would flicker.
        if not period or not self._period or abs(period / self._period - 1) > 0.005:
            self._period = period
        time, values = store.views()
        held = time, self._names, self._units, values, self._period
        recording = Recording(*held, report, source=self._spec.text, title=url)
        self._snapshot = Snapshot(recording, store.first, self.generation, store.end)
        return self._snapshot

    def keep(self, stamped: Sequence[tuple[float, LineEvent]], layout: Layout) -> None:
        """Take the rows among lines of one layout, each with the monotonic time of its arrival, s."""
        if layout is not self._layout:
            self._adopt(layout)
        at, channels = (layout.time.index if layout.time else -1), layout.channels
        arrived = ((host, row) for host, event in stamped for row in event.rows)
        few = ((host, row[at] if at >= 0 else math.nan, tuple(row[i] for i in channels)) for host, row in arrived)
        rows = [ArrivedRow(*row) for row in few]
        self.store.append(*self.time.place(gathered(rows) if layout.form.kind == "teleplot" else rows))

    def _adopt(self, layout: Layout) -> None:
        """Another layout: a new generation, unless the channels and the time are the same.

        Where a variable of Teleplot was added, the others keep their samples. A table with more columns is that of
        another program, whatever they are called.
        """
        known, self._layout, many = self._layout, layout, len(self._names)
        names = tuple(layout.columns[i].name for i in layout.channels)
        units = tuple(layout.columns[i].unit for i in layout.channels)
        before = known and (self._names, self._units, known.time)
        is_same = before == (names[:many], units[:many], layout.time)
        if is_same and len(names) == many:
            return
        self._names, self._units = names, units
        self.generation += 1
        keep = min(self._keep, MAX_NUMBERS // max(len(names), 1))
        if is_same and layout.form.kind == "teleplot":
            self.store = self.store.widened(len(names), keep)
            return
        column = layout.time
        if column is not None and column.kind == "number":
            column = replace(column, unit=self._unit or column.unit)
        self.time = LiveTime(column, self._file_period if self.kept else 0.0)
        self.store = SampleStore(len(names), keep)
        self._period = None
