"""Logs of robots: MCAP with messages of ROS or in JSON, and ULog of PX4."""

from __future__ import annotations

import contextlib
import io
import json
import re
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import is_dataclass, replace
from pathlib import Path
from typing import Any, cast

import numpy as np

from kalscope.common.files import require_memory
from kalscope.common.progress import Progress
from kalscope.errors import BadFile, KalscopeError
from kalscope.sources.containers.table import MAX_COLUMNS, MAX_NUMBERS, Part, Table, choose_part, load_library

# MCAP logs, read by mcap: every numeric field of the messages of a topic is a channel with its full name.


MAX_CHUNK = 1 << 28
"""Bytes of one unpacked chunk."""

_KIND = "an MCAP log"
_RECORDS_PER_REPORT = 1024
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*(?:/[A-Za-z][A-Za-z0-9_]*)*")
_MAX_SEQUENCE = 1 << 24
_MAX_ELEMENTS = 64
"""Elements of an array that are channels; a longer one is an image or a scan."""
_MAX_DEPTH = 12
_STAMP_PARTS = (("sec", "nanosec"), ("sec", "nsec"), ("secs", "nsecs"))
"""Fields of a stamp: of ROS 2, of rosbags for ROS 1, and of ROS 1 itself, whose messages JSON may hold."""
_STAMP_FIELDS = {"header.seq"} | {f"header.stamp.{field}" for parts in _STAMP_PARTS for field in parts}
_ROW_BYTES, _NUMBER_BYTES = 160, 48
"""Memory that a message and each of its numbers take, bytes."""

Decode = Callable[[bytes], Any]
"""From the bytes of a message to its fields."""


def read_mcap(path: Path, name: str, part: str | None, progress: Progress) -> Table:
    """Read one topic of an MCAP log.

    Raises:
        BadFile: no topic holds numbers in an encoding that is read, or one holds too many.
        BadSetting: there is no such topic.
    """
    load_library("mcap", "mcap", name, _KIND)
    schemas: dict[int, Any] = {}
    channels: dict[int, Any] = {}
    fields: dict[int, list[str]] = {}
    counts: Counter[int] = Counter()
    for record in _records(path, name, progress.part(0.0, 0.4)):
        word = type(record).__name__
        if word == "Schema":
            schemas[record.id] = record
        elif word == "Channel":
            channels[record.id] = record
        elif word == "Message":
            key = record.channel_id
            if not counts[key]:
                fields[key] = _fields(channels[key], schemas, record.data, name)
            counts[key] += 1
    # Several channels of one topic, one per publisher, get distinct names.
    topics = [channels[key].topic for key in counts]
    titles = {
        key: one if topics.count(one) == 1 else f"{one} {key}" for key, one in zip(counts, topics, strict=True)
    }
    holding = [key for key in counts if fields[key]]
    parts = [Part(titles[key], counts[key], len(fields[key])) for key in holding]
    chosen, notes = choose_part(parts, part, name, "topic")
    if without := [titles[key] for key in counts if not fields[key]]:
        more = f" and {len(without) - 8} more" if len(without) > 8 else ""
        notes = (*notes, f"topics without numbers that can be read: {', '.join(without[:8])}{more}")
    key = holding[chosen]
    rows, names = counts[key], fields[key]
    if rows * len(names) > MAX_NUMBERS or len(names) > MAX_COLUMNS:
        raise BadFile(
            f"{name} must hold at most {MAX_COLUMNS} fields a message (got {len(names)} in {titles[key]})"
        )
    # As objects of Python, before they become an array.
    require_memory(rows * (_ROW_BYTES + _NUMBER_BYTES * len(names)), name, f"{rows} messages")
    decode = _decoder(channels[key], schemas, name)
    logged: list[int] = []
    stamped: list[int] = []
    values: list[list[float]] = []
    for record in _records(path, name, replace(progress.part(0.4, 1.0), unpacking=None)):  # counted above
        if type(record).__name__ == "Message" and record.channel_id == key:
            found = leaves(decode(record.data))
            values.append([found.get(field, np.nan) for field in names])
            logged.append(record.log_time)
            stamped.append(stamp_of(found))
    time = np.array(stamped if all(stamped) else logged, dtype=np.int64)
    return Table(
        names=tuple(f"{titles[key]}/{field}" for field in names),
        units=("",) * len(names),
        columns=tuple(np.array(values, dtype=np.float64).T.copy()),
        time=(time - time[0]).astype(np.float64) / 1e9,
        start=float(time[0]) / 1e9,
        clock="time is that of the messages' headers" if all(stamped) else "time is that of the log",
        notes=(_KIND, *notes),
    )


def _fields(channel: Any, schemas: dict[int, Any], data: bytes, name: str) -> list[str]:
    """Names of the numeric fields of a message; none where it cannot be decoded."""
    try:
        found = leaves(_decoder(channel, schemas, name)(data))
    except KalscopeError:
        raise
    except Exception:
        return []
    return [field for field in found if field not in _STAMP_FIELDS]


def _decoder(channel: Any, schemas: dict[int, Any], name: str) -> Decode:
    schema, encoding = schemas.get(channel.schema_id), channel.message_encoding
    if encoding == "json":
        return json.loads
    if schema is None or (encoding, schema.encoding) not in (("cdr", "ros2msg"), ("ros1", "ros1msg")):
        raise ValueError(f"messages in {encoding} are not read")
    typesys = load_library("rosbags.typesys", "rosbags", name, _KIND)
    types = typesys.get_types_from_msg(schema.data.decode("utf-8"), schema.name)
    for full_name, (constants, fields) in types.items():
        # rosbags writes a Python program from these names: nothing but names may pass.
        for text in (full_name, *(constant[0] for constant in constants), *(field[0] for field in fields)):
            if not _NAME.fullmatch(text):
                raise ValueError(f"{text[:40]!r} is not a name of a ROS type")
    store = typesys.get_typestore(typesys.Stores.EMPTY)
    store.max_sequence_length = _MAX_SEQUENCE
    store.register(types)
    decode, first = store.deserialize_ros1 if encoding == "ros1" else store.deserialize_cdr, next(iter(types))
    return lambda data: decode(data, first)


def stamp_of(found: dict[str, float]) -> int:
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
            if record.uncompressed_size > MAX_CHUNK:
                raise BadFile(f"{name} must hold chunks of at most {MAX_CHUNK} bytes (got more)")
            progress.unpack(record.uncompressed_size)
            plain = replace(record, data=_unpacked(record, name), compression="")
            yield from reading.breakup_chunk(plain, validate_crc=True)


def _unpacked(chunk: Any, name: str) -> bytes:
    """The content of a chunk; it is never unpacked to more than it says."""
    data, said = chunk.data, chunk.uncompressed_size
    if chunk.compression == "zstd":
        data = (
            load_library("zstandard", "zstandard", name, _KIND)
            .ZstdDecompressor()
            .stream_reader(data)
            .read(said + 1)
        )
    elif chunk.compression == "lz4":
        data = load_library("lz4.frame", "lz4", name, _KIND).LZ4FrameDecompressor().decompress(data, said + 1)
    if len(data) != said:
        raise ValueError(f"a chunk of {said} bytes unpacks to {'more' if len(data) > said else len(data)}")
    return data


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
