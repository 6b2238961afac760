"""tcp://host:port, which pyserial writes socket://: a board, or a program, that sends its lines over TCP."""

from __future__ import annotations

import re
import select
import socket
from collections.abc import Callable

from kalscope.errors import BadDevice, BadSetting
from kalscope.sources.port.transports.limits import CONNECT_TIMEOUT, MAX_READ_BYTES, READ_TIMEOUT, WRITE_TIMEOUT
from kalscope.sources.port.transports.transport import Endpoint, OpenPort, Transport
from kalscope.sources.port.transports.words import quoted, short

_HOST_PORT = re.compile(r"\w+://(?:\[([0-9A-Fa-f:.]+)\]|([^/:?@\s]+)):([0-9]{1,5})(?:[/?].*)?", re.IGNORECASE)


def host_and_port(address: str) -> tuple[str, int]:
    """The host and the port of an address.

    Raises:
        BadSetting: it is not scheme://host:port.
    """
    match = _HOST_PORT.fullmatch(address)
    if match is None or not 1 <= int(match[3]) <= 65_535:
        scheme = address.partition(":")[0].lower()
        raise BadSetting(f"an address must be {scheme}://host:port (got {quoted(address)})")
    return match[1] or match[2], int(match[3])


def connect_failure(host: str, port: int, error: Exception, what: str = "the board, or its program,") -> str:
    """Why a connection could not be made, and what to do.

    Args:
        host: The other side.
        port: Its port.
        error: What the system raised.
        what: Who should answer there.
    """
    if isinstance(error, socket.gaierror | UnicodeError):
        return f"no computer is known by the name {host} ({short(getattr(error, 'strerror', None) or str(error))})"
    if isinstance(error, ConnectionRefusedError):
        return f"nothing listens at {host}:{port}: is {what} running there?"
    if isinstance(error, TimeoutError):
        return f"{host}:{port} does not answer within {CONNECT_TIMEOUT:g} s"
    return f"{host}:{port} cannot be reached ({short(str(error))})"


class SocketEndpoint(Endpoint):
    """A host and one of its ports."""

    def __init__(self, address: str) -> None:
        """Take an address; raises BadSetting as `host_and_port`."""
        self.device = address
        self._host, self._port = host_and_port(address)

    def open(self, is_ended: Callable[[], bool]) -> OpenPort:
        """Connect; see Endpoint."""
        del is_ended  # the system's connect cannot be interrupted
        try:
            connection = socket.create_connection((self._host, self._port), CONNECT_TIMEOUT)
        except (OSError, UnicodeError) as error:
            raise BadDevice(connect_failure(self._host, self._port, error)) from error
        return SocketPort(self.device, connection)


class SocketPort(OpenPort):
    """A connection over TCP."""

    def __init__(self, name: str, connection: socket.socket) -> None:
        """Args: the name in messages; the connection, which it closes."""
        self._name, self._socket = name, connection
        connection.settimeout(WRITE_TIMEOUT)

    def fetch(self) -> bytes:
        """Bytes that have arrived; see OpenPort."""
        try:
            if not select.select([self._socket], [], [], READ_TIMEOUT)[0]:
                return b""
            data = self._socket.recv(MAX_READ_BYTES)
        except OSError as error:
            raise BadDevice(f"the connection to {self._name} was lost ({short(str(error))})") from error
        if not data:
            raise BadDevice(f"the other side of {self._name} closed the connection")
        return data

    def waiting(self) -> int:
        """1 where bytes wait."""
        return len(select.select([self._socket], [], [], 0)[0])

    def write(self, data: bytes) -> None:
        """Send all of it."""
        try:
            self._socket.sendall(data)
        except OSError as error:
            raise BadDevice(f"{self._name} accepts no data ({short(str(error))})") from error

    def close(self) -> None:
        """Close the connection."""
        self._socket.close()


TCP = Transport(
    ("tcp://", "socket://"),
    "tcp://host:port",
    host_and_port,
    lambda address, _baud, _reset: SocketEndpoint(address),
)
"""A plain TCP connection."""
