"""The registry of transports: the one place that knows which kinds of address there are."""

from __future__ import annotations

import re

from kalscope.errors import BadSetting
from kalscope.sources.port.transports.local_file import FILE
from kalscope.sources.port.transports.messages.mqtt import MQTT
from kalscope.sources.port.transports.messages.udp import UDP
from kalscope.sources.port.transports.network import TCP
from kalscope.sources.port.transports.serial_port import PYSERIAL, RFC2217, SERIAL
from kalscope.sources.port.transports.ssh.ports import SSH
from kalscope.sources.port.transports.transport import Transport
from kalscope.sources.port.transports.words import quoted

TRANSPORTS = (SERIAL, SSH, TCP, UDP, MQTT, FILE, RFC2217, PYSERIAL)
"""All kinds of address, in the order in which help texts name them."""

_SCHEME = re.compile(r"[A-Za-z][A-Za-z0-9+.-]*://")


def named_transport(text: str) -> Transport | None:
    """The transport whose prefix `text` begins with; None for the bare path of a port, and for anything else."""
    return next((one for one in TRANSPORTS if one.begins(text)), None)


def transport_of(text: str, *, in_dashboard: bool = False) -> Transport:
    """The transport of an address; without a prefix it is the path of a serial port.

    Args:
        text: The address.
        in_dashboard: Whether it was typed in the dashboard.

    Raises:
        BadSetting: its scheme is unknown, or not allowed in the dashboard.
    """
    found = named_transport(text)
    if found is None and _SCHEME.match(text) is None:
        return SERIAL
    if found is None or (in_dashboard and not found.in_dashboard):
        known = [one.prefixes[0] for one in TRANSPORTS if one.in_dashboard and one.prefixes[0].endswith("://")]
        raise BadSetting(f"an address must begin with {', '.join(known[:-1])} or {known[-1]} (got {quoted(text)})")
    return found


def address_examples() -> str:
    """Addresses of all kinds that users type, for help texts."""
    return ", ".join(f'"{one.example}"' for one in TRANSPORTS if one.in_dashboard)
