"""Logs of robots: MCAP, bags of ROS 1 and ROS 2, ULog of PX4. A topic is a group of arrays, one for each field."""

from __future__ import annotations

import io
import json
import re
from collections.abc import Callable, Iterable, Iterator
from contextlib import closing, redirect_stdout, suppress
from dataclasses import replace
from functools import cache, lru_cache, partial
from mmap import ACCESS_READ, mmap
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np

from kalscope.common.files import require_memory
from kalscope.common.numbers import Array
from kalscope.common.progress import Progress
from kalscope.errors import BadFile
from kalscope.sources.containers.arrays import Found, Item, is_numeric, read_arrays
from kalscope.sources.containers.table import Table, load_library

MAX_CHUNK = 1 << 27
"""Bytes of one unpacked chunk; the writers of bags and MCAP begin a new one after 1 to 4 MB."""
MAX_MESSAGE = 1 << 16
"""Bytes of one message, and elements of one sequence; a longer one holds an image or a scan."""
_MESSAGES_PER_REPORT = 64
_PACKERS = {b"BZh": "bz2", b"\x04\x22\x4d\x18": "lz4.frame", b"\x28\xb5\x2f\xfd": "zstandard"}
"""Library that unpacks a chunk, by the first bytes of the chunk."""
_STAMP_NS = {"sec": 10**9, "secs": 10**9, "nanosec": 1, "nsec": 1, "nsecs": 1}
"""Nanoseconds by the parts of a stamp: of ROS 2, of rosbags for ROS 1, and of ROS 1 itself, as JSON may hold it."""
_ROS1 = "ros1 ros1msg"
_ROS2 = "cdr ros2msg"

_Type = tuple[str, str, str]
"""Of messages: (encodings of messages and definition, name, definition or "" where the log has none)."""
_Message = tuple[str, _Type, int, bytes]
"""(topic, type, time at which it was logged in ns since 1970, content)."""
_Plain = list[Any] | dict[str, Any] | float | str | None
"""A value of JSON."""


def read_mcap(path: Path, name: str, part: str | None, progress: Progress) -> Table:
    """Read one topic of an MCAP log; BadFile, BadSetting: see `_read_topic`."""
    reading = load_library("mcap.stream_reader", "mcap", name, "an MCAP log")

    def messages(content: mmap) -> Iterator[_Message]:
        schemas: dict[int, _Type] = {0: ("", "", "")}
        channels: dict[int, tuple[str, _Type]] = {}
        for record in reading.StreamReader(content, emit_chunks=True, validate_crcs=True).records:
            inside = [record]
            if isinstance(record, reading.Chunk):
                whole = replace(record, compression="", data=_unpacked(record.data, name, progress))
                inside = reading.breakup_chunk(whole, validate_crc=True)
            for one in inside:
                if isinstance(one, reading.Schema):
                    schemas[one.id] = (one.encoding, one.name, one.data.decode("utf-8", "replace"))
                elif isinstance(one, reading.Channel):
                    encoding, type_name, definition = schemas[one.schema_id]
                    channels[one.id] = one.topic, (f"{one.message_encoding} {encoding}", type_name, definition)
                elif isinstance(one, reading.Message):
                    yield *channels[one.channel_id], one.log_time, one.data

    # A map of the file: nothing in it can be longer than the rest of it, whatever it says.
    with path.open("rb") as file, mmap(file.fileno(), 0, access=ACCESS_READ) as content:
        return _read_topic(messages(content), part, name, "an MCAP log", progress)


def read_ros1(path: Path, name: str, part: str | None, progress: Progress) -> Table:
    """Read one topic of a ROS 1 bag; BadFile, BadSetting: see `_read_topic`."""
    rosbag1 = load_library("rosbags.rosbag1", "rosbags", name, "a ROS 1 bag")
    return _read_bag(rosbag1.Reader(path), _ROS1, part, name, "a ROS 1 bag", progress)


