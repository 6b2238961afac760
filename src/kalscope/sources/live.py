"""A board that streams, as a Recording that grows: what a dashboard draws and what a recorder writes.

    with LiveSource("serial:/dev/ttyACM0@115200") as live:
        ...
        snapshot = live.snapshot()

One thread reads the port, a second one takes the lines apart, hands them to the recorder and then keeps the
samples. Nothing here waits for whoever looks.
"""

from __future__ import annotations

import math
import os
import threading
from collections import deque
from dataclasses import dataclass, replace
from pathlib import Path
from queue import Empty
from typing import TYPE_CHECKING, Self

from kalscope.errors import BadDevice, BadSetting
from kalscope.recording import ReadReport, Recording
from kalscope.sources.clock import SYSTEM, Clock
from kalscope.sources.line_reader import LineEvent
from kalscope.sources.live_lines import LiveLines
from kalscope.sources.live_time import LiveTime, Row
from kalscope.sources.read_options import DEFAULTS, ReadOptions
from kalscope.sources.sample_store import SampleStore
from kalscope.sources.serial_port import Came, Lost, Opened, PortReader, PortSpec, PortState, Word, port_of

if TYPE_CHECKING:
    from kalscope.sources.recorder import Recorder
    from kalscope.sources.sniffer import Layout

TICK = 0.1
"""Seconds after which the second thread looks round where nothing came."""
_RATE_OVER = 2.0
_PERIOD_EVERY = 0.25
_PERIOD_MOVES = 0.005
_SLEEP = 1.0
_REPLY_GOES_ON = 0.05
_PART_OF_A_LINE = 0.25
"""Seconds before a read at most in which its first line may have begun to come."""
LONGEST_COMMAND = 63
"""Bytes of one line to the board, newline included: the ring of an AVR that receives them holds 64."""

_NO_SAMPLE = ("ovf", "inf", "+inf", "-inf")
"""What an Arduino prints for a float that it cannot print."""


@dataclass(frozen=True)
class Snapshot:
    """What has come so far. It never changes, and costs the same however much is kept."""

    recording: Recording
    """Time from the first sample, in s, and values; its arrays are views that cannot be written."""
    first: int
    """Number of its first sample, counted from the first one of this generation; those before left memory."""
    generation: int
    """Another number where the channels are others: their names, units or count."""
    version: int
    """Another number, larger, where samples were added."""


