"""ROS bags, MCAP and ULog files, written by the libraries that own the formats; ULog by its specification."""

import json
import sqlite3
import struct

import numpy as np
import pytest

from kalscope.errors import BadFile, BadSetting
from kalscope.sources.containers.robotics.topics import leaves
from kalscope.sources.grammar.read_options import ReadOptions
from kalscope.sources.readers.recording_file import read_recording

pytest.importorskip("rosbags")
pytest.importorskip("mcap")
pytest.importorskip("pyulog")

from mcap.writer import Writer as McapWriter
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

START = 1_700_000_000_000_000_000
STEP = 10_000_000
N = 25
X = np.sin(np.arange(N) / 4)
IMU, FLOAT, TEXT = "sensor_msgs/msg/Imu", "std_msgs/msg/Float64", "std_msgs/msg/String"
TOPICS = (("/imu", IMU), ("/temp", FLOAT), ("/note", TEXT))


def store_of(version):
    return get_typestore(Stores.ROS1_NOETIC if version == 1 else Stores.ROS2_HUMBLE)


def imu(store, i, version):
    types = store.types
    stamp = types["builtin_interfaces/msg/Time"](sec=1_600_000_000, nanosec=i * STEP)
    extra = {"seq": i} if version == 1 else {}
    vector, quaternion = types["geometry_msgs/msg/Vector3"], types["geometry_msgs/msg/Quaternion"]
    return types[IMU](
        header=types["std_msgs/msg/Header"](stamp=stamp, frame_id="imu", **extra),
        orientation=quaternion(x=0.0, y=0.0, z=0.0, w=1.0),
        orientation_covariance=np.zeros(9),
        angular_velocity=vector(x=0.0, y=0.0, z=0.0),
        angular_velocity_covariance=np.zeros(9),
        linear_acceleration=vector(x=X[i], y=-X[i], z=9.81),
        linear_acceleration_covariance=np.zeros(9),
    )


def write_ros1(path, compression=None):
    store = store_of(1)
    bag = Writer1(path)
    if compression:
        bag.set_compression(compression)
    with bag as writer:
        topics = [writer.add_connection(topic, kind, typestore=store) for topic, kind in TOPICS]
        for i in range(N):
            at = START + 2 * i * STEP
            writer.write(topics[0], at, store.serialize_ros1(imu(store, i, 1), IMU))
            if i % 5 == 0:
                writer.write(topics[1], at + 1, store.serialize_ros1(store.types[FLOAT](data=20.0 + i), FLOAT))
                writer.write(topics[2], at + 2, store.serialize_ros1(store.types[TEXT](data="ok"), TEXT))
    return path


def write_ros2(path, storage):
    store = store_of(2)
    with Writer2(path, version=9, storage_plugin=storage) as writer:
        topics = [writer.add_connection(topic, kind, typestore=store) for topic, kind in TOPICS]
        for i in range(N):
            at = START + 2 * i * STEP
            writer.write(topics[0], at, store.serialize_cdr(imu(store, i, 2), IMU))
            if i % 5 == 0:
                writer.write(topics[1], at + 1, store.serialize_cdr(store.types[FLOAT](data=20.0 + i), FLOAT))
                writer.write(topics[2], at + 2, store.serialize_cdr(store.types[TEXT](data="ok"), TEXT))
    return path


def write_json_mcap(path, **options):
    with path.open("wb") as file:
        writer = McapWriter(file, **options)
        writer.start()
        schema = writer.register_schema(name="Pose", encoding="jsonschema", data=b'{"type": "object"}')
        pose = writer.register_channel(topic="/pose", message_encoding="json", schema_id=schema)
        blob = writer.register_channel(topic="/blob", message_encoding="protobuf", schema_id=schema)
        for i in range(N):
            data = json.dumps({"position": {"x": X[i], "list": [i, 2 * i]}, "name": "robot"}).encode()
            writer.add_message(channel_id=pose, log_time=START + i * STEP, data=data, publish_time=START)
            writer.add_message(channel_id=blob, log_time=START + i * STEP, data=b"\x08\x01", publish_time=START)
        writer.finish()
    return path


def write_ulog(path):
    """Header, two formats, their subscriptions and data; docs.px4.io/main/en/dev_log/ulog_file_format.html."""

    def message(kind, body):
        return struct.pack("<HB", len(body), ord(kind)) + body

    out = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 5_000_000)
    out += message("B", bytes(40))
    out += message("F", b"sensor_combined:uint64_t timestamp;float[3] gyro_rad;uint8_t[4] _padding0;int32_t dt;")
    out += message("F", b"battery:uint64_t timestamp;float voltage_v;")
    for number, (instance, name) in enumerate([(0, b"sensor_combined"), (0, b"battery"), (1, b"battery")]):
        out += message("A", struct.pack("<BH", instance, number) + name)
    for i in range(N):
        out += message("D", struct.pack("<HQfff4xi", 0, 5_000_000 + 4000 * i, X[i], 0.0, 1.0, 4000))
    for i in range(4):
        out += message("D", struct.pack("<HQf", 1, 5_000_000 + 100_000 * i, 12.0 + i))
        out += message("D", struct.pack("<HQf", 2, 5_000_000 + 100_000 * i, 24.0 + i))
    path.write_bytes(out)
    return path


