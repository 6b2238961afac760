"""What all containers share: known by content, cancelled, refused where damaged or what unpacks to too much."""

import gzip
import io
import random
import re
import sys
import zipfile

import numpy as np
import pytest
from tests.support.effort import FUZZ
from tests.support.required import needs

from kalscope.common import files
from kalscope.errors import BadFile, Cancelled, NoMemory
from kalscope.sources.grammar.read_options import ReadOptions
from kalscope.sources.reading.recording_file import read_recording

needs(
    "duckdb", "pyarrow", "h5py", "nptdms", "openpyxl", "python_calamine", "rosbags", "mcap", "pyulog", "zstandard"
)

import zstandard  # noqa: E402
from tests.sources.made_containers import CONTAINERS  # noqa: E402

LIBRARIES = {
    "log.h5": ("h5py", "h5py"), "log.tdms": ("nptdms", "npTDMS"),
    "log.xlsx": ("python_calamine", "python-calamine"), "log.parquet": ("pyarrow.parquet", "pyarrow"),
    "log.ulg": ("pyulog", "pyulog"), "log.mcap": ("mcap.stream_reader", "mcap"),
    "log.bag": ("rosbags.rosbag1", "rosbags"), "log.db3": ("rosbags.rosbag2.storage_sqlite3", "rosbags"),
}  # fmt: skip


@pytest.fixture(params=CONTAINERS)
def container(request, tmp_path):
    return CONTAINERS[request.param](tmp_path / request.param)


@pytest.mark.slow
def test_a_container_is_known_by_its_content_reports_its_progress_and_is_cancelled(container, tmp_path):
    done = []
    recording = read_recording(container, progress=lambda fraction, text: done.append((fraction, text)))
    assert done
    assert all(0.0 <= fraction <= 1.0 and text for fraction, text in done)
    packed = tmp_path / f"{container.name}.gz"
    packed.write_bytes(gzip.compress(container.read_bytes()))
    again = read_recording(packed)
    assert again.names == recording.names
    np.testing.assert_array_equal(again.values, recording.values)
    report = recording.report
    assert report.rows == report.lines - report.headers - report.comments == len(recording)
    with pytest.raises(Cancelled):
        read_recording(container, cancelled=lambda: True)


@pytest.mark.slow
@pytest.mark.parametrize("name", LIBRARIES)
def test_a_missing_library_is_named_with_its_extra(tmp_path, monkeypatch, name):
    path = CONTAINERS[name](tmp_path / name)
    module, package = LIBRARIES[name]
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(BadFile, match=rf"^.*needs {package} .*kalscope\[formats\].*$"):
        read_recording(path)


# Cut short or with wrong bytes they are refused, or still read; nothing else happens.


def read_or_refuse(path, data):
    path.write_bytes(data)
    refusal = ""
    try:
        recording = read_recording(path)
    except BadFile as error:
        refusal = str(error)
    if refusal:
        assert re.fullmatch(f".*{path.name}.*", refusal)
    else:
        assert recording.values.shape == (len(recording), len(recording.names))
        assert not np.isinf(recording.values).any()


@pytest.mark.slow
def test_a_damaged_container_is_refused_or_read(container):
    data, draw = container.read_bytes(), random.Random(7)
    for cut in {1, 100, *(len(data) * k // 8 for k in (1, 4, 7)), len(data) - 1}:
        read_or_refuse(container, data[:cut])
    for _ in range(8 * FUZZ):
        damaged = bytearray(data)
        for _ in range(draw.choice((1, 1, 3, 20))):
            at = draw.randrange(min(len(data), draw.choice((300, len(data)))))  # the beginning holds the structure
            damaged[at] ^= 1 << draw.randrange(8)
        read_or_refuse(container, bytes(damaged))


ROWS = b"".join(b"%d,%d\n" % (i, i % 7) for i in range(3000))
ZIP = io.BytesIO()
with zipfile.ZipFile(ZIP, "w", zipfile.ZIP_DEFLATED) as _archive:
    _archive.writestr("log.csv", ROWS)
TEXTS = {"log.csv.gz": gzip.compress(ROWS), "log.csv.zst": zstandard.compress(ROWS), "log.zip": ZIP.getvalue()}
TEXTS["log.zip.gz"] = gzip.compress(ZIP.getvalue())
NAMES = [*TEXTS, "log.xlsx", "log.h5", "log.mat", "log.parquet", "log.mcap", "packed.bag"]


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_what_unpacks_to_too_much_is_refused_unless_it_is_allowed(tmp_path, monkeypatch, name):
    path = tmp_path / name
    if name in TEXTS:
        path.write_bytes(TEXTS[name])
    else:
        CONTAINERS[name](path)
    assert len(read_recording(path)) > 10
    monkeypatch.setattr(files, "MAX_UNPACKED", 100)
    monkeypatch.setattr(files, "MAX_RATIO", 0)
    said = f"{name} must unpack to at most 1e-07 GB (got more): --unpack-gb allows more"
    with pytest.raises(BadFile, match=f"^{re.escape(said)}$"):
        read_recording(path)
    assert len(read_recording(path, ReadOptions(unpack_gb=1e-3))) > 10
    monkeypatch.setattr(files, "MAX_RATIO", 1000)
    assert len(read_recording(path)) > 10
    if name in ("log.h5", "log.mat", "log.parquet"):
        monkeypatch.setattr(files, "free_memory", lambda: 100)
        with pytest.raises(NoMemory, match=rf"^{name} must fit into the memory that is free, 0.0 GB \(got "):
            read_recording(path)
