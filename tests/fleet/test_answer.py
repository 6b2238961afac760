"""The answer of a fleet: for simulated devices whose truth is known, and in the folder that the dashboard reads."""

from __future__ import annotations

import json
import math
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from tests.support.fleet_folder import NOISY as NOISY_FILE
from tests.support.fleet_folder import devices_with, finished_fleet, run_steps, table_of, write_logs

from kalscope import estimate, kalman_filter
from kalscope.errors import BadFile, BadSetting
from kalscope.estimation.many import estimate_many, series_of
from kalscope.estimation.pool import Pool, held_out, loss_inputs, pool_of
from kalscope.estimation.request import Request
from kalscope.filtering.steady import steady_state
from kalscope.fleet.read import FleetOptions
from kalscope.fleet.results import (
    RunNote,
    Tally,
    answer_for,
    device_tuning,
    read_fleet,
    reopen,
    save_answer,
    summary,
)
from kalscope.fleet.store import SUMMARY, TABLE, TUNING, open_store
from kalscope.sources.grammar.read_options import DEFAULTS
from kalscope.sources.reading.recording_file import read_recording

TALLY = Tally(units=500, kept=0, done=500, seconds=2.0)
NOISY, DRIFTING = range(5), range(5, 10)


def devices_of(series):
    table = estimate_many(series_of(series))
    q, r = (np.where(table.usable, one, np.nan) for one in (table.q, table.r))
    reasons = ["" if usable else str(verdict) for usable, verdict in zip(table.usable, table.verdict, strict=True)]
    inputs = loss_inputs(q / r, np.zeros(len(series)), held_out(series_of(series)))
    interval = (*table.q_interval, *table.r_interval)
    ids = [f"dev{i:03d}" for i in range(len(series))]
    return devices_with(ids, q, r, interval, reasons=reasons, loss_inputs=inputs)


def answered(devices, pool, **wanted):
    return answer_for(devices, pool, FleetOptions(Request(**wanted)), Path("out"))


@pytest.fixture(scope="module")
def fleet():
    """500 devices with q = 0.04 and r = 1; five have ten times the noise, five move thirty times as much."""
    q, r = np.full(500, 0.04), np.ones(500)
    r[NOISY], q[DRIFTING] = 10.0, 1.2
    steps, noise = np.random.default_rng(2).normal(size=(2, 500, 1000))
    series = np.cumsum(np.sqrt(q)[:, None] * steps, axis=1) + np.sqrt(r)[:, None] * noise
    return devices_of(series), pool_of(series_of(series))


@pytest.mark.slow
def test_the_odd_devices_are_found_and_the_filter_for_all_is_that_of_the_many(fleet, tmp_path):
    answer = answered(*fleet)
    assert set(answer.outliers["r"].devices) == set(NOISY)
    assert set(answer.outliers["q"].devices) == set(DRIFTING)
    assert len(answer.outliers["rate_hz"].devices) == 0
    assert all(one.expected == 0.05 for one in answer.outliers.values())
    shared = answer.shared
    assert shared.params.q / shared.params.r == pytest.approx(0.04, rel=0.1)
    assert set(shared.not_served) == set(DRIFTING) | set(NOISY) & set(shared.not_served)
    assert shared.served >= 0.98
    text = summary(answer, TALLY, tmp_path)
    lines = text.splitlines()
    assert lines[0] == "500 rows: 500 with q and r; 500 of 500 files or row groups done in 2 s"
    assert lines[1].startswith("One filter for all: q = 0.04")
    assert lines[2].startswith(
        "  for 99 % of 500 its prediction error on unseen samples is at most 10 % above that"
    )
    assert "dev005 (+" in lines[2]
    assert lines[3].startswith("  nine of ten devices, against their own filters: error −")
    assert "Unlike the others in r, 0.05 expected by chance: dev00" in text
    assert text.count(" ×)") == 10
    assert len(lines) <= 7


@pytest.mark.slow
def test_a_fleet_without_a_filter_says_why(tmp_path):
    constant = np.ones((3, 100))
    answer = answered(devices_of(constant), pool_of(series_of(constant)))
    with open_store(tmp_path) as store:
        save_answer(answer, table_of(answer.devices), store)
    assert not (tmp_path / TUNING).exists()
    assert json.loads((tmp_path / SUMMARY).read_text())["one_filter"] is None
    text = summary(answer, TALLY, tmp_path)
    assert text.startswith("3 rows: 3 without; ")
    assert "\nWhy not all have q and r:\n  3 × constant\n" in text
    assert "No filter for all: the fleet must hold at least one series that can be fitted (got none)" in text
    assert answered(devices_of(constant), Pool.empty()).shared is None
    z = np.cumsum(np.random.default_rng(1).normal(size=(3, 400)).cumsum(axis=1), axis=1)
    refusal = answered(devices_of(z), pool_of(series_of(z))).refusal
    assert refusal == "q and r of all must both be above 0 (got r = 0): a goal such as --lag-ms 50 gives both"


@pytest.mark.slow
def test_rates_that_differ_by_a_clock_are_not_unlike():
    devices = devices_of(np.random.default_rng(2).normal(size=(20, 50)).cumsum(axis=1))
    rates = np.full(20, 100.0)
    rates[3:7] *= 1.0 + np.array([1e-9, 0.01, 0.9e-4, 3e-4])
    usable = replace(devices, rate_hz=rates, q=np.ones(20), r=np.ones(20))
    assert list(answered(usable, Pool.empty()).outliers["rate_hz"].devices) == [4, 6]


# ---- the folder


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return finished_fleet(tmp_path_factory.mktemp("fleet"))


@pytest.fixture
def own(folder, tmp_path):
    """A folder of a fleet that a test may spoil; its recordings lie beside the first."""
    return shutil.copytree(folder, tmp_path / "result")


