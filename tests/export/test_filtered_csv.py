from __future__ import annotations

import csv
import io
import math
from dataclasses import replace
from pathlib import Path

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

PARAMS = FilterParams(q=1e-3, r=1.0)
NAN = math.nan


def recording(values: object, names: tuple[str, ...] = ("a",), period: float = 0.01) -> Recording:
    table = np.array(values, dtype=float)
    table = table.reshape(len(table), len(names))
    return Recording(np.arange(len(table), dtype=np.float64) * period, names, ("",) * len(names), table, period)


def tunings(params: dict[str, FilterParams]) -> list[ChannelTuning]:
    return [ChannelTuning.of_params(name, "", one, "by hand") for name, one in params.items()]


def filtered_csv(source: Recording, params: dict[str, FilterParams]) -> str:
    return "".join(filtered_csv_chunks(source, tunings(params)))


def rows(text: str) -> list[list[str]]:
    return list(csv.reader(io.StringIO(text)))


def test_the_csv_is_time_raw_filtered_variance() -> None:
    text = filtered_csv(recording([1.0, 3.0]), {"a": FilterParams(q=0.0, r=2.0)})
    assert text == "time,a,a_filtered,a_variance\n0.0,1.0,1.0,2.0\n0.01,3.0,2.0,1.0\n"


def test_missing_samples_and_what_is_not_known_yet_are_empty_cells() -> None:
    text = filtered_csv(recording([NAN, 4.0, NAN]), {"a": FilterParams(q=1.0, r=2.0)})
    assert rows(text)[1:] == [["0.0", "", "", ""], ["0.01", "4.0", "4.0", "2.0"], ["0.02", "", "4.0", "3.0"]]


@pytest.mark.parametrize(
    ("period", "column", "per"), [(0.02, "b_velocity_per_s", 50.0), (None, "b_velocity_per_sample", 1.0)]
)
def test_a_channel_with_momentum_has_its_velocity_and_the_others_are_as_before(
    period: float | None, column: str, per: float
) -> None:
    source = replace(
        recording([[1.0, NAN], [3.0, 4.0], [2.0, 6.0]], ("a", "b"), period or 1.0), sample_period=period
    )
    moving = FilterParams(q=1.0, r=2.0, momentum=5.0)
    table = rows(filtered_csv(source, {"a": PARAMS, "b": moving}))
    assert table[0][1:] == ["a", "a_filtered", "a_variance", "b", "b_filtered", "b_variance", column]
    expected = kalman_filter(source.channel("b"), moving).velocity
    assert expected is not None
    assert expected[2] > 0.0
    assert [float(row[-1]) for row in table[1:]] == (expected * per).tolist()
    assert [row[:4] for row in table] == rows(filtered_csv(source, {"a": PARAMS}))


@given(st.lists(st.floats(-1e150, 1e150) | st.just(NAN), min_size=1, max_size=30))
def test_every_number_comes_back_bit_for_bit(samples: list[float]) -> None:
    source = recording(samples)
    expected = kalman_filter(source.channel("a"), PARAMS)
    table = [
        [float(cell) if cell else NAN for cell in row] for row in rows(filtered_csv(source, {"a": PARAMS}))[1:]
    ]
    variance = np.where(np.isfinite(expected.p), expected.p, NAN)
    columns = [source.time, source.channel("a"), expected.x, variance]
    np.testing.assert_array_equal(np.array(table), np.column_stack(columns))


@pytest.mark.slow
def test_pieces_join_without_a_seam() -> None:
    n = 2 * ROWS_PER_CHUNK + 1
    source = recording(np.random.default_rng(5).normal(size=n))
    pieces = list(filtered_csv_chunks(source, tunings({"a": PARAMS})))
    assert len(pieces) == 4
    table = np.loadtxt(io.StringIO("".join(pieces)), delimiter=",", skiprows=1)
    np.testing.assert_array_equal(table[:, 2], kalman_filter(source.channel("a"), PARAMS).x)


@pytest.mark.slow
@pytest.mark.parametrize("period", [None, 0.001, 0.01, 1.0, 2.0, 5.0, 60.0, 1000.0])
def test_our_reader_reopens_it_unchanged(tmp_path: Path, period: float | None) -> None:
    source = recording(np.random.default_rng(6).normal(size=(50, 2)), ("left, right", 'say "hi"'), period or 1.0)
    source = replace(source, sample_period=period)
    path = tmp_path / "out.csv"
    path.write_text(filtered_csv(source, dict.fromkeys(source.names, PARAMS)), encoding="utf-8", newline="")
    again = read_recording(path)
    assert again.names[0::3] == source.names
    assert again.sample_period == source.sample_period
    np.testing.assert_array_equal(again.time, source.time)
    np.testing.assert_array_equal(again.values[:, 0::3], source.values)
    assert again.report.rejected == 0
    assert again.report.bad_cells == 0


