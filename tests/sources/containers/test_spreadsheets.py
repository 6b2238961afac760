"""Spreadsheets, written by openpyxl, and Parquet files, written by DuckDB."""

import datetime
import zipfile

import numpy as np
import pytest
from tests.support.required import needs

from kalscope.errors import BadFile, BadSetting
from kalscope.sources.grammar.read_options import ReadOptions
from kalscope.sources.reading.recording_file import read_recording

needs("openpyxl", "python_calamine", "duckdb", "pyarrow")

import duckdb  # noqa: E402

START = datetime.datetime(2024, 3, 1, 12, 0, 0)


@pytest.fixture
def book(tmp_path):
    import openpyxl

    def write(**sheets):
        path, workbook = tmp_path / "log.xlsx", openpyxl.Workbook()
        workbook.remove(workbook.active)
        for title, rows in sheets.items():
            sheet = workbook.create_sheet(title)
            for row in rows:
                sheet.append(row)
        workbook.save(path)
        return path

    return write


def rows(n=20):
    stamps = [START + datetime.timedelta(milliseconds=500 * i) for i in range(n)]
    return [["Time", "Temp (°C)", "State"], *([stamp, 20 + i / 8, "ok"] for i, stamp in enumerate(stamps))]


@pytest.mark.slow
def test_the_sheet_with_most_numbers_is_read_and_the_others_named(book):
    path = book(notes=[["a note"]], small=rows(3), log=[["Station 5"], [], *rows()])
    recording = read_recording(path)
    assert (recording.names, recording.units, recording.report.rows) == (("Temp",), ("°C",), 20)
    np.testing.assert_array_equal(recording.values[:, 0], 20 + np.arange(20) / 8)
    np.testing.assert_allclose(recording.time, np.arange(20) * 0.5, atol=1e-6)
    assert any('"small"' in note and "--part" in note for note in recording.report.notes)
    assert len(read_recording(path, ReadOptions(part="small"))) == 3
    with pytest.raises(BadSetting, match="notes"):
        read_recording(path, ReadOptions(part="notes"))


@pytest.mark.slow
def test_two_cells_at_the_ends_of_a_sheet_are_refused_before_they_fill_the_memory(tmp_path):
    import openpyxl

    workbook = openpyxl.Workbook()
    workbook.active["A1"], workbook.active["XFD1048576"] = 1, 2
    workbook.save(tmp_path / "log.xlsx")
    with pytest.raises(BadFile, match="cells a sheet"):
        read_recording(tmp_path / "log.xlsx")


def write_ods(path, rows):
    names = {kind: f"urn:oasis:names:tc:opendocument:xmlns:{kind}:1.0" for kind in ("office", "table", "text")}
    spaces = " ".join(f'xmlns:{kind}="{address}"' for kind, address in names.items())
    body = f'<table:table table:name="log">{rows}</table:table>'
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("mimetype", "application/vnd.oasis.opendocument.spreadsheet")
        archive.writestr("META-INF/manifest.xml", "<manifest/>")
        document = f"<office:body><office:spreadsheet>{body}</office:spreadsheet></office:body>"
        archive.writestr("content.xml", f"<office:document-content {spaces}>{document}</office:document-content>")
    return path


def ods_row(*cells, repeated=1):
    texts = ""
    for cell in cells:
        value = 'value-type="string"' if isinstance(cell, str) else f'value-type="float" office:value="{cell}"'
        many = f'table:number-columns-repeated="{repeated}"'
        texts += f"<table:table-cell office:{value} {many}><text:p>{cell}</text:p></table:table-cell>"
    return f'<table:table-row table:number-rows-repeated="{repeated}">{texts}</table:table-row>'


@pytest.mark.slow
def test_a_sheet_of_opendocument(tmp_path):
    rows = ods_row("t", "x (V)") + "".join(ods_row(i / 10, i % 5 / 4) for i in range(20))
    recording = read_recording(write_ods(tmp_path / "log.ods", rows))
    assert (recording.names, recording.units) == (("x",), ("V",))
    np.testing.assert_array_equal(recording.values[:, 0], np.arange(20) % 5 / 4)
    with pytest.raises(BadFile, match="cell"):
        read_recording(write_ods(tmp_path / "log.ods", ods_row(1.5, repeated=16384)))


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
