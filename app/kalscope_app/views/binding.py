"""Connects widgets with the session: what a user does with a widget files a request.

Values are set by plain assignment: viser sends nothing for an equal value, and `on_user` ignores assignments.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import viser

from kalscope_app.session.session import Failed, Session
from kalscope_app.session.state import Change


def on_user(
    subscribe: Callable[[Callable[[Any], Any]], object], act: Callable[[viser.ClientHandle], object]
) -> None:
    """Call `act` with the browser whenever a user does something with a widget.

    Args:
        subscribe: such as `button.on_click` or `slider.on_update`.
        act: runs on viser's event loop, so it must be quick. In the thread pool, events would overtake each other.
    """

    async def callback(event: Any) -> None:
        if event.client is not None:  # otherwise the program itself has set the value
            act(event.client)

    subscribe(callback)


def bind(handle: Any, session: Session, change: Callable[[Any], Change], failed: Failed = Failed.OTHER) -> None:
    """Request `change(value)` whenever a user edits this widget; `failed` is the heading of a refusal."""
    on_user(handle.on_update, lambda _client: session.request(change(handle.value), failed=failed))


def put(handle: Any, **properties: Any) -> None:
    """Set the properties that differ. viser sends no equal value either, but takes 15 µs to find that out.

    Every frame sets what stands on a hundred widgets, and almost all of it is as before.
    """
    for name, value in properties.items():
        if getattr(handle, name) != value:
            setattr(handle, name, value)


def offer(dropdown: viser.GuiDropdownHandle[str], options: Iterable[str], value: str) -> None:
    """Set the options and the value of a dropdown; equal options are not sent again, which would close its menu."""
    options = tuple(options)
    if tuple(dropdown.options) != options:
        dropdown.options = options
    dropdown.value = value
