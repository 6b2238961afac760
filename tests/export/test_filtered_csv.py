"""The filtered CSV: what it holds, bit for bit, and that it is read again, whatever the names."""

from __future__ import annotations

import csv
import io
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kalscope.errors import BadSetting
from kalscope.export.csv import ROWS_PER_CHUNK, csv_header, filtered_csv_chunks
from kalscope.filtering.filter import fuse, kalman_filter
from kalscope.filtering.params import FilterParams
from kalscope.recording import Recording
from kalscope.sources.reading.recording_file import read_recording
from kalscope.tuning.tuning import ChannelTuning

PARAMS, NAN = FilterParams(q=1e-3, r=1.0), math.nan
MOVING = FilterParams(q=1.0, r=2.0, momentum=5.0)


def recording(values, names=("a",), period=0.01):
    table = np.array(values, dtype=float).reshape(-1, len(names))
    return Recording(np.arange(len(table)) * (period or 1.0), names, ("",) * len(names), table, period)


def text_of(source, params):
    return "".join(
        filtered_csv_chunks(source, [ChannelTuning.of_params(name, "", one, "") for name, one in params.items()])
    )


def rows(text):
    return list(csv.reader(io.StringIO(text)))


def reopened(folder, text):
    path = folder / "out.csv"
    path.write_text(text, encoding="utf-8", newline="")
    return read_recording(path)


def test_the_csv_is_time_raw_filtered_variance_and_what_is_not_known_an_empty_cell():
    text = text_of(recording([NAN, 1.0, 3.0, NAN]), {"a": FilterParams(q=0.0, r=2.0)})
    assert text == "time,a,a_filtered,a_variance\n0.0,,,\n0.01,1.0,1.0,2.0\n0.02,3.0,2.0,1.0\n0.03,,2.0,1.0\n"


@pytest.mark.parametrize(("period", "per", "factor"), [(0.02, "s", 50.0), (None, "sample", 1.0)])
def test_a_channel_with_momentum_has_its_velocity_and_the_others_are_as_before(period, per, factor):
    source = recording([[1.0, NAN], [3.0, 4.0], [2.0, 6.0]], ("a", "b"), period)
    table = rows(text_of(source, {"a": PARAMS, "b": MOVING}))
    assert table[0][4:] == ["b", "b_filtered", "b_variance", f"b_velocity_per_{per}"]
    expected = kalman_filter(source.channel("b"), MOVING).velocity
    assert expected[2] > 0.0
    assert [float(row[-1]) for row in table[1:]] == (expected * factor).tolist()
    assert [row[:4] for row in table] == rows(text_of(source, {"a": PARAMS}))


@pytest.mark.slow
def test_pieces_join_without_a_seam():
    source = recording(np.random.default_rng(5).normal(size=2 * ROWS_PER_CHUNK + 1))
    text = text_of(source, {"a": PARAMS})
    table = np.loadtxt(io.StringIO(text), delimiter=",", skiprows=1)
    np.testing.assert_array_equal(table[:, 2], kalman_filter(source.channel("a"), PARAMS).x)


@pytest.mark.slow
@pytest.mark.parametrize("period", [None, 0.001, 0.01, 1.0, 2.0, 5.0, 60.0, 1000.0])
def test_our_reader_reopens_it_unchanged(tmp_path, period):
    source = recording(np.random.default_rng(6).normal(size=(50, 2)), ("left, right", 'say "hi"'), period)
    again = reopened(tmp_path, text_of(source, dict.fromkeys(source.names, PARAMS)))
    assert again.names[0::3] == source.names
    assert again.sample_period == source.sample_period
    np.testing.assert_array_equal(again.time, source.time)
    np.testing.assert_array_equal(again.values[:, 0::3], source.values)
    assert (again.report.rejected, again.report.bad_cells) == (0, 0)


ACTING = ("=1+1", " =1", "\t=1", "+1", "-1", "@SUM(A1)", "time", "a", "a_filtered", "a_filtered_2")


@pytest.mark.slow
@given(st.lists(st.text(max_size=8) | st.sampled_from(ACTING), unique=True))
def test_headers_are_distinct_plain_and_run_no_formula(names):
    line = csv_header(names, dict.fromkeys(names[::2], "filtered"))
    assert line.count("\n") == 1
    cells = next(csv.reader([line]))
    assert len(set(cells)) == len(cells) == 1 + 3 * len(names) + len(names[::2])
    assert all(cell.isprintable() and not cell.startswith(("=", "+", "-", "@")) for cell in cells)
    assert csv_header(["=1+1"]).split(",")[1] == "'=1+1"


@pytest.mark.parametrize("name", ["5", "1e3", "nan", "NA", ""])
def test_names_that_look_like_numbers_still_make_a_header_and_a_filtered_csv_can_be_filtered_again(tmp_path, name):
    again = reopened(tmp_path, text_of(recording(np.arange(9.0), (name,)), {name: PARAMS}))
    assert (again.names[0], len(again)) == (f"channel {name}".strip(), 9)
    header = rows(text_of(again, dict.fromkeys(again.names, PARAMS)))[0]
    assert len(set(header)) == len(header) == 10


def test_fused_sensors_have_harmless_distinct_names_and_reopen(tmp_path):
    source = recording([[1.0, NAN], [NAN, 5.0], [2.0, 4.0]], ("time", "=x"))
    fusion = ChannelTuning("time", "", 0.5, (1.0, 2.0), sensors=("=x", "time"), momentum=3.0)
    text = "".join(filtered_csv_chunks(source, [fusion]))
    assert rows(text)[0] == ["time", "'=x", "time_2", "time_3", "time_3_variance", "time_3_velocity_per_s"]
    result = fuse(source.values[:, [1, 0]], fusion.params)
    again = reopened(tmp_path, text)
    np.testing.assert_array_equal(again.values[:, :3], np.column_stack([source.values[:, [1, 0]], result.x]))
    with pytest.raises(BadSetting, match="channel must be one of"):
        filtered_csv_chunks(source, [ChannelTuning("f", "", 0.5, (1.0, 2.0), sensors=("a", "b"))])
