"""The samples of a live source: a growing store, the names of the channels, when each sample was taken."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from kalscope.common.numbers import Array
from kalscope.recording import ReadReport, Recording
from kalscope.sources.grammar.cells import SECONDS_PER_UNIT
from kalscope.sources.grammar.timestamps import TimeColumn
from kalscope.sources.live.lines import LineCounts
from kalscope.sources.port.reader import Clock
from kalscope.sources.port.registry import PortSpec
from kalscope.sources.reading.axis import unit_by_magnitude
from kalscope.sources.reading.line_reader import LineEvent
from kalscope.sources.reading.sniffer import Layout

# A growing store of samples whose views cost nothing and never change.


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


# When the samples of a stream were taken: by the stamps of the board if it sends any, else by their arrival.
#
# A board restarts and its counter with it, a counter wraps, a stamp is damaged on the wire: the time that
# comes out never steps back, and after a pause it is the true time again.


_LOOK = 0.2
"""Seconds of host time after which the unit of a stamp is judged, if the board does not name it."""
_SOON = 64
"""Rows after which it is judged anyway: a replay may come much faster than it was sampled."""
_TICK = 1e-6
"""Least step of host time, s."""
_COUNTERS = (2.0**16, 2.0**32)
_STEPS = 4096
"""Steps from which period and jitter are judged."""
_PAUSE = 0.5
"""Seconds without a line that are a pause and not a step, unless the lines come that slowly."""


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
        self._column, self._file_period = column, file_period
        self._scale = _scale_of(column)
        self._decided = column is None or self._scale is not None
        self._pending: list[ArrivedRow] = []
        self._time: float | None = None  # of the last row
        self._host = 0.0
        self._stamp = math.nan  # in s, of the last row whose stamp was accepted
        self._offset = 0.0  # time of a row is its stamp plus this
        self._doubted = False
        self._broken = False
        self._steps = np.empty(_STEPS)
        self._count = 0

    def interrupt(self) -> None:
        """Note an interruption before the next row."""
        self._broken = True

    def place(self, rows: Sequence[ArrivedRow]) -> tuple[list[float], list[tuple[float, ...]]]:
        """Times and values of the rows, with one row of NaN for each interruption.

        The first rows are kept until the unit of their stamps is known.
        """
        times: list[float] = []
        values: list[tuple[float, ...]] = []
        if not self._decided:
            self._pending += rows
            if not self._decide():
                return times, values
            rows, self._pending = self._pending, []
        for row in rows:
            last = self._time
            time = self._next(row)
            if self._broken and last is not None:
                times.append(last + min(self.period or (time - last) / 2, (time - last) / 2))
                values.append((math.nan,) * len(row.values))
            elif last is not None:
                self._steps[self._count % _STEPS] = time - last
                self._count += 1
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
        steps = self._steps[: min(self._count, _STEPS)]
        if not steps.size or not steps.any():
            return None
        if self._scale is None:
            return float(steps[steps <= max(_PAUSE, 20 * steps.mean())].mean())
        median = float(np.median(steps))
        if median > 10 * self._scale:
            return median or float(steps.mean())
        ordinary = steps[steps <= max(5 * median, 5 * self._scale)]
        return float(ordinary.mean()) or median or None

    @property
    def jitter(self) -> float | None:
        """Half the width that holds nine of ten steps, in s; None before there are ten."""
        steps = self._steps[: min(self._count, _STEPS)]
        if steps.size < 10:
            return None
        low, high = np.percentile(steps, (5, 95))
        return round(float(high - low) / 2, 9)  # less is only the rounding of the stamps

    def _decide(self) -> bool:
        """Find the unit of the stamps by the clock of the host, or find that they are not a time."""
        first, last = self._pending[0], self._pending[-1]
        host, stamp = last.host - first.host, last.stamp - first.stamp
        if len(self._pending) < 2 or (host < _LOOK and len(self._pending) < _SOON):
            return False
        self._decided = True
        if stamp > 0:
            self._scale = self._scale_by(host, np.array([row.stamp for row in self._pending]))
        return True

    def _scale_by(self, host: float, stamps: Array) -> float | None:
        """Seconds in one unit of stamps that came within `host` s; None if they are not a time."""
        if self._file_period:
            return SECONDS_PER_UNIT[unit_by_magnitude(stamps[np.isfinite(stamps)])]
        units = [SECONDS_PER_UNIT[unit] for unit in ("s", "ms", "us", "ns")]
        stamp = stamps[-1] - stamps[0]
        return min(units, key=lambda scale: abs(math.log(stamp * scale / host))) if host > 0 else None

    def _next(self, row: ArrivedRow) -> float:
        """Time of the next row."""
        if self._time is None:
            self._time, self._host = 0.0, row.host
            if self._scale is not None and math.isfinite(row.stamp):
                self._stamp = row.stamp * self._scale
                self._offset = -self._stamp
            return 0.0
        waited = max(row.host - self._host, 0.0)
        self._host = row.host
        time = (
            self._by_stamp(row, waited)
            if self._scale is not None
            else self._time + (self._file_period or max(waited, _TICK))
        )
        self._time = max(time, self._time)
        return self._time

    def _by_stamp(self, row: ArrivedRow, waited: float) -> float:
        """Time by the stamp where it can be trusted, else by the host's time since the last row."""
        last, stamp = self._time or 0.0, row.stamp * (self._scale or 1.0)
        if not math.isfinite(row.stamp):
            return last if self._file_period else last + waited
        if self._file_period:  # a step back is the beginning of another record, which follows at once
            turn = self._clock_turn(stamp - self._stamp)
            if stamp + turn < self._stamp:
                self._offset = last + (self.period or _TICK) - stamp
            self._offset += turn
            self._stamp = stamp
            return stamp + self._offset
        turn = self._turn(row.stamp, stamp - self._stamp, waited)
        step = stamp - self._stamp + turn
        # An interruption must last as long by both clocks, else the board has restarted.
        alike = not self._broken or abs(step - waited) <= 0.25 + 0.05 * waited
        if 0 <= step <= 30 * waited + 10 and alike:
            self._offset += turn
        elif self._broken or self._doubted:
            # From here on the stamps count from this row, whatever they were before.
            self._offset = last + max(waited, _TICK) - stamp
        else:
            self._doubted = True  # damaged, unless the next one agrees
            return last + waited
        self._stamp, self._doubted = stamp, False
        return stamp + self._offset

    def _clock_turn(self, step: float) -> float:
        """Seconds of a day, or of whatever period the clock of the stamps has, where it wrapped; else 0."""
        column = self._column
        is_clock = column is not None and column.kind == "clock" and step < -column.turn_s / 2
        return column.turn_s if column is not None and is_clock else 0.0

    def _turn(self, raw: float, step: float, waited: float) -> float:
        """Seconds of a full turn of the counter, where a step back is a wrap; else 0."""
        if not step < 0:
            return 0.0
        scale = self._scale or 1.0
        if self._column is not None and self._column.kind == "clock":
            return self._clock_turn(step)
        for size in _COUNTERS:
            turn = size * scale
            if self._stamp < turn and raw >= 0 and abs(step + turn - waited) <= 1.0 + 0.5 * waited:
                return turn
        return 0.0


