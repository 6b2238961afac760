"""Addresses and reasons as messages repeat them: on one line, not too long, and without a password."""

from __future__ import annotations

import re

from kalscope.errors import BadSetting

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
