"""`kalscope ports`: what is plugged in, and how to open it."""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import Annotated

import typer

from kalscope.common.text import escaped, one_line
from kalscope.sources.port.plugged_in import PortInfo, list_ports

NONE_FOUND = (
    "No serial port was found. Plug the board in with a cable that carries data, and install the driver of its USB"
    " chip (CH340, CP210x) where the system has none. A port that is not listed opens by its path:"
    " kalscope open serial:/dev/ttyACM0. Without a board: kalscope demo-board"
)
"""What to do where nothing is plugged in."""

_HEADINGS = ("device", "description", "serial number")


def ports_command(
    as_json: Annotated[bool, typer.Option("--json", help="Print the ports as JSON.")] = False,
) -> None:
    """List the serial ports: device, description, serial number."""
    ports = list_ports()
    if as_json:
        print(escaped(json.dumps([asdict(port) for port in ports], indent=1, ensure_ascii=False)))
    else:
        print(ports_text(ports))


def ports_text(ports: tuple[PortInfo, ...]) -> str:
    """A table of the ports and the command that opens the first one; advice where there are none."""
    if not ports:
        return NONE_FOUND
    said = ((port.device, port.description, port.serial_number) for port in ports)
    rows = [_HEADINGS, *(tuple(one_line(cell) or "-" for cell in row) for row in said)]
    widths = [max(len(row[i]) for row in rows) for i in range(len(_HEADINGS))]
    lines = ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]
    first = next((port for port in ports if port.usb is not None), ports[0])  # a board is on USB
    return "\n".join([*lines, "", f"Open one: kalscope open serial:{one_line(first.device)}@115200"])
