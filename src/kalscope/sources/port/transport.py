"""What a transport must offer, its limits, and how messages repeat addresses and reasons."""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass

from kalscope.errors import BadDevice, BadSetting
from kalscope.sources.port.events import Start

# Limits that every transport keeps.


READ_TIMEOUT = 0.1
"""Seconds after which a read without data returns, so that close never waits longer."""
WRITE_TIMEOUT = 2.0
"""Seconds after which a write that is not accepted fails."""
CONNECT_TIMEOUT = 5.0
"""Seconds within which the other side must answer."""
MAX_READ_BYTES = 1 << 13
"""Bytes of one read: whether to stop is checked between two of them."""


# Addresses and reasons as messages repeat them: on one line, not too long, and without a password.


MAX_REASON_LENGTH = 200
"""Characters of a reason that comes from outside."""

_PASSWORD = re.compile(r"([^:/]*://[^:]*):(?!\d+@\d+\Z).*@", re.DOTALL)  # not host:port@baud


def refuse_password(address: str, where: str = "") -> None:
    """Refuse what may hold a password: an address is shown, recorded and shared.

    `scheme://user:123/456@host/name` reads as host, port and name, too. So an @ after a colon is always refused.

    Args:
        address: The address, without a baud rate.
        where: Where a password is put instead.

    Raises:
        BadSetting: there is an @ after a colon.
    """
    if _PASSWORD.match(address):
        instead = f": {where}" if where else ""
        raise BadSetting(
            f"an address must hold no password{instead}; an @ of a path or a topic is written %40"
            f" (got {quoted(address)})"
        )


def quoted(address: str) -> str:
    """An address as messages repeat it: without the password that may precede its last @, not too long."""
    match = _PASSWORD.match(address)
    shown = f"{match[1]}:…@{address[match.end() :]}" if match else address
    return f"{shown!r:.100}"


def short(text: str) -> str:
    """A text of another program on one line, not too long."""
    return " ".join(text.split())[:MAX_REASON_LENGTH]


# What a transport must offer: an address that may be opened again and again, and the port that is open.


class OpenPort(ABC):
    """An open port. Each method raises BadDevice where the connection is lost: a sentence without its full stop."""

    starts: Start = "inside a line"
    """Where its first byte is."""
    keeps = False
    """True where the other side keeps what is not read yet: it is then fetched no faster than it is used."""

    @abstractmethod
    def fetch(self) -> bytes:
        """Bytes that have arrived; after READ_TIMEOUT none.

        MAX_READ_BYTES at most, and beyond them only the end of a line, or a message, that is passed on whole.
        """

    @abstractmethod
    def waiting(self) -> int:
        """Bytes that wait to be read, or 1 where only that is known; 0 where there are none."""

    def take_lost(self) -> int:
        """Lines, or messages, lost since the last call because they came faster than they were fetched."""
        return 0

    def write(self, data: bytes) -> None:
        """Send all of it. Here: refuse, as most transports only receive."""
        del data
        raise BadDevice("nothing can be sent there: it is only read")

    @abstractmethod
    def close(self) -> None:
        """Release the port; may be called twice, and after the connection was lost. Raises nothing."""


class Endpoint(ABC):
    """One address over all its openings."""

    device: str
    """What is opened, as users know it: the path may change when a board is plugged in again."""

    when_silent: str = ""
    """What to check where nothing arrives, a sentence without its full stop; "" where silence may be all right."""

    @abstractmethod
    def open(self, is_ended: Callable[[], bool]) -> OpenPort:
        """Connect.

        Args:
            is_ended: True once the port is no longer needed; called at least every READ_TIMEOUT s where that is
                possible.

        Raises:
            BadDevice: it cannot be opened: why, and what to do, a sentence without its full stop.
        """


@dataclass(frozen=True)
class Transport:
    """One kind of address."""

    prefixes: tuple[str, ...]
    """How its addresses begin, in lower case; the usual one first."""
    example: str
    """Such an address, for help texts."""
    check: Callable[[str], object]
    """Raises BadSetting where an address is malformed; its return value is not used. Opens nothing."""
    endpoint: Callable[[str, int, bool], Endpoint]
    """The endpoint of an address, a baud rate, and whether the board may be reset; imports what it needs."""
    has_baud: bool = False
    """Whether an address may end with @ and a baud rate."""
    in_dashboard: bool = True
    """Whether it may be typed in the dashboard, too."""
    password: str = ""
    """Where its users put a password, for messages; "" where there is none."""

    def begins(self, address: str) -> bool:
        """Whether the address is of this kind."""
        return address.lower().startswith(self.prefixes)

    def refuse(self, address: str) -> None:
        """Raise BadSetting where an address is malformed, or holds a password."""
        if self.prefixes[0].endswith("://"):
            refuse_password(address, self.password)
        self.check(address)
