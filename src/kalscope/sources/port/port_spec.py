"""Names of ports: what users type, and what is plugged in. Opens nothing."""

from __future__ import annotations

import re
from dataclasses import dataclass

from kalscope.errors import BadSetting

DEFAULT_BAUD = 115_200
MAX_BAUD = 20_000_000
"""No USB chip goes beyond 12 million baud; a larger number is a slip of the keyboard."""

_URL_SCHEMES = ("socket", "rfc2217", "loop", "spy", "alt", "hwgrep", "cp2110")
"""Schemes of pyserial's URLs."""

_NETWORK = re.compile(r"(?:socket|rfc2217)://", re.IGNORECASE)
_HOST_PORT = re.compile(r"\w+://(?:\[[0-9A-Fa-f:.]+\]|[^/:?@\s]+):[0-9]{1,5}(?:[/?].*)?", re.IGNORECASE)
_URL = re.compile(rf"(?:{'|'.join(_URL_SCHEMES)})://.+", re.IGNORECASE | re.DOTALL)
_DEVICE = re.compile(r"(?:\\\\\.\\)?COM[0-9]+|/dev/(?:tty|cu|pts/|serial/|rfcomm).*", re.IGNORECASE | re.DOTALL)
_BAUD = re.compile(r"(.*)@([^@/\\]*)", re.DOTALL)


@dataclass(frozen=True)
class PortInfo:
    """A serial port that the system lists."""

    device: str
    """What opens it: /dev/ttyACM0, COM3."""
    description: str
    """What the system calls it; "" where it has no words for it."""
    serial_number: str
    """USB serial number, by which a board is found again under another name; "" where there is none."""
    manufacturer: str = ""
    """Maker of the USB chip or board; "" where unknown."""
    usb: tuple[int, int] | None = None
    """USB numbers of maker and product; None where it is no USB port."""


@dataclass(frozen=True)
class PortSpec:
    """A port to be opened."""

    url: str
    """Path of the port (/dev/ttyACM0, COM3), or a URL of pyserial (socket://host:port, rfc2217://host:port)."""
    baud: int = DEFAULT_BAUD
    """Bits a second, 1 … 20,000,000; a pseudo-terminal and a network port do not care."""
    reset: bool = True
    """True lets DTR rise, as every terminal does: most Arduinos then restart. False keeps DTR and RTS low,
    as far as the driver obeys; boards with USB of their own (Leonardo, RP2040, ESP32-S3) then send nothing."""

    def __post_init__(self) -> None:
        if not self.url.strip() or "\x00" in self.url:
            raise BadSetting(f"port must be a path such as /dev/ttyACM0 or COM3, or a URL (got {self.url!r})")
        if _NETWORK.match(self.url) and not _HOST_PORT.fullmatch(self.url):
            raise BadSetting(
                f"an address must be socket://host:port or rfc2217://host:port (got {self.url!r:.100})"
            )
        if type(self.baud) is not int or not 1 <= self.baud <= MAX_BAUD:
            raise BadSetting(f"baud rate must be a whole number from 1 to {MAX_BAUD} (got {self.baud!r})")

    @property
    def is_url(self) -> bool:
        """True for a URL of pyserial, false for the path of a port."""
        return _URL.fullmatch(self.url) is not None

    @property
    def text(self) -> str:
        """What `port_of` reads back: "serial:PORT@BAUD", or the URL."""
        baud = "" if self.is_url and self.baud == DEFAULT_BAUD else f"@{self.baud}"
        return f"{self.url}{baud}" if self.is_url else f"serial:{self.url}{baud}"


def is_live(spec: str) -> bool:
    """True where `spec` names a port that streams, false where it names something finished: a file, a sample."""
    text = spec.strip()
    bare, _ = _split_baud(text)
    scheme, colon, _ = text.partition(":")
    return (colon == ":" and scheme.lower() == "serial") or bool(_URL.fullmatch(text) or _DEVICE.fullmatch(bare))


def port_of(text: str, *, reset: bool = True) -> PortSpec:
    """The port that `text` names.

    Args:
        text: "serial:PORT@BAUD", "serial:PORT", "PORT@BAUD", "PORT" (115200 baud), "socket://host:port",
            "rfc2217://host:port", "rfc2217://host:port@BAUD".
        reset: See PortSpec.

    Raises:
        BadSetting: no port is named, or the baud rate is no number of its range.
    """
    bare = text.strip()
    if bare[:7].lower() == "serial:":
        bare = bare[7:]
    url, baud = _split_baud(bare)
    if baud is None:
        return PortSpec(url, reset=reset)
    if not (baud.isascii() and baud.isdecimal()):
        raise BadSetting(f"baud rate must be a whole number, as in COM3@9600 (got {baud!r} in {text!r})")
    return PortSpec(url, int(baud), reset)


def _split_baud(text: str) -> tuple[str, str | None]:
    match = _BAUD.fullmatch(text)
    return (match[1], match[2]) if match else (text, None)


def list_ports() -> tuple[PortInfo, ...]:
    """The serial ports that the system knows, by name. A pseudo-terminal is never among them."""
    from serial.tools import list_ports as pyserial

    return tuple(sorted((_info(port) for port in pyserial.comports()), key=lambda info: _natural(info.device)))


def _info(port: object) -> PortInfo:
    def text(name: str) -> str:
        value = getattr(port, name, None)
        return "" if value in (None, "n/a") else str(value)

    vid, pid = getattr(port, "vid", None), getattr(port, "pid", None)
    usb = (vid, pid) if isinstance(vid, int) and isinstance(pid, int) else None
    return PortInfo(text("device"), text("description"), text("serial_number"), text("manufacturer"), usb)


def _natural(device: str) -> list[tuple[int, str]]:
    """COM10 after COM9."""
    return [(int(part) if part.isdecimal() else -1, part) for part in re.split(r"([0-9]+)", device)]
