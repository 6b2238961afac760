"""What a connected browser may send, and how much: every message is checked before viser sees it."""

from __future__ import annotations

import asyncio
import functools
import logging
import math
import sys
import time
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, cast

import msgspec
import viser
from viser import _messages as messages

from kalscope_app.guard.viser_private import Channel, connections_of, on_clients, socket_of

if TYPE_CHECKING:
    from viser.infra import WebsockClientConnection

    from kalscope_app.guard.viser_private import Dispatch


# What a client's message may contain, as pure functions: viser stores the content unchecked.


MAX_TEXT = 10_000
"""Characters in a text box."""
MAX_NAME = 1_000
"""Characters in any other text, such as the name of an uploaded file; file systems stop at 255."""
MAX_ITEMS = 16
"""Numbers in a vector; an orientation has 4."""
MAX_INTEGER = 2**53
"""The largest whole number of JavaScript."""
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

BROWSER_MESSAGES = (
    messages.GuiUpdateMessage,
    messages.GuiFormSubmitMessage,
    messages.GuiFormDirtyMessage,
    messages.GuiButtonHoldMessage,
    messages.CommandTriggerMessage,
    messages.FileTransferStartUpload,
    messages.FileTransferPart,
    messages.ViewerCameraMessage,
    messages.SceneNodeClickMessage,
    messages.SceneNodeDragMessage,
    messages.ScenePointerMessage,
)
"""The messages that a browser sends to a dashboard like ours."""


def check_fields(message: object) -> None:
    """Check that each field of a message has the type that viser declares, and a plausible size.

    The values of a GuiUpdateMessage are left to `fitting_value`, which knows the widget.

    Raises:
        Misbehaviour: a field is not what it must be.
    """
    kind = type(message)
    if kind not in BROWSER_MESSAGES:
        return
    try:
        msgspec.convert(vars(message), kind, builtin_types=(bytes,))
    except (msgspec.ValidationError, OverflowError) as error:
        raise Misbehaviour(f"an invalid {kind.__name__}: {error}") from None
    for name, value in vars(message).items():
        limit = MAX_SCREEN if name in ("image_width", "image_height") else MAX_INTEGER
        if not _is_possible(value, limit):
            raise Misbehaviour(f"{kind.__name__} with an invalid {name}")


def _is_possible(value: object, max_integer: int) -> bool:
    if isinstance(value, str):
        return len(value) <= MAX_NAME
    if isinstance(value, float):
        return math.isfinite(value)
    if isinstance(value, int):
        return abs(value) <= max_integer
    if isinstance(value, tuple):
        items = cast("tuple[object, ...]", value)
        return len(items) <= MAX_ITEMS and all(_is_possible(item, max_integer) for item in items)
    return True


# How much browsers may upload: the bytes are counted before viser stores them.


MAX_UPLOAD_BYTES = 64 * 2**20
"""Size of an upload, by default. Larger files are opened by path."""


STALLED_S = 30.0
"""Seconds without a part after which an upload no longer counts."""

MIN_PART_BYTES = 1024
"""A browser cuts an upload into parts of 512 KiB; one that announces parts smaller than this is refused."""


MAX_UPLOADS = 2
"""Unfinished uploads at a time, of different clients."""


def upload_refusal(size_bytes: int, part_count: int, max_bytes: int) -> str | None:
    """Why an announced upload of this many bytes and parts cannot be taken, or None if it can."""
    if size_bytes > max_bytes:
        return (
            f"This file has {size_bytes / 2**20:.1f} MiB; up to {max_bytes / 2**20:g} MiB can be uploaded. "
            "Start Kalscope with the file's path instead: kalscope open FILE"
        )
    fewest, most = min(size_bytes, 1), -(-size_bytes // MIN_PART_BYTES)
    return None if 0 <= fewest <= part_count <= most else "This upload could not be understood."


class UploadLimits:
    """Refuses uploads that are too large or belong to another client. Runs on the event loop."""

    def __init__(self, shared: Channel, max_bytes: int, on_refused: Callable[[str], None] | None) -> None:
        self._max_bytes, self._on_refused = max_bytes, on_refused
        self.channels = {-1: shared}
        """The panels to which files may be uploaded: the shared ones, then by client id from 0."""
        self._last_part: dict[str, float] = {}

    def checked_start(
        self, channel: Channel, client_id: int, message: messages.FileTransferStartUpload
    ) -> messages.FileTransferStartUpload | None:
        """The announcement of an upload, if there is room for it."""
        name = message.transfer_uuid
        if name in channel.uploads or not _is_upload_button(channel, message.source_component_uuid):
            return None
        self._drop_stalled()
        reason = upload_refusal(message.size_bytes, message.part_count, self._max_bytes)
        owners = [one["client_id"] for channel in self.channels.values() for one in channel.uploads.values()]
        if reason is None and (client_id in owners or len(owners) >= MAX_UPLOADS):
            reason = "Other uploads are still under way. Try again when they have ended."
        if reason is not None:
            self._refuse(client_id, message, reason)
            return None
        self._last_part[name] = time.monotonic()
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
        if not _is_upload_button(channel, message.source_component_uuid):
            del channel.uploads[name]
            return None
        if upload["transferred_bytes"] + len(message.content) > upload["total_bytes"]:
            del channel.uploads[name]
            self._refuse(client_id, message, "This upload has more bytes than it announced.")
            raise Misbehaviour("an upload with more bytes than announced")
        self._last_part[name] = time.monotonic()
        return message

    def _drop_stalled(self) -> None:
        """No client can block the others by announcing a file and never sending it."""
        now = time.monotonic()
        for channel in self.channels.values():
            for name in [name for name in channel.uploads if now - self._last_part.get(name, now) > STALLED_S]:
                del channel.uploads[name]
        under_way = {name for channel in self.channels.values() for name in channel.uploads}
        self._last_part = {name: when for name, when in self._last_part.items() if name in under_way}

    def _refuse(
        self, client_id: int, message: messages.FileTransferStartUpload | messages.FileTransferPart, reason: str
    ) -> None:
        """Free the sender's upload button, which waits for an acknowledgement, and say why."""
        channel = self.channels.get(client_id)
        if channel is not None:
            channel.send(messages.FileTransferPartAck(message.source_component_uuid, message.transfer_uuid, 0, 0))
            # The browser's own notice would now claim success.
            channel.send(messages.RemoveNotificationMessage(f"upload-{message.transfer_uuid}"))
        if self._on_refused is not None:
            self._on_refused(reason)


def _is_upload_button(channel: Channel, uuid: str | None) -> bool:
    return isinstance(channel.widget(uuid), viser.GuiUploadButtonHandle)


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
