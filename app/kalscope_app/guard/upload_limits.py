"""What a connected browser may send: viser's own handlers, wrapped.

The holder of the link is trusted to use the dashboard, not to break it. Stock viser sets any attribute of a
widget that a client names, keeps any number of uploaded bytes, and stores a file as the value of any widget.
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

import viser
from viser import _messages as messages

from kalscope_app.guard.message_schema import Misbehaviour, fitting_value
from kalscope_app.guard.widget_sync import Agreement

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine

    from viser.infra import WebsockClientConnection, WebsockMessageHandler

_SHARED = -1
"""The place of `server.gui` among the client ids, which count from 0."""

CLIENTS_AT_A_TIME = 2
"""How many clients may upload files of the largest size at once."""

STALLED = 30.0
"""Seconds without a part after which an upload no longer holds its place."""

_MIN_PART_BYTES = 1024
"""A browser cuts an upload into parts of 512 KiB; a plan of parts smaller than this is no honest upload."""


def upload_refusal(
    size_bytes: object, part_count: object, bytes_under_way: int, max_bytes: int, own_bytes: int = 0
) -> str | None:
    """Why an announced upload cannot be taken, or None if it can.

    Args:
        size_bytes: the size the client declares; anything may come over the wire.
        part_count: the number of parts it declares.
        bytes_under_way: declared sizes of the uploads not yet complete, of all clients.
        max_bytes: the most that one client may need at a time; all together may need CLIENTS_AT_A_TIME times it.
        own_bytes: the same of this client alone.
    """
    if type(size_bytes) is not int or type(part_count) is not int or size_bytes < 0:
        return "This upload could not be understood."
    if size_bytes > max_bytes:
        return (
            f"This file has {size_bytes / 2**20:.1f} MiB; up to {max_bytes / 2**20:g} MiB can be uploaded. "
            "Start Kalscope with the file's path instead: kalscope open FILE"
        )
    if own_bytes + size_bytes > max_bytes or bytes_under_way + size_bytes > CLIENTS_AT_A_TIME * max_bytes:
        return "Other uploads are still under way. Try again when they have ended."
    fewest, most = min(size_bytes, 1), -(-size_bytes // _MIN_PART_BYTES)
    return None if fewest <= part_count <= most else "This upload could not be understood."


def disable_sharing(server: viser.ViserServer) -> None:
    """Let no client, and no slip of ours, open viser's public tunnel to this machine."""
    for message_class in (messages.ShareUrlRequest, messages.ShareUrlDisconnect):
        del server._websock_server._incoming_handlers[message_class]
    server.request_share_url = lambda verbose=True: None  # noqa: ARG005


