"""The folder of a fleet as the dashboard reads it: finished, and written by somebody else."""

from __future__ import annotations

import json
import math
import shutil

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from tests.support.fleet_folder import NOISY, finished_fleet, run_steps, write_logs

from kalscope import estimate, kalman_filter, steady_state
from kalscope.errors import BadFile, BadSetting
from kalscope.estimation.request import Request
from kalscope.fleet.read import FleetOptions
from kalscope.fleet.results import RunNote, device_tuning, read_fleet, reopen
from kalscope.fleet.store import SUMMARY, TABLE
from kalscope.sources.grammar.read_options import DEFAULTS
from kalscope.sources.reading.recording_file import read_recording


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
    assert (len(fleet), fleet.note) == (13, RunNote(DEFAULTS, None))
    answer = json.loads((folder / SUMMARY).read_text())["one_filter"]
    assert (fleet.shared.params.q, fleet.shared.params.r) == (answer["q"], answer["r"])
    assert set(json.loads((folder / SUMMARY).read_text())["unlike"]["r"]) == {"dev03.csv"}
    assert np.flatnonzero(fleet.outlier).tolist() == [NOISY]
    assert np.nanargmax(fleet.distance) == NOISY
    assert all(source.endswith(name) for source, name in zip(fleet.devices.sources, fleet.devices.ids, strict=True))
    assert "empty" in fleet.devices.reasons[fleet.devices.ids.index("empty.csv")]


@pytest.mark.slow
def test_a_device_is_opened_as_it_was_read_at_its_own_setting(folder):
    fleet = read_fleet(folder)
    recording = reopen(fleet.devices.ids[NOISY], fleet.devices.sources[NOISY], fleet.note)
    assert np.array_equal(recording.values, read_recording(folder.parent / "logs" / "dev03.csv").values)
    mine = device_tuning(fleet, NOISY)
    assert (mine.channels[0].q, mine.channels[0].r) == (fleet.devices.q[NOISY], fleet.devices.r[NOISY])
    assert mine.sample_period == pytest.approx(0.01)
    with pytest.raises(BadSetting):
        device_tuning(fleet, fleet.devices.ids.index("empty.csv"))


@pytest.mark.slow
def test_the_table_says_what_each_device_loses_also_by_a_goal(tmp_path):
    write_logs(tmp_path / "logs", devices=4)
    asked = FleetOptions(Request(target={"lag_s": 0.02}, momentum=0.0))
    answer = run_steps(tmp_path / "logs", tmp_path / "result", asked)
    rows = pq.read_table(tmp_path / "result" / TABLE).to_pylist()
    assert "loss_inputs" not in rows[0]
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


@pytest.mark.parametrize(
    "text",
    [
        *("", "[]", "{", '{"why_not": 3}', "[" * 100_000),
        *({"note": {"sample_period": period}} for period in ("NaN", -1, 0, [])),
        {"note": {"reading": {"gaps": ["none"]}}},
        *({"one_filter": {"q": pair[0], "r": pair[1]}} for pair in ((-1, 1), (0, 1), ("x", 1), (math.nan, 1.0))),
        *({"one_filter": one} for one in ([], 3, {})),
    ],
)
def test_an_answer_of_somebody_else_is_refused_with_one_line(own, text):
    if isinstance(text, dict):
        plain, ((name, value),) = json.loads((own / SUMMARY).read_text()), text.items()
        text = json.dumps(plain | {name: plain[name] | value if value and isinstance(value, dict) else value})
    (own / SUMMARY).write_text(text)
    with pytest.raises(BadFile) as refused:
        read_fleet(own)
    assert "\n" not in str(refused.value)


def test_a_run_that_is_not_finished_has_no_answer_yet(own):
    (own / SUMMARY).unlink()
    with pytest.raises(BadFile, match="must be the folder of a finished fleet"):
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
    "source", ["", "demo", "/no/such.csv", "/", "[", "[]", "[null, []]", '[null, [["a"]]]', '["x", [[3, 4]]]']
)
def test_only_a_recording_that_lies_where_the_table_says_is_opened(own, source):
    table = pq.read_table(own / TABLE)
    i = table.schema.get_field_index("source")
    pq.write_table(table.set_column(i, "source", pa.array([source] * len(table))), own / TABLE)
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
    run_steps(tmp_path / "data", tmp_path / "result")
    fleet = read_fleet(tmp_path / "result")
    assert fleet.devices.ids == [str(name) for name in names]
    for i, name in enumerate(names):
        recording = reopen(fleet.devices.ids[i], fleet.devices.sources[i], fleet.note)
        assert np.array_equal(recording.values[:, 0], values[name])
        assert recording.sample_period == pytest.approx(0.1)
