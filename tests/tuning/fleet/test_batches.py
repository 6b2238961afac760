"""Laws of the batches: each unit exactly once, bounded bytes, and nothing innocent is lost, whatever dies."""

from __future__ import annotations

import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from kalscope.tuning.fleet import batches
from kalscope.tuning.fleet.batches import Batch, Dispatcher, batch_bytes, lay_out, window

sizes = st.lists(st.integers(0, 300_000) | st.integers(0, 1 << 30), max_size=300)


@given(sizes)
def test_batches_hold_each_unit_once_in_order(sizes):
    assert [i for batch in lay_out(sizes) for i in batch] == list(range(len(sizes)))
    assert all(lay_out(sizes))


@given(sizes)
def test_a_batch_of_several_units_has_no_more_bytes_than_a_batch_may(sizes):
    limit = batch_bytes(sum(sizes))
    assert limit <= batches.MAX_BATCH_BYTES
    assert all(sum(sizes[i] for i in batch) <= limit for batch in lay_out(sizes) if len(batch) > 1)


def test_a_large_fleet_of_even_units_loses_a_thousandth_to_a_kill():
    assert len(lay_out([8000] * 100_000)) in range(1000, 3200)
    assert len(lay_out([8000] * 1_000_000)) in range(1000, 1010)


def test_a_billion_series_make_batches_of_the_largest_size():
    assert batch_bytes(8 * 10**12) == batches.MAX_BATCH_BYTES


def test_empty_files_make_batches_too():
    assert {len(batch) for batch in lay_out([0] * 10_000)} == {batches.MAX_UNITS}


@pytest.mark.parametrize(("threads", "tasks"), [(0, 4), (1, 4), (2, 4), (64, 128), (100_000, 2000)])
def test_tasks_in_flight_are_bounded(threads, tasks):
    assert window(threads) == tasks


def play(units, poison, seed, kills=0.0, leaves=0.0, threads=3):
    """A run in which units of `poison` kill their worker, and others are killed or left by chance."""
    draw = random.Random(seed)
    jobs = Dispatcher.of(units[i : i + 7] for i in range(0, len(units), 7))
    flight, done, lost, steps = [], [], [], 0
    while jobs.active:
        steps += 1
        assert steps < 10_000
        while len(flight) < window(threads) and (batch := jobs.next()) is not None:
            flight.append(batch)
        assert flight, "something waits but may never begin"
        batch = flight.pop(draw.randrange(len(flight)))
        if poison & set(batch.units) or draw.random() < kills:
            jobs.died(batch)
        elif len(batch.units) > 1 and draw.random() < leaves:
            cut = draw.randrange(1, len(batch.units))
            done += batch.units[:cut]
            jobs.finished(batch, batch.units[cut:])
        elif draw.random() < 0.1:
            jobs.returned(batch)
        else:
            done += batch.units
            jobs.finished(batch)
        lost += jobs.lost
        jobs.lost.clear()
    return done, lost


@given(st.integers(0, 60), st.sets(st.integers(0, 59), max_size=4), st.integers())
def test_every_unit_is_done_once_or_is_lost_because_it_kills(n, poison, seed):
    units = list(range(n))
    done, lost = play(units, poison, seed, leaves=0.3)
    assert sorted(done + lost) == units
    assert set(lost) == poison & set(units)


@given(st.integers(0, 60), st.integers())
def test_each_unit_ends_once_however_often_workers_are_killed(n, seed):
    done, lost = play(list(range(n)), set(), seed, kills=0.3, leaves=0.2)
    assert sorted(done + lost) == list(range(n))


def test_a_suspect_runs_alone():
    jobs = Dispatcher.of([[0, 1], [2]])
    pair, single = jobs.next(), jobs.next()
    jobs.died(pair)
    again = jobs.next()
    assert again == Batch((0, 1), 1)  # the first death is forgiven
    jobs.died(again)
    assert jobs.next() is None  # while the other one runs
    jobs.finished(single)
    assert jobs.next() == Batch((0,), 2)
    assert jobs.next() is None


def test_what_a_batch_leaves_goes_to_two_workers_before_the_rest():
    jobs = Dispatcher.of([[0, 1, 2, 3, 4], [5]])
    jobs.finished(jobs.next(), (1, 2, 3, 4))
    assert [jobs.next().units for _ in range(3)] == [(1, 2), (3, 4), (5,)]
