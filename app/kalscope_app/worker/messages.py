"""Messages between two processes, over pipes: pickles whose arrays are sent as they are in memory."""

from __future__ import annotations

import io
import pickle
import struct
from dataclasses import dataclass
from typing import Any, cast

import numpy as np

from kalscope.common.files import free_memory
from kalscope.common.numbers import Array


@dataclass(frozen=True)
class Progress:
    """The progress of a task."""

    fraction: float
    """0 … 1."""
    text: str
    """What is being done."""


@dataclass(frozen=True)
class Done:
    """A task is finished."""

    answer: Any
    """What it returned."""


@dataclass(frozen=True)
class Failed:
    """A task has failed."""

    error: Exception
    """What it raised, with the traceback as a note unless the message is meant for the user."""


class _Pickler(pickle.Pickler):
    def reducer_override(self, obj: Any) -> Any:
        """Arrays that are not contiguous, which would otherwise be copied into the pickle."""
        if isinstance(obj, np.ndarray) and not obj.flags.forc:
            return np.ascontiguousarray(cast("Array", obj)).__reduce_ex__(5)
        return NotImplemented


def send(stream: io.RawIOBase, message: Any) -> None:
    """Write a message.

    Raises:
        OSError: the other process no longer reads.
    """
    body, buffers = io.BytesIO(), list[pickle.PickleBuffer]()
    _Pickler(body, 5, buffer_callback=buffers.append).dump(message)
    parts = [body.getbuffer(), *(buffer.raw() for buffer in buffers)]
    _write(stream, memoryview(struct.pack(f"<I{len(parts)}Q", len(parts), *(part.nbytes for part in parts))))
    for part in parts:
        _write(stream, part)


def _write(stream: io.RawIOBase, data: memoryview) -> None:
    while data:
        data = data[stream.write(data) :]


def receive(stream: io.RawIOBase) -> Any:
    """Read a message; other threads can run while its arrays arrive.

    Raises:
        EOFError: the other process has ended.
        MemoryError: it does not fit into the memory.
    """
    (count,) = struct.unpack("<I", _read(stream, 4))
    sizes = struct.unpack(f"<{count}Q", _read(stream, 8 * count))
    free = free_memory()
    if free is not None and sum(sizes) > free:
        raise MemoryError
    body, *buffers = [_read(stream, size) for size in sizes]
    return pickle.loads(body, buffers=buffers)


def _read(stream: io.RawIOBase, size: int) -> memoryview:
    data = np.empty(size, np.uint8).data  # a bytearray would be filled with zeros first
    at = 0
    while at < size:
        got = stream.readinto(data[at:])
        if not got:
            raise EOFError
        at += got
    return data
