"""A board that streams, as a Recording that grows: its samples, its status, commands to it.

    with LiveSource("serial:/dev/ttyACM0@115200") as live:
        ...
        snapshot = live.snapshot()

One thread reads the port, a second one parses the lines, passes them to the recorder and then stores the samples.
Neither waits for the caller.
"""

from __future__ import annotations

import math
import os
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path
from queue import Empty, Full, Queue
from typing import Self

import numpy as np

from kalscope.common.text import count
from kalscope.errors import BadDevice, BadSetting
from kalscope.sources.grammar.read_options import DEFAULTS, ReadOptions
from kalscope.sources.live.lines import LineCounts, LiveLines
from kalscope.sources.live.samples import LiveSamples, Snapshot
from kalscope.sources.port.reader import BytesReceived, Item, Opened, PortReader, Word
from kalscope.sources.port.registry import PortSpec, port_of
from kalscope.sources.reading.line_reader import LineEvent
from kalscope.sources.recorder import Recorder, StampedLine

# Commands to a board: one line is sent, lines with # that follow are the reply.


MAX_COMMAND_BYTES = 63
"""Bytes of one line to the board, newline included: the receive buffer of an AVR holds 64."""
ANSWER_S = 5.0
"""Seconds within which a board answers."""


class Remark(str):
    """A line with # and its place among the samples; "" for the first sample after one."""

    row = 0
    """Samples that came before it, counted from the first of its generation."""
    generation = 0
    """That of `Snapshot.generation`."""


class CommandChannel:
    """Sends one command at a time; `on_events` takes every line that arrives."""

    def __init__(self, write: Callable[[bytes], None]) -> None:
        """Set up the channel; `write` sends bytes to the board."""
        self._write = write
        self._one_at_a_time = threading.Lock()
        self._remarks: Queue[Remark] | None = None
        self._is_after_remark = self._is_gone = False

    def send(
        self,
        line: str,
        timeout: float = ANSWER_S,
        *,
        is_reply: Callable[[Remark], object] = bool,
        check: Callable[[], object] = bool,
    ) -> tuple[str, ...]:
        """Send a line and wait for the reply: the next sample, or a second without a line, completes it.

        Args:
            line: As for `LiveSource.send`, which also says what this returns and raises.
            timeout: Seconds to wait.
            is_reply: Whether a line with # belongs to the reply; by default every one.
            check: Called while it waits; what it raises ends the wait.
        """
        data = line.encode("utf-8") + b"\n"
        if len(data) > MAX_COMMAND_BYTES or not line.isprintable():
            raise BadSetting(f"commands must be lines of at most {MAX_COMMAND_BYTES - 1} bytes (got {line!r:.80})")
        with self._one_at_a_time:
            self._remarks, self._is_gone = Queue(1000), False  # further ones are dropped
            try:
                self._write(data)
                replies, end = list[str](), time.monotonic() + timeout
                while time.monotonic() < end:
                    try:
                        remark = self._remarks.get(timeout=1.0 if replies else min(timeout, 0.1))
                    except Empty:
                        remark = Remark()
                    if replies and not remark:
                        break
                    if self._is_gone:
                        raise BadDevice("the board was disconnected before it answered")
                    if remark and is_reply(remark):
                        end = end if replies else time.monotonic() + 2.0  # a board may send without end
                        replies.append(remark)
                    if not replies:
                        check()
            finally:
                self._remarks = None
        if not replies:
            raise BadDevice(f"the board did not answer {line!r} within {timeout:g} s: is an exported sketch on it?")
        return tuple(replies)

    def on_events(self, events: Iterable[LineEvent], row: int, generation: int) -> None:
        """Pass the comment lines among these to the command that waits.

        Args:
            events: The lines, in their order.
            row: Samples that came before them.
            generation: Of these samples.
        """
        if (remarks := self._remarks) is None:
            return
        for event in events:
            is_remark = event.kind == "comment" and event.text.startswith("#")
            if is_remark or (event.rows and self._is_after_remark):
                remark = Remark(event.text if is_remark else "")
                remark.row, remark.generation = row, generation
                with suppress(Full):
                    remarks.put_nowait(remark)
            self._is_after_remark = is_remark or (self._is_after_remark and not event.rows)
            row += len(event.rows)

    def on_disconnected(self) -> None:
        """End the wait for a reply that cannot come."""
        self._is_gone = True


# The status of a live source: its counts, and a sentence for the user if something is wrong.


_SILENT_AFTER = 5.0
"""Seconds after which a source that should send is reported as silent."""


@dataclass(kw_only=True)
class LiveStatus(LineCounts):
    """The status of a live source."""

    word: Word
    """closed, connecting, connected, or "disconnected, waiting"."""
    hint: str
    """A sentence for the user: what is wrong and what to do; "" if nothing is."""
    port: str
    """What is open, or was open last."""
    lines_per_s: float
    """Lines a second, over the last 2 s."""
    period: float | None
    """Measured sample period in s, the median step; None before two samples."""
    reconnects: int
    """How many times the port was opened again."""
    recording: Recorder | None
    """The active recorder; None if there is none."""


