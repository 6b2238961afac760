"""Small files of every container, written by the libraries that own the formats; ULog and LVM by their rules."""

import json
import struct

import h5py
import nptdms
import numpy as np
from mcap.writer import Writer as McapWriter
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

N = 25
X = np.sin(np.arange(N) / 4)
Compression = Writer1.CompressionFormat
START = 1_700_000_000_000_000_000
STEP = 10_000_000
FIELD, FLOAT, TEXT = "sensor_msgs/msg/MagneticField", "std_msgs/msg/Float64", "std_msgs/msg/String"


def write_messages(writer, version):
    """A vector at every step, temperature and text at every fifth, by stamps of the log twice as fast."""
    store = get_typestore(Stores.ROS1_NOETIC if version == 1 else Stores.ROS2_HUMBLE)
    pack = store.serialize_ros1 if version == 1 else store.serialize_cdr
    kinds = {"/mag": FIELD, "/temp": FLOAT, "/note": TEXT}
    topics = [writer.add_connection(topic, kind, typestore=store) for topic, kind in kinds.items()]
    vector, stamp = store.types["geometry_msgs/msg/Vector3"], store.types["builtin_interfaces/msg/Time"]
    for i in range(N):
        at, extra = START + 2 * i * STEP, {"seq": i} if version == 1 else {}
        header = store.types["std_msgs/msg/Header"](stamp=stamp(1_600_000_000, i * STEP), frame_id="", **extra)
        field = store.types[FIELD](header, vector(x=X[i], y=-X[i], z=9.81), np.arange(9.0))
        writer.write(topics[0], at, pack(field, FIELD))
        if i % 5 == 0:
            writer.write(topics[1], at + 1, pack(store.types[FLOAT](data=20.0 + i), FLOAT))
            writer.write(topics[2], at + 2, pack(store.types[TEXT](data="ok"), TEXT))


def write_ros1(path, compression=None):
    bag = Writer1(path)
    if compression:
        bag.set_compression(compression)
    with bag as writer:
        write_messages(writer, 1)
    return path


def write_ros2(path, storage):
    with Writer2(path, version=9, storage_plugin=storage) as writer:
        write_messages(writer, 2)
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


def write_mat(path):
    import scipy.io

    scipy.io.savemat(path, {"t": np.arange(N) * 0.01, "log": {"x": X, "y": X[:, None] * 2}}, do_compression=True)
    return path


def write_hdf5(path):
    with h5py.File(path, "w") as file:
        file["run/t"] = np.arange(N) * 0.01
        file.create_dataset("run/x", data=X, compression="gzip", chunks=(10,)).attrs["units"] = "V"
    return path


def write_tdms(path):
    with nptdms.TdmsWriter(path) as writer:
        for part in (X[:10], X[10:]):
            writer.write_segment([nptdms.ChannelObject("ai", name, part, {"wf_increment": 0.01}) for name in "xy"])
    return path


def write_xlsx(path):
    import openpyxl

    workbook = openpyxl.Workbook()
    for row in (["t", "x (V)"], *([i * 0.01, float(x)] for i, x in enumerate(X))):
        workbook.active.append(row)
    workbook.save(path)
    return path


def write_parquet(path):
    import duckdb

    duckdb.sql(f"SELECT i * 0.01 AS t, sin(i) AS x FROM range({N}) r(i)").write_parquet(str(path))
    return path


def write_lvm(path):
    rows = "".join(f"{i * 0.01:.6f}\t{x:.6f}\n" for i, x in enumerate(X))
    path.write_text(
        "LabVIEW Measurement\t\nSeparator\tTab\nDecimal_Separator\t.\nX_Columns\tOne\n***End_of_Header***\t\n\t\n"
        "Channels\t1\t\nDate\t2024/03/01\nTime\t10:00:00.5\nY_Unit_Label\tV\nX0\t0.0\nDelta_X\t0.01\n"
        "***End_of_Header***\t\nX_Value\tx\tComment\n" + rows
    )
    return path


def write_npy(path):
    table = np.zeros(N, dtype=[("t", "f8"), ("x", "f4")])
    table["t"], table["x"] = np.arange(N) * 0.01, X
    np.save(path, table)
    return path


def write_npz(path):
    np.savez_compressed(
        path, t=np.arange(N) * 0.01, x=X, y=np.column_stack((X, X)), what=np.array([{}], dtype=object)
    )
    return path


def write_edf(path, kind="EDF+C"):
    """Three signals, four records of half a second; edfplus.info/specs/edf.html."""
    signals = [("EEG Fp1", "uV", 50), ("EDF Annotations", "", 8), ("Temp", "degC", 5)]

    def column(width, *values):
        return "".join(str(value).ljust(width) for value in values)

    head = column(8, 0) + column(80, "X", "Startdate X") + "01.03.2410.00.00" + column(8, 1024) + column(44, kind)
    head += column(8, 4, 0.5) + column(4, 3)
    head += column(16, *(name for name, *_ in signals)) + " " * 240 + column(8, *(unit for _, unit, _ in signals))
    head += column(8, *[-100] * 3, *[100] * 3, *[-2048] * 3, *[2047] * 3) + " " * 240
    head += column(8, *(n for *_, n in signals)) + " " * 96
    records = np.arange(4 * 63, dtype="<i2").reshape(4, 63)
    path.write_bytes(head.encode() + records.tobytes())
    return path


def write_json(path):
    path.write_text(json.dumps([{"t": i * 0.01, "x": x} for i, x in enumerate(X)], indent=1))
    return path


CONTAINERS = {
    "log.mat": write_mat, "log.edf": write_edf, "log.h5": write_hdf5, "log.tdms": write_tdms,
    "log.xlsx": write_xlsx, "log.parquet": write_parquet, "log.lvm": write_lvm, "log.json": write_json,
    "log.npy": write_npy, "log.npz": write_npz, "log.ulg": write_ulog, "log.mcap": write_json_mcap,
    "log.bag": write_ros1, "packed.bag": lambda path: write_ros1(path, Compression.LZ4),
    "log.db3": lambda path: next(write_ros2(path.parent / "ros2", StoragePlugin.SQLITE3).glob("*.db3")),
    "ros2.mcap": lambda path: next(write_ros2(path.parent / "ros2m", StoragePlugin.MCAP).glob("*.mcap")),
}  # fmt: skip
"""Name of a small file of each kind, and its writer: from the path to the path of the file."""
