"""The folder of a fleet as the dashboard reads it: finished, half done, and written by somebody else."""

from __future__ import annotations

import json
import math
import pickle
import shutil

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from fleet_folder import NOISY, PLAIN, FleetRun, finished_fleet, write_logs

from kalscope import estimate, kalman_filter, steady_state
from kalscope.cli.tune_options import TuneOptions
from kalscope.errors import BadFile, BadSetting
from kalscope.fleet import store
from kalscope.fleet.read import FleetOptions
from kalscope.fleet.results import device_tuning, read_fleet, reopen
from kalscope.fleet.store import NOTE, SUMMARY, TABLE, TUNING, RunNote, read_json, write_note
from kalscope.sources.grammar.read_options import DEFAULTS, ReadOptions
from kalscope.sources.reading.recording_file import read_recording
from kalscope.tuning.file import load_tuning


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return finished_fleet(tmp_path_factory.mktemp("fleet"))


@pytest.fixture
def own(folder, tmp_path):
    """A folder of a fleet that a test may spoil; its recordings lie beside the first."""
    return shutil.copytree(folder, tmp_path / "result")


@pytest.mark.slow
def test_a_finished_fleet_has_its_answer_and_its_sources(folder):
    fleet = read_fleet(folder)
    assert fleet.devices.counted == "13 rows: 12 with q and r, 1 failed"
    assert (len(fleet), fleet.done, fleet.note.units) == (13, None, 13)
    answer = json.loads((folder / SUMMARY).read_text())["one_filter"]
    assert (fleet.shared.params.q, fleet.shared.params.r) == (answer["q"], answer["r"])
    assert fleet.shared.served == answer["served"]
    assert np.flatnonzero(fleet.outlier).tolist() == [NOISY]
    assert np.nanargmax(fleet.distance) == NOISY
    assert all(source.endswith(name) for source, name in zip(fleet.devices.sources, fleet.devices.ids, strict=True))
    assert "empty" in fleet.devices.reasons[fleet.devices.ids.index("empty.csv")]


@pytest.mark.slow
def test_a_device_is_opened_as_it_was_read_at_its_own_or_the_shared_setting(folder):
    fleet = read_fleet(folder)
    recording = reopen(fleet.devices.ids[NOISY], fleet.devices.sources[NOISY], fleet.note)
    assert np.array_equal(recording.values, read_recording(folder.parent / "logs" / "dev03.csv").values)
    mine, all_of_them = device_tuning(fleet, NOISY), device_tuning(fleet, NOISY, shared=True)
    assert (mine.channels[0].q, mine.channels[0].r) == (fleet.devices.q[NOISY], fleet.devices.r[NOISY])
    saved = load_tuning(folder / TUNING).channels[0]
    assert (all_of_them.channels[0].q, all_of_them.channels[0].r) == (saved.q, saved.r)
    assert mine.sample_period == pytest.approx(0.01)
    with pytest.raises(BadSetting):
        device_tuning(fleet, fleet.devices.ids.index("empty.csv"))


@pytest.mark.slow
def test_a_running_fleet_grows_and_ends_equal_to_its_table(tmp_path, monkeypatch):
    """Read as the dashboard does: by another process, each part once."""
    write_logs(tmp_path / "logs")
    run = FleetRun(tmp_path / "logs", tmp_path / "result")
    checked, tables = store.checked_table, []
    monkeypatch.setattr(store, "checked_table", lambda path, known: tables.append(path) or checked(path, known))

    def read():
        return pickle.loads(pickle.dumps(read_fleet(run.folder)))

    with pytest.raises(BadFile, match="folder of a fleet"):
        read()
    run.do(0, 5)
    some = read()
    assert (len(some), some.done, some.note.units) == (5, 5, 13)
    run.do(5)
    every = read()
    assert (len(every), every.done) == (13, 13)
    assert len(tables) == len(set(tables)) > 1
    answer = run.finish()
    final = read()
    assert final.done is None
    assert float(every.shared.params.q) == pytest.approx(float(answer.shared.params.q), rel=1e-12)
    assert sorted(every.devices.ids) == final.devices.ids
    order = np.argsort(every.devices.ids)
    np.testing.assert_allclose(every.growth[order], final.growth, rtol=1e-9)
    assert np.isfinite(final.growth).sum() == 12
    assert {*zip(every.devices.ids, every.devices.sources, strict=True)} == {
        *zip(final.devices.ids, final.devices.sources, strict=True)
    }


