"""Several browsers, one value.

viser sends a new value to all browsers but its sender. When two users move the same slider, each may receive the
other's value after sending their own, and keep it: the screens then differ for good.
"""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING

import viser

from kalscope_app.guard.viser_private import messages

if TYPE_CHECKING:
    from kalscope_app.guard.viser_private import Channel

SETTLED_S = 0.3
"""Seconds without a change after which a value is final; shorter than a pause of the hand."""


class WidgetSync:
    """Rebroadcasts a widget's final value so that all browsers agree. Runs on the event loop."""

    def __init__(self, shared: Channel) -> None:
        self._shared = shared
        self._due: dict[str, asyncio.TimerHandle] = {}

    def changed(self, uuid: str) -> None:
        """A client has changed this widget of the shared panels."""
        if uuid in self._due:
            self._due[uuid].cancel()
        self._due[uuid] = asyncio.get_running_loop().call_later(SETTLED_S, self._rebroadcast, uuid)

    def _rebroadcast(self, uuid: str) -> None:
        del self._due[uuid]
        widget = self._shared.widget(uuid)
        if isinstance(widget, viser.GuiInputHandle):  # buttons have no value to agree on
            self._shared.send(messages.GuiUpdateMessage(uuid, {"value": widget.value}))
