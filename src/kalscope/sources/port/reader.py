"""The reader thread of a port: it opens, reads, stamps and queues, and waits for a lost board to come back.

It does nothing else, because bytes that it does not fetch in time are lost: the Windows driver holds 0.36 s of
115200 baud. The consumer of its queue may take its time, and leave out lines that it cannot keep up with.
"""

from __future__ import annotations

import re
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from queue import SimpleQueue
from typing import TYPE_CHECKING, Literal

from kalscope.errors import BadDevice, BadSetting, reason_of

if TYPE_CHECKING:
    from kalscope.sources.port.registry import PortSpec

# What a transport offers: an address that may be opened again and again, and the port that is open.


READ_TIMEOUT = 0.1
"""Seconds after which a read without data returns, so that close never waits longer."""
CONNECT_TIMEOUT = 5.0
"""Seconds within which the other side must answer."""
MAX_READ_BYTES = 1 << 13
"""Bytes of one read: whether to stop is checked between two of them."""

Start = Literal["inside a line", "at a line", "where it stopped"]
"""Where the first byte after an opening is: in general inside a line, of which the beginning is lost; at the
beginning of a line, as that of a message or a file; or right after the last byte of the opening before."""


class OpenPort(ABC):
    """A port: to construct one is to open it. Methods raise an OSError where the connection is lost."""

    prefixes: tuple[str, ...] = ()
    """How its addresses begin, in lower case; the usual one first."""
    has_baud = False
    """Whether an address may end with @ and a baud rate."""
    check: Callable[[str], object] = staticmethod(str)
    """Raises BadSetting where an address is malformed; the return value is not used. Opens nothing."""
    device = ""
    """What is open, as users know it, where that is not the address: a board may come back under another path."""
    when_silent = ""
    """What to check where nothing arrives, a sentence without its full stop; "" where silence may be all right."""
    when_lost = ""
    """What to check where it is lost; "" for nothing."""
    starts: Start = "inside a line"
    """Where its first byte is."""
    keeps = False
    """True where the other side keeps what is not read yet: it is then fetched no faster than it is used."""

    @abstractmethod
    def __init__(self, spec: PortSpec, is_ended: Callable[[], bool], last: OpenPort | None) -> None:
        """Open it.

        Args:
            spec: The port.
            is_ended: True once it is no longer needed; called at least every READ_TIMEOUT s where that is possible.
            last: The last port that was open, closed by now; None for the first.

        Raises:
            BadDevice: why it cannot be opened, and what to do, a sentence without its full stop.
        """

    @abstractmethod
    def fetch(self) -> bytes:
        """Bytes that have arrived, little more than MAX_READ_BYTES; after READ_TIMEOUT none."""

    def write(self, data: bytes) -> None:
        """Send all of it. Here: refuse, as most transports only receive."""
        del data
        raise BadDevice("nothing can be sent there: it is only read")

    @abstractmethod
    def close(self) -> None:
        """Release the port; may be called twice, and after the connection was lost. Raises nothing."""


Opener = Callable[["PortSpec", Callable[[], bool], OpenPort | None], OpenPort]
"""The constructor of a port."""


# Addresses and reasons as messages repeat them: on one line, not too long, and without a password.


MQTT_ENV = "KALSCOPE_MQTT_PASSWORD"
"""The environment variable that holds the password of a broker."""
_PASSWORD = re.compile(r"([^:/]*://[^:]*):(?!\d+@\d+\Z).*@", re.DOTALL)  # not host:port@baud


def refuse_password(address: str) -> None:
    """Refuse what may hold a password: an address is shown, recorded and shared.

    `scheme://user:123/456@host/name` reads as host, port and name, too. So an @ after a colon is always refused.

    Raises:
        BadSetting: there is an @ after a colon, and more than a baud rate after it.
    """
    if _PASSWORD.match(address):
        raise BadSetting(
            "an address must hold no password: ssh:// uses your keys, mqtt:// the environment variable"
            f" {MQTT_ENV}; an @ of a path or a topic is written %40 (got {quoted(address)})"
        )


def quoted(address: str) -> str:
    """An address as messages repeat it: without the password that may precede its last @, not too long."""
    match = _PASSWORD.match(address)
    shown = f"{match[1]}:…@{address[match.end() :]}" if match else address
    return f"{shown!r:.100}"


