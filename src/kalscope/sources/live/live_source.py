"""A board that streams, as a Recording that grows: what a dashboard draws and what a recorder writes.

    with LiveSource("serial:/dev/ttyACM0@115200") as live:
        ...
        snapshot = live.snapshot()

One thread reads the port, a second one takes the lines apart, hands them to the recorder and then keeps the
samples. Nothing here waits for whoever looks.
"""

from __future__ import annotations

import math
import threading
from dataclasses import replace
from itertools import groupby
from pathlib import Path
from queue import Empty
from typing import TYPE_CHECKING, Self

import numpy as np

from kalscope.errors import BadSetting
from kalscope.sources.lines.read_options import DEFAULTS, ReadOptions
from kalscope.sources.live.command_channel import Talk
from kalscope.sources.live.live_lines import Counts, LiveLines
from kalscope.sources.live.live_samples import LiveSamples, Snapshot
from kalscope.sources.live.live_status import LineRate, LiveStatus, hint_of, recording_status
from kalscope.sources.live.recorder_slot import RecorderSlot
from kalscope.sources.port.clock import SYSTEM, Clock
from kalscope.sources.port.events import Came, Lost, Opened
from kalscope.sources.port.port_reader import PortReader
from kalscope.sources.port.port_spec import PortSpec, port_of

if TYPE_CHECKING:
    import os

    from kalscope.sources.lines.line_reader import LineEvent
    from kalscope.sources.lines.sniffer import Layout
    from kalscope.sources.recorder.recorder import Recorder

TICK = 0.1
"""Seconds after which the second thread looks round where nothing came."""
_SLEEP = 1.0
_PART_OF_A_LINE = 0.25
"""Seconds before a read at most in which its first line may have begun to come."""

_NO_SAMPLE = ("ovf", "inf", "+inf", "-inf")
"""What an Arduino prints for a float that it cannot print."""


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
        self._clock = clock
        self._reader = reader or PortReader(self.spec, reconnect=reconnect, clock=clock)
        self._lines = LiveLines(replace(options, missing=(*options.missing, *_NO_SAMPLE)))
        self._layout: Layout | None = None
        self._samples = LiveSamples(self.spec, keep, clock)
        self._lock = threading.Lock()  # of the lines and of the samples
        self._counts = Counts()  # of the lines whose samples are kept: what is told never runs ahead of them
        self._rate = LineRate()
        self._thread: threading.Thread | None = None
        self._stop = threading.Event()
        self._asleep = clock.asleep()
        self._lost_at: float | None = None
        self._line_at = -math.inf  # when the last whole line had come: a read may bring only part of one
        self._slot = RecorderSlot()
        self._talk = Talk(self._reader.write)

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
            return self._samples.snapshot(self._lines.counts)

    def status(self) -> LiveStatus:
        """How it stands now."""
        state, recorder = self._reader.state, self._slot.recorder
        with self._lock:
            counts, time = self._counts, self._samples.time
            period, jitter, by_device = time.period, time.jitter, time.by_device
            rate, left, noise = self._rate.now, self._samples.left_memory, self._lines.wrong_baud
        return LiveStatus(
            word=state.word,
            hint=hint_of(state, self.spec, noise=noise, accepted=counts.accepted, received=counts.received),
            port=state.device,
            since=state.since,
            received=counts.received,
            lines_per_s=rate if state.word == "connected" else 0.0,
            period=period,
            jitter=jitter,
            device_time=by_device,
            accepted=counts.accepted,
            rejected=counts.rejected,
            dropped=counts.dropped,
            reconnects=max(state.opened - 1, 0),
            left_memory=left,
            longest_pause=self._reader.longest_pause,
            recording=None if recorder is None else recording_status(recorder),
        )

    @property
    def recorder(self) -> Recorder | None:
        """The recorder that runs; None where none does."""
        return self._slot.recorder

    def record(self, path: str | os.PathLike[str], *, resume: bool = False) -> Recorder:
        """Write what comes from now on to a new file, raw, before it is shown.

        Args:
            path: The file.
            resume: Go on with a recording that is there instead.

        Raises:
            BadSetting: a recording runs already.
            BadFile: the file cannot be written, or is there already; to resume: it is no recording.
        """
        started, wall = self._clock.monotonic(), self._clock.wall()
        return self._slot.begin(Path(path), source=self.spec.text, started=started, wall=wall, resume=resume)

    def stop_recording(self) -> None:
        """End the recording and close its file; does nothing where none runs."""
        self._slot.end()

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
        return self._talk.ask(line, timeout)

    def _run(self, stop: threading.Event) -> None:
        while True:
            try:
                item = self._reader.items.get(timeout=TICK)
            except Empty:
                self._slot.write([], self._layout)
                self._rate.note(self._clock.monotonic(), self._lines.counts.received)
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
            self._counts = replace(self._lines.counts)

    def _on_opened(self, opened: Opened) -> None:
        self._look_for_sleep()
        with self._lock:
            self._lines.opened(opened.at)
        self._line_at = opened.at
        if self._lost_at is not None:
            self._samples.time.broke_off()
            self._slot.gap("unplug", opened.at - self._lost_at)
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
        self._rate.note(came.end, self._lines.counts.received)
        if not batch:
            return
        begin, self._line_at = max(self._line_at, came.begin - _PART_OF_A_LINE), came.end
        moments = np.linspace(begin, came.end, len(batch) + 1)[1:].tolist()
        stamped = [(at, event, layout) for at, (event, layout) in zip(moments, batch, strict=True)]
        for _, run in groupby(stamped, key=lambda line: id(line[2])):
            lines = list(run)
            self._hand_on([(at, event) for at, event, _ in lines], lines[0][2])

    def _hand_on(self, stamped: list[tuple[float, LineEvent]], layout: Layout | None) -> None:
        self._slot.write(stamped, layout)
        self._talk.hear(event for _, event in stamped)
        self._layout = layout
        if layout is not None:
            with self._lock:
                self._samples.keep(stamped, layout)

    def _tell_dropped(self) -> None:
        count, self._lines.untold = self._lines.untold, 0
        if count:
            self._slot.drop(count)

    def _look_for_sleep(self) -> None:
        asleep = self._clock.asleep()
        slept, self._asleep = asleep - self._asleep, asleep
        if slept > _SLEEP:
            self._samples.time.broke_off(slept)
            self._slot.gap("suspend", slept)
