"""Small files of every container, written by the libraries that own the formats; LVM by its rules."""

import json

import h5py
import nptdms
import numpy as np

N = 25
X = np.sin(np.arange(N) / 4)


def write_mat(path):
    import scipy.io

    scipy.io.savemat(path, {"t": np.arange(N) * 0.01, "log": {"x": X, "y": X[:, None] * 2}}, do_compression=True)
    return path


def write_hdf5(path):
    with h5py.File(path, "w") as file:
        file["run/t"] = np.arange(N) * 0.01
        file.create_dataset("run/x", data=X, compression="gzip", chunks=(10,))
        file["run/x"].attrs["units"] = "V"
    return path


def write_tdms(path):
    with nptdms.TdmsWriter(path) as writer:
        for part in (X[:10], X[10:]):
            channels = [nptdms.ChannelObject("ai", name, part, {"wf_increment": 0.01}) for name in ("x", "y")]
            writer.write_segment(channels)
    return path


def write_xlsx(path):
    import openpyxl

    workbook = openpyxl.Workbook()
    workbook.active.append(["t", "x (V)"])
    for i, x in enumerate(X):
        workbook.active.append([i * 0.01, float(x)])
    workbook.save(path)
    return path


def write_parquet(path):
    import duckdb

    connection = duckdb.connect()
    connection.execute(
        f"COPY (SELECT i * 0.01 AS t, sin(i) AS x FROM range({N}) r(i)) TO '{path}' (FORMAT parquet)"
    )
    connection.close()
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


def write_json(path):
    path.write_text(json.dumps([{"t": i * 0.01, "x": x} for i, x in enumerate(X)], indent=1))
    return path


CONTAINERS = {
    "log.mat": write_mat,
    "log.h5": write_hdf5,
    "log.tdms": write_tdms,
    "log.xlsx": write_xlsx,
    "log.parquet": write_parquet,
    "log.lvm": write_lvm,
    "log.json": write_json,
    "log.npy": write_npy,
    "log.npz": write_npz,
}
"""Name of a small file of each kind, and its writer: from the path to the path of the file."""
