"""Parquet files, written by DuckDB and read by pyarrow."""

import numpy as np
import pytest
from tests.support.required import needs

from kalscope.errors import BadSetting
from kalscope.sources.grammar.read_options import ReadOptions
from kalscope.sources.reading.recording_file import read_recording

needs("duckdb", "pyarrow")

import duckdb  # noqa: E402


@pytest.fixture
def parquet(tmp_path):
    def write(select):
        path = tmp_path / "log.parquet"
        connection = duckdb.connect()
        connection.execute(f"COPY ({select}) TO '{path}' (FORMAT parquet)")
        connection.close()
        return read_recording(path)

    return write


@pytest.mark.parametrize("kind", ["TIMESTAMP", "TIMESTAMP_NS", "TIMESTAMP_S", "TIMESTAMPTZ"])
def test_a_parquet_file_with_stamps(parquet, kind):
    recording = parquet(
        f"SELECT (TIMESTAMP '2026-01-01' + INTERVAL (i) SECOND)::{kind} AS at, 'ok' AS state, i AS n"
        " FROM range(9) t(i)"
    )
    assert recording.names == ("n",)
    assert recording.time.tolist() == list(range(9))
    assert any("2026-01-01T00:00:00" in note for note in recording.report.notes)


def test_nulls_and_infinities_of_parquet_are_missing_samples(parquet):
    recording = parquet(
        "SELECT * FROM (VALUES (0.0::DOUBLE, 1.0::DOUBLE), (1, NULL), (2, 'inf'), (NULL, 4), (3, 5)) v(t, a)"
    )
    np.testing.assert_array_equal(recording.values[:, 0], [1, np.nan, np.nan, 5])
    report = recording.report
    assert (report.rows, report.rejected, report.lines, report.bad_cells) == (4, 1, 5, 1)


@pytest.mark.parametrize("name", ["log.parquet", "log.csv"])
def test_a_part_of_a_file_of_one_table_is_refused(tmp_path, name):
    path = tmp_path / name
    form = name.partition(".")[2]
    duckdb.execute(f"COPY (SELECT i * 0.1 AS t, i * 2 AS x FROM range(9) r(i)) TO '{path}' (FORMAT {form})")
    with pytest.raises(BadSetting, match="holds one table"):
        read_recording(path, ReadOptions(part="x"))
