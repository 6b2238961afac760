"""LabVIEW measurement files: made-up files of every shape, with lvm_read as the oracle."""

import math

import numpy as np
import pytest

from kalscope.errors import BadSetting

lvm_read = pytest.importorskip("lvm_read")


def file_header(sep="\t", decimal=".", x_columns="One"):
    said = {"Writer_Version": "2", "Separator": "Tab" if sep == "\t" else "Comma", "Decimal_Separator": decimal}
    said |= {"Multi_Headings": "Yes", "X_Columns": x_columns, "Date": "2024/02/29", "Time": "23:59:59,5"}
    body = "".join(f"{key}{sep}{value}\n" for key, value in said.items())
    return f"LabVIEW Measurement{sep}\n{body}***End_of_Header***{sep}\n{sep}\n"


def segment(names, rows, *, sep="\t", decimal=".", x="One", step=0.01, start="10:00:00.25", units=None):
    """One segment; `rows` hold the numbers of the channels, the x axis is made of `step`."""
    spread = 2 if x == "Multi" else 1

    def tagged(tag, values):
        cells = [""] * (spread * len(names) + 1)
        cells[1 : 1 + spread * len(values) : spread] = values
        return sep.join([tag, *cells[1:]]) + "\n"

    def written(value):
        return ("" if math.isnan(value) else f"{value:.6f}").replace(".", decimal)

    n = len(names)
    text = tagged("Channels", [str(n)]) + tagged("Samples", [str(len(rows))] * n)
    text += tagged("Date", ["2024/03/01"] * n) + tagged("Time", [start.replace(".", decimal)] * n)
    text += tagged("Y_Unit_Label", units or [f"unit{i}" for i in range(n)])
    text += tagged("X_Dimension", ["Time"] * n) + tagged("X0", ["0.0E+0".replace(".", decimal)] * n)
    text += tagged("Delta_X", [f"{step:.9E}".replace(".", decimal)] * n) + f"***End_of_Header***{sep}\n"

    def line(stamp, cells):
        return sep.join([stamp, *cells] if x != "Multi" else [part for cell in cells for part in (stamp, cell)])

    text += line("X_Value", names) + f"{sep}Comment\n"
    for i, row in enumerate(rows):
        text += line("" if x == "No" else written(i * step), map(written, row)) + "\n"
    return text + "\n"


ROWS = np.round(np.random.default_rng(1).normal(size=(20, 2)), 6)


@pytest.mark.parametrize("x", ["No", "One", "Multi"])
@pytest.mark.parametrize(("sep", "decimal"), [("\t", "."), ("\t", ","), (",", ".")])
def test_every_form_reads_as_lvm_read_reads_it(read, x, sep, decimal):
    form = {"sep": sep, "decimal": decimal}
    text = file_header(x_columns=x, **form) + segment(["a", "b"], ROWS, x=x, units=["V", "g"], **form)
    recording = read(text)
    oracle = lvm_read.read_str(text.replace("\r\n", "\n"), separator=sep)[0]["data"]
    channels = {"No": slice(0, 2), "One": slice(1, 3), "Multi": slice(1, 4, 2)}[x]
    np.testing.assert_array_equal(recording.values, oracle[:, channels])
    np.testing.assert_array_equal(recording.values, ROWS)
    assert (recording.names, recording.units) == (("a", "b"), ("V", "g"))
    assert recording.sample_period == pytest.approx(0.01, rel=1e-12)
    np.testing.assert_allclose(recording.time, np.arange(20) * 0.01, atol=1e-12)
    report = recording.report
    assert report.lines == report.rows + report.headers + report.comments == text.count("\n")


def test_the_step_of_the_header_outranks_an_x_column_that_is_only_rounded(read):
    step = 1.25e-6  # below the six decimals of the x column
    recording = read(file_header() + segment(["a"], ROWS[:, :1], step=step))
    np.testing.assert_allclose(np.diff(recording.time), step, rtol=1e-9)
    text = file_header() + segment(["a"], ROWS[:4, :1], step=1.0)
    for i, stamp in enumerate(["0.3", "1.9", "7.0"], 1):
        text = text.replace(f"\n{i}.000000\t", f"\n{stamp}\t")
    assert read(text).time.tolist() == [0.0, 0.3, 1.9, 7.0]


def test_segments_of_the_same_channels_follow_their_clocks_and_of_others_are_parts(read):
    text = file_header() + segment(["a"], ROWS[:5, :1]) + segment(["a"], ROWS[5:9, :1], start="10:00:02.25")
    recording = read(text)
    np.testing.assert_array_equal(recording.values[:, 0], ROWS[:9, 0])
    np.testing.assert_allclose(recording.time[4:6], [0.04, 2.0], atol=1e-6)
    assert any("2 segments" in note for note in recording.report.notes)
    text = file_header() + segment(["a", "b"], ROWS) + segment(["other"], ROWS[:3, :1])
    assert read(text).names == ("a", "b")
    assert any('"other" (3 × 1)' in note for note in read(text).report.notes)
    assert len(read(text, part="other")) == 3
    with pytest.raises(BadSetting, match='"a, b"'):
        read(text, part="missing")


def test_missing_cells_special_blocks_comments_and_latin_1(read):
    rows = ROWS[:6].copy()
    rows[2, 1] = np.nan
    special = "***Start_Special***\nCHANNELS\t5\n1\t2\t3\n***End_Special***\n"
    text = file_header() + special + segment(["T (°C)", "b"], rows, units=["°C", ""])
    text = text.replace(f"{rows[1, 1]:.6f}\n", f"{rows[1, 1]:.6f}\tLOST 5\n")
    recording = read(text, encoding="latin-1")
    np.testing.assert_array_equal(recording.values, rows)
    assert (recording.names, recording.units) == (("T", "b"), ("°C", ""))


@pytest.mark.parametrize("x", ["One", "No"])
def test_segments_without_a_clock_of_their_own_follow_each_other(read, x):
    dated = segment(["a"], ROWS[:5, :1], x=x)
    undated = "".join(line for line in dated.splitlines(True) if not line.startswith(("Date", "Time\t")))
    recording = read(file_header(x_columns=x) + 3 * undated)
    np.testing.assert_allclose(recording.time, np.arange(15) * 0.01, atol=1e-9)
    assert any("2024-02-29T23:59:59.5" in note for note in recording.report.notes)
