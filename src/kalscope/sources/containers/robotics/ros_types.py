"""Decode ROS messages by the definitions that the log holds."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

from kalscope.sources.containers.library import load_library

_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*(?:/[A-Za-z][A-Za-z0-9_]*)*")
_MAX_SEQUENCE = 1 << 24


Decode = Callable[[bytes], Any]
"""From the bytes of a message to its fields."""


def ros_decoder(name: str, kind: str) -> Callable[[str, str, bool], Decode]:
    """Return a maker of decoders, from a type, its definition ("" where the log has none) and whether it is ROS 1.

    Args:
        name: The file, for the error where rosbags is not installed.
        kind: What it is.
    """
    typesys = load_library("rosbags.typesys", "rosbags", name, kind)
    stores: dict[str, Any] = {}

    def decoder(type_name: str, definition: str, is_ros1: bool) -> Decode:
        if type_name not in stores:
            stores[type_name] = _store(typesys, type_name, definition)
        store, full_name = stores[type_name]
        decode = store.deserialize_ros1 if is_ros1 else store.deserialize_cdr
        return lambda data: decode(data, full_name)

    return decoder


def _store(typesys: Any, type_name: str, definition: str) -> tuple[Any, str]:
    """The types of one definition, and the full name of the first; the standard ones where the log holds none."""
    if not definition:
        store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
        store.max_sequence_length = _MAX_SEQUENCE
        return store, type_name
    types = typesys.get_types_from_msg(definition, type_name)
    for full_name, (constants, fields) in types.items():
        # rosbags writes a Python program from these names: nothing but names may pass.
        for text in (full_name, *(constant[0] for constant in constants), *(field[0] for field in fields)):
            if not _NAME.fullmatch(text):
                raise ValueError(f"{text[:40]!r} is not a name of a ROS type")
    store = typesys.get_typestore(typesys.Stores.EMPTY)
    store.max_sequence_length = _MAX_SEQUENCE
    store.register(types)
    return store, next(iter(types))