@pytest.mark.slow
def test_the_table_says_what_each_device_loses_also_by_a_goal(tmp_path):
    write_logs(tmp_path / "logs", devices=4)
    asked = FleetOptions(TuneOptions(lag_ms=20.0, momentum=0.0))
    run = FleetRun(tmp_path / "logs", tmp_path / "result", asked).do()
    answer = run.finish()
    rows = pq.read_table(run.folder / TABLE).to_pylist()
    assert "left" not in rows[0]
    fitted = [row for row in rows if not row["reason"]]
    assert {row["verdict"] for row in fitted} == {"chosen"}
    z = read_recording(tmp_path / "logs" / "dev00.csv").values[:, 0]
    own = steady_state(estimate(z, momentum=0.0, robust=False).params)
    assert fitted[0]["lag_loss_samples"] == pytest.approx(2.0 - own.lag_samples, rel=1e-5)
    shared = steady_state(answer.shared.params)
    wanted = own.noise_reduction_db - shared.noise_reduction_db
    assert fitted[0]["noise_loss_db"] == pytest.approx(wanted, rel=1e-5)
    half = estimate(z[:150], momentum=0.0, robust=False).params
    errors = [kalman_filter(z, params).innovation[150:] for params in (answer.shared.params, half)]
    assert fitted[0]["error_growth"] == pytest.approx(
        np.sqrt(np.mean(errors[0] ** 2) / np.mean(errors[1] ** 2)) - 1, abs=2e-3
    )


@pytest.mark.slow
def test_parts_of_other_options_do_not_count(tmp_path, monkeypatch):
    write_logs(tmp_path / "logs", devices=3)
    FleetRun(tmp_path / "logs", tmp_path / "result").do()
    monkeypatch.setattr("kalscope.fleet.results.CLOCKS_NS", 0)
    again = FleetRun(tmp_path / "logs", tmp_path / "result", FleetOptions(TuneOptions(momentum=0.0)))
    with pytest.raises(BadFile, match="folder of a fleet"):
        read_fleet(again.folder)
    again.do(0, 2)
    assert read_fleet(again.folder).done == 2


def test_the_note_keeps_how_files_are_read(tmp_path):
    reading = ReadOptions(
        delimiter=";", missing=(-200.0, "n/a"), day_first=True, time_column=2, gaps="dt", rate=3.7
    )
    write_note(tmp_path, 7, "a", reading, 0.25, pooled=False)
    first = read_json(tmp_path / NOTE, RunNote)
    assert (first.units, first.reading, first.sample_period, first.pooled) == (7, reading, 0.25, False)
    write_note(tmp_path, 8, "a", DEFAULTS, None, pooled=True)
    assert read_json(tmp_path / NOTE, RunNote).since == first.since
    write_note(tmp_path, 8, "b", DEFAULTS, None, pooled=True)
    assert read_json(tmp_path / NOTE, RunNote).since > first.since


@pytest.mark.parametrize(
    "note", ["", "[]", "{", '{"units": 3}', "[" * 100_000, '{"units": "x", "reading": {"gaps": ["none"]}}']
)
def test_a_note_of_somebody_else_is_refused_with_one_line(own, note):
    (own / NOTE).write_text(note)
    with pytest.raises(BadFile) as refused:
        read_fleet(own)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("period", ["NaN", "-1", "0", "1e999", '"x"', "[]"])
def test_a_note_without_a_sample_period_is_refused(own, period):
    content = (own / NOTE).read_text().replace('"sample_period": null', f'"sample_period": {period}')
    (own / NOTE).write_text(content)
    with pytest.raises(BadFile):
        read_fleet(own)


