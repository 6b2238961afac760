"""Several browsers, one value: after a gesture has ended, every browser is told where the widget came to rest.

viser sends a new value to all but its sender. When two persons move the same slider, each may receive the other's
value after its own was sent, and keep it: the screens then differ for good.
"""

from __future__ import annotations

import asyncio

import viser
from viser import _messages as messages

REST = 0.3
"""Seconds without a change after which the value is sent to all; less than a pause of the hand."""


class Agreement:
    """Repeats the settled value of a shared widget. Runs on the event loop."""

    def __init__(self, server: viser.ViserServer) -> None:
        self._server = server
        self._due: dict[str, asyncio.TimerHandle] = {}

    def changed(self, uuid: str) -> None:
        """A client has changed this widget; alone, a client knows its own values."""
        earlier = self._due.pop(uuid, None)
        if earlier is not None:
            earlier.cancel()
        if len(self._server._connected_clients) > 1:
            self._due[uuid] = asyncio.get_running_loop().call_later(REST, self._repeat, uuid)

    def _repeat(self, uuid: str) -> None:
        del self._due[uuid]
        widget = self._server.gui._gui_input_handle_from_uuid.get(uuid)
        if widget is not None and not widget._impl.removed and not widget._impl.is_button:
            update = messages.GuiUpdateMessage(uuid, {"value": widget._impl.value})
            self._server._websock_server.queue_message(update)
