"""What a transport must offer: an address that may be opened again and again, and the port that is open."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass

from kalscope.errors import BadDevice
from kalscope.sources.port.events import Start
from kalscope.sources.port.transports.words import refuse_password


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