WRITERS = {
    "ros1": lambda folder: write_ros1(folder / "log.bag"),
    "ros1 bz2": lambda folder: write_ros1(folder / "log.bag", Writer1.CompressionFormat.BZ2),
    "ros1 lz4": lambda folder: write_ros1(folder / "log.bag", Writer1.CompressionFormat.LZ4),
    "ros2 sqlite": lambda folder: write_ros2(folder / "log", StoragePlugin.SQLITE3),
    "ros2 mcap": lambda folder: write_ros2(folder / "log", StoragePlugin.MCAP),
}


@pytest.mark.parametrize("kind", WRITERS)
def test_the_topic_with_most_numbers_of_a_bag(tmp_path, kind):
    path = WRITERS[kind](tmp_path)
    recording = read_recording(path)
    np.testing.assert_array_equal(recording.channel("/imu/linear_acceleration.x"), X)
    np.testing.assert_array_equal(recording.channel("/imu/orientation_covariance[8]"), np.zeros(N))
    np.testing.assert_allclose(recording.time, np.arange(N) * 0.01, atol=1e-12)
    assert recording.sample_period == pytest.approx(0.01)
    notes = " ".join(recording.report.notes)
    assert '"/temp" (5 × 1)' in notes
    assert "/note" in notes
    assert "headers" in notes
    assert not any("stamp" in name or "seq" in name for name in recording.names)


@pytest.mark.parametrize("kind", WRITERS)
def test_another_topic_of_a_bag_by_the_end_of_its_name(tmp_path, kind):
    path = WRITERS[kind](tmp_path)
    recording = read_recording(path, ReadOptions(part="temp"))
    assert recording.names == ("/temp/data",)
    np.testing.assert_array_equal(recording.values[:, 0], 20.0 + np.arange(0, N, 5))
    np.testing.assert_allclose(recording.time, np.arange(5) * 0.1, atol=1e-6)  # by the log: it has no header
    with pytest.raises(BadSetting, match=r'"/imu".*"/temp"'):
        read_recording(path, ReadOptions(part="/camera"))


def test_a_bag_of_a_ros_that_stored_no_definitions(tmp_path):
    path = write_ros2(tmp_path / "log", StoragePlugin.SQLITE3)
    file = next(path.glob("*.db3"))
    with sqlite3.connect(file) as connection:
        connection.execute("DROP TABLE message_definitions")
    connection.close()
    np.testing.assert_array_equal(read_recording(file).channel("/imu/linear_acceleration.x"), X)


def test_a_split_bag_names_its_files(tmp_path):
    path = write_ros2(tmp_path / "log", StoragePlugin.SQLITE3)
    (path / "log_1.db3").write_bytes(b"")
    with pytest.raises(BadFile, match=r"log_1\.db3"):
        read_recording(path)


def test_another_database_is_no_bag(tmp_path):
    path = tmp_path / "app #1.db3"
    with sqlite3.connect(path) as connection:
        connection.execute("CREATE TABLE notes (text)")
    connection.close()
    with pytest.raises(BadFile, match="another SQLite database"):
        read_recording(path)


@pytest.mark.parametrize("options", [{}, {"use_chunking": False}])
def test_messages_of_json_in_mcap(tmp_path, options):
    recording = read_recording(write_json_mcap(tmp_path / "log.mcap", **options))
    assert recording.names == ("/pose/position.x", "/pose/position.list[0]", "/pose/position.list[1]")
    np.testing.assert_array_equal(recording.values[:, 0], X)
    np.testing.assert_allclose(recording.time, np.arange(N) * 0.01, atol=1e-12)
    assert any("/blob" in note for note in recording.report.notes)


def test_a_definition_that_would_smuggle_in_a_program_is_not_run(tmp_path):
    """rosbags writes Python from definitions; a name that is none must stop it."""
    path = write_ros2(tmp_path / "log", StoragePlugin.SQLITE3)
    file = next(path.glob("*.db3"))
    bad = "float64 x\nstring A='''\nimport os\nos.abort()\n'''\n"
    with sqlite3.connect(file) as connection:
        connection.execute("UPDATE message_definitions SET encoded_message_definition = ?", (bad,))
    connection.close()
    with pytest.raises(BadFile, match="topic with numbers"):
        read_recording(file)


def test_topics_of_ulog_with_their_instances(tmp_path, capsys):
    path = write_ulog(tmp_path / "log.ulg")
    recording = read_recording(path)
    assert recording.names[:2] == ("sensor_combined/gyro_rad[0]", "sensor_combined/gyro_rad[1]")
    np.testing.assert_array_equal(recording.values[:, 0], X.astype(np.float32))
    assert recording.sample_period == pytest.approx(0.004)
    assert recording.time[0] == 5.0
    assert not any("padding" in name for name in recording.names)
    second = read_recording(path, ReadOptions(part="battery_1"))
    np.testing.assert_array_equal(second.channel("battery_1/voltage_v"), 24.0 + np.arange(4))
    assert capsys.readouterr().out == ""


def test_the_numbers_of_a_message():
    message = {"a": 1, "b": {"c": True, "d": "text"}, "e": [0.5, {"f": 2}], "g": list(range(65)), "h": None}
    assert leaves(message) == {"a": 1.0, "b.c": 1.0, "e[0]": 0.5, "e[1].f": 2.0}
