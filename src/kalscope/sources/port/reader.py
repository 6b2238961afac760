"""The reader thread of a port: it opens, reads, stamps and queues, and waits for a lost board to come back.

It does nothing else, because bytes that it does not fetch in time are lost: the Windows driver holds 0.36 s of
115200 baud. The consumer of its queue may take its time: what it cannot keep up with is left out line by line.
"""

from __future__ import annotations

import threading
from collections.abc import Callable

from kalscope.errors import BadDevice
from kalscope.sources.port.events import (
    SYSTEM,
    BytesReceived,
    Clock,
    Disconnected,
    EventQueue,
    LinesDropped,
    Opened,
    Overload,
    PortState,
    Word,
)
from kalscope.sources.port.registry import PortSpec
from kalscope.sources.port.transport import READ_TIMEOUT, Endpoint, OpenPort

MIN_RETRY_DELAY, MAX_RETRY_DELAY = 0.25, 2.0
"""Seconds between two attempts to reopen the port: the delay doubles from the first to the second."""
_MIN_CONNECTED_S = 5.0
"""A connection that lasted longer, in s, resets the retry delay."""
_KEPT_BYTES, _KEPT_PAUSE = 1 << 17, 0.01
"""Bytes that wait for the consumer where the other side can keep the rest, and seconds until it is asked again."""
_MIN_GAPS = 20
"""Reads after which it is known whether the board sends line by line or in bursts."""