@dataclass(frozen=True)
class LiveStatus:
    """How a live source stands. received = accepted + rejected + dropped, always."""

    word: Word
    """closed, connecting, connected, or "disconnected, waiting"."""
    hint: str
    """A sentence for the person: what is wrong and what to do; "" where nothing is."""
    port: str
    """What is open, or was last."""
    since: float
    """Monotonic time at which it came to stand so, s."""
    received: int
    """Lines that came."""
    lines_per_s: float
    """Lines a second, over the last 2 s."""
    period: float | None
    """Measured sample period in s, the median step; None before two samples."""
    jitter: float | None
    """Half the width that holds nine of ten steps, in s; None before ten steps."""
    device_time: bool
    """True where the time is the board's own, false where it is that of arrival."""
    accepted: int
    """Lines that became samples."""
    rejected: int
    """Lines that should have become samples and did not."""
    dropped: int
    """Other lines: comments, headers, boot text, the first line after each opening, torn ones."""
    reconnects: int
    """How many times the port was opened again."""
    left_memory: int
    """Samples of this generation that are no longer kept."""
    longest_pause: float
    """Longest time in s for which bytes waited to be read, at most."""
    recording_trouble: str
    """What keeps the recorder from writing; "" where nothing does, or none runs."""


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
            options: What is decided about the lines; the rest is found by looking.
            reconnect: Open the port again when the board comes back; `reconnect` may be set at any time.
            keep: Samples a channel that are kept at least.
            clock: Where the time comes from.
            reader: The thread that reads; None = one for `spec`.

        Raises:
            BadSetting: `spec` names no port, or `keep` is less than 1.
        """
        if keep < 1:
            raise BadSetting(f"keep must be at least 1 sample (got {keep})")
        self.spec = port_of(spec) if isinstance(spec, str) else spec
        self._options = replace(options, missing=(*options.missing, *_NO_SAMPLE))
        self._keep = keep
        self._clock = clock
        self._reader = reader or PortReader(self.spec, reconnect=reconnect, clock=clock)
        self._lines = LiveLines(self._options)
        self._layout: Layout | None = None
        self._time = LiveTime(None)
        self._store: SampleStore | None = None
        self._names: tuple[str, ...] = ()
        self._units: tuple[str, ...] = ()
        self._generation = self._version = 0
        self._snapshot: Snapshot | None = None
        self._period: float | None = None
        self._period_at = -1e9
        self._lock = threading.Lock()  # of the counts and of the snapshot
        self._rates: deque[tuple[float, int]] = deque()
        self._thread: threading.Thread | None = None
        self._stop = threading.Event()
        self._asleep = clock.asleep()
        self._lost_at: float | None = None
        self._line_at = -math.inf  # when the last whole line had come: a read may bring only part of one
        self._recorder: Recorder | None = None
        self._recorder_lock = threading.Lock()
        self._send_lock = threading.Lock()
        self._replies: list[str] | None = None
        self._replied = threading.Condition()

    # ------------------------------------------------------------------ for whoever owns it

    def start(self, *, require: bool = False) -> None:
        """Connect; does nothing while it runs. After `close` it goes on with the same samples.

        Args:
            require: Open the port before returning. Otherwise a board that is not there is waited for.

        Raises:
            BadDevice: the port cannot be opened, where that is required.
        """
        if self._thread is not None:
            return
        self._reader.start(require=require)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, args=(self._stop,), name="kalscope lines", daemon=True)
        self._thread.start()

    def close(self, timeout: float = 3.0) -> None:
        """Free the port, take what it had brought, end the recording. May be called twice.

        Args:
            timeout: Seconds to wait for an attempt to connect over the network; the recording ends all the same.
        """
        self._reader.close(timeout)
        self._stop.set()
        thread, self._thread = self._thread, None
        if thread is not None:
            thread.join()
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
            store, known = self._store, self._snapshot
            if store is None or not len(store):
                return None
            if known is not None and (known.version, known.generation) == (self._version, self._generation):
                return known
            time, values = store.views()
            first, version, generation = store.first, self._version, self._generation
            counts = replace(self._lines.counts)
            period = self._steady_period()
            report = ReadReport(
                lines=counts.received,
                rows=counts.accepted,
                rejected=counts.rejected,
                comments=counts.dropped,
                notes=self._layout.notes if self._layout else (),
            )
            recording = Recording(
                time, self._names, self._units, values, period, report, source=self.spec.text, title=self.spec.url
            )
            self._snapshot = Snapshot(recording, first, generation, version)
            return self._snapshot

    def status(self) -> LiveStatus:
        """How it stands now."""
        state, recorder = self._reader.state, self._recorder
        with self._lock:
            counts, store = replace(self._lines.counts), self._store
            period, jitter = self._time.period, self._time.jitter
            rate = self._rate()
            left, by_device = (store.first if store else 0), self._time.by_device
            noise = self._lines.wrong_baud
        return LiveStatus(
            word=state.word,
            hint=_hint(state, self.spec, noise=noise, counts_rows=counts.accepted, received=counts.received),
            port=state.device,
            since=state.since,
            received=counts.received,
            lines_per_s=rate,
            period=period,
            jitter=jitter,
            device_time=by_device,
            accepted=counts.accepted,
            rejected=counts.rejected,
            dropped=counts.dropped,
            reconnects=max(state.opened - 1, 0),
            left_memory=left,
            longest_pause=self._reader.longest_pause,
            recording_trouble=recorder.trouble if recorder else "",
        )

    # ------------------------------------------------------------------ recording, sending

    @property
    def recorder(self) -> Recorder | None:
        """The recorder that runs, or the last one that did not stop cleanly; None where none runs."""
        return self._recorder

    def record(self, path: str | os.PathLike[str], *, resume: bool = False) -> Recorder:
        """Write what comes from now on to a new file, raw, before it is shown.

        Args:
            path: The file.
            resume: Go on with a recording that is there instead.

        Raises:
            BadSetting: a recording runs already.
            BadFile: the file cannot be written, or is there already; to resume: it is no recording.
        """
        from kalscope.sources.recorder import Recorder

        with self._recorder_lock:
            if self._recorder is not None:
                raise BadSetting("a recording must be stopped before the next begins (got one that runs)")
            started, wall = self._clock.monotonic(), self._clock.wall()
            begin = Recorder.resume if resume else Recorder
            self._recorder = begin(Path(path), source=self.spec.text, started=started, wall=wall)
            return self._recorder

    def stop_recording(self) -> None:
        """End the recording and close its file; does nothing where none runs."""
        with self._recorder_lock:
            recorder, self._recorder = self._recorder, None
            if recorder is not None:
                recorder.close()

    def send(self, line: str, timeout: float = 2.0) -> tuple[str, ...]:
        """Send one line to the board and wait for its answer, the next line that begins with #.

        Args:
            line: At most 62 bytes, without newline: an AVR loses what comes in faster than it reads.
            timeout: Seconds to wait.

        Returns:
            The line, and those with # that follow it at once.

        Raises:
            BadSetting: `line` is too long or holds a newline.
            BadDevice: the port is not connected, or no answer came.
        """
        data = line.encode("utf-8") + b"\n"
        if len(data) > LONGEST_COMMAND or not line.isprintable():
            raise BadSetting(
                f"what is sent must be one line of at most {LONGEST_COMMAND - 1} bytes"
                f" (got {len(data) - 1} in {line[:80]!r})"
            )
        with self._send_lock:
            with self._replied:
                self._replies = []
            try:
                self._reader.write(data)
                with self._replied:
                    if not self._replied.wait_for(lambda: bool(self._replies), timeout):
                        raise BadDevice(
                            f"the board must answer with a line that begins with # (got nothing in {timeout:g} s)"
                        )
                    known = -1
                    while self._replies is not None and len(self._replies) > known:
                        known = len(self._replies)
                        self._replied.wait(_REPLY_GOES_ON)
                    return tuple(self._replies or ())
            finally:
                with self._replied:
                    self._replies = None

    # ------------------------------------------------------------------ the second thread

    def _run(self, stop: threading.Event) -> None:
        while True:
            try:
                item = self._reader.items.get(timeout=TICK)
            except Empty:
                self._record([], self._layout)
                self._note_rate()
                if stop.is_set():
                    return
                continue
            if isinstance(item, Came):
                self._take(item)
                self._reader.taken(item)
            elif isinstance(item, Opened):
                self._on_opened(item)
            elif isinstance(item, Lost):
                self._on_lost(item)

    def _on_opened(self, opened: Opened) -> None:
        self._look_for_sleep()
        with self._lock:
            self._lines.opened(opened.at)
        self._line_at = opened.at
        if self._lost_at is not None:
            self._time.broke_off()
            self._gap("unplug", opened.at - self._lost_at)
            self._lost_at = None

    def _on_lost(self, lost: Lost) -> None:
        self._lost_at = lost.at
        with self._lock:
            self._lines.lost()
        self._tell_dropped()

    def _take(self, came: Came) -> None:
        self._look_for_sleep()
        batch: list[tuple[LineEvent, Layout | None]] = []
        with self._lock:
            for event in self._lines.feed(came):
                batch.append((event, self._lines.layout))
        self._tell_dropped()
        self._note_rate()
        if not batch:
            return
        begin, self._line_at = max(self._line_at, came.begin - _PART_OF_A_LINE), came.end
        step = (came.end - begin) / len(batch)
        stamped = [(begin + (i + 1) * step, event) for i, (event, _) in enumerate(batch)]
        start = 0
        for i in range(1, len(batch) + 1):
            if i == len(batch) or batch[i][1] is not batch[start][1]:
                self._hand_on(stamped[start:i], batch[start][1])
                start = i

    def _hand_on(self, stamped: list[tuple[float, LineEvent]], layout: Layout | None) -> None:
        self._record(stamped, layout)
        self._look_for_replies(stamped)
        if layout is not None:
            if layout is not self._layout:
                self._adopt(layout)
            self._keep_samples(stamped, layout)

    def _adopt(self, layout: Layout) -> None:
        """Another layout: a new generation, unless the channels and the time are the same."""
        known, self._layout = self._layout, layout
        names = tuple(layout.columns[i].name for i in layout.channels)
        units = tuple(layout.columns[i].unit for i in layout.channels)
        if known is not None and (names, units, layout.time) == (self._names, self._units, known.time):
            return
        with self._lock:
            self._names, self._units = names, units
            self._time, self._store = LiveTime(layout.time), SampleStore(len(names), self._keep)
            self._generation += 1
            self._period, self._period_at = None, -1e9

    def _keep_samples(self, stamped: list[tuple[float, LineEvent]], layout: Layout) -> None:
        at, channels = (layout.time.index if layout.time else -1), layout.channels
        rows = [
            Row(host, row[at] if at >= 0 else float("nan"), tuple(row[i] for i in channels))
            for host, event in stamped
            if event.kind == "row"
            for row in event.rows
        ]
        if not rows:
            return
        with self._lock:
            time, values = self._time.place(rows)
            if time and self._store is not None:
                self._store.append(time, values)
                self._version += 1

    def _record(self, stamped: list[tuple[float, LineEvent]], layout: Layout | None) -> None:
        with self._recorder_lock:
            if self._recorder is not None:
                self._recorder.write(stamped, layout)

    def _gap(self, kind: str, seconds: float) -> None:
        with self._recorder_lock:
            if self._recorder is not None:
                self._recorder.gap(kind, seconds)

    def _tell_dropped(self) -> None:
        count, self._lines.untold = self._lines.untold, 0
        if count:
            with self._recorder_lock:
                if self._recorder is not None:
                    self._recorder.drop(count)

    def _look_for_replies(self, stamped: list[tuple[float, LineEvent]]) -> None:
        if self._replies is None:
            return
        found = [event.text for _, event in stamped if event.kind == "comment" and event.text.startswith("#")]
        if found:
            with self._replied:
                if self._replies is not None:
                    self._replies += found
                    self._replied.notify_all()

    def _look_for_sleep(self) -> None:
        asleep = self._clock.asleep()
        slept, self._asleep = asleep - self._asleep, asleep
        if slept > _SLEEP:
            self._time.broke_off(slept)
            self._gap("suspend", slept)

    def _note_rate(self) -> None:
        now = self._clock.monotonic()
        with self._lock:
            rates = self._rates
            if not rates or now - rates[-1][0] >= TICK:
                rates.append((now, self._lines.counts.received))
            while len(rates) > 2 and now - rates[1][0] > _RATE_OVER:
                rates.popleft()

    def _rate(self) -> float:
        if len(self._rates) < 2:
            return 0.0
        (begin, old), (end, new) = self._rates[0], self._rates[-1]
        return (new - old) / (end - begin) if end > begin else 0.0

    def _steady_period(self) -> float | None:
        """The period, which moves only when it has changed: whatever is derived from it would flicker."""
        now = self._clock.monotonic()
        if self._period is None or now - self._period_at > _PERIOD_EVERY:
            period, self._period_at = self._time.period, now
            if period is None or self._period is None or abs(period / self._period - 1) > _PERIOD_MOVES:
                self._period = period
        return self._period


def _hint(state: PortState, spec: PortSpec, *, noise: bool, counts_rows: int, received: int) -> str:
    if state.why:
        return state.why
    if noise:
        return f"wrong baud rate? What comes is no text ({spec.baud} baud is set)"
    if state.word == "connected" and received > 20 and not counts_rows:
        return "lines come, but none holds numbers"
    return ""
