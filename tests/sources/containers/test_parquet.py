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
        duckdb.sql(select).write_parquet(str(tmp_path / "log.parquet"))
        return read_recording(tmp_path / "log.parquet")

    return write


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["TIMESTAMP", "TIMESTAMP_NS", "TIMESTAMP_S", "TIMESTAMPTZ"])
def test_a_parquet_file_with_stamps(parquet, kind):
    recording = parquet(
        f"SELECT (TIMESTAMP '2026-01-01' + INTERVAL (i) SECOND)::{kind} AS at, 'ok' AS state, i AS n"
        " FROM range(9) t(i)"
    )
    assert recording.names == ("n",)
    assert recording.time.tolist() == list(range(9))
    assert any("2026-01-01T00:00:00" in note for note in recording.report.notes)


@pytest.mark.slow
def test_nulls_and_infinities_of_parquet_are_missing_samples_and_it_holds_one_table(parquet, tmp_path):
    recording = parquet(
        "SELECT * FROM (VALUES (0.0::DOUBLE, 1.0::DOUBLE), (1, NULL), (2, 'inf'), (NULL, 4), (3, 5)) v(t, a)"
    )
    np.testing.assert_array_equal(recording.values[:, 0], [1, np.nan, np.nan, 5])
    report = recording.report
    assert (report.rows, report.rejected, report.lines, report.bad_cells) == (4, 1, 5, 1)
    with pytest.raises(BadSetting, match="holds one table"):
        read_recording(tmp_path / "log.parquet", ReadOptions(part="x"))
