"""What a client's message may hold, as pure functions. viser stores what comes; here it must fit first."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from viser import _messages as messages

LONGEST_TEXT = 10_000
"""Characters that a text box takes."""
LONGEST_NAME = 1_000
"""Characters of an uploaded file's name; file systems stop at 255."""
_LONGEST_ID = 100
_LARGEST_SCREEN = 100_000


class Misbehaviour(Exception):
    """What no browser would send. Whoever sends it is disconnected."""


def fitting_value(
    current: object,
    value: object,
    low: float | None = None,
    high: float | None = None,
    options: Sequence[str] | None = None,
) -> object | None:
    """The value as the widget may take it, held within its range; None if it must stay as it is.

    Args:
        current: what the widget holds; the new value must be of its kind.
        value: what came.
        low: the least number allowed.
        high: the largest number allowed.
        options: the texts allowed.
    """
    if isinstance(current, bool):
        return value if isinstance(value, bool) else None
    if isinstance(current, int | float):
        return _fitting_number(value, low, high)
    if isinstance(current, str):
        if not isinstance(value, str) or len(value) > LONGEST_TEXT:
            return None
        return value if options is None or value in options else None
    if isinstance(current, tuple) and isinstance(value, list | tuple) and len(value) == len(current):
        pairs = zip(current, value, strict=True)
        fitting = tuple(fitting_value(old, new, low, high, options) for old, new in pairs)
        return None if None in fitting else fitting
    return None


def _fitting_number(value: object, low: float | None, high: float | None) -> float | None:
    """A browser sends each key that is pressed, so a number on its way to the range is no mistake."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not _is_finite(value):
        return None
    value = value if low is None else max(value, low)
    return value if high is None else min(value, high)


def _is_finite(value: object) -> bool:
    try:
        return isinstance(value, int | float) and math.isfinite(value)
    except OverflowError:  # an integer beyond every float
        return False


# --- the fields of whole messages -------------------------------------------------------------------------

Check = Callable[[object], bool]


def _text(longest: int) -> Check:
    return lambda value: isinstance(value, str) and len(value) <= longest


def _number(value: object) -> bool:
    return not isinstance(value, bool) and _is_finite(value)


def _whole(value: object) -> bool:
    return type(value) is int


def _vector(length: int) -> Check:
    return lambda value: isinstance(value, tuple) and len(value) == length and all(map(_number, value))


def _screen(value: object) -> bool:
    return type(value) is int and 0 <= value <= _LARGEST_SCREEN


def _mapping(value: object) -> bool:
    return isinstance(value, dict) and all(isinstance(key, str) for key in value)


def _one_of(*choices: str) -> Check:
    return lambda value: isinstance(value, str) and value in choices


def _optional(check: Check) -> Check:
    return lambda value: value is None or check(value)


def _pairs(value: object) -> bool:
    return isinstance(value, tuple) and len(value) <= 2 and all(map(_vector(2), value))


_id = _text(_LONGEST_ID)
_pointer = {"modifier": _optional(_id), "instance_index": _optional(_whole), "name": _id, "owner": _id}

FIELDS: dict[type, dict[str, Check]] = {
    messages.GuiUpdateMessage: {"uuid": _id, "updates": _mapping},
    messages.GuiFormSubmitMessage: {"uuid": _id},
    messages.GuiFormDirtyMessage: {"uuid": _id},
    messages.GuiButtonHoldMessage: {"uuid": _id, "frequency": _number},
    messages.CommandTriggerMessage: {"uuid": _id},
    messages.FileTransferStartUpload: {
        "source_component_uuid": _id,
        "transfer_uuid": _id,
        "filename": _text(LONGEST_NAME),
        "mime_type": _text(LONGEST_NAME),
        "part_count": _whole,
        "size_bytes": _whole,
    },
    messages.FileTransferPart: {
        "source_component_uuid": _optional(_id),
        "transfer_uuid": _id,
        "part_index": _whole,
        "content": lambda value: isinstance(value, bytes),
    },
    messages.ViewerCameraMessage: {
        "wxyz": _vector(4),
        "position": _vector(3),
        "fov": _number,
        "near": _number,
        "far": _number,
        "image_height": _screen,
        "image_width": _screen,
        "look_at": _vector(3),
        "up_direction": _vector(3),
    },
    messages.SceneNodeClickMessage: {
        **_pointer,
        "ray_origin": _vector(3),
        "ray_direction": _vector(3),
        "screen_pos": _vector(2),
    },
    messages.SceneNodeDragMessage: {
        **_pointer,
        "phase": _one_of("start", "update", "end"),
        "start_position": _vector(3),
        "start_screen_pos": _vector(2),
        "end_position": _vector(3),
        "end_screen_pos": _vector(2),
        "button": _one_of("left", "middle", "right"),
    },
    messages.ScenePointerMessage: {
        "event_type": _one_of("click", "rect-select"),
        "ray_origin": _optional(_vector(3)),
        "ray_direction": _optional(_vector(3)),
        "screen_pos": _pairs,
        "modifier": _optional(_id),
    },
}
"""The messages that a browser sends to a dashboard like ours, and what their fields must be."""


def check_fields(message: object) -> None:
    """Let pass what a browser would send.

    Raises:
        Misbehaviour: a field is not what it must be.
    """
    for name, is_right in FIELDS.get(type(message), {}).items():
        if not is_right(getattr(message, name)):
            raise Misbehaviour(f"{type(message).__name__} with an impossible {name}")
