"""ROS 1 bags (.bag) and the files of ROS 2 bags (.db3), read by rosbags and by SQLite."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

from kalscope.common.progress import Progress
from kalscope.errors import BadFile
from kalscope.sources.containers.library import load_library
from kalscope.sources.containers.robotics.chunks import check_chunk
from kalscope.sources.containers.robotics.ros_types import ros_decoder
from kalscope.sources.containers.robotics.topics import Messages, Topic, read_topics
from kalscope.sources.containers.table import Table

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