def short(reason: object) -> str:
    """An error, or a text of another program, on one line of at most 200 characters."""
    return " ".join(str(reason).split())[:200]


# The clocks of a live source. Only the monotonic one measures; setting the wall clock changes nothing.


_GOES_ON = getattr(time, "CLOCK_BOOTTIME", getattr(time, "CLOCK_MONOTONIC", None))


def _monotonic() -> float:
    """Seconds that never step and go on while the machine sleeps, as those of a board do.

    `time.monotonic` stops then on Linux and macOS, where CLOCK_BOOTTIME and CLOCK_MONOTONIC go on.
    """
    return time.monotonic() if _GOES_ON is None else time.clock_gettime(_GOES_ON)


@dataclass(frozen=True)
class Clock:
    """The clocks of a live source."""

    monotonic: Callable[[], float] = _monotonic
    """Seconds that never step."""
    wall: Callable[[], float] = time.time
    """Seconds since 1970; read once for each recording, for its first line."""


SYSTEM = Clock()
"""The clocks of this machine."""


# What the thread queues, and the state of the port.


Word = Literal["closed", "connecting", "connected", "disconnected, waiting"]


@dataclass(frozen=True)
class PortState:
    """The state of a port."""

    word: Word
    """closed, connecting, connected, or "disconnected, waiting" for the board to come back."""
    reason: str = ""
    """What ended or prevents the connection, a sentence without its full stop; "" if nothing does."""
    device: str = ""
    """The device that is, or was last, open: the path may change when a board is plugged in again."""
    opened: int = 0
    """How many times the port was opened; all but the first are reconnects."""


@dataclass(frozen=True)
class BytesReceived:
    """Bytes of one read."""

    data: bytes
    """At least one byte."""
    begin: float
    """Monotonic time of the previous read, or of the opening, s."""
    end: float
    """Monotonic time at which they had arrived, s."""
    silence: float
    """Seconds before them in which reads found nothing: not those in which this machine did not read."""


@dataclass(frozen=True)
class Opened:
    """The port is open."""

    at: float
    """Monotonic time, s."""
    starts: Start = "inside a line"
    """Where the next bytes begin."""
    keeps: bool = False
    """True where the other side keeps its lines, as a file does: the times in them can then be trusted."""


@dataclass(frozen=True)
class Disconnected:
    """The board was lost or the port closed; the current line will not be finished."""

    at: float
    """Monotonic time, s."""


Item = BytesReceived | Opened | Disconnected
"""What the thread queues."""


# The thread.


_KEPT_BYTES = 1 << 17
"""Bytes that may wait for the consumer where the other side keeps the rest."""
_MOST_BYTES = 1 << 23
"""Bytes that may wait elsewhere, 12 minutes of 115200 baud."""