# The source.


MAX_WAITING_BYTES = 1 << 20
"""Bytes that may wait to be parsed: 91 s of a port at 115200 baud. Beyond that lines are left out."""
TICK = 0.1
"""Seconds without a line after which the second thread updates the recorder and the rate."""


class LiveSource:
    """One board and its samples."""

    def __init__(
        self,
        spec: PortSpec | str,
        options: ReadOptions = DEFAULTS,
        *,
        reconnect: bool = True,
        keep: int = 1_000_000,
        reader: PortReader | None = None,
    ) -> None:
        """Prepare; nothing is opened.

        Args:
            spec: The port, or what `port_of` reads.
            options: How the lines are read; everything left open is detected.
            reconnect: Open the port again when the board comes back.
            keep: Samples per channel that are kept at least, fewer if there are very many channels.
            reader: The thread that reads; None = one for `spec`.

        Raises:
            BadSetting: `spec` names no port, or `keep` is less than 1.
        """
        if keep < 1:
            raise BadSetting(f"keep must be at least 1 sample (got {keep})")
        self.spec = port_of(spec) if isinstance(spec, str) else spec
        self.recorder: Recorder | None = None
        """The active recorder; None if there is none."""
        self._reader = reader or PortReader(self.spec, reconnect=reconnect)
        self._clock = self._reader.clock
        self._lines = LiveLines(options)
        self._samples = LiveSamples(self.spec, keep, options.rate, options.time_unit)
        self._lock = threading.Lock()  # of the lines and of the samples
        self._counts = LineCounts()  # of the lines whose samples are stored: the status agrees with the snapshot
        self._arrived: deque[tuple[float, int]] = deque()  # (monotonic time in s, lines until then) of late
        self._lines_per_s = 0.0
        self._thread: threading.Thread | None = None
        self._stop = threading.Event()
        self._failure = ""
        self._disconnected_at: float | None = None
        self._left_out_s = 0.0  # seconds in which what arrives is left out, as too much waits
        self._line_at = -math.inf  # when the last whole line had arrived: a read may hold only part of one
        self.commands = CommandChannel(self._reader.write)
        """What is sent to the board, and its remarks."""

    def start(self, *, require: bool = False) -> None:
        """Connect; does nothing while it runs. After `close` it continues with the same samples.

        Args:
            require: Open the port before returning. Otherwise it waits for a missing board.

        Raises:
            BadDevice: the port cannot be opened, where that is required.
        """
        if self._thread is not None:
            return
        self._reader.start(require=require)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, args=(self._stop,), name="kalscope lines", daemon=True)
        self._thread.start()

    def open(self) -> None:
        """Open the port of a board that must be there; what it sends waits until `start`.

        Raises:
            BadDevice: the port cannot be opened.
        """
        self._reader.start(require=True)

    def close(self, timeout: float = 3.0) -> None:
        """Release the port, process the bytes that had arrived, end the recording. May be called twice.

        Args:
            timeout: Seconds to wait for an attempt to connect over the network; the recording ends in any case.
        """
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

    def snapshot(self) -> Snapshot | None:
        """All samples that are kept; None before the first. The same object while nothing was added."""
        with self._lock:
            return self._samples.snapshot(self._counts)

    def status(self) -> LiveStatus:
        """The current status."""
        with self._lock:
            state = self._reader.state
            return LiveStatus(
                **vars(self._counts),
                word=state.word,
                hint=self._failure or self._hint(),
                port=state.device,
                lines_per_s=self._lines_per_s if state.word == "connected" else 0.0,
                period=self._samples.time.period,
                reconnects=max(state.opened - 1, 0),
                recording=self.recorder,
            )

    def _hint(self) -> str:
        """What is wrong with the port and what to do, in a sentence; "" where nothing is."""
        reader, counts = self._reader, self._counts
        check = reader.port.when_silent if reader.port else ""
        if reader.state.reason:
            return reader.state.reason
        if check and self._clock.monotonic() - reader.received_at >= _SILENT_AFTER:
            return f"nothing has arrived for more than {_SILENT_AFTER:g} s: {check}"
        if self._lines.wrong_baud:
            has_baud = reader.spec.transport.has_baud
            return "the data is not text" + (f": is {reader.spec.baud} the right baud rate?" if has_baud else "")
        if reader.state.word == "connected" and counts.overrun:
            return f"the port sends faster than it can be read: {count(counts.overrun)} lines dropped"
        is_text = reader.state.word == "connected" and counts.received > 20 and not counts.accepted
        return "lines arrive, but none has numbers" if is_text else ""

    def record(self, path: str | os.PathLike[str]) -> Recorder:
        """Write every line from now on to a new file, raw, before it is shown.

        Args:
            path: The file.

        Raises:
            BadSetting: a recording is active already.
            BadFile: the file cannot be written, or exists already.
        """
        if self.recorder is not None:
            raise BadSetting("a recording must be stopped before the next begins (got one that is running)")
        self.recorder = Recorder(Path(path), self.spec.text, clock=self._clock)
        return self.recorder

    def stop_recording(self) -> None:
        """End the recording and close its file; does nothing if none is active."""
        recorder, self.recorder = self.recorder, None
        if recorder is not None:
            recorder.close()

    def send(self, line: str, timeout: float = ANSWER_S) -> tuple[str, ...]:
        """Send one line to the board and wait for its answer, lines that begin with #.

        Args:
            line: At most 62 bytes, without newline: an AVR loses what comes in faster than it reads.
            timeout: Seconds to wait.

        Returns:
            The lines of the answer: the first, and those that follow it before the next sample.

        Raises:
            BadSetting: `line` is too long or holds a newline.
            BadDevice: the port is not connected, or no reply arrived.
        """
        return self.commands.send(line, timeout)

    def _run(self, stop: threading.Event) -> None:
        while True:
            is_over = stop.is_set()  # then all that was read is in the queue
            try:
                item = self._reader.items.get(timeout=TICK)
            except Empty:
                self._write([])
                self._note_rate(self._clock.monotonic())
                if is_over:
                    return
                continue
            try:
                self._handle(item)
            except Exception as error:  # the thread must go on: without it nothing would be read, nor said
                self._failure = f"an error of Kalscope left lines out ({type(error).__name__}: {error})"
            with self._lock:
                self._counts = replace(self._lines.counts)

    def _handle(self, item: Item) -> None:
        if isinstance(item, BytesReceived):
            self._reader.taken += len(item.data)
            most = MAX_WAITING_BYTES // 2 if self._left_out_s else MAX_WAITING_BYTES  # one gap, not a hundred
            if self._reader.waiting > most:
                self._leave_out(item)
            else:
                self._take(item)
        elif isinstance(item, Opened):
            self._on_opened(item)
        else:
            self._disconnected_at = item.at
            self.commands.on_disconnected()
            if not self._samples.kept:  # else the rest of the line may follow
                self._interrupt()

    def _leave_out(self, item: BytesReceived) -> None:
        with self._lock:
            dropped = self._lines.overrun(item.data)
            self._samples.time.interrupt()
        self._note_loss(dropped)
        self._left_out_s += item.end - item.begin

    def _on_opened(self, event: Opened) -> None:
        self._line_at, lost_at, self._disconnected_at = event.at, self._disconnected_at, None
        if event.starts != "where it stopped":
            self._interrupt()
            if lost_at is not None:
                self._samples.time.interrupt()
                self._note_loss(0, "unplug", event.at - lost_at)
        with self._lock:
            self._lines.opened(event.at, event.starts, keeps=event.keeps)
            self._samples.kept = event.keeps

    def _interrupt(self) -> None:
        """Drop the beginning of a line, whose end will not come."""
        with self._lock:
            torn = self._lines.interrupted()
        self._note_loss(torn)

    def _take(self, received: BytesReceived) -> None:
        """Write the lines, then show their samples and count them in one step."""
        if self._left_out_s:
            self._note_loss(0, "overrun", self._left_out_s)
            self._left_out_s = 0.0
        with self._lock:
            batch = [(event, self._lines.layout) for event in self._lines.feed(received)]
        self._note_rate(received.end)
        if not batch:
            return
        # The first line may have begun to arrive up to 0.25 s before.
        begin, self._line_at = max(self._line_at, received.begin - 0.25), received.end
        moments = np.linspace(begin, received.end, len(batch) + 1)[1:].tolist()
        stamped = [(at, event, layout) for at, (event, layout) in zip(moments, batch, strict=True)]
        self._write(stamped)
        with self._lock:
            for _, group in groupby(stamped, key=lambda line: id(line[2])):
                run, samples = list(group), self._samples
                self.commands.on_events((event for _, event, _ in run), samples.store.end, samples.generation)
                if (layout := run[0][2]) is not None:
                    samples.keep([(at, event) for at, event, _ in run], layout)
            self._counts = replace(self._lines.counts)

    def _note_rate(self, at: float) -> None:
        arrived = self._arrived
        arrived.append((at, self._lines.counts.received))
        while at - arrived[0][0] > 2.0:  # s
            arrived.popleft()
        (begin, before), (_, received) = arrived[0], arrived[-1]
        self._lines_per_s = (received - before) / (at - begin) if at > begin else 0.0

    def _write(self, stamped: list[StampedLine]) -> None:
        if recorder := self.recorder:
            recorder.write(stamped)

    def _note_loss(self, lines: int, kind: str = "", seconds: float = 0.0) -> None:
        if recorder := self.recorder:
            recorder.lose(lines, kind, seconds)
