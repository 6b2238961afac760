"""A board that streams, as a Recording that grows."""

from __future__ import annotations

import math
import os
import threading
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import groupby
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Self

import numpy as np

from kalscope.errors import BadSetting
from kalscope.sources.grammar.read_options import DEFAULTS, ReadOptions
from kalscope.sources.live.commands import CommandChannel
from kalscope.sources.live.lines import LineCounts, LiveLines
from kalscope.sources.live.samples import LiveSamples, Snapshot
from kalscope.sources.live.status import LineRate, LiveStatus, status_of
from kalscope.sources.port.events import SYSTEM, BytesReceived, Clock, Disconnected, Item, LinesDropped, Opened
from kalscope.sources.port.reader import PortReader
from kalscope.sources.port.registry import PortSpec, port_of
from kalscope.sources.reading.line_reader import LineEvent
from kalscope.sources.reading.sniffer import Layout
from kalscope.sources.recorder import Recorder

# The first items of a source whose messages each name one variable: held until each has likely come once.
#
# Otherwise a board of six variables would begin with one, then two, then three: each time the charts would start
# again, with a new part of the recording.


HOLD_S = 0.5
"""Seconds for which the first variables are held: a board sends all at once, a broker all retained messages."""
_MAX_BYTES = 1 << 20


class FirstItems:
    """Passes on the items of a port in order, the first ones late where that helps."""

    def __init__(
        self, items: SimpleQueue[Item], monotonic: Callable[[], float], on_first: Callable[[bytes], None]
    ) -> None:
        """Wrap a queue.

        Args:
            items: The items of the port.
            monotonic: The clock of their stamps, s.
            on_first: Called once with all bytes that were held, before the first of them is passed on.
        """
        self._items, self._monotonic, self._on_first = items, monotonic, on_first
        self._held: list[BytesReceived] = []
        self._ready = deque[Item]()
        self._is_first = False

    def get(self, timeout: float) -> Item:
        """The next item; Empty where none came within `timeout` s."""
        while not self._ready:
            try:
                item = self._items.get(timeout=timeout)
            except Empty:
                if not self._held or self._monotonic() - self._held[0].end < HOLD_S:
                    raise
                self._release()
                continue
            if isinstance(item, Opened):
                self._is_first = item.starts == "at a line"
            if not self._holds(item):
                self._release()
                self._ready.append(item)
        return self._ready.popleft()

    def _holds(self, item: Item) -> bool:
        """Whether this is one of the first, and more may follow."""
        if isinstance(item, Opened):
            return False
        if not isinstance(item, BytesReceived) or not self._is_first:
            self._is_first = False
            return False
        self._held.append(item)
        size = sum(len(one.data) for one in self._held)
        waits = item.end - self._held[0].end < HOLD_S and size < _MAX_BYTES
        self._is_first = waits and self._held[0].data.startswith(b">")
        if not self._is_first:
            self._held.pop()
        return self._is_first

    def _release(self) -> None:
        held, self._held, self._is_first = self._held, [], self._is_first and not self._held
        if held:
            self._on_first(b"".join(item.data for item in held))
            self._ready.extend(held)


# The recorder of a live source: it starts and stops while lines arrive, never during a write.


class RecorderSlot:
    """Holds one recorder or none; lines written while no recorder is active are discarded."""

    def __init__(self) -> None:
        self._recorder: Recorder | None = None
        self._lock = threading.Lock()

    @property
    def recorder(self) -> Recorder | None:
        """The active recorder; None if there is none."""
        return self._recorder

    def begin(self, path: Path, *, source: str, started: float, wall: float, resume: bool) -> Recorder:
        """Record from now on; the arguments are those of `Recorder`.

        Raises:
            BadSetting: a recording is active already.
            BadFile: as `Recorder` raises it.
        """
        with self._lock:
            if self._recorder is not None:
                raise BadSetting("a recording must be stopped before the next begins (got one that is running)")
            self._recorder = Recorder(path, source=source, started=started, wall=wall, resume=resume)
            return self._recorder

    def end(self) -> None:
        """End the recording and close its file; does nothing if none is active."""
        with self._lock:
            recorder, self._recorder = self._recorder, None
            if recorder is not None:
                recorder.close()

    def write(self, stamped: Sequence[tuple[float, LineEvent]], layout: Layout | None) -> None:
        """Write lines of one layout, each with its monotonic time in s."""
        with self._lock:
            if self._recorder is not None:
                self._recorder.write(stamped, layout)

    def gap(self, kind: str, seconds: float) -> None:
        """Note how long nothing was received, and why."""
        with self._lock:
            if self._recorder is not None:
                self._recorder.gap(kind, seconds)

    def drop(self, count: int) -> None:
        """Count lines that were lost before they arrived here."""
        with self._lock:
            if self._recorder is not None:
                self._recorder.drop(count)


