"""What SOURCE names: every file below it once, and every series of a data set whole and once."""

from __future__ import annotations

import os
from datetime import date

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from kalscope.catalogue import open_source
from kalscope.errors import BadFile, BadSetting
from kalscope.estimation.request import Request
from kalscope.fleet import read as read_module
from kalscope.fleet.read import FleetOptions, find_units, read_block, read_list
from kalscope.fleet.run import run_fleet
from kalscope.fleet.work import fit_unit, run_batch
from kalscope.sources.grammar.read_options import ReadOptions

RNG = np.random.default_rng(5)


def units_in(*sources, output="out"):
    """The units that these sources name, by their ids."""
    return {unit.id: unit for unit in find_units([str(one) for one in sources], output)}


def reasons(*sources):
    """Why each cannot be read, "" where it can."""
    return {name: unit.reason for name, unit in units_in(*sources).items()}


# ---- files


@pytest.fixture
def tree(tmp_path):
    """Two files, one in a folder named as a file, an empty folder, a hidden file, a dead link and a pipe."""
    (tmp_path / "logs" / "x.csv").mkdir(parents=True)
    (tmp_path / "logs" / "none").mkdir()
    (tmp_path / "logs" / "a.csv").write_text("1\n2\n3\n")
    (tmp_path / "logs" / "x.csv" / "b.csv").write_text("1\n2\n3\n")
    (tmp_path / "logs" / ".DS_Store").write_text("")
    os.symlink(tmp_path / "nowhere", tmp_path / "logs" / "link.csv")
    os.mkfifo(tmp_path / "logs" / "pipe.csv")
    return tmp_path / "logs"


def test_everything_in_a_folder_is_accounted_for_and_a_pattern_stands_for_what_it_meets(tree):
    assert reasons(tree) == {
        "a.csv": "",
        "link.csv": f"'{tree / 'link.csv'}' cannot be used: it or its folder does not exist",
        "none": "the folder is empty",
        "pipe.csv": "it must be a file (got a folder, a device or a pipe)",
        "x.csv/b.csv": "",
    }
    assert set(reasons(tree / "*.csv")) == {"a.csv", "link.csv", "pipe.csv", "x.csv/b.csv"}
    for source in ("nowhere.csv", "nowhere/*.csv", "none/**"):
        with pytest.raises(BadSetting, match=r"SOURCE must be a folder, a file, @LIST, or a pattern .*\(got "):
            run_fleet([str(tree / source)], FleetOptions(Request()), tree / "results")
    assert not (tree / "results").exists()


def test_a_list_names_files_each_once_and_one_that_is_gone_has_a_reason(tree):
    path = tree.parent / "list.txt"
    path.write_text("# devices\nlogs/a.csv\nlogs/a.csv\n\nlogs/x.csv\nlogs/gone.csv\n")
    named = reasons(f"@{path}", tree / "x.csv" / "b.csv")
    assert set(named) == {"a.csv", "gone.csv", "x.csv/b.csv"}
    assert named["gone.csv"].endswith("it or its folder does not exist")
    names = ["form\ffeed.csv", "line\u2028separator.csv", "a, b.csv", "group\x1dmark.csv"]  # no ends of a line
    path.write_bytes("\r\n".join(names).encode() + b"\nlast.csv\n")
    assert read_list(str(path)) == [str(tree.parent / name) for name in (*names, "last.csv")]
    for text in ("", "# nothing\n"):
        path.write_text(text)
        with pytest.raises(BadFile, match="must name at least one file"):
            read_list(str(path))


