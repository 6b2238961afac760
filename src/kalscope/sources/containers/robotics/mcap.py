"""MCAP logs, read by mcap: messages of ROS 1, ROS 2 and JSON."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from kalscope.common.progress import Progress
from kalscope.sources.containers.library import load_library
from kalscope.sources.containers.robotics.chunks import check_chunk, check_size
from kalscope.sources.containers.robotics.ros_types import ros_decoder
from kalscope.sources.containers.robotics.topics import Messages, Topic, read_topics
from kalscope.sources.containers.table import Table

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
