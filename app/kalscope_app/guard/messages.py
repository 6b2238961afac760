"""What a connected browser may send, and how much: every message is checked before viser sees it."""
# viser leaves the type arguments of its coroutines open.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

import asyncio
import functools
import logging
import sys
import time
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, cast

import msgspec
import viser
from viser import _messages as messages

from kalscope_app.guard.viser_private import Channel, connection_of, socket_of

if TYPE_CHECKING:
    from viser.infra import Message, WebsockClientConnection


# What a client's message may contain, as pure functions: viser stores the content unchecked.


MAX_TEXT = 10_000
"""Characters in a text box."""
MAX_NAME = 1_000
"""Characters in any other text, such as the name of an uploaded file; file systems stop at 255."""
MAX_ITEMS = 16
"""Numbers in a vector; an orientation has 4."""
MAX_NUMBER = 2**53
"""The largest number in other messages than of a value: the largest whole number of JavaScript."""
MAX_SCREEN = 100_000
"""Width and height of a browser's canvas, px."""


class Misbehaviour(Exception):
    """A message that no browser would send; its sender is disconnected."""


def fitting_value(
    current: object,
    value: object,
    low: float | None = None,
    high: float | None = None,
    options: Sequence[str] | None = None,
) -> object | None:
    """The value as the widget may take it, clamped to its range; None if the widget must stay as it is.

    Args:
        current: the value of the widget; the new one must be of the same kind.
        value: the value that was sent.
        low: the least number allowed.
        high: the largest number allowed.
        options: the texts allowed.
    """
    if isinstance(current, bool):
        return value if isinstance(value, bool) else None
    if isinstance(current, int | float):
        return _fitting_number(value, low, high)
    if isinstance(current, str):
        if not isinstance(value, str) or len(value) > MAX_TEXT:
            return None
        return value if options is None or value in options else None
    if isinstance(current, tuple) and isinstance(value, list | tuple):
        now, new = cast("tuple[object, ...]", current), cast("Sequence[object]", value)
        if len(now) == len(new):
            fitting = tuple(fitting_value(*pair, low, high, options) for pair in zip(now, new, strict=True))
            return None if None in fitting else fitting
    return None


def _fitting_number(value: object, low: float | None, high: float | None) -> float | None:
    """A browser sends the text at each key press, so an unfinished number outside the range is not an error."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    if not abs(value) <= sys.float_info.max:  # NaN, infinite, or an integer beyond every float
        return None
    value = value if low is None else max(value, low)
    return value if high is None else min(value, high)


# --- the fields of whole messages -------------------------------------------------------------------------


def check_fields(message: object) -> None:
    """Check that each field of a message has the type that viser declares, and a plausible size.

    The values of a GuiUpdateMessage are left to `fitting_value`, which knows the widget.

    Raises:
        Misbehaviour: a field is not what it must be.
    """
    kind = type(message)
    try:
        msgspec.convert(vars(message), kind, builtin_types=(bytes,))
    except (msgspec.ValidationError, OverflowError) as error:
        raise Misbehaviour(f"an invalid {kind.__name__}: {error}") from None
    for name, value in vars(message).items():
        limit = MAX_SCREEN if name in ("image_width", "image_height") else MAX_NUMBER
        if not _is_possible(value, limit):
            raise Misbehaviour(f"{kind.__name__} with an invalid {name}")


def _is_possible(value: object, most: int) -> bool:
    if isinstance(value, str):
        return len(value) <= MAX_NAME
    if isinstance(value, int | float):
        return abs(value) <= most  # false for NaN
    if isinstance(value, tuple):
        items = cast("tuple[object, ...]", value)
        return len(items) <= MAX_ITEMS and all(_is_possible(item, most) for item in items)
    return True


# How much browsers may upload: the bytes are counted before viser stores them.


MAX_UPLOAD_BYTES = 64 * 2**20
"""Size of an upload, at most. Larger files are opened by path."""


STALLED_S = 30.0
"""Seconds without a part after which an upload no longer counts."""

MIN_PART_BYTES = 1024
"""A browser cuts an upload into parts of 512 KiB; one that announces parts smaller than this is refused."""


def upload_refusal(size_bytes: int, part_count: int) -> str | None:
    """Why an announced upload of this many bytes and parts cannot be taken, or None if it can."""
    if size_bytes > MAX_UPLOAD_BYTES:
        return (
            f"This file has {size_bytes / 2**20:.1f} MiB; up to {MAX_UPLOAD_BYTES / 2**20:g} MiB can be uploaded. "
            "Start Kalscope with the file's path instead: kalscope open FILE"
        )
    fewest, most = min(size_bytes, 1), -(-size_bytes // MIN_PART_BYTES)
    return None if 0 <= fewest <= part_count <= most else "This upload could not be understood."


class UploadLimits:
    """Takes one upload at a time, within its announced size. Runs on the event loop."""

    def __init__(self, on_refused: Callable[[str], None] | None) -> None:
        self._on_refused = on_refused
        self.clients: dict[int, Channel] = {}
        """The panels of each client."""
        self._uploads: dict[str, Any] = {}
        self._name, self._last_part = "", 0.0  # of the newest upload, which is in `_uploads` until it has ended

    def checked_start(
        self, channel: Channel, client_id: int, message: messages.FileTransferStartUpload
    ) -> messages.FileTransferStartUpload | None:
        """The announcement of an upload, if there is room for it."""
        name = message.transfer_uuid
        if name in channel.uploads or not channel.is_upload_button(message.source_component_uuid):
            return None
        if time.monotonic() - self._last_part > STALLED_S:  # it cannot block the others for ever
            self._uploads.pop(self._name, None)
        reason = upload_refusal(message.size_bytes, message.part_count)
        if reason is None and self._name in self._uploads:
            reason = "Another upload is still under way. Try again when it has ended."
        if reason is not None:
            self._refuse(client_id, message, reason)
            return None
        self._uploads, self._name, self._last_part = channel.uploads, name, time.monotonic()
        return message

    def checked_part(
        self, channel: Channel, client_id: int, message: messages.FileTransferPart
    ) -> messages.FileTransferPart | None:
        """A part of an upload, if it is the sender's own and within the announced size.

        Raises:
            Misbehaviour: it is more than was announced.
        """
        name = message.transfer_uuid
        upload = channel.uploads.get(name)
        if upload is None or upload["client_id"] != client_id:
            return None
        if not channel.is_upload_button(message.source_component_uuid):
            del channel.uploads[name]
            return None
        if upload["transferred_bytes"] + len(message.content) > upload["total_bytes"]:
            del channel.uploads[name]
            self._refuse(client_id, message, "This upload has more bytes than it announced.")
            raise Misbehaviour("an upload with more bytes than announced")
        self._last_part = time.monotonic()
        return message

    def _refuse(
        self, client_id: int, message: messages.FileTransferStartUpload | messages.FileTransferPart, reason: str
    ) -> None:
        """Free the sender's upload button, which waits for an acknowledgement, and say why."""
        send = self.clients[client_id].send
        send(messages.FileTransferPartAck(message.source_component_uuid, message.transfer_uuid, 0, 0))
        # The browser's own notice would now claim success.
        send(messages.RemoveNotificationMessage(f"upload-{message.transfer_uuid}"))
        if self._on_refused is not None:
            self._on_refused(reason)