@pytest.mark.slow
def test_a_finished_fleet_has_its_answer_and_its_devices_open_as_they_were_read(folder):
    fleet = read_fleet(folder)
    assert fleet.devices.counted == "13 rows: 12 with q and r, 1 failed"
    assert (len(fleet), fleet.note) == (13, RunNote(DEFAULTS, None))
    answer = json.loads((folder / SUMMARY).read_text())
    assert (fleet.shared.params.q, fleet.shared.params.r) == (answer["one_filter"]["q"], answer["one_filter"]["r"])
    assert set(answer["unlike"]["r"]) == {"dev03.csv"}
    assert np.flatnonzero(fleet.outlier).tolist() == [NOISY_FILE]
    assert np.nanargmax(fleet.distance) == NOISY_FILE
    assert all(source.endswith(name) for source, name in zip(fleet.devices.sources, fleet.devices.ids, strict=True))
    assert "empty" in fleet.devices.reasons[fleet.devices.ids.index("empty.csv")]

    recording = reopen(fleet.devices.ids[NOISY_FILE], fleet.devices.sources[NOISY_FILE], fleet.note)
    assert np.array_equal(recording.values, read_recording(folder.parent / "logs" / "dev03.csv").values)
    mine = device_tuning(fleet, NOISY_FILE)
    assert (mine.channels[0].q, mine.channels[0].r) == (fleet.devices.q[NOISY_FILE], fleet.devices.r[NOISY_FILE])
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
    shared = steady_state(answer.shared.params, 0.01)
    assert shared.lag_s == pytest.approx(0.02)
    assert "a lag of 20 ms" in answer.shared.how
    wanted = own.noise_reduction_db - shared.noise_reduction_db
    assert fitted[0]["noise_loss_db"] == pytest.approx(wanted, rel=1e-5)
    half = estimate(z[:150], momentum=0.0, robust=False).params
    errors = [kalman_filter(z, params).innovation[150:] for params in (answer.shared.params, half)]
    growth = np.sqrt(np.mean(errors[0] ** 2) / np.mean(errors[1] ** 2)) - 1
    assert fitted[0]["error_growth"] == pytest.approx(growth, abs=2e-3)


WRONG = [
    *("", "[]", "{", '{"why_not": 3}', "[" * 100_000),
    *({"note": {"sample_period": period}} for period in ("NaN", -1, 0, [])),
    {"note": {"reading": {"gaps": ["none"]}}},
    *({"one_filter": {"q": q, "r": 1.0}} for q in (-1, 0, "x", math.nan)),
    *({"one_filter": one} for one in ([], 3, {})),
]


@pytest.mark.slow
def test_an_answer_of_somebody_else_or_none_yet_is_refused_with_one_line(own):
    plain = json.loads((own / SUMMARY).read_text())
    for wrong in WRONG:
        text = wrong
        if isinstance(wrong, dict):
            ((name, value),) = wrong.items()
            text = json.dumps(plain | {name: plain[name] | value if value and isinstance(value, dict) else value})
        (own / SUMMARY).write_text(text)
        with pytest.raises(BadFile) as refused:
            read_fleet(own)
        assert "\n" not in str(refused.value)
    (own / SUMMARY).unlink()
    with pytest.raises(BadFile, match="must be the folder of a finished fleet"):
        read_fleet(own)


@pytest.mark.slow
def test_tables_of_somebody_else_are_refused_with_one_line(own):
    table = pq.read_table(own / TABLE)
    n = len(table)
    for hostile in (
        table.drop_columns(["source"]),
        table.set_column(0, "id", pa.array([[1]] * n)),
        table.set_column(0, "id", pa.array(["x" * 5000] * n)),
        table.set_column(table.schema.get_field_index("q"), "q", pa.array(["much"] * n)),
        pa.table({"a": [1]}),
        *(b"", b"PAR1", b"x" * 1000),
    ):
        if isinstance(hostile, bytes):
            (own / TABLE).write_bytes(hostile)
        else:
            pq.write_table(hostile, own / TABLE)
        with pytest.raises(BadFile) as refused:
            read_fleet(own)
        assert "\n" not in str(refused.value)


@pytest.mark.slow
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


def test_only_a_recording_that_lies_where_the_table_says_is_opened():
    note = RunNote(DEFAULTS, None)
    for source in ("", "demo", "/no/such.csv", "/", "[", "[]", "[null, []]", '[null, [["a"]]]', '["x", [[3, 4]]]'):
        with pytest.raises(BadFile) as refused:
            reopen("dev00.csv", source, note)
        assert "\n" not in str(refused.value)


@pytest.mark.slow
@pytest.mark.parametrize("numbers", [False, True])
def test_a_series_of_a_data_set_is_opened_again(tmp_path, numbers):
    names, lengths = [7, 8, 9] if numbers else ["a", "b", "c"], [50, 51, 52]
    z, time = np.random.default_rng(1).normal(size=153), np.concatenate([np.arange(n) / 10 for n in lengths])
    (tmp_path / "data").mkdir()
    table = pa.table({"id": np.repeat(names, lengths), "time": time, "value": z})
    pq.write_table(table, tmp_path / "data" / "all.parquet", row_group_size=40)
    run_steps(tmp_path / "data", tmp_path / "result")
    fleet = read_fleet(tmp_path / "result")
    assert fleet.devices.ids == [str(name) for name in names]
    for i, samples in enumerate(np.split(z, [50, 101])):
        recording = reopen(fleet.devices.ids[i], fleet.devices.sources[i], fleet.note)
        assert np.array_equal(recording.values[:, 0], samples)
        assert recording.sample_period == pytest.approx(0.1)
