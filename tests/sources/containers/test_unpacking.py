"""What a packed file may unpack to: one rule for every kind, with an option to go on."""

from __future__ import annotations

import gzip
import io
import re
import zipfile

import pytest
from tests.support.required import needs

needs("duckdb", "h5py", "mcap", "nptdms", "openpyxl", "python_calamine", "rosbags", "scipy", "zstandard")

import zstandard  # noqa: E402
from tests.sources.made_containers import CONTAINERS  # noqa: E402

from kalscope.common import files  # noqa: E402
from kalscope.errors import BadFile, NoMemory  # noqa: E402
from kalscope.sources.grammar.read_options import ReadOptions  # noqa: E402
from kalscope.sources.reading.recording_file import read_recording  # noqa: E402

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