def _scale_of(column: TimeColumn | None) -> float | None:
    """Seconds in one unit of the stamps as they are parsed; None if the board does not name it."""
    if column is None:
        return None
    if column.kind != "number":
        return 1e-6  # calendar stamps and clocks are parsed to µs
    return SECONDS_PER_UNIT[column.unit] if column.unit else None


# The samples of a live source: the names of their channels, their times, and a view of all of them.
#
# Not thread-safe: the owner holds a lock around each call.


MAX_NUMBERS = 1 << 25
"""Most numbers of one board that are sure to be kept, 256 MiB: with more than 32 channels, fewer samples each."""
_PERIOD_EVERY = 0.25
_PERIOD_MOVES = 0.005


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
    """Increases when samples are added."""


def gathered(rows: Sequence[ArrivedRow]) -> Iterator[ArrivedRow]:
    """Merge rows of one variable each, from one read and one stamp of the board, into rows of all variables."""
    row: ArrivedRow | None = None
    for new in rows:
        if row is None:
            row = new
            continue
        alike = row.stamp == new.stamp or (math.isnan(row.stamp) and math.isnan(new.stamp))
        pairs = [*zip(row.values, new.values, strict=True)]
        if alike and all(math.isnan(old) or math.isnan(value) for old, value in pairs):
            row = replace(row, values=tuple(value if math.isnan(old) else old for old, value in pairs))
        else:
            yield row
            row = new
    if row is not None:
        yield row


