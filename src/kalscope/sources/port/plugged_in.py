"""The serial ports that the system lists. Opens nothing."""

from __future__ import annotations

import re
from dataclasses import dataclass


@dataclass(frozen=True)
class PortInfo:
    """A serial port that the system lists."""

    device: str
    """What opens it: /dev/ttyACM0, COM3."""
    description: str
    """What the system calls it; "" where it gives no description."""
    serial_number: str
    """USB serial number, by which a board is found again under another name; "" where there is none."""
    manufacturer: str = ""
    """Maker of the USB chip or board; "" where unknown."""
    usb: tuple[int, int] | None = None
    """USB numbers of maker and product; None where it is not a USB port."""


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
