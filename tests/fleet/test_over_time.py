"""Recordings of one device after each other: which device has changed."""

from __future__ import annotations

import json
from collections import Counter

import numpy as np
import pytest
from fleet_folder import table_of
from fleets import fleet

from kalscope import estimate_many
from kalscope.cli.tune_options import NOTHING
from kalscope.estimation.pool import pool_of
from kalscope.fleet.answer import Devices, answer_for, save_answer, split_date, summary
from kalscope.fleet.run import Tally
from kalscope.fleet.store import SUMMARY

TALLY = Tally(units=100, kept=0, bytes=1, kept_bytes=0, done=100, rows=100, seconds=2.0)
MONTHS = [f"2024-{month:02d}-01" for month in range(1, 6)]


def answer_of(ids, r=1.0, q=0.04):
    series = fleet(len(ids), 800, q, r)
    table, n = estimate_many(series, robust=False), len(ids)
    intervals = (table.q_interval, table.r_interval)
    devices = Devices(
        ids, ["light"] * n, ["lx"] * n, np.full(n, 100.0), table.q, table.r, *intervals, np.zeros(n), Counter()
    )
    return answer_for(devices, pool_of(series), NOTHING)


@pytest.mark.parametrize(
    ("name", "device", "date"),
    [
        ("dev7/2024-05-01.csv", "dev7/.csv", "20240501000000"),
        ("dev7_20240501.csv", "dev7_.csv", "20240501000000"),
        ("2024/2024-05/dev7.csv", "2024//dev7.csv", "20240500000000"),
        ("dev7 2024.05.01 08.30.15.log", "dev7 .log", "20240501083015"),
        ("dev7-20240501T0830", "dev7-", "20240501083000"),
    ],
)
def test_the_date_is_taken_out_of_the_name(name, device, date):
    assert split_date(name) == (device, date)


@pytest.mark.parametrize(
    "name", ["dev7.csv", "dev202405.csv", "dev120240501.csv", "2024-13-01", "2024-05.01x9", "7"]
)
def test_other_digits_are_no_date(name):
    split = split_date(name)
    assert split is None or name == "2024-05.01x9"


def test_a_device_that_grows_noisier_is_named_with_the_date(tmp_path):
    ids = [f"dev{device:02d}/{month}.csv" for device in range(20) for month in MONTHS]
    r = np.ones(100)
    r[7 * 5 + 3 : 8 * 5] = 2.0
    order = np.random.default_rng(1).permutation(100)  # a table is sorted by name, which need not be by date
    answer = answer_of([ids[i] for i in order], r[order])
    one = answer.changed["r"]
    (device,) = one.changes.changed
    assert one.name(device) == "dev07"
    assert answer.devices.ids[one.since(device)] == "dev07/2024-04-01.csv"
    assert one.factor(device) == pytest.approx(2.0, rel=0.25)
    assert answer.changed["q"].changes.changed.size == 0
    text = summary(answer, TALLY, tmp_path)
    assert "Changed in r, of 20 devices with several recordings: dev07 (" in text
    assert "× from dev07/2024-04-01.csv on)" in text
    assert "Changed in q, of 20 devices with several recordings: none" in text
    save_answer(answer, table_of(answer.devices), tmp_path)
    (listed,) = json.loads((tmp_path / SUMMARY).read_text())["changed"]["r"]["devices"]
    assert (listed["since"], listed["recordings"]) == ("dev07/2024-04-01.csv", 5)
    assert listed["p"] < 0.05


def test_a_fleet_of_one_recording_a_device_says_nothing_of_time(tmp_path):
    for ids in ([f"dev{i:02d}.csv" for i in range(30)], [f"dev{i:02d}/2024-05-01.csv" for i in range(30)]):
        answer = answer_of(ids)
        assert answer.changed == {}
        assert "Changed" not in summary(answer, TALLY, tmp_path)
