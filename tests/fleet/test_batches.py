"""Laws of the batches: each unit exactly once, bounded bytes, and nothing innocent is lost, whatever dies."""

from __future__ import annotations

import random
from collections import deque

from hypothesis import given
from hypothesis import strategies as st

from kalscope.fleet.run import BATCHES, MAX_BATCH_BYTES, MAX_UNITS, MIN_BATCH_BYTES, Dispatcher, lay_out


@given(st.lists(st.integers(0, 300_000) | st.integers(0, 1 << 30), max_size=300))
def test_batches_hold_each_unit_once_in_order_and_few_bytes(sizes):
    limit = min(max(sum(sizes) / BATCHES, MIN_BATCH_BYTES), MAX_BATCH_BYTES)
    assert [i for batch in lay_out(sizes) for i in batch] == list(range(len(sizes)))
    assert all(lay_out(sizes))
    assert all(sum(sizes[i] for i in batch) <= limit for batch in lay_out(sizes) if len(batch) > 1)


def test_a_kill_costs_a_thousandth_of_a_large_fleet_and_empty_files_make_batches_too():
    assert len(lay_out([8000] * 1_000_000)) in range(1000, 1010)
    assert {len(batch) for batch in lay_out([0] * 10_000)} == {MAX_UNITS}


@given(st.integers(0, 60), st.sets(st.integers(0, 59), max_size=4), st.integers(), st.sampled_from([0.0, 0.3]))
def test_every_unit_is_done_once_or_is_lost_because_it_kills(n, poison, seed, kills):
    """Units of `poison` kill their worker, others are killed, cut short or forgotten by chance."""
    draw, units = random.Random(seed), list(range(n))
    jobs = Dispatcher(deque(units[i : i + 7] for i in range(0, n, 7)))
    flight, done, lost = [], [], []
    while jobs.active:
        while len(flight) < 6 and (batch := jobs.next()) is not None:
            flight.append(batch)
        batch = flight.pop(draw.randrange(len(flight)))
        cut = draw.choice([0, *range(1, len(batch) + 1)])  # 0: the scheduler forgot it
        killer = next((i for i in batch if i in poison), draw.choice(batch))
        if killer in poison or draw.random() < kills:
            lost += [killer] if jobs.died(batch, killer) else []
        else:
            done += batch[:cut]
            jobs.ended(batch[cut:])
    assert sorted(done + lost) == units
    assert kills or set(lost) == poison & set(units)


def test_what_is_not_done_of_a_batch_comes_before_the_others():
    jobs = Dispatcher(deque([[0, 1, 2, 3, 4], [5]]))
    jobs.ended(*(jobs.next()[1:3], [3, 4]))
    assert [jobs.next() for _ in range(3)] == [[1, 2], [3, 4], [5]]
