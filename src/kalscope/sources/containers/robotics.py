"""Logs of robots: MCAP, bags of ROS 1 and ROS 2, ULog of PX4."""

from __future__ import annotations

import bz2
import contextlib
import io
import json
import re
import sqlite3
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, is_dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from kalscope.common.files import require_memory
from kalscope.common.numbers import Array
from kalscope.common.progress import Progress
from kalscope.errors import BadFile, KalscopeError
from kalscope.sources.containers.table import MAX_COLUMNS, MAX_NUMBERS, Part, Table, choose_part, load_library

# How much the packed chunks of a log unpack to, counted up to a limit before a library unpacks them.


MAX_CHUNK = 1 << 28
"""Bytes of one unpacked chunk; rosbag writes chunks below 1 MB."""

_BZIP2, _LZ4 = b"BZh", b"\x04\x22\x4d\x18"


def check_chunk(data: bytes, name: str, kind: str) -> int:
    """What a chunk unpacks to, bytes; refuse one of bzip2 or LZ4 that would fill the memory.

    Args:
        data: The chunk as it is stored.
        name: The file.
        kind: What it is.

    Raises:
        BadFile: the chunk unpacks to more than MAX_CHUNK bytes.
    """
    size = len(data)
    if data.startswith(_BZIP2):
        size = unpacked_size(data, bz2.BZ2Decompressor, OSError)
    elif data.startswith(_LZ4):
        lz4 = load_library("lz4.frame", "lz4", name, kind)
        size = unpacked_size(data, lz4.LZ4FrameDecompressor, RuntimeError)
    check_size(size, name)
    return size


def check_size(size: int, name: str) -> None:
    """Refuse a chunk that unpacks to `size` bytes, where that is more than MAX_CHUNK."""
    if size > MAX_CHUNK:
        raise BadFile(f"{name} must hold chunks of at most {MAX_CHUNK} bytes (got more)")


def unpacked_size(data: bytes, unpacker: Callable[[], Any], damage: type[Exception]) -> int:
    """Bytes to which all streams in `data` unpack, counted up to one more than MAX_CHUNK.

    Args:
        data: Streams or frames, one after the other.
        unpacker: Makes the decompressor of one of them, such as `bz2.BZ2Decompressor`.
        damage: What it raises where no stream begins.
    """
    size = 0
    while data and size <= MAX_CHUNK:
        stream = unpacker()
        try:
            size += len(stream.decompress(data, MAX_CHUNK + 1 - size))
        except damage:
            if not size:
                raise
            break  # bytes after the last stream are ignored
        data = stream.unused_data or b""
    return size


# Decode ROS messages by the definitions that the log holds.


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


# Turn the messages of a topic into a table: every numeric field is a channel with its full name.


_MAX_ELEMENTS = 64
"""Elements of an array that are channels; a longer one is an image or a scan."""
_MAX_DEPTH = 12
_STAMP_PARTS = (("sec", "nanosec"), ("sec", "nsec"), ("secs", "nsecs"))
"""Fields of a stamp: of ROS 2, of rosbags for ROS 1, and of ROS 1 itself, whose messages JSON may hold."""
_STAMP_FIELDS = {"header.seq"} | {f"header.stamp.{field}" for parts in _STAMP_PARTS for field in parts}
_MESSAGES_PER_REPORT = 1024
_ROW_BYTES, _NUMBER_BYTES = 160, 48
"""Memory that a message and each of its numbers take, bytes."""

Messages = Iterable[tuple[int, Any]]
"""(time at which it was logged in ns since 1970, decoded message)."""


@dataclass(frozen=True)
class Topic:
    """One topic of a log."""

    name: str
    """Its full name."""
    count: int
    """Messages that it holds."""
    messages: Callable[[], Messages]
    """Decodes them, in the order of the log; raises where it cannot."""


