"""What a client's message may contain, as pure functions: viser stores the content unchecked."""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from typing import cast

import msgspec

from kalscope_app.guard.viser_private import messages

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
