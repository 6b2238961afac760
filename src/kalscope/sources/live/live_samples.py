"""The samples of a live source: the names of their channels, their times, and a view of all of them.

Not thread-safe: the owner holds a lock around each call.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from kalscope.recording import ReadReport, Recording
from kalscope.sources.layout.sniffer import Layout
from kalscope.sources.lines.line_reader import LineEvent
from kalscope.sources.live.live_lines import LineCounts
from kalscope.sources.live.sample_store import SampleStore
from kalscope.sources.live.sample_times import ArrivedRow, FileTime, LiveTime
from kalscope.sources.port.clock import Clock
from kalscope.sources.port.port_spec import PortSpec

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

    def __init__(self, spec: PortSpec, keep: int, clock: Clock, rate: float | None = None) -> None:
        """Prepare.

        Args:
            spec: The port, named in the Recording.
            keep: The least number of samples kept per channel.
            clock: Where the time comes from.
            rate: Rows a second of a file without times; None = 1.
        """
        self._spec, self._keep, self._clock = spec, keep, clock
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
        self.time = FileTime(layout.time, self._file_period) if self.kept else LiveTime(layout.time)
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