def test_folders_and_patterns_leave_out_the_results_of_an_earlier_run(tmp_path):
    for name in ("logs/a.csv", "logs/out/fleet.json", "logs/out/parts/x.csv"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("1\n2\n3\n")
    for source in (tmp_path / "logs", tmp_path / "logs" / "*"):
        assert list(units_in(source, output=tmp_path / "logs" / "out")) == ["a.csv"]
        assert "out/fleet.json" in units_in(source)


# ---- data sets


def fleet(devices=7, n=40, rate=100.0):
    """{id: (time, value)} of some devices with different lengths."""
    return {
        f"dev{i:02d}": (np.arange(n + i) / rate, np.cumsum(RNG.normal(size=n + i)) + RNG.normal(size=n + i))
        for i in range(devices)
    }


def long_table(series, **more):
    ids = np.concatenate([[name] * len(time) for name, (time, _) in series.items()])
    time, value = (np.concatenate([one[k] for one in series.values()]) for k in (0, 1))
    return pa.table({"id": ids, "time": time, "value": value, **more})


def write_parts(table, folder, files, rows):
    """A table in files of row groups of so many rows."""
    n = -(-len(table) // files)
    for i in range(files):
        pq.write_table(table.slice(i * n, n), folder / f"{i}.parquet", row_group_size=rows)


def read(folder, **options):
    """{(id, channel): (samples, rate)} of all series; each must come once."""
    found = {}
    asked = FleetOptions(Request(), **options)
    for unit in units_in(folder).values():
        block = read_block(unit, asked.reading)
        for i, name in enumerate(block.ids):
            recording = block.recording(i, asked.reading, asked.sample_period)
            for channel in recording.names:
                assert (name, channel) not in found
                found[name, channel] = (recording.channel(channel), recording.sample_period)
    return found


def equal(found, series, channel="value"):
    assert set(found) == {(name, channel) for name in series}
    return all(np.array_equal(found[name, channel][0], value) for name, (_, value) in series.items())


@pytest.mark.slow
@pytest.mark.parametrize(("files", "rows"), [(1, 1), (3, 1), (1, 40), (3, 47), (1, 100), (3, 10_000)])
def test_every_series_is_whole_and_once_wherever_row_groups_end(tmp_path, files, rows):
    series = fleet()
    write_parts(long_table(series), tmp_path, files, rows)
    assert equal(read(tmp_path), series)


@pytest.mark.slow
@pytest.mark.parametrize(("size", "units", "files"), [(1, 8, 1), (1, 8, 3), (1 << 20, 1, 3)])
def test_a_data_set_in_any_order_is_cut_by_its_ids(tmp_path, monkeypatch, size, units, files):
    """As pandas writes one that it has shuffled: each series whole and once, each row group read a few times."""
    series = {f"dev{i:03d}": (np.arange(3.0), RNG.normal(size=3)) for i in range(300)}
    write_parts(long_table(series).take(RNG.permutation(900)), tmp_path, files, rows=60)
    monkeypatch.setattr(read_module, "MIXED_BYTES", size)
    found = units_in(tmp_path).values()
    assert len(found) == units
    assert sum(len(piece.groups) for unit in found for piece in unit.pieces) <= 8 * 15
    assert equal(read(tmp_path), series)


def test_ids_mixed_over_too_many_bytes_are_a_row_that_says_how_to_sort_them(tmp_path, monkeypatch):
    (tmp_path / "site").mkdir()
    table = long_table(fleet()).sort_by([("time", "ascending")])
    for name in "ab":
        pq.write_table(table, tmp_path / "site" / f"{name}.parquet", row_group_size=50)
    (tmp_path / "fine.csv").write_text("1\n2\n3\n")
    for limit in ("MAX_UNIT_BYTES", "MIXED_BYTES"):
        monkeypatch.setattr(read_module, limit, 1000)
    why = reasons(tmp_path)
    assert (set(why), why["fine.csv"]) == ({"fine.csv", "site"}, "")
    assert why["site"].endswith(" GB with mixed ids): DuckDB sorts files of any size")


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "statistics"), [("text", True), ("number", False), ("date", True)])
def test_rows_without_an_id_are_counted(tmp_path, kind, statistics):
    table = long_table(fleet(3))
    ids = table["id"].to_pylist()
    if kind != "text":
        ids = [float(one[3:]) for one in ids]
    if kind == "date":
        ids = [date(2026, 1, 1 + int(one)) for one in ids]
    nothing = float("nan") if kind == "number" else None
    ids[5:9] = [nothing] * 4
    ids[-60:] = [nothing] * 60  # a row group of its own, and more
    table = table.set_column(0, "id", pa.array(ids))
    pq.write_table(table, tmp_path / "x.parquet", row_group_size=20, write_statistics=statistics)
    assert reasons(tmp_path)["rows without an id"] == "64 rows have no id, so that no series can take them"
    units = [unit for unit in units_in(tmp_path).values() if not unit.reason]
    held = sum(int(block.starts[-1]) for unit in units if (block := read_block(unit, ReadOptions())))
    assert held == len(table) - 64