def test_true_time_between_samples_counts_where_it_was_chosen() -> None:
    time_s = np.array([0.0, 1.0, 5.0, 4.5, 6.0])
    source = replace(recording([1.0, 2.0, 3.0, 4.0, 5.0], period=1.0), time=time_s, gaps="dt")
    table = np.array(rows(filtered_csv(source, {"a": PARAMS}))[1:], dtype=float)
    dt = np.array([1.0, 1.0, 4.0, 0.0, 1.5])
    np.testing.assert_array_equal(table[:, 2], kalman_filter(source.channel("a"), PARAMS, dt).x)
    np.testing.assert_array_equal(table[:, 0], time_s)


def test_the_filtered_csv_can_be_filtered_again(tmp_path: Path) -> None:
    path = tmp_path / "out.csv"
    path.write_text(filtered_csv(recording(np.arange(9.0)), {"a": PARAMS}))
    again = read_recording(path)
    header = rows(filtered_csv(again, dict.fromkeys(again.names, PARAMS)))[0]
    assert header[:3] == ["time", "a", "a_filtered_2"]
    assert header[4] == "a_filtered"
    assert len(set(header)) == len(header) == 10


@pytest.mark.slow
@given(st.lists(st.text(max_size=8) | st.sampled_from(["time", "a", "a_filtered", "a_filtered_2"]), unique=True))
def test_headers_are_distinct_plain_and_run_no_formula(names: list[str]) -> None:
    line = csv_header(names, dict.fromkeys(names[::2], "filtered"))
    assert line.count("\n") == 1
    cells = next(csv.reader([line]))
    assert len(set(cells)) == len(cells) == 1 + 3 * len(names) + len(names[::2])
    assert all(cell.isprintable() and not cell.startswith(("=", "+", "-", "@")) for cell in cells)


@pytest.mark.parametrize("name", ["=1+1", "+1", "-1", "@SUM(A1)", "\t=1", " =1"])
def test_names_that_look_like_formulas_are_text(name: str) -> None:
    assert rows(csv_header([name]))[0][1] == "'" + name.strip()


@pytest.mark.parametrize("name", ["5", "1e3", "nan", "NA", ""])
def test_names_that_look_like_numbers_still_make_a_header(tmp_path: Path, name: str) -> None:
    path = tmp_path / "out.csv"
    path.write_text(filtered_csv(recording(np.arange(9.0), (name,)), {name: PARAMS}))
    assert read_recording(path).names[0] == f"channel {name}".strip()
    assert len(read_recording(path)) == 9


def test_an_unknown_channel_is_refused_before_any_text() -> None:
    with pytest.raises(BadSetting, match=r"one of a \(got 'z'\)"):
        filtered_csv_chunks(recording([1.0]), tunings({"z": PARAMS}))


def test_an_empty_recording_is_a_header() -> None:
    assert filtered_csv(recording(np.empty((0, 1))), {"a": PARAMS}) == "time,a,a_filtered,a_variance\n"


def test_fused_sensors_have_harmless_distinct_names_and_reopen(tmp_path: Path) -> None:
    source = recording([[1.0, NAN], [NAN, 5.0], [2.0, 4.0]], ("time", "=x"))
    fusion = ChannelTuning("time", "", 0.5, (1.0, 2.0), sensors=("=x", "time"), momentum=3.0)
    text = "".join(filtered_csv_chunks(source, [fusion]))
    header, *table = rows(text)
    assert header == ["time", "'=x", "time_2", "time_3", "time_3_variance", "time_3_velocity_per_s"]
    result = fuse(source.values[:, [1, 0]], fusion.params)
    assert [row[1:4] for row in table] == [
        ["" if math.isnan(x) else repr(x) for x in row]
        for row in np.column_stack([source.values[:, [1, 0]], result.x]).tolist()
    ]
    path = tmp_path / "fused.csv"
    path.write_text(text, encoding="utf-8", newline="")
    np.testing.assert_array_equal(read_recording(path).channel("time_3"), result.x)
    with pytest.raises(BadSetting, match="channel must be one of"):
        filtered_csv_chunks(source, [ChannelTuning("f", "", 0.5, (1.0, 2.0), sensors=("a", "b"))])
