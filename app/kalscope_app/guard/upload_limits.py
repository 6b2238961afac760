"""How much browsers may upload: the bytes are counted before viser stores them."""

from __future__ import annotations

import time
from collections.abc import Callable

import viser

from kalscope_app.guard.message_schema import Misbehaviour
from kalscope_app.guard.viser_private import Channel, messages

MAX_UPLOAD_BYTES = 64 * 2**20
"""Size of the unfinished uploads of one client, by default. Larger files are opened by path."""

MAX_FULL_CLIENTS = 2
"""How many clients may upload files of the largest size at once."""

STALLED_S = 30.0
"""Seconds without a part after which an upload no longer counts."""

MIN_PART_BYTES = 1024
"""A browser cuts an upload into parts of 512 KiB; one that announces parts smaller than this is refused."""


def upload_refusal(
    size_bytes: int, part_count: int, bytes_under_way: int, max_bytes: int, own_bytes: int = 0
) -> str | None:
    """Why an announced upload cannot be taken, or None if it can.

    Args:
        size_bytes: the size that the client declares.
        part_count: the number of parts that it declares.
        bytes_under_way: declared sizes of the uploads not yet complete, of all clients.
        max_bytes: the most that one client may need at a time; all together may need MAX_FULL_CLIENTS times it.
        own_bytes: the part of `bytes_under_way` that belongs to this client.
    """
    if size_bytes > max_bytes:
        return (
            f"This file has {size_bytes / 2**20:.1f} MiB; up to {max_bytes / 2**20:g} MiB can be uploaded. "
            "Start Kalscope with the file's path instead: kalscope open FILE"
        )
    if own_bytes + size_bytes > max_bytes or bytes_under_way + size_bytes > MAX_FULL_CLIENTS * max_bytes:
        return "Other uploads are still under way. Try again when they have ended."
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
        total, own = self._bytes_under_way(), self._bytes_under_way(client_id)
        reason = upload_refusal(message.size_bytes, message.part_count, total, self._max_bytes, own)
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

    def _bytes_under_way(self, client_id: int | None = None) -> int:
        return sum(
            upload["total_bytes"]
            for channel in self.channels.values()
            for upload in channel.uploads.values()
            if client_id in (None, upload["client_id"])
        )

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
