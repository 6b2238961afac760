"""The connection of the demo board: a pseudo-terminal that opens like a serial port, or a local socket."""

from __future__ import annotations

import os
import select
import socket

from kalscope.errors import BadDevice, BadSetting

_READ = 4096


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
            tty.setraw(slave)  # before it is opened: in cooked mode it would echo everything
            self.address = f"serial:{os.ttyname(slave)}"
            """What opens the other end, as `kalscope open` takes it."""
        finally:
            os.close(slave)  # so that POLLHUP shows whether the other end is open
        os.set_blocking(self._master, False)

    def connected(self) -> bool:
        """Whether the port is open elsewhere."""
        poll = select.poll()
        poll.register(self._master, 0)
        return not any(event & select.POLLHUP for _, event in poll.poll(0))

    def send(self, data: bytes) -> int:
        """Send what fits into the buffer of the terminal, about 4 KB."""
        try:
            return os.write(self._master, data)
        except BlockingIOError:
            return 0

    def receive(self) -> bytes:
        """What was sent to the board."""
        try:
            return os.read(self._master, _READ)
        except OSError:  # nothing was sent, or the port is closed
            return b""

    def close(self) -> None:
        """Remove the port, as an unplugged cable does."""
        os.close(self._master)


class SocketWire:
    """A listening socket on 127.0.0.1 for one client at a time."""

    def __init__(self, port: int) -> None:
        """Listen on `port`; 0 means any free one.

        Raises:
            BadSetting: the port is out of range.
            BadDevice: the port is in use.
        """
        if not 0 <= port <= 65535:
            raise BadSetting(f"--socket must be a port from 0 to 65535 (got {port})")
        self._client: socket.socket | None = None
        try:
            self._server = socket.create_server(("127.0.0.1", port), backlog=1)
        except OSError as error:
            raise BadDevice(f"--socket must be a free port (got {port}: {error.strerror})") from error
        self._server.setblocking(False)
        self.address = f"tcp://127.0.0.1:{self._server.getsockname()[1]}"

    def connected(self) -> bool:
        """Whether a client is connected; accepts the next one if not."""
        if self._client is None:
            try:
                self._client = self._server.accept()[0]
            except BlockingIOError:
                return False
            self._client.setblocking(False)
        return True

    def send(self, data: bytes) -> int:
        """Send what fits into the buffer of the connection."""
        try:
            return self._client.send(data) if self._client else 0
        except BlockingIOError:
            return 0
        except OSError:
            self._disconnect()
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
            self._disconnect()
        return data

    def close(self) -> None:
        """Disconnect and stop listening."""
        self._disconnect()
        self._server.close()

    def _disconnect(self) -> None:
        if self._client is not None:
            self._client.close()
            self._client = None


Wire = PtyWire | SocketWire
"""The board's end of a connection; the other end may be opened and closed at any time."""