@pytest.mark.parametrize(
    "one",
    [[], 3, {}, {"q": -1, "r": 1}, {"q": 0, "r": 0}, {"q": "x"}, {"q": math.nan, "r": 1.0}],
)
def test_a_filter_for_all_of_somebody_else_is_refused(own, one):
    (own / SUMMARY).write_text(json.dumps({"one_filter": one}))
    with pytest.raises(BadFile):
        read_fleet(own)


def test_tables_of_somebody_else_are_refused_with_one_line(own):
    table = pq.read_table(own / TABLE)
    n = len(table)
    hostile = [
        table.drop_columns(["source"]),
        table.set_column(0, "id", pa.array([[1]] * n)),
        table.set_column(0, "id", pa.array(["x" * 5000] * n)),
        table.set_column(table.schema.get_field_index("q"), "q", pa.array(["much"] * n)),
        pa.table({"a": [1]}),
    ]
    for one in hostile:
        pq.write_table(one, own / TABLE)
        with pytest.raises(BadFile) as refused:
            read_fleet(own)
        assert "\n" not in str(refused.value)
    for content in (b"", b"PAR1", b"x" * 1000):
        (own / TABLE).write_bytes(content)
        with pytest.raises(BadFile):
            read_fleet(own)


def test_numbers_that_cannot_be_are_left_out(own):
    table = pq.read_table(own / TABLE)
    wrong = [-1.0, math.inf, math.nan, 1e308, None, 0.0] + [1.0] * (len(table) - 6)
    for name in ("q", "momentum", "gate", "rate_hz"):
        table = table.set_column(table.schema.get_field_index(name), name, pa.array(wrong, pa.float64()))
    for name in ("reason", "id"):
        table = table.set_column(table.schema.get_field_index(name), name, pa.nulls(len(table), pa.string()))
    pq.write_table(table, own / TABLE)
    fleet = read_fleet(own)
    assert fleet.devices.usable.tolist() == [False] * 6 + [True] * 6 + [False]
    assert fleet.devices.ids == [""] * 13
    assert device_tuning(fleet, 7).channels[0].q == 1.0


@pytest.mark.parametrize(
    "source",
    [
        "",
        "logs/dev00.csv",
        "demo",
        "serial:COM1",
        "/no/such/file.csv",
        "/",
        "[",
        "[]",
        "[null, []]",
        '[null, [["a"]]]',
        '[null, [["/no/such", [0]]]]',
        '[null, [["/no/such", [-1]]]]',
        "[" * 100_000,
        '["x", [[3, 4]]]',
    ],
)
def test_only_a_recording_that_lies_where_the_table_says_is_opened(own, source):
    table = pq.read_table(own / TABLE)
    i = table.schema.get_field_index("source")
    pq.write_table(table.set_column(i, "source", pa.array([source[:4000]] * len(table))), own / TABLE)
    fleet = read_fleet(own)
    with pytest.raises(BadFile) as refused:
        reopen(fleet.devices.ids[0], fleet.devices.sources[0], fleet.note)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("numbers", [False, True])
def test_a_series_of_a_data_set_is_opened_again(tmp_path, numbers):
    g = np.random.default_rng(1)
    names = [7, 8, 9] if numbers else ["a", "b", "c"]
    values = {name: np.cumsum(g.normal(size=50 + i)) for i, name in enumerate(names)}
    (tmp_path / "data").mkdir()
    columns = {
        "id": np.concatenate([[name] * len(z) for name, z in values.items()]),
        "time": np.concatenate([np.arange(len(z)) / 10 for z in values.values()]),
        "value": np.concatenate(list(values.values())),
    }
    pq.write_table(pa.table(columns), tmp_path / "data" / "all.parquet", row_group_size=40)
    run = FleetRun(tmp_path / "data", tmp_path / "result", PLAIN).do()
    run.finish()
    fleet = read_fleet(run.folder)
    assert fleet.devices.ids == [str(name) for name in names]
    for i, name in enumerate(names):
        recording = reopen(fleet.devices.ids[i], fleet.devices.sources[i], fleet.note)
        assert np.array_equal(recording.values[:, 0], values[name])
        assert recording.sample_period == pytest.approx(0.1)