class PortReader:
    """One port and its thread."""

    def __init__(
        self, spec: PortSpec, *, reconnect: bool = True, clock: Clock = SYSTEM, opener: Opener | None = None
    ) -> None:
        """Prepare; nothing is opened.

        Args:
            spec: The port.
            reconnect: Reopen it when the board comes back.
            clock: The source of the stamps.
            opener: What opens the port; None = what `spec` names.
        """
        self.spec = spec
        self.items = SimpleQueue[Item]()
        """The events in order."""
        self.taken = 0
        """Bytes that the consumer has taken out of the queue and processed; the consumer counts them."""
        self.state = PortState("closed", device=spec.url)
        """The current state of the port."""
        self.port: OpenPort | None = None
        """What is open, as long as it may still be read."""
        self.received_at = 0.0
        """Monotonic time of the last bytes, or of the opening, s."""
        self.clock = clock
        """The source of the stamps."""
        self._reconnect, self._opener = reconnect, opener or spec.transport
        self._last: OpenPort | None = None
        self._thread: threading.Thread | None = None
        self._stop = threading.Event()
        self._write_lock = threading.Lock()
        self._queued = 0  # bytes

    def start(self, *, require: bool = False) -> None:
        """Begin to read; does nothing while it runs.

        Args:
            require: Open before returning. Otherwise the thread opens, and waits for a board that is not there.

        Raises:
            BadDevice: the port cannot be opened, where that is required.
        """
        if self._thread is not None and self._thread.is_alive():
            return
        self._stop = stop = threading.Event()
        self._set_state("connecting")
        try:
            port = self._opened(stop) if require else None
        except BadDevice as error:
            self._set_state("closed", str(error))
            raise
        self._thread = threading.Thread(target=self._run, args=(port, stop), name="kalscope port", daemon=True)
        self._thread.start()

    def close(self, timeout: float = 3.0) -> None:
        """Release the port: when this returns, another program can open it. May be called twice.

        A read ends within 0.1 s; an attempt to connect over the network may take up to `timeout`, and is
        then closed as soon as it ends.
        """
        self._stop.set()
        thread, self._thread = self._thread, None
        if thread is not None:
            thread.join(timeout)
        self._set_state("closed", self.state.reason if self.state.word == "closed" else "")

    def write(self, data: bytes) -> None:
        """Send bytes to the board.

        Raises:
            BadDevice: the port is not open, or the board was lost while they were sent.
        """
        with self._write_lock:
            if self.port is None:
                raise BadDevice(f"port {self.state.device} is not connected ({self.state.word})")
            with _one_sentence(f"{self.state.device} accepts no data"):
                self.port.write(data)

    @property
    def waiting(self) -> int:
        """Bytes that the consumer has not taken yet."""
        return self._queued - self.taken

    def _run(self, port: OpenPort | None, stop: threading.Event) -> None:
        waits = port is not None or not stop.is_set()
        while waits:
            reason = ""
            try:
                port = port or self._opened(stop)
                self._read(port, stop)
            except BadDevice as error:
                reason = "" if stop.is_set() else str(error)
            waits = self._reconnect and not stop.is_set()
            if stop is self._stop:  # not started again in the meantime
                self._set_state("disconnected, waiting" if waits else "closed", reason)
            if port is not None:
                # After the state has changed, so that the consumer finds there why the board is gone.
                self.items.put(Disconnected(self.clock.monotonic()))
                port = None
            waits = waits and not stop.wait(1.0)

    def _opened(self, stop: threading.Event) -> OpenPort:
        """Open the port and queue the event."""
        with _one_sentence(f"{self.spec.url} cannot be opened"):
            port = self._opener(self.spec, stop.is_set, self._last)
        device = port.device or self.spec.url
        if stop.is_set():  # closed, or started again, in the meantime
            port.close()
            raise BadDevice(f"port {device} was closed before it had opened")
        at = self.received_at = self.clock.monotonic()
        with self._write_lock:
            self.port = self._last = port
        # Before the state changes, so that a caller who sees "connected" finds the event.
        self.items.put(Opened(at, port.starts, port.keeps))
        self.state = PortState("connected", "", device, self.state.opened + 1)
        return port

    def _read(self, port: OpenPort, stop: threading.Event) -> None:
        """Read until `stop`; then close the port. Raises BadDevice where the board is lost."""
        clock, silence = self.clock.monotonic, 0.0
        before = now = clock()
        check = f": {port.when_lost}" if port.when_lost else ""
        try:
            while not stop.is_set():
                if self.waiting > (_KEPT_BYTES if port.keeps else _MOST_BYTES):
                    stop.wait(0.01)
                    continue
                with _one_sentence(f"{self.state.device} was lost", check):
                    data = port.fetch()
                now = clock()
                if not data:
                    # Not `now - before`: a machine that stalls in a read receives nothing either.
                    silence = min(silence + READ_TIMEOUT, now - before)
                    continue
                self.received_at = now
                self._queued += len(data)
                self.items.put(BytesReceived(data, before, now, silence))
                before, silence = now, 0.0
        finally:
            with self._write_lock:
                self.port = None
            port.close()

    def _set_state(self, word: Word, reason: str = "") -> None:
        self.state = replace(self.state, word=word, reason=reason)


@contextmanager
def _one_sentence(what: str, check: str = "") -> Generator[None]:
    """Whatever a driver or a library raises is a BadDevice: it must not end the thread, which would say nothing."""
    try:
        yield
    except BadDevice:
        raise
    except Exception as error:
        reason = short(reason_of(error)) or type(error).__name__
        raise BadDevice(f"{what} ({reason}){check}") from error
