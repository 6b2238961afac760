"""What a packed file may unpack to: one rule for every kind, with an option to go on."""

from __future__ import annotations

import gzip
import io
import re
import zipfile

import numpy as np
import pytest
from tests.support.required import needs

needs("duckdb", "h5py", "mcap", "nptdms", "openpyxl", "python_calamine", "rosbags", "scipy", "zstandard")

import duckdb  # noqa: E402
import h5py  # noqa: E402
import openpyxl  # noqa: E402
import scipy.io  # noqa: E402
import zstandard  # noqa: E402
from tests.sources.made_containers import Compression, write_json_mcap, write_ros1  # noqa: E402

from kalscope.common import files  # noqa: E402
from kalscope.errors import BadFile, NoMemory  # noqa: E402
from kalscope.sources.grammar.read_options import ReadOptions  # noqa: E402
from kalscope.sources.reading.recording_file import read_recording  # noqa: E402

ROWS = b"".join(b"%d,%d\n" % (i, i % 7) for i in range(3000))


def zipped(data):
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("log.csv", data)
    return buffer.getvalue()


def sheet(path):
    book = openpyxl.Workbook()
    for i in range(300):
        book.active.append([i, 0.5 * i])
    book.save(path)


def hdf5(path):
    with h5py.File(path, "w") as file:
        file.create_dataset("x", data=np.zeros(3000), compression="gzip")


def parquet(path):
    duckdb.sql("SELECT 1 AS x FROM range(3000)").write_parquet(str(path))


WRITERS = {
    "log.csv.gz": lambda path: path.write_bytes(gzip.compress(ROWS)),
    "log.csv.zst": lambda path: path.write_bytes(zstandard.compress(ROWS)),
    "log.zip": lambda path: path.write_bytes(zipped(ROWS)),
    "log.zip.gz": lambda path: path.write_bytes(gzip.compress(zipped(ROWS))), "log.xlsx": sheet, "log.h5": hdf5,
    "log.mat": lambda path: scipy.io.savemat(path, {"log": {"x": np.zeros(3000)}}, do_compression=True),
    "log.parquet": parquet, "log.mcap": lambda path: write_json_mcap(path, chunk_size=300),
    "log.bag": lambda path: write_ros1(path, Compression.BZ2),
}  # fmt: skip


@pytest.mark.parametrize(("name", "write"), WRITERS.items(), ids=list(WRITERS))
def test_what_unpacks_to_too_much_is_refused_unless_it_is_allowed(tmp_path, name, write):
    path = tmp_path / name
    write(path)
    with pytest.MonkeyPatch.context() as patch:
        assert len(read_recording(path)) > 10
        patch.setattr(files, "MAX_UNPACKED", 900)
        patch.setattr(files, "MAX_RATIO", 0)
        said = f"{name} must unpack to at most 9e-07 GB (got more): --unpack-gb allows more"
        with pytest.raises(BadFile, match=f"^{re.escape(said)}$"):
            read_recording(path)
        assert len(read_recording(path, ReadOptions(unpack_gb=1e-3))) > 10
        patch.setattr(files, "MAX_RATIO", 1000)
        assert len(read_recording(path)) > 10


@pytest.mark.parametrize("name", ["log.h5", "log.mat", "log.parquet"])
def test_a_container_that_will_not_fit_into_memory_is_refused_before_it_is_read(tmp_path, name):
    path = tmp_path / name
    WRITERS[name](path)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(files, "free_memory", lambda: 1000)
        with pytest.raises(NoMemory, match=rf"^{name} must fit into the memory that is free, 0.0 GB \(got "):
            read_recording(path)