def test_files_that_hold_each_id_once_come_together(tmp_path):
    """A file a day, and an id that only one file has: what its neighbours hold decides."""
    for k in range(9):
        table = pa.table({"id": ["a", "b", "c"], "time": [k / 10] * 3, "value": [1.0 * k, 2.0 * k, 7.0]})
        pq.write_table(table, tmp_path / f"{k}.parquet")
    pq.write_table(pa.table({"id": ["d", "a"], "time": [0.0, 0.9], "value": [5.0, 9.0]}), tmp_path / "x.parquet")
    days = list(range(9))
    whole = {"a": [*days, 9.0], "b": [2.0 * k for k in days], "c": [7.0] * 9, "d": [5.0]}
    assert {name: samples.tolist() for (name, _), (samples, _) in read(tmp_path).items()} == whole


def test_recordings_that_number_their_rows_stay_apart(tmp_path):
    for name in "ab":
        table = pa.table({"id": np.arange(50), "value": RNG.normal(size=50)})
        pq.write_table(table, tmp_path / f"{name}.parquet")
    assert list(units_in(tmp_path)) == ["a.parquet", "b.parquet"]


def test_the_rate_comes_from_the_stamps_whatever_their_form(tmp_path):
    series = fleet(3)
    time = np.concatenate([one for one, _ in series.values()])
    dates = np.datetime64("2026-01-01T00:00:00", "us") + (time * 1e6).round().astype("timedelta64[us]")
    for name, column in (("time", time), ("time_ms", 1000 * time), ("ds", dates)):
        table = long_table(series)
        (tmp_path / name).mkdir()
        pq.write_table(table.set_column(1, name, pa.array(column)), tmp_path / name / "x.parquet")
        assert {round(period, 12) for _, period in read(tmp_path / name).values()} == {0.01}, name


@pytest.mark.slow
def test_a_series_is_read_as_the_same_rows_in_a_file_of_their_own(tmp_path):
    """Jitter, a gap and missing values: the quick way for even stamps must not be taken."""
    time = np.arange(200) / 50 + RNG.uniform(-0.002, 0.002, size=200)
    time[120:] += 3.0
    value = np.cumsum(RNG.normal(size=200))
    value[[5, 6, 90]] = np.nan
    (tmp_path / "set").mkdir()
    pq.write_table(long_table({"a": (time, value)}), tmp_path / "set" / "x.parquet")
    pq.write_table(pa.table({"time (s)": time, "value": value}), tmp_path / "one.parquet")
    for options in (ReadOptions(), ReadOptions(gaps="missing"), ReadOptions(rate=40.0)):
        alone = open_source(str(tmp_path / "one.parquet"), options)
        ((samples, period),) = read(tmp_path / "set", reading=options).values()
        assert np.array_equal(samples, alone.channel("value"), equal_nan=True)
        assert period == pytest.approx(alone.sample_period, rel=1e-9)


PLAIN = Request(momentum=0.0, robust=False)