class ClientLimits:
    """Widget updates reduced to `value`, uploads counted before they are stored.

    Everything but `install` runs on the event loop, so nothing here needs a lock.
    """

    def __init__(
        self, server: viser.ViserServer, max_upload_bytes: int, on_refused: Callable[[str], None] | None
    ) -> None:
        self._server = server
        self._max_upload_bytes = max_upload_bytes
        self._on_refused = on_refused
        self._guis: dict[int, viser.GuiApi] = {}
        self._agreement = Agreement(server)
        self._last_part: dict[str, float] = {}

    def install(self) -> None:
        """Limit the shared panels now and the panels of each client as it connects.

        Raises:
            AttributeError, LookupError, TypeError, ValueError: viser's private names are not the known ones.
                Raised in the hook of a new client, the same errors close that client's connection.
        """
        websock = self._server._websock_server
        self._limit(websock, _SHARED)
        websock.on_client_connect(self._on_connect)
        websock.on_client_disconnect(self._on_disconnect)

    def _on_connect(self, connection: WebsockClientConnection) -> None:
        self._limit(connection, connection.client_id)

    def _on_disconnect(self, connection: WebsockClientConnection) -> None:
        self._guis.pop(connection.client_id, None)
        # viser forgets this for a client that never sent its camera; its bytes would count for ever.
        self._guis[_SHARED]._drop_uploads_from_client(connection.client_id)  # pyright: ignore[reportArgumentType]

    def _limit(self, channel: WebsockMessageHandler, scope: int) -> None:
        handlers = channel._incoming_handlers
        (stock_update,) = handlers[messages.GuiUpdateMessage]
        (stock_start,) = handlers[messages.FileTransferStartUpload]
        (stock_part,) = handlers[messages.FileTransferPart]
        gui = stock_start.__self__  # pyright: ignore[reportFunctionMemberAccess]
        if not isinstance(gui, viser.GuiApi):
            raise TypeError(f"uploads are handled by {type(gui).__name__}")
        self._guis[scope] = gui
        self._bytes_under_way()  # so that a missing name shows now
        (stock_dirty,) = handlers[messages.GuiFormDirtyMessage]
        handlers[messages.GuiUpdateMessage] = [self._checked_update(gui, stock_update, scope == _SHARED)]
        handlers[messages.GuiFormDirtyMessage] = [_of_known_form(gui, stock_dirty)]
        handlers[messages.FileTransferStartUpload] = [self._checked_start(gui, stock_start)]
        handlers[messages.FileTransferPart] = [self._checked_part(gui, stock_part)]

    def _checked_update(
        self, gui: viser.GuiApi, stock: Callable[..., Any], is_shared: bool
    ) -> Callable[..., Coroutine[Any, Any, None]]:
        async def on_update(client_id: int, message: messages.GuiUpdateMessage) -> None:
            widget = gui._gui_input_handle_from_uuid.get(message.uuid)
            if widget is None or "value" not in message.updates:
                return
            low, high, options = (getattr(widget, name, None) for name in ("min", "max", "options"))
            value = fitting_value(widget._impl.value, message.updates["value"], low, high, options)
            if value is None:
                return
            await stock(client_id, messages.GuiUpdateMessage(message.uuid, {"value": value}))
            if is_shared:
                self._agreement.changed(message.uuid)

        return on_update

    def _checked_start(self, gui: viser.GuiApi, stock: Callable[..., Any]) -> Callable[..., None]:
        def on_start(client_id: int, message: messages.FileTransferStartUpload) -> None:
            is_known = message.transfer_uuid in gui._current_file_upload_states
            if is_known or not _is_upload_button(gui, message.source_component_uuid):
                return
            self._drop_stalled()
            why = upload_refusal(
                message.size_bytes,
                message.part_count,
                self._bytes_under_way(),
                self._max_upload_bytes,
                self._bytes_under_way(client_id),
            )
            if why is None:
                self._last_part[message.transfer_uuid] = time.monotonic()
                stock(client_id, message)
            else:
                self._refuse(client_id, message, why)

        return on_start

    def _checked_part(self, gui: viser.GuiApi, stock: Callable[..., Any]) -> Callable[..., None]:
        def on_part(client_id: int, message: messages.FileTransferPart) -> None:
            upload = gui._current_file_upload_states.get(message.transfer_uuid)
            if upload is None or upload["client_id"] != client_id:
                return
            self._last_part[message.transfer_uuid] = time.monotonic()
            if not _is_upload_button(gui, message.source_component_uuid):
                del gui._current_file_upload_states[message.transfer_uuid]
            elif upload["transferred_bytes"] + len(message.content) > upload["total_bytes"]:
                del gui._current_file_upload_states[message.transfer_uuid]
                self._refuse(client_id, message, "This upload has more bytes than it announced.")
                raise Misbehaviour("an upload with more bytes than announced")
            else:
                stock(client_id, message)

        return on_part

    def _bytes_under_way(self, client_id: int | None = None) -> int:
        return sum(
            upload["total_bytes"]
            for gui in self._guis.values()
            for upload in gui._current_file_upload_states.values()
            if client_id in (None, upload["client_id"])
        )

    def _drop_stalled(self) -> None:
        """Nobody can keep others from uploading by announcing a file and never sending it."""
        now, under_way = time.monotonic(), set()
        for gui in self._guis.values():
            uploads = gui._current_file_upload_states
            for name in [name for name in uploads if now - self._last_part.get(name, now) > STALLED]:
                del uploads[name]
            under_way.update(uploads)
        self._last_part = {name: when for name, when in self._last_part.items() if name in under_way}

    def _refuse(
        self, client_id: int, message: messages.FileTransferStartUpload | messages.FileTransferPart, why: str
    ) -> None:
        """Free the sender's upload button, which waits for an acknowledgement, and say why."""
        client = self._server.get_clients().get(client_id)
        if client is not None:
            done = messages.FileTransferPartAck(message.source_component_uuid, message.transfer_uuid, 0, 0)
            client._websock_connection.queue_message(done)
            # The browser's own notice would now claim success.
            notice = messages.RemoveNotificationMessage(f"upload-{message.transfer_uuid}")
            client._websock_connection.queue_message(notice)
        if self._on_refused is not None:
            self._on_refused(why)


def _of_known_form(gui: viser.GuiApi, stock: Callable[..., Any]) -> Callable[..., Coroutine[Any, Any, None]]:
    """The stock handler keeps a message for each name that a client makes up."""

    async def on_dirty(client_id: int, message: messages.GuiFormDirtyMessage) -> None:
        if isinstance(gui._container_handle_from_uuid.get(message.uuid), viser.GuiFormHandle):
            await stock(client_id, message)

    return on_dirty


def _is_upload_button(gui: viser.GuiApi, component_uuid: object) -> bool:
    widget = gui._gui_input_handle_from_uuid.get(component_uuid)  # pyright: ignore[reportArgumentType, reportCallIssue]
    return isinstance(widget, viser.GuiUploadButtonHandle)
