"""One gate for all that connected clients send: who sends the impossible, or too much of it, is disconnected."""

from __future__ import annotations

import logging
import time
from typing import TYPE_CHECKING, Any

from kalscope_app.guard.message_schema import FIELDS, Misbehaviour, check_fields

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine

    import viser
    from viser.infra import WebsockClientConnection, WebsockMessageHandler

_log = logging.getLogger(__name__)

MESSAGES_PER_SECOND = 300.0
"""What one client may send over time; a hand on a slider makes 20."""
BURST = 1000.0
"""What it may send at once; an upload of 64 MiB has 128 parts."""


class Allowance:
    """How many messages a client may still send: it refills with time. Pure but for the clock it is told."""

    def __init__(self, now: float) -> None:
        self._left, self._at = BURST, now

    def take(self, now: float) -> bool:
        """Use up one; False if none is left."""
        self._left = min(BURST, self._left + (now - self._at) * MESSAGES_PER_SECOND) - 1.0
        self._at = now
        return self._left >= 0.0


class ClientGate:
    """Stands before viser's dispatch of messages. Everything but `install` runs on the event loop."""

    def __init__(self, server: viser.ViserServer) -> None:
        self._websock = server._websock_server
        self._allowances: dict[int, Allowance] = {}
        self._closing: dict[int, Any] = {}

    def install(self) -> None:
        """Stand in the way of every message from now on.

        Raises:
            AttributeError: viser's private names are not the known ones.
        """
        self._websock._live_connections.get(-1)  # so that a missing name shows now
        self._gate(self._websock, counts=True)
        self._websock.on_client_connect(self._on_connect)
        self._websock.on_client_disconnect(self._on_disconnect)

    def _on_connect(self, connection: WebsockClientConnection) -> None:
        self._allowances[connection.client_id] = Allowance(time.monotonic())
        self._gate(connection, counts=False)

    def _on_disconnect(self, connection: WebsockClientConnection) -> None:
        self._allowances.pop(connection.client_id, None)
        self._closing.pop(connection.client_id, None)

    def _gate(self, channel: WebsockMessageHandler, *, counts: bool) -> None:
        """Gate one dispatch; viser has two for each message, the shared one and the client's, and one counts it."""
        stock: Callable[..., Coroutine[Any, Any, None]] = channel._handle_incoming_message

        async def gated(client_id: Any, message: Any) -> None:
            if client_id in self._closing or client_id not in self._allowances:
                return
            try:
                if counts and not self._allowances[client_id].take(time.monotonic()):
                    raise Misbehaviour("more messages than a hand can make")
                check_fields(message)
                await stock(client_id, message)
            except Misbehaviour as error:
                self._expel(client_id, str(error))
            except Exception as error:
                if type(message) in FIELDS:
                    raise  # the message was as it must be, so the mistake is ours
                self._expel(client_id, f"{type(message).__name__} that viser could not take ({error!r})")

        setattr(channel, "_handle_incoming_message", gated)  # noqa: B010  (its type says: a method, not this)

    def _expel(self, client_id: int, why: str) -> None:
        connection = self._websock._live_connections.get(client_id)
        if connection is None or client_id in self._closing:
            return
        _log.info("client %d is disconnected: %s", client_id, why)
        loop = self._websock._background_event_loop
        assert loop is not None, "messages come from a running loop"
        self._closing[client_id] = loop.create_task(connection.close(1008, "Kalscope cannot use what was sent"))