@pytest.mark.slow
@pytest.mark.parametrize("asked", [PLAIN, Request(momentum=0.0)], ids=["all samples", "spikes set aside"])
def test_the_compiled_way_gives_the_rows_and_the_pool_of_the_way_of_a_file(tmp_path, monkeypatch, asked):
    """Even stamps take the compiled way, others not; a constant and a short series have a reason in both."""
    series = fleet(8, n=200)
    series["dev02"] = (series["dev02"][0], np.full(202, 3.0))
    series["dev03"] = (series["dev03"][0][:2], series["dev03"][1][:2])
    series["dev04"] = (series["dev04"][0] * RNG.uniform(1.0, 1.001, size=204), series["dev04"][1])
    series["dev05"][1][7] = np.inf
    series["dev06"] = (series["dev06"][0], np.round(series["dev06"][1]))
    series["dev07"][1][[40, 90, 150]] += 40.0
    pq.write_table(long_table(series), tmp_path / "x.parquet")
    (unit,) = units_in(tmp_path).values()
    quick = fit_unit(unit, FleetOptions(asked))
    monkeypatch.setattr("kalscope.fleet.work.PLAIN", ())
    slow = fit_unit(unit, FleetOptions(asked))
    assert (quick.rows[7].spikes > 0) == (asked is not PLAIN)
    assert [row.id for row in quick.rows] == list(series)
    assert [row.verdict for row in quick.rows][2:4] == ["constant", "too_few"]
    for one, other in zip(quick.rows, slow.rows, strict=True):
        for name in ["id", "channel", "unit", "samples", "verdict", "spikes", "rejected_lines", "gate", "reason"]:
            assert getattr(one, name) == getattr(other, name), (one.id, name)
        for name in ["rate_hz", "q", "r", "momentum", "lag_samples"]:
            value, expected = getattr(one, name), getattr(other, name)
            assert value is expected or value == pytest.approx(expected, rel=1e-6), (one.id, name)
    assert quick.pool.devices == slow.pool.devices
    assert quick.pool.sums == pytest.approx(slow.pool.sums, rel=1e-9)


def test_whole_numbers_that_no_double_holds_keep_their_digits(tmp_path):
    stamps = 1_700_000_000_000_000_001 + np.arange(40) * 10_000_000
    values = np.append(np.arange(39), 2**60 + 1)
    pq.write_table(pa.table({"id": ["a"] * 40, "time_ns": stamps, "value": values}), tmp_path / "a.parquet")
    samples, period = read(tmp_path)["a", "value"]
    assert period == pytest.approx(0.01, rel=1e-12)
    assert np.array_equal(samples, values.astype(float))


def test_a_missing_date_costs_only_its_own_row(tmp_path):
    stamps = np.tile(np.datetime64("2024-05-01", "ns") + np.arange(40) * np.timedelta64(10, "ms"), 2)
    stamps[0] = np.datetime64("NaT")
    ids = ["a"] * 40 + ["b"] * 40
    column = pa.array(stamps, from_pandas=True)
    pq.write_table(pa.table({"id": ids, "ts": column, "value": np.arange(80.0)}), tmp_path / "a.parquet")
    found = read(tmp_path)
    assert [len(found[name, "value"][0]) for name in "ab"] == [39, 40]
    assert found["b", "value"][1] == pytest.approx(0.01)


def test_ids_of_two_types_are_refused(tmp_path):
    for name, ids in (("a", ["x"] * 4), ("b", [3] * 4)):
        table = pa.table({"id": ids, "time": np.arange(4.0), "value": np.arange(4.0)})
        pq.write_table(table, tmp_path / f"{name}.pq")
    assert "must be of one type in all files (got int and str)" in reasons(tmp_path)[tmp_path.name]


def test_a_worker_of_another_version_is_refused(tmp_path):
    (tmp_path / "units.sqlite").touch()
    with pytest.raises(BadSetting, match=r"every worker of --cluster must have kalscope 9 \(got "):
        run_batch([], FleetOptions(Request(), program="kalscope 9"), str(tmp_path))
