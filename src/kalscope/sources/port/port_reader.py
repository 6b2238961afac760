"""The thread that reads a port: it opens, reads, stamps and hands over, and when the board goes it waits for it.

It does nothing else, because what it does not fetch in time is lost: the driver of Windows holds 0.36 s of
115200 baud. Whoever takes the items from its queue may take its time.
"""

from __future__ import annotations

import os
import threading
from collections import deque
from queue import SimpleQueue
from typing import TYPE_CHECKING

from kalscope.errors import BadDevice
from kalscope.sources.port.clock import SYSTEM, Clock
from kalscope.sources.port.events import Came, Item, Lost, Opened, PortState, Word
from kalscope.sources.port.open_port import OpenPort, SerialPort, gone_errors, why_gone
from kalscope.sources.port.port_spec import PortSpec, list_ports

if TYPE_CHECKING:
    from collections.abc import Callable

SHORTEST_WAIT, LONGEST_WAIT = 0.25, 2.0
"""Seconds between two attempts to open the port again: the wait doubles from the first to the second."""
_SHORT_LIFE = 5.0
"""Seconds a port must stay open before the next loss counts as a new story."""
_GAPS_TO_KNOW = 20
"""Reads after which it is known how the board sends: line by line or in bursts."""
MOST_WAITING = 64 << 20
"""Bytes that may wait for whoever takes them; beyond, the reader waits too. That is minutes of the fastest port."""


