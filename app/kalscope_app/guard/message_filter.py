"""What a connected browser may send: every message is checked before viser handles it.

The holder of the link is trusted to use the dashboard, not to break it. Stock viser sets any attribute of a widget
that a client names, keeps any number of uploaded bytes, and opens a public tunnel to this machine when asked.
"""

from __future__ import annotations

import asyncio
import functools
import logging
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import viser

from kalscope_app.guard.message_schema import BROWSER_MESSAGES, Misbehaviour, check_fields, fitting_value
from kalscope_app.guard.upload_limits import UploadLimits
from kalscope_app.guard.viser_private import Channel, connections_of, messages, on_clients, socket_of

if TYPE_CHECKING:
    from viser.infra import WebsockClientConnection

    from kalscope_app.guard.viser_private import Dispatch

_log = logging.getLogger(__name__)

MAX_PER_SECOND = 300.0
"""Messages per second that one client may send in the long run; dragging a slider sends 20."""
MAX_BURST = 1000.0
"""Messages that it may send in one burst; an upload of 64 MiB has 128 parts."""
SETTLED_S = 0.3
"""Seconds without a change after which a widget's value is final; shorter than a pause in a drag."""


class RateLimit:
    """How many messages a client may still send: a token bucket."""

    def __init__(self, now: float) -> None:
        self._left, self._at = MAX_BURST, now

    def allows(self, now: float) -> bool:
        """Count one message; False if it is one too many."""
        self._left = min(MAX_BURST, self._left + (now - self._at) * MAX_PER_SECOND) - 1.0
        self._at = now
        return self._left >= 0.0


class WidgetSync:
    """Rebroadcasts a widget's final value so that all browsers agree. Runs on the event loop.

    viser sends a new value to all browsers but its sender. When two users move the same slider, each may receive
    the other's value after sending their own, and keep it: the screens then stay different. The same happens to
    one user whose text crosses what the program writes into the box.
    """

    def __init__(self, shared: Channel) -> None:
        self._shared = shared
        self._due: dict[str, asyncio.TimerHandle] = {}

    def changed(self, uuid: str) -> None:
        """A client has changed this widget of the shared panels."""
        if uuid in self._due:
            self._due[uuid].cancel()
        self._due[uuid] = asyncio.get_running_loop().call_later(SETTLED_S, self._rebroadcast, uuid)

    def _rebroadcast(self, uuid: str, sent: object = None) -> None:
        """Send the value until it has stayed the same: a thread may have set another one meanwhile."""
        del self._due[uuid]
        widget = self._shared.widget(uuid)
        if isinstance(widget, viser.GuiInputHandle) and widget.value != sent:  # buttons have no value
            value = widget.value
            self._shared.send(messages.GuiUpdateMessage(uuid, {"value": value}))
            again = asyncio.get_running_loop().call_later(SETTLED_S, self._rebroadcast, uuid, value)
            self._due[uuid] = again


class MessageFilter:
    """Validates and rate-limits client messages; disconnects offenders.

    Everything but `install` runs on the event loop, so nothing here needs a lock.
    """

    def __init__(
        self, server: viser.ViserServer, max_upload_bytes: int, on_refused: Callable[[str], None] | None
    ) -> None:
        self._server, self._socket = server, socket_of(server)
        self._connections = connections_of(self._socket)
        self._shared = Channel(self._socket)
        self._uploads = UploadLimits(self._shared, max_upload_bytes, on_refused)
        self._sync = WidgetSync(self._shared)
        self._rates: dict[int, RateLimit] = {}
        self._closing: dict[int, asyncio.Task[None]] = {}

    def install(self) -> None:
        """Filter all messages from now on.

        Raises:
            AttributeError, LookupError, TypeError, ValueError: viser's private names are not the known ones.
                In the hook of a new client, the same errors close that client's connection.
        """
        for kind in (messages.ShareUrlRequest, messages.ShareUrlDisconnect):
            self._shared.ignore(kind)
        self._server.request_share_url = lambda verbose=True: None  # noqa: ARG005
        self._filter(self._shared)
        on_clients(self._socket, self._on_connect, self._on_disconnect)

    def _on_connect(self, connection: WebsockClientConnection) -> None:
        channel = Channel(connection)
        self._rates[connection.client_id] = RateLimit(time.monotonic())
        self._uploads.channels[connection.client_id] = channel
        self._filter(channel)

    def _on_disconnect(self, connection: WebsockClientConnection) -> None:
        for known in (self._rates, self._closing, self._uploads.channels):
            known.pop(connection.client_id, None)
        # viser does not do this for a client that never sent its camera; its bytes would count forever.
        self._shared.drop_uploads(connection.client_id)

    def _filter(self, channel: Channel) -> None:
        channel.intercept(functools.partial(self._dispatch, channel))
        channel.filter(messages.GuiUpdateMessage, functools.partial(self._checked_update, channel))
        channel.filter(messages.GuiFormDirtyMessage, functools.partial(_checked_form, channel))
        channel.filter(messages.FileTransferStartUpload, functools.partial(self._uploads.checked_start, channel))
        channel.filter(messages.FileTransferPart, functools.partial(self._uploads.checked_part, channel))

    async def _dispatch(self, channel: Channel, stock: Dispatch, client_id: int, message: Any) -> None:
        """Check one message; viser dispatches each twice, for the shared panels and for those of the client."""
        if client_id in self._closing or client_id not in self._rates:
            return
        try:
            if channel is self._shared and not self._rates[client_id].allows(time.monotonic()):
                raise Misbehaviour("more messages than a user can cause")
            check_fields(message)
            await stock(client_id, message)
        except Misbehaviour as error:
            self._disconnect(client_id, str(error))
        except Exception as error:
            if isinstance(message, BROWSER_MESSAGES):
                raise  # the message was valid, so this is a bug in Kalscope
            self._disconnect(client_id, f"{type(message).__name__} that viser could not handle ({error!r})")

    def _disconnect(self, client_id: int, reason: str) -> None:
        connection = self._connections.get(client_id)
        if connection is not None and client_id not in self._closing:
            _log.info("client %d is disconnected: %s", client_id, reason)
            closing = connection.close(1008, "Kalscope cannot use what was sent")
            self._closing[client_id] = asyncio.get_running_loop().create_task(closing)

    def _checked_update(
        self, channel: Channel, _client_id: int, message: messages.GuiUpdateMessage
    ) -> messages.GuiUpdateMessage | None:
        """Of an update only the value, within the widget's range."""
        widget = channel.widget(message.uuid)
        if widget is None or "value" not in message.updates:
            return None
        low, high, options = (getattr(widget, name, None) for name in ("min", "max", "options"))
        value = fitting_value(widget.value, message.updates["value"], low, high, options)
        is_text = isinstance(widget, viser.GuiTextHandle)  # `text_boxes.js` shows the value sent back
        if channel is self._shared and (is_text or (value is not None and len(self._rates) > 1)):
            self._sync.changed(message.uuid)
        if value is None:
            return None
        return messages.GuiUpdateMessage(message.uuid, {"value": value})


def _checked_form(
    channel: Channel, _client_id: int, message: messages.GuiFormDirtyMessage
) -> messages.GuiFormDirtyMessage | None:
    """Only for a form that exists: viser would keep a message for each name that a client makes up."""
    return message if channel.is_form(message.uuid) else None
