"""The one place that knows which kinds of addresses there are, and the names of ports as users type them."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass

from kalscope.errors import BadSetting
from kalscope.sources.port.messages import (
    MqttPort,
    UdpPort,
    interface_and_port,
    mqtt_parts,
)
from kalscope.sources.port.reader import Opener, quoted, refuse_password
from kalscope.sources.port.serial_port import SerialPort, SocketPort, host_and_port, is_serial_device
from kalscope.sources.port.ssh import FILE_PREFIX, FilePort, SshPort, check_file, ssh_parts

# The kinds of addresses.


@dataclass(frozen=True)
class Transport:
    """One kind of address."""

    prefixes: tuple[str, ...]
    """How its addresses begin, in lower case; the usual one first."""
    example: str
    """Such an address, for help texts."""
    check: Callable[[str], object]
    """Raises BadSetting where an address is malformed; its return value is not used. Opens nothing."""
    opener: Opener
    """Opens it; imports what it needs."""
    has_baud: bool = False
    """Whether an address may end with @ and a baud rate."""

    def begins(self, address: str) -> bool:
        """Whether the address is of this kind."""
        return address.lower().startswith(self.prefixes)

    def refuse(self, address: str) -> None:
        """Raise BadSetting where an address is malformed, or holds a password."""
        if self.prefixes[0].endswith("://"):
            refuse_password(address)
        self.check(address)


SERIAL = Transport(("serial:",), "/dev/ttyACM0 or COM3@9600", lambda _path: None, SerialPort, has_baud=True)
"""A serial port of this computer; its path alone is an address, too."""
TRANSPORTS = (
    SERIAL,
    Transport(("ssh://",), "ssh://host/dev/ttyACM0@115200", ssh_parts, SshPort, has_baud=True),
    Transport(("tcp://", "socket://"), "tcp://host:port", host_and_port, SocketPort),
    Transport(("udp://",), "udp://:47269", interface_and_port, UdpPort),
    Transport(("mqtt://", "mqtts://"), "mqtt://broker/topic", mqtt_parts, MqttPort),
    Transport((FILE_PREFIX,), "file:log.csv", check_file, FilePort),
    Transport(("rfc2217://",), "rfc2217://host:port", host_and_port, SerialPort, has_baud=True),
)
"""All kinds of address, in the order in which help texts name them."""

_SCHEME = re.compile(r"[A-Za-z][A-Za-z0-9+.-]*://")


def named_transport(text: str) -> Transport | None:
    """The transport whose prefix `text` begins with; None for the bare path of a port, and for anything else."""
    return next((one for one in TRANSPORTS if one.begins(text)), None)


def transport_of(text: str) -> Transport:
    """The transport of an address; without a prefix it is the path of a serial port.

    Raises:
        BadSetting: its scheme is unknown.
    """
    found = named_transport(text)
    if found is None and _SCHEME.match(text) is not None:
        known = [one.prefixes[0] for one in TRANSPORTS if one.prefixes[0].endswith("://")]
        raise BadSetting(f"an address must begin with {', '.join(known[:-1])} or {known[-1]} (got {quoted(text)})")
    return found or SERIAL


def address_examples() -> str:
    """Addresses of all kinds that users type, for help texts."""
    return ", ".join(f'"{one.example}"' for one in TRANSPORTS)


# Names of ports as users type them. Nothing is opened.


DEFAULT_BAUD = 115_200
MAX_BAUD = 20_000_000
"""No USB chip goes beyond 12 million baud; a larger number is a typing error."""

_BAUD = re.compile(r"(.*)@([^@/\\]*)", re.DOTALL)


@dataclass(frozen=True)
class PortSpec:
    """A port to be opened."""

    url: str
    """Path of a serial port (/dev/ttyACM0, COM3), or an address such as tcp://host:port."""
    baud: int = DEFAULT_BAUD
    """Bits a second, 1 … 20,000,000; a pseudo-terminal and a network connection ignore it."""
    reset: bool = True
    """True lets DTR rise, as every terminal does: most Arduinos then restart. False keeps DTR and RTS low,
    as far as the driver allows; boards with native USB (Leonardo, RP2040, ESP32-S3) then send nothing."""

    def __post_init__(self) -> None:
        if not self.url.strip() or "\x00" in self.url:
            raise BadSetting(f"port must be a path such as /dev/ttyACM0 or COM3, or a URL (got {self.url!r})")
        self.transport.refuse(self.url)
        if type(self.baud) is not int or not 1 <= self.baud <= MAX_BAUD:
            raise BadSetting(f"baud rate must be a whole number from 1 to {MAX_BAUD} (got {self.baud!r})")

    @property
    def transport(self) -> Transport:
        """The kind of its address."""
        return transport_of(self.url)

    @property
    def text(self) -> str:
        """What `port_of` reads back: "serial:PORT@BAUD", or the address."""
        if self.transport is SERIAL:
            return f"{SERIAL.prefixes[0]}{self.url}@{self.baud}"
        return self.url if self.baud == DEFAULT_BAUD else f"{self.url}@{self.baud}"


def is_live(spec: str) -> bool:
    """True where `spec` names a port that streams, false where it names something finished: a file, a sample."""
    text = spec.strip()
    return named_transport(text) is not None or is_serial_device(_split_baud(text)[0])


def port_of(text: str, *, default_baud: str = str(DEFAULT_BAUD), reset: bool = True) -> PortSpec:
    """The port that `text` names.

    Args:
        text: "serial:PORT@BAUD", "serial:PORT", "PORT@BAUD", "PORT" (115200 baud), "tcp://host:port",
            "rfc2217://host:port", "rfc2217://host:port@BAUD".
        default_baud: The baud rate where the address names none.
        reset: See PortSpec.

    Raises:
        BadSetting: no port is named, or the baud rate is not a number in its range.
    """
    address = text.strip()
    if SERIAL.begins(address):
        address = address[len(SERIAL.prefixes[0]) :].strip()
    transport = transport_of(address)
    url, baud = _split_baud(address) if transport.has_baud else (address, str(DEFAULT_BAUD))
    baud = default_baud if baud is None else baud
    if not (baud.isascii() and baud.isdecimal()):
        try:
            transport.refuse(url)
        except BadSetting:
            transport.refuse(address)  # the whole one, since a message hides the password of a whole address only
        raise BadSetting(f"baud rate must be a whole number, as in COM3@9600 (got {baud!r} in {quoted(text)})")
    return PortSpec(url, int(baud[:10]), reset)  # more digits are too many in any case


def _split_baud(text: str) -> tuple[str, str | None]:
    match = _BAUD.fullmatch(text)
    return (match[1], match[2]) if match else (text, None)
