"""Draws views. One that fails is emptied: it must not go on showing another recording or an earlier setting."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import Any, cast

import numpy as np
import viser

NO_TEXT = "\u200b"
"""What an emptied text shows: it cannot be seen, and no view writes it."""

NO_PICTURE = np.zeros((2, 2, 3), dtype=np.uint8)
"""What an emptied picture shows: the page hides a picture of this size (`map.js`)."""


class GuardedViews:
    """Calls the methods that draw views. An exception is reported once, until the same method has succeeded."""

    def __init__(self, report: Callable[[Exception], object]) -> None:
        """Args: logs an exception and notifies the user."""
        self._report = report
        self._failed: dict[Callable[..., None], type[Exception] | None] = {}  # how the last call ended
        self._emptied: dict[Any, list[tuple[Any, str, Any]]] = {}

    def draw(self, show: Callable[..., None], *answer: Any, **options: Any) -> None:
        """Call `show`, a method of a view."""
        try:
            show(*answer, **options)
        except Exception as error:
            self.fail(error, show)
            return
        self._failed[show], view = None, view_of(show)
        if view in self._emptied and view not in [view_of(one) for one, error in [*self._failed.items()] if error]:
            for widget, name, before in self._emptied.pop(view):
                if is_empty(widget):  # the view has not written it again, because it has not changed
                    setattr(widget, name, before)

    def fail(self, error: Exception, *shows: Callable[..., None]) -> None:
        """Empty the views of these methods; without any, of all methods that were called."""
        shows = shows or tuple(self._failed)
        if type(error) not in map(self._failed.get, shows):
            self._report(error)
        for show in shows:
            self._failed[show], view = type(error), view_of(show)
            for widget in [one for one in widgets_in(view) if not is_empty(one)]:
                name, nothing = property_of(widget)
                self._emptied.setdefault(view, []).append((widget, name, getattr(widget, name)))
                setattr(widget, name, nothing)
            if (on_emptied := getattr(view, "on_emptied", None)) is not None:
                on_emptied()


def view_of(show: Callable[..., None]) -> Any:
    """The view that a method draws."""
    return getattr(show, "__self__", None)


def property_of(widget: Any) -> tuple[str, Any]:
    """The property by which a widget shows something, and its value when it shows nothing; "": it has none."""
    match widget:
        case viser.GuiMarkdownHandle():
            return "content", NO_TEXT
        case viser.GuiTextHandle(multiline=True):  # the others are for typing
            return "value", NO_TEXT
        case viser.GuiUplotHandle():
            return "data", (np.zeros(0),) * len(widget.data)
        case viser.GuiImageHandle():
            return "image", NO_PICTURE
        case _:
            return "", None


def is_empty(widget: Any) -> bool:
    """Whether a widget shows nothing."""
    name, nothing = property_of(widget)
    return np.array_equal(getattr(widget, name), nothing)


def widgets_in(part: object) -> Iterator[Any]:
    """What shows something in a view, and in the parts that it consists of."""
    parts: Iterable[object] = ()
    if property_of(part)[0]:
        yield part
    elif isinstance(part, list | tuple):
        parts = cast("Iterable[object]", part)
    elif type(part).__module__.startswith("kalscope_app.views"):
        parts = vars(part).values()
    for one in parts:
        yield from widgets_in(one)
