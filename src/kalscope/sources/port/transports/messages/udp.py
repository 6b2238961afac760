"""udp://:port: datagrams of lines, such as Teleplot's, from every sender that reaches the port.

There is no connection: the port is bound, and whatever arrives is read. Only this machine reaches it unless the
address names an interface, because anyone who reaches it can send.
"""

from __future__ import annotations

import errno
import re
import select
import socket
import struct
import sys
from collections.abc import Callable

from kalscope.errors import BadDevice, BadSetting
from kalscope.sources.port.transports.limits import MAX_READ_BYTES, READ_TIMEOUT
from kalscope.sources.port.transports.messages.text import lines_of
from kalscope.sources.port.transports.transport import Endpoint, OpenPort, Transport
from kalscope.sources.port.transports.words import quoted, short

LOOPBACK = "127.0.0.1"
"""What is bound where the address names no interface: this machine alone reaches it."""
MAX_DATAGRAM = 65_535
"""Bytes of one datagram: none can be longer."""
RECEIVE_BUFFER = 4 << 20
"""Bytes that the system is asked to buffer; Linux gives 2 × net.core.rmem_max at most."""

_ADDRESS = re.compile(r"udp://(?:(?:\[([0-9A-Fa-f:.%\w]+)\]|([^/:?@\[\]\s]*)):)?([0-9]{1,5})/?", re.IGNORECASE)
_MEMORY, _DROPS = 55, 8  # Linux: SO_MEMINFO, whose ninth number counts the dropped datagrams


def interface_and_port(address: str) -> tuple[str, int]:
    """The interface and the port of an address.

    Raises:
        BadSetting: it is not udp://:port or udp://interface:port.
    """
    match = _ADDRESS.fullmatch(address)
    if match is None or not 1 <= int(match[3]) <= 65_535:
        raise BadSetting(
            f"an address must be udp://:47269, or udp://0.0.0.0:47269 for all networks (got {quoted(address)})"
        )
    return match[1] or match[2] or LOOPBACK, int(match[3])


class UdpEndpoint(Endpoint):
    """A port of this machine, on one interface or on all."""

    def __init__(self, address: str) -> None:
        """Take an address; raises BadSetting as `interface_and_port`."""
        self.device = address
        self._host, self._port = interface_and_port(address)
        if self._host in (LOOPBACK, "localhost", "::1"):
            self.when_silent = (
                f"only this computer can send to {self._host}; udp://0.0.0.0:{self._port} is open to all networks"
            )
        else:
            self.when_silent = "does the board send to this computer and this port, and does a firewall let it in?"

    def open(self, is_ended: Callable[[], bool]) -> OpenPort:
        """Bind the port; see Endpoint."""
        del is_ended
        try:
            found = socket.getaddrinfo(self._host, self._port, type=socket.SOCK_DGRAM, flags=socket.AI_PASSIVE)
            family, kind, protocol, _, place = found[0]
            bound = socket.socket(family, kind, protocol)
        except (OSError, UnicodeError) as error:
            raise BadDevice(f"{self._host} is not an address of this computer ({short(str(error))})") from error
        try:
            bound.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER)
            bound.bind(place)
        except OSError as error:
            bound.close()
            raise BadDevice(self._refusal(error)) from error
        return UdpPort(self.device, bound)

    def _refusal(self, error: OSError) -> str:
        if error.errno == errno.EADDRINUSE:
            return f"port {self._port} is in use by another program: close it, or send to another port"
        if error.errno == errno.EADDRNOTAVAIL:
            return f"{self._host} is not an address of this computer: 0.0.0.0 means all of its addresses"
        if error.errno == errno.EACCES:
            return f"port {self._port} needs more privileges: choose one above 1023"
        return f"{self.device} cannot be bound ({short(str(error))})"


class UdpPort(OpenPort):
    """A bound port."""

    starts = "at a line"

    def __init__(self, name: str, bound: socket.socket) -> None:
        """Args: the name in messages; the socket, which it closes."""
        self._name, self._socket = name, bound
        self._reported = self._drop_count()
        bound.setblocking(False)

    def fetch(self) -> bytes:
        """Lines of the datagrams that have arrived; see OpenPort. The last line is whole, even beyond the limit."""
        lines = bytearray()
        try:
            if select.select([self._socket], [], [], READ_TIMEOUT)[0]:
                for _ in range(MAX_READ_BYTES):  # so that it also ends where only empty ones arrive
                    if len(lines) >= MAX_READ_BYTES or (data := self._receive()) is None:
                        break
                    lines += lines_of(data)
        except OSError as error:
            raise BadDevice(f"{self._name} can no longer be read ({short(str(error))})") from error
        return bytes(lines)

    def _receive(self) -> bytes | None:
        """The next datagram; None where none waits. Errors of earlier datagrams are ignored."""
        try:
            return self._socket.recv(MAX_DATAGRAM)
        except (BlockingIOError, InterruptedError, ConnectionError):
            return None

    def take_lost(self) -> int:
        """Datagrams that the system dropped since the last call: they came faster than they were fetched."""
        now, before = self._drop_count(), self._reported
        self._reported = now
        return (now - before) % (1 << 32)

    def _drop_count(self) -> int:
        """How many datagrams the system has dropped so far; 0 where it does not report it."""
        if sys.platform != "linux":
            return 0
        try:
            info = self._socket.getsockopt(socket.SOL_SOCKET, _MEMORY, 64)
        except OSError:
            return 0
        return struct.unpack_from("=I", info, 4 * _DROPS)[0] if len(info) >= 4 * (_DROPS + 1) else 0

    def waiting(self) -> int:
        """1 where a datagram waits."""
        return len(select.select([self._socket], [], [], 0)[0])

    def close(self) -> None:
        """Release the port."""
        self._socket.close()


UDP = Transport(
    ("udp://",), "udp://:47269", interface_and_port, lambda address, _baud, _reset: UdpEndpoint(address)
)
"""Datagrams."""
