"""The one place that knows which kinds of addresses there are, and the names of ports as users type them."""

from __future__ import annotations

import re
from dataclasses import dataclass

from kalscope.errors import BadSetting
from kalscope.sources.port.messages import MqttPort, UdpPort
from kalscope.sources.port.reader import OpenPort, quoted, refuse_password
from kalscope.sources.port.serial_port import PORT_NAME, SerialPort, SocketPort
from kalscope.sources.port.ssh import FilePort, SshPort

TRANSPORTS: tuple[type[OpenPort], ...] = (SerialPort, SshPort, SocketPort, UdpPort, MqttPort, FilePort)
"""All kinds of address, in the order in which help texts name them."""

_SERIAL = SerialPort.prefixes[0]
_SCHEME = re.compile(r"[A-Za-z][A-Za-z0-9+.-]*://")


def named_transport(text: str) -> type[OpenPort] | None:
    """The transport whose prefix `text` begins with; None for the bare path of a port, and for anything else."""
    return next((one for one in TRANSPORTS if text.lower().startswith(one.prefixes)), None)


def transport_of(text: str) -> type[OpenPort]:
    """The transport of an address; without a prefix it is the path of a serial port.

    Raises:
        BadSetting: its scheme is unknown.
    """
    found = named_transport(text)
    if found is None and _SCHEME.match(text) is not None:
        known = ", ".join(prefix for one in TRANSPORTS for prefix in one.prefixes if prefix.endswith("://"))
        raise BadSetting(f"an address must begin with one of {known} (got {quoted(text)})")
    return found or SerialPort


ADDRESS_EXAMPLES = (
    '"/dev/ttyACM0 or COM3@9600", "ssh://host/dev/ttyACM0@115200", "tcp://host:port",'
    ' "udp://:47269", "mqtt://broker/topic", "file:log.csv"'
)
"""Addresses of all kinds that users type, for help texts."""


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
        if "://" in self.url and self.transport is not FilePort:
            refuse_password(self.url)
        self.transport.check(self.url)
        if type(self.baud) is not int or not 1 <= self.baud <= MAX_BAUD:
            raise BadSetting(f"baud rate must be a whole number from 1 to {MAX_BAUD} (got {self.baud!r})")

    @property
    def transport(self) -> type[OpenPort]:
        """The kind of its address."""
        return transport_of(self.url)

    @property
    def text(self) -> str:
        """What `port_of` reads back: "serial:PORT@BAUD", or the address."""
        if self.transport is SerialPort:
            return f"{_SERIAL}{self.url}@{self.baud}"
        return self.url if self.baud == DEFAULT_BAUD else f"{self.url}@{self.baud}"


def is_live(spec: str) -> bool:
    """True where `spec` names a port that streams, false where it names something finished: a file, a sample."""
    text = spec.strip()
    return named_transport(text) is not None or PORT_NAME.fullmatch(_split_baud(text)[0]) is not None


def port_of(text: str, *, default_baud: str = str(DEFAULT_BAUD), reset: bool = True) -> PortSpec:
    """The port that `text` names.

    Args:
        text: "serial:PORT@BAUD", "serial:PORT", "PORT@BAUD", "PORT" (115200 baud), "tcp://host:port",
            "ssh://host/path@BAUD".
        default_baud: The baud rate where the address names none.
        reset: See PortSpec.

    Raises:
        BadSetting: no port is named, or the baud rate is not a number in its range.
    """
    address = text.strip()
    if address.lower().startswith(_SERIAL):
        address = address[len(_SERIAL) :].strip()
    url, baud = _split_baud(address) if transport_of(address).has_baud else (address, str(DEFAULT_BAUD))
    baud = default_baud if baud is None else baud
    if not (baud.isascii() and baud.isdecimal()):
        raise BadSetting(f"baud rate must be a whole number, as in COM3@9600 (got {baud!r} in {quoted(text)})")
    return PortSpec(url, int(baud[:10]), reset)  # more digits are too many in any case


def _split_baud(text: str) -> tuple[str, str | None]:
    match = _BAUD.fullmatch(text)
    return (match[1], match[2]) if match else (text, None)