class PortReader:
    """One port and its thread."""

    def __init__(
        self,
        spec: PortSpec,
        *,
        reconnect: bool = True,
        clock: Clock = SYSTEM,
        endpoint: Endpoint | None = None,
    ) -> None:
        """Prepare; nothing is opened.

        Args:
            spec: The port.
            reconnect: Reopen it when the board comes back; may be switched at any time.
            clock: The source of the stamps.
            endpoint: What is opened; None = what `spec` names.
        """
        self.spec = spec
        self.items = EventQueue()
        """The events in order. The consumer releases each `BytesReceived` and `LinesDropped`."""
        self._reconnect = reconnect
        self._clock = clock
        self._endpoint = endpoint or spec.transport.endpoint(spec.url, spec.baud, spec.reset)
        self._state = PortState("closed", device=spec.url)
        self._port: OpenPort | None = None
        self._ready: OpenPort | None = None  # open, but not read yet
        self._thread: threading.Thread | None = None
        self._stop = threading.Event()
        self._write_lock = threading.Lock()
        self._usual_gap, self._gaps = 0.0, 0
        self._received_at = 0.0
        self._overload = Overload()
        self.max_read_latency = 0.0
        """Upper bound of the longest time between two reads while bytes were waiting, s."""

    @property
    def state(self) -> PortState:
        """The current state of the port."""
        return self._state

    @property
    def dropped(self) -> int:
        """Lines left out because too many bytes wait, in gaps that have not been released."""
        return self._overload.dropped + self.items.dropped

    @property
    def is_endless(self) -> bool:
        """Whether more bytes come than may wait, without a line end among them."""
        return self._overload.is_endless

    @property
    def silence(self) -> tuple[float, str]:
        """Seconds since the last bytes, or the opening, and what to check after many; (0, "") if not open."""
        if self._state.word != "connected":
            return 0.0, ""
        return self._clock.monotonic() - max(self._received_at, self._state.since), self._endpoint.when_silent

    @property
    def reconnect(self) -> bool:
        """Whether the port is reopened when the board comes back."""
        return self._reconnect

    @reconnect.setter
    def reconnect(self, wanted: bool) -> None:
        self._reconnect = wanted

    @property
    def running(self) -> bool:
        """True from start to close, and until the board is lost if it does not reconnect."""
        return self._thread is not None and self._thread.is_alive()

    def open(self, is_ended: Callable[[], bool] = bool) -> None:
        """Open the port; `start` then reads it from its first byte. Does nothing while it is open and not read yet.

        Args:
            is_ended: True once that is no longer wanted: connecting is then given up.

        Raises:
            BadDevice: the port cannot be opened.
        """
        if self._ready is not None:
            return
        self._stop = threading.Event()
        self._set_state("connecting")
        try:
            self._ready = self._opened(self._stop, is_ended)
        except BadDevice as error:
            self._set_state("closed", str(error))
            raise

    def start(self, *, require: bool = False) -> None:
        """Begin to read; does nothing while it runs.

        Args:
            require: Open before returning. Otherwise the thread opens, and waits for a board that is not there.

        Raises:
            BadDevice: the port cannot be opened, where that is required.
        """
        if self.running:
            return
        if require:
            self.open()
        port, self._ready = self._ready, None
        if port is None:
            self._stop = threading.Event()
            self._set_state("connecting")
        self._thread = threading.Thread(
            target=self._run, args=(port, self._stop), name="kalscope port", daemon=True
        )
        self._thread.start()

    def close(self, timeout: float = 3.0) -> None:
        """Release the port: when this returns, another program can open it. May be called twice.

        A read ends within 0.1 s; an attempt to connect over the network may take up to `timeout`, and is
        then closed as soon as it ends.
        """
        self._stop.set()
        thread, self._thread = self._thread, None
        ready, self._ready = self._ready, None
        if ready is not None:
            ready.close()
        if thread is not None and thread is not threading.current_thread():
            thread.join(timeout)
        self._set_state("closed", self._state.reason if self._state.word == "closed" else "")

    def write(self, data: bytes) -> None:
        """Send bytes to the board.

        Raises:
            BadDevice: the port is not open, or the board was lost while they were sent.
        """
        with self._write_lock:
            port = self._port
            if port is None:
                raise BadDevice(f"port {self._state.device} is not connected ({self._state.word})")
            port.write(data)

    def _run(self, port: OpenPort | None, stop: threading.Event) -> None:
        delay = MIN_RETRY_DELAY
        while port is not None or not stop.is_set():
            try:
                port = port or self._opened(stop)
                reason = self._read(port, stop)
                if self._clock.monotonic() - self._state.since > _MIN_CONNECTED_S:
                    delay = MIN_RETRY_DELAY
            except BadDevice as error:
                reason = str(error)
            is_closed = stop.is_set()
            waits = self._reconnect and not is_closed
            if stop is self._stop:  # not started again in the meantime
                self._set_state("disconnected, waiting" if waits else "closed", "" if is_closed else reason)
            if port is not None:
                # After the state has changed, so that the consumer finds there why the board is gone.
                self.items.put(Disconnected(self._clock.monotonic()))
                port = None
            if not waits:
                return
            stop.wait(delay)
            delay = min(2 * delay, MAX_RETRY_DELAY)

    def _opened(self, stop: threading.Event, is_ended: Callable[[], bool] = bool) -> OpenPort:
        """Open the port and queue the event."""
        port = self._endpoint.open(lambda: stop.is_set() or is_ended())
        device = self._endpoint.device
        if stop.is_set():  # closed, or started again, in the meantime
            port.close()
            raise BadDevice(f"port {device} was closed before it had opened")
        at = self._clock.monotonic()
        with self._write_lock:
            self._port = port
        # Before the state changes, so that a caller who sees "connected" finds the event.
        self.items.put(Opened(at, port.starts, port.keeps))
        self._state = PortState("connected", "", device, at, self._state.opened + 1)
        return port

    def _read(self, port: OpenPort, stop: threading.Event) -> str:
        """Read until the board is lost or `stop`; then close the port. Returns why it was lost."""
        why, clock = "", self._clock.monotonic
        before, waiting, silence, self._usual_gap, self._gaps = clock(), 0, 0.0, 0.0, 0
        overload = self._overload = Overload()
        try:
            while not stop.is_set():
                if port.keeps and self.items.waiting > _KEPT_BYTES:
                    stop.wait(_KEPT_PAUSE)
                    continue
                data = port.fetch()
                now = clock()
                if lost := port.take_lost():
                    self.items.put(LinesDropped(lost, before, now))
                if not data:
                    # Not `now - before`: a machine that stalls in a read receives nothing either.
                    waiting, silence = 0, min(silence + READ_TIMEOUT, now - before)
                    continue
                self._received_at = now
                for item in overload.take(BytesReceived(data, before, now, silence), self.items.waiting):
                    self.items.put(item)
                left = port.waiting()
                if not port.keeps:
                    self._note_read_latency(now - before, waiting, left)
                before, waiting, silence = now, left, 0.0
        except BadDevice as error:
            why = str(error)
        finally:
            with self._write_lock:
                self._port = None
            port.close()
            for gap in overload.end():
                self.items.put(gap)
        return why

    def _note_read_latency(self, gap: float, waiting: int, left: int) -> None:
        """Note a late read. Where nothing was waiting at its call, it was late by what has piled up since.

        A board that sends in bursts piles up as much; so only what exceeds the usual gap counts.
        """
        if waiting:
            self.max_read_latency = max(self.max_read_latency, gap)
            return
        self._gaps += 1
        if left and self._gaps > _MIN_GAPS:
            late = min(gap - self._usual_gap, 10.0 * left / self.spec.baud)
            self.max_read_latency = max(self.max_read_latency, late)
        self._usual_gap = max(gap, 0.98 * self._usual_gap)

    def _set_state(self, word: Word, reason: str = "") -> None:
        state = self._state
        since = state.since if word == state.word else self._clock.monotonic()
        self._state = PortState(word, reason, state.device, since, state.opened)
