"""ROS bags, MCAP and ULog files, written by the libraries that own the formats; ULog by its specification."""

import bz2
import sqlite3
import struct

import numpy as np
import pytest
from each import each

from kalscope.common.progress import Progress
from kalscope.errors import BadFile, BadSetting
from kalscope.sources.containers import robotics
from kalscope.sources.containers.robotics import Topic, leaves, read_topics
from kalscope.sources.grammar.read_options import ReadOptions
from kalscope.sources.reading.recording_file import read_recording

pytest.importorskip("rosbags")
pytest.importorskip("mcap")
pytest.importorskip("pyulog")

from made_containers import (
    Compression,
    N,
    StoragePlugin,
    X,
    write_json_mcap,
    write_ros1,
    write_ros2,
    write_ulog,
)

zstandard = pytest.importorskip("zstandard")
lz4 = pytest.importorskip("lz4.frame")

WRITERS = {
    "ros1": lambda folder: write_ros1(folder / "log.bag"),
    "ros1 bz2": lambda folder: write_ros1(folder / "log.bag", Compression.BZ2),
    "ros1 lz4": lambda folder: write_ros1(folder / "log.bag", Compression.LZ4),
    "ros2 sqlite": lambda folder: write_ros2(folder / "log", StoragePlugin.SQLITE3),
    "ros2 mcap": lambda folder: write_ros2(folder / "log", StoragePlugin.MCAP),
}


@pytest.mark.slow
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


@pytest.mark.slow
@pytest.mark.parametrize("kind", WRITERS)
def test_another_topic_of_a_bag_by_the_end_of_its_name(tmp_path, kind):
    path = WRITERS[kind](tmp_path)
    recording = read_recording(path, ReadOptions(part="temp"))
    assert recording.names == ("/temp/data",)
    np.testing.assert_array_equal(recording.values[:, 0], 20.0 + np.arange(0, N, 5))
    np.testing.assert_allclose(recording.time, np.arange(5) * 0.1, atol=1e-6)  # by the log: it has no header
    with pytest.raises(BadSetting, match=r'"/imu".*"/temp"'):
        read_recording(path, ReadOptions(part="/camera"))


@pytest.mark.parametrize(
    ("pack", "unpacker", "damage"),
    [
        (bz2.compress, bz2.BZ2Decompressor, OSError),
        (lz4.compress, lz4.LZ4FrameDecompressor, RuntimeError),
    ],
)
def test_all_streams_of_a_packed_chunk_count(monkeypatch, pack, unpacker, damage):
    packed = pack(bytes(600)) * 3
    assert robotics.unpacked_size(packed + b"what follows", unpacker, damage) == 1800
    monkeypatch.setattr(robotics, "MAX_CHUNK", 1000)
    assert robotics.unpacked_size(packed, unpacker, damage) == 1001
    with pytest.raises(damage):
        robotics.unpacked_size(b"BZh9 no stream", unpacker, damage)
    with pytest.raises(BadFile, match="at most 1000 bytes"):
        robotics.check_chunk(packed, "log.bag", "a bag")


@pytest.mark.parametrize("compression", list(Compression))
def test_a_bag_of_chunks_that_unpack_to_too_much_is_refused(tmp_path, monkeypatch, compression):
    path = write_ros1(tmp_path / "log.bag", compression)
    assert len(read_recording(path)) == N
    monkeypatch.setattr(robotics, "MAX_CHUNK", 1000)
    with pytest.raises(BadFile, match="at most 1000 bytes"):
        read_recording(path)


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


@pytest.mark.parametrize("limit", [1 << 28, 1 << 20])
def test_a_chunk_of_mcap_that_unpacks_to_more_than_it_says_is_refused(tmp_path, monkeypatch, limit):
    monkeypatch.setattr(robotics, "MAX_CHUNK", limit)
    packed = zstandard.compress(bytes(5_000_000))
    chunk = struct.pack("<QQQII", 0, 0, 10, 0, 4) + b"zstd" + struct.pack("<Q", len(packed)) + packed
    header, magic = bytes(8), b"\x89MCAP0\r\n"
    path = tmp_path / "log.mcap"
    path.write_bytes(
        magic + struct.pack("<BQ", 1, len(header)) + header + struct.pack("<BQ", 6, len(chunk)) + chunk + magic
    )
    said = "10 bytes unpacks to 5000000" if limit > 5_000_000 else f"at most {limit} bytes"
    with pytest.raises(BadFile, match=said):
        read_recording(path)


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


@each(
    ("seconds", "rest", "clock"),
    [
        ("sec", "nsec", "headers"),
        ("sec", "nanosec", "headers"),
        ("secs", "nsecs", "headers"),
        ("sec", "other", "log"),
        ("secs", "nanosec", "log"),
    ],
)
def test_the_time_of_a_header_needs_both_its_parts(seconds, rest, clock):
    def message(i):
        return {"header": {"stamp": {seconds: 1_700_000_000, rest: i * 1_000_000}}, "x": i}

    topic = Topic("/a", 5, lambda: [(1_800_000_000_000_000_000 + i * 2_000_000, message(i)) for i in range(5)])
    table = read_topics([topic], None, "log.mcap", "an MCAP log", Progress())
    assert clock in table.clock
    assert table.names[-1] == "/a/x"
    assert not any(f"header.stamp.{field}" in name for name in table.names for field in ("nsec", "nsecs", "secs"))
    np.testing.assert_allclose(table.time, np.arange(5) * (0.001 if clock == "headers" else 0.002))


def test_without_a_time_column_nothing_is_said_of_stamps(tmp_path):
    path = write_json_mcap(tmp_path / "log.mcap")
    assert any("time is that of" in note for note in read_recording(path).report.notes)
    recording = read_recording(path, ReadOptions(time_column="none"))
    assert recording.sample_period is None
    assert [note for note in recording.report.notes if "time" in note] == ["no time column: samples are counted"]


def test_the_numbers_of_a_message():
    message = {"a": 1, "b": {"c": True, "d": "text"}, "e": [0.5, {"f": 2}], "g": list(range(65)), "h": None}
    assert leaves(message) == {"a": 1.0, "b.c": 1.0, "e[0]": 0.5, "e[1].f": 2.0}