def read_ros2(path: Path, name: str, part: str | None, progress: Progress) -> Table:
    """Read one topic of the SQLite file of a ROS 2 bag; BadFile, BadSetting: see `_read_topic`."""
    storage = load_library("rosbags.rosbag2.storage_sqlite3", "rosbags", name, "a ROS 2 bag")
    quoted = Path(quote(str(path.resolve())))  # it takes the path for a part of an address
    return _read_bag(storage.Sqlite3Reader(quoted), _ROS2, part, name, "a ROS 2 bag", progress)


def _read_bag(reader: Any, form: str, part: str | None, name: str, kind: str, progress: Progress) -> Table:
    reader.open()
    with closing(reader):
        for place, chunk in getattr(reader, "chunks", {}).items():
            reader.chunks[place] = chunk._replace(decompressor=partial(_unpacked, name=name, progress=progress))
        found = reader.messages(reader.connections)
        messages = ((one.topic, (form, one.msgtype, one.msgdef.data), time, data) for one, time, data in found)
        return _read_topic(messages, part, name, kind, progress)


def read_ulog(path: Path, name: str, part: str | None, progress: Progress) -> Table:
    """Read one topic of a ULog file; BadFile, BadSetting: see `_read_topic`."""
    pyulog = load_library("pyulog", "pyulog", name, "a ULog file")
    # The library prints its warnings, which are not part of a command's output.
    with path.open("rb") as file, redirect_stdout(io.StringIO()):
        topics = pyulog.ULog(file).data_list
    found = Found(what="topic")
    for topic in topics:
        # Several sensors of one kind are distinguished by their instance.
        group, data = f"{topic.name}_{topic.multi_id}" if topic.multi_id else topic.name, dict(topic.data)
        time = data.pop("timestamp")
        fields = [key for key, array in data.items() if "_padding" not in key and is_numeric(array.dtype)]
        columns = {"time": time / 1e6, **{f"{group}/{key}": data[key] for key in fields}} if fields else {}
        found.items += [Item(key, group, time.shape, array.copy) for key, array in columns.items()]
    return _timed(found, part, name, "a ULog file", progress)


def _read_topic(messages: Iterable[_Message], part: str | None, name: str, kind: str, progress: Progress) -> Table:
    """Read the requested topic of a log; a channel for each numeric field of its first message.

    Args:
        messages: The messages of all topics.
        part: `ReadOptions.part`.
        name: The file.
        kind: What it is: "a ROS 1 bag".
        progress: Reports the messages as they are read.

    Raises:
        BadFile: no topic holds numbers, it holds too many, or it is damaged.
        BadSetting: there is no such topic.
    """
    load_library("rosbags.typesys", "rosbags", name, kind)
    topics: dict[str, list[tuple[_Type, int, bytes]]] = {}
    size = 0
    for i, (topic, form, time, data) in enumerate(messages):
        if i % _MESSAGES_PER_REPORT == 0:
            progress.part(0.0, 0.5).step(i >> 14, "reading")
            require_memory(size, name, f"more than {i} messages")
        if len(data) <= MAX_MESSAGE:
            topics.setdefault(topic, []).append((form, time, data))
            size += len(data)

    @cache
    def columns(topic: str, fields: tuple[str, ...], first_stamp: int) -> Array:
        """Time in s since the first message, by the headers where it has a stamp, and the fields, each (n,)."""
        n, origin = len(topics[topic]), first_stamp or topics[topic][0][1]
        values = np.full((1 + len(fields), n), np.nan)
        for i, (form, time, data) in enumerate(topics[topic]):
            if i % _MESSAGES_PER_REPORT == 0:
                progress(0.5 + 0.5 * i / n, "reading")
            numbers = _numbers(_decoder(*form, name)(data), "", {})
            values[0, i] = (((_stamp(numbers) or np.nan) if first_stamp else time) - origin) / 1e9
            values[1:, i] = [numbers.get(field, np.nan) for field in fields]
        return values

    found = Found(what="topic")
    for topic, held in topics.items():
        first: dict[str, float] = {}
        with suppress(Exception):  # another encoding, an unknown type, a damaged message
            first = _numbers(_decoder(*held[0][0], name)(held[0][2]), "", {})
        fields = tuple(field for field in first if not field.startswith(("header.stamp.", "header.seq")))
        load, start = partial(columns, topic, fields, _stamp(first)), (_stamp(first) or held[0][1]) / 1e9
        for j, one in enumerate(("time", *(f"{topic}/{field}" for field in fields)) if fields else ()):
            found.items.append(Item(one, topic, (len(held),), lambda j=j, load=load: load()[j], start=start))
    return _timed(found, part, name, kind, progress)


