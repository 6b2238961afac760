"""The answer for a simulated fleet whose truth is known."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.support.fleet_folder import devices_with, table_of

from kalscope.estimation.many import estimate_many, series_of
from kalscope.estimation.pool import Pool, held_out, loss_inputs, pool_of
from kalscope.estimation.request import Request
from kalscope.filtering.params import FilterParams
from kalscope.filtering.steady import steady_state
from kalscope.fleet.read import FleetOptions
from kalscope.fleet.results import Tally, answer_for, save_answer, summary
from kalscope.fleet.store import SUMMARY, TUNING, open_store

RNG = np.random.default_rng(2)
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


def simulated():
    """500 devices with q = 0.04 and r = 1; five have ten times the noise, five move thirty times as much."""
    q, r = np.full(500, 0.04), np.ones(500)
    r[NOISY], q[DRIFTING] = 10.0, 1.2
    steps, noise = RNG.normal(size=(500, 1000)), RNG.normal(size=(500, 1000))
    return np.cumsum(np.sqrt(q)[:, None] * steps, axis=1) + np.sqrt(r)[:, None] * noise


def answered(devices, pool, **wanted):
    return answer_for(devices, pool, FleetOptions(Request(**wanted)), Path("out"))


@pytest.fixture(scope="module")
def fleet():
    series = simulated()
    return devices_of(series), pool_of(series_of(series))


@pytest.mark.slow
def test_the_odd_devices_are_found_and_no_others(fleet):
    answer = answered(*fleet)
    assert set(answer.outliers["r"].devices) == set(NOISY)
    assert set(answer.outliers["q"].devices) == set(DRIFTING)
    assert len(answer.outliers["rate_hz"].devices) == 0
    assert all(one.expected == 0.05 for one in answer.outliers.values())


@pytest.mark.slow
def test_one_filter_for_all_is_that_of_the_many_and_names_those_it_does_not_serve(fleet):
    shared = answered(*fleet).shared
    assert (shared.params.q / shared.params.r) == pytest.approx(0.04, rel=0.1)
    assert set(shared.not_served) == set(DRIFTING) | set(NOISY) & set(shared.not_served)
    assert shared.served >= 0.98


def test_a_goal_holds_for_the_filter_of_all(fleet):
    shared = answered(*fleet, target={"lag_s": 0.05}).shared
    assert steady_state(shared.params, 0.01).lag_s == pytest.approx(0.05)
    assert "a lag of 50 ms" in shared.how
    assert shared.losses.lag_samples[0] * 10.0 == pytest.approx(50.0 - 10.0 * own_lag(fleet[0], 0))
    given = answered(*fleet, ratio=0.5).shared.params
    assert given.q / given.r == 0.5


def own_lag(devices, i):
    return steady_state(FilterParams(devices.q[i], devices.r[i])).lag_samples


def save(answer, folder):
    with open_store(folder) as store:
        save_answer(answer, table_of(answer.devices), store)


def test_the_report_says_it_in_words(fleet, tmp_path):
    text = summary(answered(*fleet), TALLY, tmp_path)
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


def test_a_fleet_without_a_filter_says_why(tmp_path):
    constant = np.ones((3, 100))
    answer = answered(devices_of(constant), pool_of(series_of(constant)))
    save(answer, tmp_path)
    assert not (tmp_path / TUNING).exists()
    assert json.loads((tmp_path / SUMMARY).read_text())["one_filter"] is None
    text = summary(answer, TALLY, tmp_path)
    assert text.startswith("3 rows: 3 without; ")
    assert "\nWhy not all have q and r:\n  3 × constant\n" in text
    assert "No filter for all: the fleet must hold at least one series that can be fitted (got none)" in text
    assert answered(devices_of(constant), Pool.empty()).shared is None


def test_a_fleet_that_is_all_movement_is_refused_for_its_common_q_and_r():
    z = np.cumsum(np.random.default_rng(1).normal(size=(3, 400)).cumsum(axis=1), axis=1)
    refusal = answered(devices_of(z), pool_of(series_of(z))).refusal
    assert refusal == "q and r of all must both be above 0 (got r = 0): a goal such as --lag-ms 50 gives both"


def test_rates_that_differ_by_a_clock_are_not_unlike():
    devices = devices_of(RNG.normal(size=(20, 50)).cumsum(axis=1))
    rates = np.full(20, 100.0)
    rates[3:7] *= 1.0 + np.array([1e-9, 0.01, 0.9e-4, 3e-4])
    usable = replace(devices, rate_hz=rates, q=np.ones(20), r=np.ones(20))
    assert list(answered(usable, Pool.empty()).outliers["rate_hz"].devices) == [4, 6]