# A board that streams, as a Recording that grows: what a dashboard draws and what a recorder writes.
#
#     with LiveSource("serial:/dev/ttyACM0@115200") as live:
#         ...
#         snapshot = live.snapshot()
#
# One thread reads the port, a second one parses the lines, passes them to the recorder and then stores the samples.
# Neither waits for the caller.


TICK = 0.1
"""Seconds without a line after which the second thread updates the recorder and the rate."""
MAX_CLOSE_S = 0.5
"""Seconds from the call of `close` in which waiting lines are processed; the rest is dropped, and counted."""
_SLEEP = 1.0
_PART_OF_A_LINE = 0.25
"""Most seconds before a read in which its first line may have begun to arrive."""


class LiveSource:
    """One board and its samples."""

    def __init__(
        self,
        spec: PortSpec | str,
        options: ReadOptions = DEFAULTS,
        *,
        reconnect: bool = True,
        keep: int = 1_000_000,
        clock: Clock = SYSTEM,
        reader: PortReader | None = None,
    ) -> None:
        """Prepare; nothing is opened.

        Args:
            spec: The port, or what `port_of` reads.
            options: How the lines are read; everything left open is detected.
            reconnect: Open the port again when the board comes back; `reconnect` may be set at any time.
            keep: Samples per channel that are kept at least, fewer if there are very many channels.
            clock: Where the time comes from.
            reader: The thread that reads; None = one for `spec`.

        Raises:
            BadSetting: `spec` names no port, or `keep` is less than 1.
        """
        if keep < 1:
            raise BadSetting(f"keep must be at least 1 sample (got {keep})")
        self.spec = port_of(spec) if isinstance(spec, str) else spec
        self._clock = clock
        self._reader = reader or PortReader(self.spec, reconnect=reconnect, clock=clock)
        self._lines = LiveLines(options)
        self._items = FirstItems(self._reader.items, clock.monotonic, self._lines.prime)
        self._layout: Layout | None = None
        self._samples = LiveSamples(self.spec, keep, clock, options.rate, options.time_unit)
        self._lock = threading.Lock()  # of the lines and of the samples
        self._counts = LineCounts()  # of the lines whose samples are stored: the status agrees with the snapshot
        self._rate = LineRate()
        self._thread: threading.Thread | None = None
        self._stop = threading.Event()
        self._end_by = math.inf
        self._asleep = clock.asleep()
        self._disconnected_at: float | None = None
        self._line_at = -math.inf  # when the last whole line had arrived: a read may hold only part of one
        self._slot = RecorderSlot()
        self.commands = CommandChannel(self._reader.write)
        """What is sent to the board, and its remarks."""

    def start(self, *, require: bool = False, is_ended: Callable[[], bool] = bool) -> None:
        """Connect; does nothing while it runs. After `close` it continues with the same samples.

        Args:
            require: Open the port before returning. Otherwise it waits for a missing board.
            is_ended: True once the caller no longer waits for this; it is then given up as if there were no board.

        Raises:
            BadDevice: the port cannot be opened, where that is required.
        """
        if self._thread is not None:
            return
        if require:
            self._reader.open(is_ended)
        self._reader.start()
        self._stop, self._end_by = threading.Event(), math.inf
        self._thread = threading.Thread(target=self._run, args=(self._stop,), name="kalscope lines", daemon=True)
        self._thread.start()

    def open(self) -> None:
        """Open the port of a board that must be there; a later start reads it from its first byte.

        Raises:
            BadDevice: the port cannot be opened.
        """
        self._reader.open()

    def close(self, timeout: float = 3.0) -> None:
        """Release the port, process the bytes that had arrived, end the recording. May be called twice.

        Args:
            timeout: Seconds to wait for an attempt to connect over the network; the recording ends in any case.
        """
        self._end_by = self._clock.monotonic() + MAX_CLOSE_S
        self._reader.close(timeout)
        self._stop.set()
        thread, self._thread = self._thread, None
        if thread is not None:
            thread.join()
        self.commands.on_disconnected()
        self.stop_recording()

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def reconnect(self) -> bool:
        """Whether the port is opened again when the board comes back."""
        return self._reader.reconnect

    @reconnect.setter
    def reconnect(self, wanted: bool) -> None:
        self._reader.reconnect = wanted

    def snapshot(self) -> Snapshot | None:
        """All samples that are kept; None before the first. The same object while nothing was added."""
        with self._lock:
            return self._samples.snapshot(self._counts)

    def status(self) -> LiveStatus:
        """The current status."""
        with self._lock:
            counts = self._counts.with_overrun(self._reader.dropped)
            return status_of(
                self._reader, counts, self._samples, self._rate.now, self._lines.wrong_baud, self._slot.recorder
            )

    @property
    def recorder(self) -> Recorder | None:
        """The active recorder; None if there is none."""
        return self._slot.recorder

    def record(self, path: str | os.PathLike[str], *, resume: bool = False) -> Recorder:
        """Write every line from now on to a new file, raw, before it is shown.

        Args:
            path: The file.
            resume: Continue an existing recording instead.

        Raises:
            BadSetting: a recording is active already.
            BadFile: the file cannot be written, or exists already; to resume: it is not a recording.
        """
        started, wall = self._clock.monotonic(), self._clock.wall()
        return self._slot.begin(Path(path), source=self.spec.text, started=started, wall=wall, resume=resume)

    def stop_recording(self) -> None:
        """End the recording and close its file; does nothing if none is active."""
        self._slot.end()

    def send(self, line: str, timeout: float | None = None) -> tuple[str, ...]:
        """Send one line to the board and wait for its answer, lines that begin with #.

        Args:
            line: At most 62 bytes, without newline: an AVR loses what comes in faster than it reads.
            timeout: Seconds to wait; None = 5 s.

        Returns:
            The lines of the answer: the first, and those that follow it before the next sample.

        Raises:
            BadSetting: `line` is too long or holds a newline.
            BadDevice: the port is not connected, or no reply arrived.
        """
        return self.commands.send(line, timeout)

    def _run(self, stop: threading.Event) -> None:
        while True:
            try:
                item = self._items.get(timeout=TICK)
            except Empty:
                self._slot.write([], self._layout)
                self._rate.note(self._clock.monotonic(), self._lines.counts.received)
                if stop.is_set():
                    return
                continue
            if isinstance(item, BytesReceived) and stop.is_set() and self._clock.monotonic() > self._end_by:
                item = self._reader.items.leave_out(item)
            if isinstance(item, BytesReceived):
                self._take(item)
                self._reader.items.release(item)
            elif isinstance(item, Opened):
                self._on_opened(item)
            elif isinstance(item, LinesDropped):
                self._on_dropped(item)
            else:
                self._on_disconnected(item)
            self._counts = replace(self._lines.counts)

    def _on_dropped(self, gap: LinesDropped) -> None:
        with self._lock:
            self._lines.overrun(gap.count)
            self._counts = replace(self._lines.counts)
            self._reader.items.release(gap)
        self._samples.time.interrupt()
        self._report_drops()
        self._slot.gap("overrun", gap.end - gap.begin)

    def _on_opened(self, event: Opened) -> None:
        self._check_for_sleep()
        with self._lock:
            self._lines.opened(event.at, event.starts, keeps=event.keeps)
            self._samples.kept = event.keeps
        self._line_at = event.at
        if self._disconnected_at is not None and event.starts != "where it stopped":
            self._samples.time.interrupt()
            self._slot.gap("unplug", event.at - self._disconnected_at)
        self._disconnected_at = None

    def _on_disconnected(self, event: Disconnected) -> None:
        self._disconnected_at = event.at
        with self._lock:
            self._lines.disconnected()
        self.commands.on_disconnected()
        self._report_drops()

    def _take(self, received: BytesReceived) -> None:
        self._check_for_sleep()
        with self._lock:
            batch = [(event, self._lines.layout) for event in self._lines.feed(received)]
        self._report_drops()
        self._rate.note(received.end, self._lines.counts.received)
        if not batch:
            return
        begin, self._line_at = max(self._line_at, received.begin - _PART_OF_A_LINE), received.end
        moments = np.linspace(begin, received.end, len(batch) + 1)[1:].tolist()
        stamped = [(at, event, layout) for at, (event, layout) in zip(moments, batch, strict=True)]
        runs = [list(run) for _, run in groupby(stamped, key=lambda line: id(line[2]))]
        self._pass_on([([(at, event) for at, event, _ in run], run[0][2]) for run in runs])

    def _pass_on(self, runs: list[tuple[list[tuple[float, LineEvent]], Layout | None]]) -> None:
        """Write the lines of each layout, then show their samples and count them in one step."""
        for stamped, layout in runs:
            self._slot.write(stamped, layout)
            self._layout = layout
        with self._lock:
            for stamped, layout in runs:
                self.commands.on_events((event for _, event in stamped), *self._samples.position)
                if layout is not None:
                    self._samples.keep(stamped, layout)
            self._counts = replace(self._lines.counts)

    def _report_drops(self) -> None:
        count, self._lines.unreported_drops = self._lines.unreported_drops, 0
        if count:
            self._slot.drop(count)

    def _check_for_sleep(self) -> None:
        asleep = self._clock.asleep()
        slept, self._asleep = asleep - self._asleep, asleep
        if slept > _SLEEP:
            self._samples.time.interrupt(slept)
            self._slot.gap("suspend", slept)