class LiveSamples:
    """The samples of one board, of the layout that it sends now."""

    def __init__(
        self, spec: PortSpec, keep: int, clock: Clock, rate: float | None = None, unit: str | None = None
    ) -> None:
        """Prepare.

        Args:
            spec: The port, named in the Recording.
            keep: The least number of samples kept per channel.
            clock: Where the time comes from.
            rate: Rows a second of a file without times; None = 1.
            unit: Unit of numeric stamps, as the user gives it; None = the column's.
        """
        self._spec, self._keep, self._clock, self._unit = spec, keep, clock, unit
        self._file_period = 1.0 / (rate or 1.0)
        self.kept = False
        """Whether the lines come from a file: their time of arrival then means nothing."""
        self._layout: Layout | None = None
        self.time: LiveTime = LiveTime(None)
        """When the samples were taken."""
        self._store: SampleStore | None = None
        self._names: tuple[str, ...] = ()
        self._units: tuple[str, ...] = ()
        self._generation = self._version = 0
        self._snapshot: Snapshot | None = None
        self._period: float | None = None
        self._period_at = -1e9

    @property
    def left_memory(self) -> int:
        """Samples of this generation that are no longer kept."""
        return self._store.first if self._store is not None else 0

    @property
    def position(self) -> tuple[int, int]:
        """Samples of this generation that ever arrived, and its number."""
        return (0 if self._store is None else self._store.end), self._generation

    def snapshot(self, counts: LineCounts) -> Snapshot | None:
        """All that is kept, with the line counts so far; the same object while nothing was added."""
        store, known = self._store, self._snapshot
        if store is None or not len(store):
            return None
        if known is not None and (known.version, known.generation) == (self._version, self._generation):
            return known
        time, values = store.views()
        report = ReadReport(
            lines=counts.received,
            rows=counts.accepted,
            rejected=counts.rejected,
            comments=counts.dropped,
            notes=self._layout.notes if self._layout else (),
        )
        url, period = self._spec.url, self._steady_period()
        recording = Recording(
            time, self._names, self._units, values, period, report, source=self._spec.text, title=url
        )
        self._snapshot = Snapshot(recording, store.first, self._generation, self._version)
        return self._snapshot

    def keep(self, stamped: Sequence[tuple[float, LineEvent]], layout: Layout) -> None:
        """Take the rows among lines of one layout, each with the monotonic time of its arrival, s."""
        if layout is not self._layout:
            self._adopt(layout)
        at, channels = (layout.time.index if layout.time else -1), layout.channels
        rows = [
            ArrivedRow(host, row[at] if at >= 0 else float("nan"), tuple(row[i] for i in channels))
            for host, event in stamped
            if event.kind == "row"
            for row in event.rows
        ]
        if not rows:
            return
        if layout.form.kind == "teleplot":
            rows = list(gathered(rows))
        time, values = self.time.place(rows)
        if time and self._store is not None:
            self._store.append(time, values)
            self._version += 1

    def _adopt(self, layout: Layout) -> None:
        """Another layout: a new generation, unless the channels and the time are the same.

        Where a variable of Teleplot was added, the others keep their samples. A table with more columns is that of
        another program, whatever they are called.
        """
        known, self._layout = self._layout, layout
        names = tuple(layout.columns[i].name for i in layout.channels)
        units = tuple(layout.columns[i].unit for i in layout.channels)
        if known is not None and (names, units, layout.time) == (self._names, self._units, known.time):
            return
        many = len(self._names)
        same = (names[:many], units[:many], layout.time) == (self._names, self._units, known and known.time)
        grows = layout.form.kind == "teleplot" and same
        self._names, self._units = names, units
        self._generation += 1
        keep = min(self._keep, MAX_NUMBERS // max(len(names), 1))
        if grows and self._store is not None:
            self._store = self._store.widened(len(names), keep)
            return
        column = layout.time
        if column is not None and column.kind == "number":
            column = replace(column, unit=self._unit or column.unit)
        self.time = LiveTime(column, self._file_period if self.kept else 0.0)
        self._store = SampleStore(len(names), keep)
        self._period, self._period_at = None, -1e9

    def _steady_period(self) -> float | None:
        """The period, updated only when it has really changed, so that values derived from it do not flicker."""
        now = self._clock.monotonic()
        if self._period is None or now - self._period_at > _PERIOD_EVERY:
            period, self._period_at = self.time.period, now
            if period is None or self._period is None or abs(period / self._period - 1) > _PERIOD_MOVES:
                self._period = period
        return self._period