def read_topics(topics: Sequence[Topic], wanted: str | None, name: str, note: str, progress: Progress) -> Table:
    """The requested topic.

    Args:
        topics: The topics of the log.
        wanted: `ReadOptions.part`.
        name: The file.
        note: What it is: "a ROS 1 bag".
        progress: Reports the messages as they are decoded.

    Raises:
        BadFile: there is no topic with numbers, or it holds too many.
        BadSetting: there is no such topic.
    """
    fields: dict[str, list[str]] = {}
    without: list[str] = []
    for topic in topics:
        progress(0.0, "reading")
        found = _fields(topic)
        if found and topic.count:
            fields[topic.name] = found
        elif topic.count:
            without.append(topic.name)
    holding = [topic for topic in topics if topic.name in fields]
    parts = [Part(topic.name, topic.count, len(fields[topic.name])) for topic in holding]
    chosen, notes = choose_part(parts, wanted, name, "topic")
    if without:
        more = f" and {len(without) - 8} more" if len(without) > 8 else ""
        notes = (*notes, f"topics without numbers that can be read: {', '.join(without[:8])}{more}")
    topic, names = holding[chosen], fields[holding[chosen].name]
    if topic.count * len(names) > MAX_NUMBERS or len(names) > MAX_COLUMNS:
        raise BadFile(f"{name} must hold at most {MAX_COLUMNS} fields a message (got {len(names)} in {topic.name})")
    # As objects of Python, before they become an array.
    require_memory(topic.count * (_ROW_BYTES + _NUMBER_BYTES * len(names)), name, f"{topic.count} messages")
    time, values, clock = _read(topic, names, progress)
    return Table(
        names=tuple(f"{topic.name}/{field}" for field in names),
        units=("",) * len(names),
        columns=tuple(np.ascontiguousarray(values[:, j]) for j in range(len(names))),
        time=(time - time[0]).astype(np.float64) / 1e9,
        start=float(time[0]) / 1e9,
        clock=clock,
        notes=(note, *notes),
    )


def _fields(topic: Topic) -> list[str]:
    """Names of the numeric fields of the first message; none where it cannot be decoded."""
    try:
        first = next(iter(topic.messages()), None)
    except KalscopeError:
        raise
    except Exception:
        return []
    return [] if first is None else [field for field in leaves(first[1]) if field not in _STAMP_FIELDS]


def _read(topic: Topic, names: list[str], progress: Progress) -> tuple[NDArray[np.int64], Array, str]:
    """(ns since 1970, values, which clock it is): of the header's stamps where all messages have one."""
    logged: list[int] = []
    stamped: list[int] = []
    rows: list[list[float]] = []
    for i, (time, message) in enumerate(topic.messages()):
        if i % _MESSAGES_PER_REPORT == 0:
            progress(i / max(topic.count, 1), "reading")
        found = leaves(message)
        rows.append([found.get(field, np.nan) for field in names])
        logged.append(time)
        stamped.append(_stamp(found))
    by_header = bool(stamped) and all(stamped)
    clock = "time is that of the messages' headers" if by_header else "time is that of the log"
    return np.array(stamped if by_header else logged, dtype=np.int64), np.array(rows, dtype=np.float64), clock


def _stamp(found: dict[str, float]) -> int:
    """Time of the header of a message in ns since 1970; 0 unless both parts are present."""
    for parts in _STAMP_PARTS:
        seconds, rest = (found.get(f"header.stamp.{field}") for field in parts)
        if seconds is not None and rest is not None:
            return int(seconds) * 1_000_000_000 + int(rest)
    return 0


def leaves(message: Any) -> dict[str, float]:
    """The numbers of a message by their full names: `linear_acceleration.x`, `position[0]`."""
    found: dict[str, float] = {}
    _collect(message, "", found, 0)
    return found


def _collect(value: Any, name: str, found: dict[str, float], depth: int) -> None:
    if isinstance(value, (bool, int, float, np.number, np.bool_)):
        found[name] = float(cast("float", value))
    elif depth >= _MAX_DEPTH:
        return
    elif isinstance(value, dict) or is_dataclass(value):
        fields = cast("dict[str, Any]", value if isinstance(value, dict) else vars(value))
        for key, part in fields.items():
            _collect(part, f"{name}.{key}" if name else str(key), found, depth + 1)
    elif isinstance(value, (list, np.ndarray)) and 0 < len(cast("list[Any]", value)) <= _MAX_ELEMENTS:
        for i, part in enumerate(cast("list[Any]", value)):
            _collect(part, f"{name}[{i}]", found, depth + 1)


# MCAP logs, read by mcap: messages of ROS 1, ROS 2 and JSON.


_KIND = "an MCAP log"
_RECORDS_PER_REPORT = 1024


