"""What a fake board is wired to: a pseudo-terminal that opens like a serial port, or a socket on this machine."""

from __future__ import annotations

import os
import select
import socket
from typing import Protocol

from kalscope.errors import BadDevice, BadSetting

_READ = 4096


class Wire(Protocol):
    """One end of a line; whoever opens the other end may come and go."""

    address: str
    """What opens the other end, as `kalscope open` takes it."""

    def connected(self) -> bool:
        """True while somebody has the other end open."""
        ...

    def send(self, data: bytes) -> int:
        """Send without waiting; how many bytes were taken."""
        ...

    def receive(self) -> bytes:
        """What came from the other end, without waiting."""
        ...

    def close(self) -> None:
        """Take the port away."""
        ...


class PtyWire:
    """A pseudo-terminal. Linux and macOS."""

    def __init__(self) -> None:
        """Make the port.

        Raises:
            BadDevice: this system has no pseudo-terminals.
        """
        try:
            import tty

            self._master, slave = os.openpty()
        except (ImportError, AttributeError, OSError) as error:
            raise BadDevice("demo-board needs --socket PORT on this system (got no pseudo-terminal)") from error
        try:
            tty.setraw(slave)  # before anyone opens it: a cooked one would send all back
            self.address = f"serial:{os.ttyname(slave)}"
        finally:
            os.close(slave)  # then the other end is told to be open only while somebody has it
        os.set_blocking(self._master, False)

    def connected(self) -> bool:
        """True while somebody has the port open."""
        poll = select.poll()
        poll.register(self._master, 0)
        return not any(event & select.POLLHUP for _, event in poll.poll(0))

    def send(self, data: bytes) -> int:
        """Bytes that went into the buffer of the terminal, some 4 KB."""
        try:
            return os.write(self._master, data)
        except BlockingIOError:
            return 0

    def receive(self) -> bytes:
        """What was sent to the board."""
        try:
            return os.read(self._master, _READ)
        except OSError:  # nothing there, or nobody
            return b""

    def close(self) -> None:
        """Take the port away, as an unplugged cable does."""
        os.close(self._master)


class SocketWire:
    """A listening socket on 127.0.0.1, for one at a time."""

    def __init__(self, port: int) -> None:
        """Listen on `port`, 0 for any that is free.

        Raises:
            BadSetting: the port is out of its range.
            BadDevice: it is taken.
        """
        if not 0 <= port <= 65535:
            raise BadSetting(f"--socket must be a port from 0 to 65535 (got {port})")
        self._client: socket.socket | None = None
        try:
            self._server = socket.create_server(("127.0.0.1", port), backlog=1)
        except OSError as error:
            raise BadDevice(f"--socket must be a free port (got {port}: {error.strerror})") from error
        self._server.setblocking(False)
        self.address = f"socket://127.0.0.1:{self._server.getsockname()[1]}"

    def connected(self) -> bool:
        """True while somebody is connected; takes the next one where nobody is."""
        if self._client is None:
            try:
                self._client = self._server.accept()[0]
            except BlockingIOError:
                return False
            self._client.setblocking(False)
        return True

    def send(self, data: bytes) -> int:
        """Bytes that went into the buffer of the connection."""
        try:
            return self._client.send(data) if self._client else 0
        except BlockingIOError:
            return 0
        except OSError:
            self._hang_up()
            return 0

    def receive(self) -> bytes:
        """What was sent to the board."""
        try:
            data = self._client.recv(_READ) if self._client else b""
        except BlockingIOError:
            return b""
        except OSError:
            data = b""
        if not data:
            self._hang_up()
        return data

    def close(self) -> None:
        """Hang up, and listen no more."""
        self._hang_up()
        self._server.close()

    def _hang_up(self) -> None:
        if self._client is not None:
            self._client.close()
            self._client = None
