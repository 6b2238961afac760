"""ROS bags, MCAP and ULog files, written by the libraries that own the formats; ULog by its specification."""

import sqlite3
from contextlib import closing

import numpy as np
import pytest
from tests.support.required import needs

from kalscope.errors import BadFile, BadSetting
from kalscope.sources.containers import robotics
from kalscope.sources.grammar.read_options import ReadOptions
from kalscope.sources.reading.recording_file import read_recording

needs("rosbags", "mcap", "pyulog", "lz4", "zstandard", "h5py", "nptdms")

from tests.sources import made_containers as made  # noqa: E402
from tests.sources.made_containers import N, X  # noqa: E402

WRITERS = {
    "ros1": lambda folder: made.write_ros1(folder / "log.bag"),
    "ros1 bz2": lambda folder: made.write_ros1(folder / "log.bag", made.Compression.BZ2),
    "ros1 lz4": lambda folder: made.write_ros1(folder / "log.bag", made.Compression.LZ4),
    "ros2 sqlite": lambda folder: made.write_ros2(folder / "log", made.StoragePlugin.SQLITE3).rename(
        folder / "#1%41"
    ),
    "ros2 mcap": lambda folder: made.write_ros2(folder / "log", made.StoragePlugin.MCAP),
}


@pytest.mark.slow
@pytest.mark.parametrize("kind", WRITERS)
def test_topics_of_a_bag_by_the_stamps_of_their_headers_or_of_the_log(tmp_path, kind):
    path = WRITERS[kind](tmp_path)
    recording = read_recording(path)
    np.testing.assert_array_equal(recording.channel("/mag/magnetic_field.x"), X)
    np.testing.assert_array_equal(recording.channel("/mag/magnetic_field_covariance[8]"), np.full(N, 8))
    np.testing.assert_allclose(recording.time, np.arange(N) * 0.01, atol=1e-12)
    assert recording.sample_period == pytest.approx(0.01)
    assert not any("stamp" in name or "seq" in name for name in recording.names)
    recording = read_recording(path, ReadOptions(part="temp"))
    assert recording.names == ("/temp/data",)
    np.testing.assert_array_equal(recording.values[:, 0], 20.0 + np.arange(0, N, 5))
    np.testing.assert_allclose(recording.time, np.arange(5) * 0.1, atol=1e-6)  # by the log: it has no header
    with pytest.raises(BadSetting, match=r'one topic of "/mag" .*"/temp"'):
        read_recording(path, ReadOptions(part="/camera"))


BAD = "float64 x\nstring A='''\nimport os\nos.abort()\n'''\n"
CHANGES = {
    "topic with numbers": f"""UPDATE message_definitions SET encoded_message_definition = "{BAD}" """,
    "ROS 2 bag: Cannot open database": "DROP TABLE messages",
    "": "DELETE FROM message_definitions",
}


@pytest.mark.slow
@pytest.mark.parametrize("said", CHANGES)
def test_a_bag_without_definitions_is_read_and_what_is_no_bag_refused(tmp_path, said):
    file = next(made.write_ros2(tmp_path / "log", made.StoragePlugin.SQLITE3).glob("*.db3"))
    with closing(sqlite3.connect(file)) as connection, connection:
        connection.execute(CHANGES[said])
    if said:
        with pytest.raises(BadFile, match=said):
            read_recording(file)
    else:
        np.testing.assert_array_equal(read_recording(file).channel("/mag/magnetic_field.x"), X)
    (tmp_path / "log" / "log_1.db3").write_bytes(b"")
    with pytest.raises(BadFile, match=r"log_1\.db3"):
        read_recording(tmp_path / "log")


@pytest.mark.parametrize("options", [{}, {"use_chunking": False}])
def test_messages_of_json_in_mcap(tmp_path, options):
    recording = read_recording(made.write_json_mcap(tmp_path / "log.mcap", **options))
    assert recording.names == ("/pose/position.x", "/pose/position.list[0]", "/pose/position.list[1]")
    np.testing.assert_array_equal(recording.values[:, 0], X)
    np.testing.assert_allclose(recording.time, np.arange(N) * 0.01, atol=1e-12)


@pytest.mark.slow
def test_a_chunk_that_unpacks_to_too_much_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(robotics, "MAX_CHUNK", 1000)
    for compression in made.Compression:
        with pytest.raises(BadFile, match="chunks of at most 1000 bytes"):
            read_recording(made.write_ros1(tmp_path / f"{compression}.bag", compression))


def test_topics_of_ulog_with_their_instances(tmp_path, capsys):
    path = made.write_ulog(tmp_path / "log.ulg")
    recording = read_recording(path)
    assert recording.names[:2] == ("sensor_combined/gyro_rad[0]", "sensor_combined/gyro_rad[1]")
    np.testing.assert_array_equal(recording.values[:, 0], X.astype(np.float32))
    assert recording.sample_period == pytest.approx(0.004)
    assert recording.time[0] == 5.0
    assert not any("padding" in name for name in recording.names)
    second = read_recording(path, ReadOptions(part="battery_1"))
    np.testing.assert_array_equal(second.channel("battery_1/voltage_v"), 24.0 + np.arange(4))
    assert capsys.readouterr().out == ""