def read_mcap(path: Path, name: str, part: str | None, progress: Progress) -> Table:
    """Read one topic of an MCAP log.

    Raises:
        BadFile: no topic holds numbers in an encoding that is read.
        BadSetting: there is no such topic.
    """
    load_library("mcap", "mcap", name, _KIND)
    schemas: dict[int, Any] = {}
    channels: dict[int, Any] = {}
    firsts: dict[int, tuple[int, bytes]] = {}
    counts: Counter[int] = Counter()
    for record in _records(path, name, progress.part(0.0, 0.4)):
        word = type(record).__name__
        if word == "Schema":
            schemas[record.id] = record
        elif word == "Channel":
            channels[record.id] = record
        elif word == "Message":
            counts[record.channel_id] += 1
            firsts.setdefault(record.channel_id, (record.log_time, record.data))

    def messages(channel_id: int) -> Messages:
        channel = channels[channel_id]
        decode = _decoder(channel, schemas.get(channel.schema_id), name)
        # The first is decoded alone, to see its fields: only one topic is read to its end.
        yield firsts[channel_id][0], decode(firsts[channel_id][1])
        found = (
            record
            for record in _records(path, name, replace(progress.part(0.4, 0.6), unpacking=None))  # counted above
            if type(record).__name__ == "Message" and record.channel_id == channel_id
        )
        next(found, None)
        for record in found:
            yield record.log_time, decode(record.data)

    topics = [Topic(one.topic, counts[key], partial(messages, key)) for key, one in channels.items() if counts[key]]
    return read_topics(_distinct(topics), part, name, _KIND, progress.part(0.6, 1.0))


def _distinct(topics: list[Topic]) -> list[Topic]:
    """Several channels of one topic, one per publisher, get distinct names."""
    seen: Counter[str] = Counter()
    distinct: list[Topic] = []
    for topic in topics:
        seen[topic.name] += 1
        number = seen[topic.name]
        distinct.append(topic if number == 1 else Topic(f"{topic.name} {number}", topic.count, topic.messages))
    return distinct


def _decoder(channel: Any, schema: Any, name: str) -> Callable[[bytes], Any]:
    encoding = (channel.message_encoding, "" if schema is None else schema.encoding)
    if channel.message_encoding == "json":
        return json.loads
    if schema is not None and encoding in (("cdr", "ros2msg"), ("ros1", "ros1msg")):
        make = ros_decoder(name, _KIND)
        return make(schema.name, schema.data.decode("utf-8"), channel.message_encoding == "ros1")
    raise ValueError(f"messages in {encoding[0]} are not read")


def _records(path: Path, name: str, progress: Progress) -> Iterator[Any]:
    """All records of the file, those in chunks as well, checked by their checksums."""
    reading = load_library("mcap.stream_reader", "mcap", name, _KIND)
    size = max(path.stat().st_size, 1)
    with path.open("rb") as file:
        stream = reading.StreamReader(file, emit_chunks=True, validate_crcs=True, record_size_limit=size)
        for i, record in enumerate(stream.records):
            if i % _RECORDS_PER_REPORT == 0:
                progress(file.tell() / size, "reading")
            if type(record).__name__ != "Chunk":
                yield record
                continue
            progress(file.tell() / size, "reading")
            check_size(record.uncompressed_size, name)
            progress.unpack(max(record.uncompressed_size, check_chunk(record.data, name, _KIND)))
            if record.compression == "zstd":
                _check_zstd(record, name)
            yield from reading.breakup_chunk(record, validate_crc=True)


def _check_zstd(chunk: Any, name: str) -> None:
    """Refuse a chunk that unpacks to more than it says; a frame that gives no size is bounded by the chunk's."""
    zstandard = load_library("zstandard", "zstandard", name, _KIND)
    size = int(zstandard.get_frame_parameters(chunk.data).content_size)
    if size in (zstandard.CONTENTSIZE_UNKNOWN, chunk.uncompressed_size):
        return
    check_size(size, name)
    raise ValueError(f"a chunk of {chunk.uncompressed_size} bytes unpacks to {size}")


# ROS 1 bags (.bag) and the files of ROS 2 bags (.db3), read by rosbags and by SQLite.


_STEPS = 100_000
"""Steps of SQLite between two checks whether the user has cancelled."""

_DEFINITIONS = "SELECT topic_type, encoded_message_definition FROM message_definitions WHERE encoding = 'ros2msg'"
_MESSAGES = "SELECT timestamp, data FROM messages WHERE topic_id = ? ORDER BY timestamp"


