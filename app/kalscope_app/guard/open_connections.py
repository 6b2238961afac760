"""The connections that no valid request has come on: the oldest is closed where there are too many.

Anybody who reaches the port may open a connection, send nothing and keep it; each takes one of the descriptors that
the files of the program need too.
"""

from __future__ import annotations

import logging
import math
import time
from typing import TYPE_CHECKING

from websockets.asyncio.server import ServerConnection

if TYPE_CHECKING:
    import asyncio

_log = logging.getLogger(__name__)

MAX_UNKNOWN = 64
"""Connections without a valid request at a time. macOS gives a program 256 descriptors, Linux 1024."""

BURST = 8
"""Connections that the event loop accepts before it counts them."""

REPEAT_S = 60.0
"""Seconds for which the warning is not repeated."""


class OpenConnections:
    """Counts connections from their start until a request on them is allowed."""

    def __init__(self) -> None:
        self._unknown: dict[ServerConnection, None] = {}
        self._warned = -math.inf
        counted = self

        class Counted(ServerConnection):
            def connection_made(self, transport: asyncio.BaseTransport) -> None:
                super().connection_made(transport)
                counted._add(self)

            def connection_lost(self, exc: Exception | None) -> None:
                counted.allow(self)
                super().connection_lost(exc)

        self.connection_type = Counted
        """For `create_connection` of websockets."""

    def allow(self, connection: ServerConnection) -> None:
        """A valid request came on it, or it has ended: no longer count it."""
        self._unknown.pop(connection, None)

    def _add(self, connection: ServerConnection) -> None:
        self._unknown[connection] = None
        if len(self._unknown) <= MAX_UNKNOWN:
            return
        oldest = next(iter(self._unknown))
        self.allow(oldest)
        oldest.transport.abort()
        if (now := time.monotonic()) - self._warned >= REPEAT_S:
            self._warned = now
            _log.warning(
                "too many open connections: another program opens them and sends no valid request. "
                "More than %d are not kept, the oldest is closed first. The dashboard keeps running.",
                MAX_UNKNOWN,
            )