# What a connected browser may send: every message is checked before viser handles it.
#
# The holder of the link is trusted to use the dashboard, not to break it. Stock viser sets any attribute of a
# widget that a client names, keeps any number of uploaded bytes, and opens a public tunnel to this machine when
# asked.


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

    def __init__(self, server: viser.ViserServer, on_refused: Callable[[str], None] | None) -> None:
        self._server, self._socket = server, socket_of(server)
        self._shared = Channel(self._socket)
        self._sync = WidgetSync(self._shared)
        self._rates: dict[int, RateLimit] = {}
        self._closing: dict[int, asyncio.Task[None]] = {}
        uploads = UploadLimits(on_refused)
        self._clients = uploads.clients
        self._checks: dict[type[Message], Callable[[Channel, int, Any], Message | None]] = {
            messages.GuiUpdateMessage: self._checked_update,
            messages.FileTransferStartUpload: uploads.checked_start,
            messages.FileTransferPart: uploads.checked_part,
        }

    def install(self) -> None:
        """Filter all messages from now on.

        Raises:
            AttributeError, LookupError, TypeError, ValueError: viser's private names are not the known ones.
                In the hook of a new client, the same errors close that client's connection.
        """
        for kind in (messages.ShareUrlRequest, messages.ShareUrlDisconnect):
            del self._shared.handlers[kind]
        self._server.request_share_url = lambda verbose=True: None  # noqa: ARG005
        self._filter(self._shared)
        self._socket.on_client_connect(self._on_connect)
        self._socket.on_client_disconnect(self._on_disconnect)

    def _on_connect(self, connection: WebsockClientConnection) -> None:
        channel = Channel(connection)
        self._rates[connection.client_id] = RateLimit(time.monotonic())
        self._clients[connection.client_id] = channel
        self._filter(channel)

    def _on_disconnect(self, connection: WebsockClientConnection) -> None:
        # viser does not do this for a client that never sent its camera; its bytes would count until they stall.
        for channel in (self._shared, self._clients.pop(connection.client_id, self._shared)):
            channel.drop_uploads(connection.client_id)
        for known in (self._rates, self._closing):
            known.pop(connection.client_id, None)

    def _filter(self, channel: Channel) -> None:
        # It marks a form's title, and ours have none; viser would keep one for each name that a client makes up.
        del channel.handlers[messages.GuiFormDirtyMessage]
        if missing := self._checks.keys() - channel.handlers.keys():
            raise LookupError(f"viser does not handle {missing}")
        channel.intercept(functools.partial(self._dispatch, channel))

    async def _dispatch(self, channel: Channel, client_id: int, message: Message) -> None:
        """Check one message; viser dispatches each twice, for the shared panels and for those of the client."""
        if client_id in self._closing or client_id not in self._rates:
            return
        checked: Message | None = message
        try:
            if channel is self._shared and not self._rates[client_id].allows(time.monotonic()):
                raise Misbehaviour("more messages than a user can cause")
            if type(message) not in channel.handlers:
                return
            check_fields(message)
            if check := self._checks.get(type(message)):
                checked = check(channel, client_id, message)
        except Misbehaviour as error:
            self._disconnect(client_id, str(error))
            return
        if checked is not None:
            await channel.handle(client_id, checked)

    def _disconnect(self, client_id: int, reason: str) -> None:
        connection = connection_of(self._socket, client_id)
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
        return None if value is None else messages.GuiUpdateMessage(message.uuid, {"value": value})