def read_ros1(path: Path, name: str, part: str | None, progress: Progress) -> Table:
    """Read one topic of a ROS 1 bag.

    Raises:
        BadFile: no topic holds numbers.
        BadSetting: there is no such topic.
    """
    kind = "a ROS 1 bag"
    rosbag1 = load_library("rosbags.rosbag1", "rosbags", name, kind)
    make = ros_decoder(name, kind)
    with rosbag1.Reader(path) as reader:
        _check_chunks(reader, path, progress)

        def messages(connections: list[Any]) -> Messages:
            decoders = {one.id: make(one.msgtype, one.msgdef.data, True) for one in connections}
            for connection, time, data in reader.messages(connections):
                yield time, decoders[connection.id](data)

        topics = [
            Topic(topic, info.msgcount, partial(messages, list(info.connections)))
            for topic, info in reader.topics.items()
        ]
        return read_topics(topics, part, name, kind, progress)


def _check_chunks(reader: Any, path: Path, progress: Progress) -> None:
    with path.open("rb") as file:
        for chunk in reader.chunks.values():
            progress(0.0, "reading")
            file.seek(chunk.datapos)
            progress.unpack(check_chunk(file.read(chunk.datasize), path.name, "a ROS 1 bag"))


def read_ros2(path: Path, name: str, part: str | None, progress: Progress) -> Table:
    """Read one topic of the SQLite file of a ROS 2 bag.

    Raises:
        BadFile: it is another database, or no topic holds numbers.
        BadSetting: there is no such topic.
    """
    kind = "a ROS 2 bag"
    make = ros_decoder(name, kind)
    connection = sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro&immutable=1", uri=True)
    try:
        connection.execute("PRAGMA trusted_schema = OFF")
        connection.set_progress_handler(lambda: progress(0.0, "reading"), _STEPS)
        tables = {str(row[0]) for row in connection.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
        if not tables >= {"topics", "messages"}:
            raise BadFile(f"{name} must be a ROS 2 bag (got another SQLite database)")
        definitions: dict[str, str] = {}
        if "message_definitions" in tables:
            definitions = dict(connection.execute(_DEFINITIONS))
        counts = dict(connection.execute("SELECT topic_id, count(*) FROM messages GROUP BY topic_id"))

        def messages(topic_id: int, kind_of: str) -> Iterator[tuple[int, Any]]:
            decode = make(kind_of, definitions.get(kind_of, ""), False)
            for time, data in connection.execute(_MESSAGES, (topic_id,)):
                yield int(time), decode(data)

        listed = connection.execute("SELECT id, name, type FROM topics WHERE serialization_format = 'cdr'")
        topics = [
            Topic(str(topic), int(counts.get(number, 0)), partial(messages, number, str(kind_of)))
            for number, topic, kind_of in listed.fetchall()
        ]
        return read_topics(topics, part, name, kind, progress)
    finally:
        connection.close()


# PX4 ULog files, read by pyulog: the fields of one topic.


_TIME = "timestamp"


def read_ulog(path: Path, name: str, part: str | None, progress: Progress) -> Table:
    """Read one topic of a ULog file.

    Raises:
        BadFile: no topic holds numbers.
        BadSetting: there is no such topic.
    """
    pyulog = load_library("pyulog", "pyulog", name, "a ULog file")
    progress(0.0, "reading")
    # The library prints its warnings, which are not part of a command's output.
    with path.open("rb") as file, contextlib.redirect_stdout(io.StringIO()):
        log = pyulog.ULog(file)
    progress(0.8, "reading")
    topics = [(_name(one), one.data, _ulog_fields(one.data)) for one in log.data_list]
    topics = [topic for topic in topics if topic[2] and len(topic[1][_TIME])]
    parts = [Part(topic, len(data[_TIME]), len(fields)) for topic, data, fields in topics]
    chosen, notes = choose_part(parts, part, name, "topic")
    topic, data, fields = topics[chosen]
    return Table(
        names=tuple(f"{topic}/{field}" for field in fields),
        units=("",) * len(fields),
        columns=tuple(np.asarray(data[field], dtype=np.float64) for field in fields),
        time=np.asarray(data[_TIME], dtype=np.float64) / 1e6,
        notes=("a ULog file", *notes),
    )


def _name(topic: Any) -> str:
    """Several sensors of one kind are told apart by their instance."""
    return f"{topic.name}_{topic.multi_id}" if topic.multi_id else str(topic.name)


def _ulog_fields(data: dict[str, Any]) -> list[str]:
    names = [name for name in data if name != _TIME and "_padding" not in name and data[name].dtype.kind in "iufb"]
    return names[:MAX_COLUMNS] if _TIME in data else []