class PortReader:
    """One port and its thread."""

    def __init__(
        self,
        spec: PortSpec,
        *,
        reconnect: bool = True,
        clock: Clock = SYSTEM,
        open_port: Callable[[PortSpec, str], OpenPort] = SerialPort,
    ) -> None:
        """Prepare; nothing is opened.

        Args:
            spec: The port.
            reconnect: Open it again when the board comes back; may be switched at any time.
            clock: Where the stamps come from.
            open_port: Opens the device of that name; BadDevice where it cannot.
        """
        self.spec = spec
        self.items: SimpleQueue[Item] = SimpleQueue()
        """What came, in order. Whoever takes a `Came` calls `taken`."""
        self._reconnect = reconnect
        self._clock = clock
        self._open_port = open_port
        self._state = PortState("closed", device=spec.url)
        self._port: OpenPort | None = None
        self._thread: threading.Thread | None = None
        self._stop = threading.Event()
        self._write_lock = threading.Lock()
        self._waiting = 0
        self._waiting_lock = threading.Lock()
        self._serial_number = ""
        self._losses: deque[float] = deque(maxlen=3)
        self._usual_gap, self._gaps = 0.0, 0
        self.longest_pause = 0.0
        """Longest time between two reads while bytes were waiting, at most, in s."""

    @property
    def state(self) -> PortState:
        """How the port stands now."""
        return self._state

    @property
    def reconnect(self) -> bool:
        """Whether the port is opened again when the board comes back."""
        return self._reconnect

    @reconnect.setter
    def reconnect(self, wanted: bool) -> None:
        self._reconnect = wanted

    @property
    def running(self) -> bool:
        """True from start to close, and until the board goes where nothing reconnects."""
        return self._thread is not None and self._thread.is_alive()

    def start(self, *, require: bool = False) -> None:
        """Open the port and begin to read; does nothing while it runs.

        Args:
            require: Open before returning. Otherwise the thread opens, and waits for a board that is not there.

        Raises:
            BadDevice: the port cannot be opened, where that is required.
        """
        if self.running:
            return
        self._stop = threading.Event()
        self._say("connecting")
        port = None
        if require:
            try:
                port = self._opened(self._stop)
            except BadDevice as error:
                self._say("closed", str(error))
                raise
        self._thread = threading.Thread(
            target=self._run, args=(port, self._stop), name="kalscope port", daemon=True
        )
        self._thread.start()

    def close(self, timeout: float = 3.0) -> None:
        """Free the port: when this returns another program can open it. May be called twice.

        A read ends within 0.1 s; an attempt to connect over the network may take up to `timeout`, and is
        then closed as soon as it ends.
        """
        self._stop.set()
        thread, self._thread = self._thread, None
        if thread is not None and thread is not threading.current_thread():
            thread.join(timeout)
        self._say("closed", self._state.why if self._state.word == "closed" else "")

    def write(self, data: bytes) -> None:
        """Send bytes to the board.

        Raises:
            BadDevice: the port is not open, or the board went while they were sent.
        """
        with self._write_lock:
            port = self._port
            if port is None:
                raise BadDevice(f"port {self._state.device} must be connected (got {self._state.word})")
            try:
                port.write(data)
            except gone_errors() as error:
                raise BadDevice(f"port {self._state.device} must take what is sent (got {error})") from error

    def taken(self, came: Came) -> None:
        """Tell that the bytes of `came` need no more room."""
        with self._waiting_lock:
            self._waiting -= len(came.data)

    def _run(self, port: OpenPort | None, stop: threading.Event) -> None:
        wait = SHORTEST_WAIT
        try:
            while not stop.is_set():
                if port is None:
                    try:
                        port = self._opened(stop)
                    except BadDevice as error:
                        if stop.is_set():
                            return
                        if not self._reconnect:
                            self._say("closed", str(error))
                            return
                        self._say("disconnected, waiting", str(error))
                        stop.wait(wait)
                        wait = min(2 * wait, LONGEST_WAIT)
                        continue
                opened = self._clock.monotonic()
                why = self._read(port, stop)
                port = None
                if stop.is_set():
                    return
                if self._clock.monotonic() - opened > _SHORT_LIFE:
                    wait = SHORTEST_WAIT
                self._say("disconnected, waiting" if self._reconnect else "closed", why)
                if not self._reconnect:
                    return
                stop.wait(wait)
                wait = min(2 * wait, LONGEST_WAIT)
        finally:
            if port is not None:
                port.close()
            if stop.is_set() and stop is self._stop:
                self._say("closed")

    def _opened(self, stop: threading.Event) -> OpenPort:
        """The port, open, under whatever name the board has now."""
        device = self._device()
        port = self._open_port(self.spec, device)
        if stop.is_set():  # nobody waits for it any longer, or somebody else has begun anew
            port.close()
            raise BadDevice(f"port {device} must be wanted (got a connection after it was given up)")
        if not self.spec.is_url and not self._serial_number:
            real = os.path.realpath(device)
            found = [info for info in list_ports() if info.device in (device, real)]
            self._serial_number = found[0].serial_number if found else ""
        at = self._clock.monotonic()
        with self._write_lock:
            self._port = port
        # Before the state tells, so that whoever sees "connected" finds the item.
        self.items.put(Opened(at))
        self._state = PortState("connected", "", device, at, self._state.opened + 1)
        return port

    def _device(self) -> str:
        if self.spec.is_url or not self._serial_number:
            return self.spec.url
        same = [info.device for info in list_ports() if info.serial_number == self._serial_number]
        real = os.path.realpath(self.spec.url)
        return same[0] if same and real not in same else self.spec.url

    def _read(self, port: OpenPort, stop: threading.Event) -> str:
        """Read until the board goes or `stop`; then close the port. Why it went."""
        why, clock = "", self._clock.monotonic
        before, waiting, self._usual_gap, self._gaps = clock(), 0, 0.0, 0
        try:
            while not stop.is_set():
                data = port.fetch()
                now = clock()
                if not data:
                    waiting = 0
                    continue
                self._hand_over(Came(data, before, now), stop)
                left = port.waiting()
                self._judge_pause(now - before, waiting, left)
                before, waiting = now, left
        except gone_errors() as error:
            self._losses.append(clock())
            often = len(self._losses) > 1 and self._losses[-1] - self._losses[-2] < 2 * _SHORT_LIFE
            why = why_gone(self.spec, self._state.device, error, again=often)
        finally:
            with self._write_lock:
                self._port = None
            port.close()
            self.items.put(Lost(clock()))
        return why

    def _hand_over(self, came: Came, stop: threading.Event) -> None:
        while self._waiting > MOST_WAITING and not stop.is_set():
            stop.wait(0.01)
        with self._waiting_lock:
            self._waiting += len(came.data)
        self.items.put(came)

    def _judge_pause(self, gap: float, waiting: int, left: int) -> None:
        """Note a late read. Where nothing was waiting at its call, it was late by what has piled up since.

        A board that sends in bursts piles up as much; so only what exceeds the usual gap counts.
        """
        if waiting:
            self.longest_pause = max(self.longest_pause, gap)
            return
        self._gaps += 1
        if left and self._gaps > _GAPS_TO_KNOW:
            late = min(gap - self._usual_gap, 10.0 * left / self.spec.baud)
            self.longest_pause = max(self.longest_pause, late)
        self._usual_gap = max(gap, 0.98 * self._usual_gap)

    def _say(self, word: Word, why: str = "") -> None:
        state = self._state
        since = state.since if word == state.word else self._clock.monotonic()
        self._state = PortState(word, why, state.device, since, state.opened)