def _timed(found: Found, part: str | None, name: str, note: str, progress: Progress) -> Table:
    """The requested topic, whose first column is the time; what it unpacks to is counted already."""
    return replace(read_arrays(found, part, name, note, replace(progress, unpacking=None)), time=0)


def _unpacked(data: bytes, name: str, progress: Progress) -> bytes:
    """A chunk, unpacked up to MAX_CHUNK bytes; BadFile where it holds more."""
    library = next((library for magic, library in _PACKERS.items() if data.startswith(magic)), None)
    if library is not None:
        with load_library(library, library.split(".")[0], name, "a packed log").open(io.BytesIO(data)) as file:
            data = file.read(MAX_CHUNK + 1)
        progress.unpack(len(data))
    if len(data) > MAX_CHUNK:
        raise BadFile(f"{name} must hold chunks of at most {MAX_CHUNK} bytes (got more)")
    return data


@lru_cache(256)
def _decoder(form: str, type_name: str, definition: str, name: str) -> Callable[[bytes], Any]:
    """Decode messages by the definition in the log; by the types of ROS 2 where it has none."""
    if form.startswith("json"):
        return json.loads
    typesys = load_library("rosbags.typesys", "rosbags", name, "messages of ROS")
    store = typesys.get_typestore(typesys.Stores.EMPTY if definition else typesys.Stores.ROS2_HUMBLE)
    store.max_sequence_length = MAX_MESSAGE
    if definition:
        types = typesys.get_types_from_msg(definition, type_name)
        type_name = next(iter(types))
        # rosbags writes a Python program from these names, with a line for each element of an array of messages.
        members = [member[0] for pair in types.values() for group in pair for member in group]
        are_names = all(word.isidentifier() for text in (*types, *members) for word in text.split("/"))
        if not are_names or re.search(r"\[[0-9]{5}", definition):
            raise ValueError("a definition of ROS must hold names, and arrays of at most 9999 elements")
        store.register(types)
    return partial({_ROS1: store.deserialize_ros1, _ROS2: store.deserialize_cdr}[form], typename=type_name)


def _numbers(value: Any, name: str, found: dict[str, float]) -> dict[str, float]:
    """`found` with the numbers of a message by their full names: `linear_acceleration.x`, `position[0]`."""
    plain: _Plain = value.tolist() if isinstance(value, np.ndarray) else value
    if isinstance(plain, (int, float)):
        found[name] = plain
    elif isinstance(plain, list):
        for i, part in enumerate(plain if len(plain) <= 64 else ()):  # a longer one is an image or a scan
            _numbers(part, f"{name}[{i}]", found)
    else:  # an object of JSON or of rosbags, or a text
        fields: dict[str, Any] = plain if isinstance(plain, dict) else getattr(plain, "__dict__", {})
        for key, part in fields.items():
            _numbers(part, f"{name}.{key}" if name else str(key), found)
    return found


def _stamp(numbers: dict[str, float]) -> int:
    """Time of the header of a message in ns since 1970; 0 unless both parts are present."""
    keys = {ns: f"header.stamp.{part}" for part, ns in _STAMP_NS.items() if f"header.stamp.{part}" in numbers}
    return sum(ns * int(numbers[key]) for ns, key in keys.items()) if len(keys) == 2 else 0
