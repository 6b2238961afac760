"""Laws of the batches: each unit exactly once, bounded bytes, and nothing innocent is lost, whatever dies."""

from __future__ import annotations

import random
import tempfile
from pathlib import Path
from types import SimpleNamespace

import msgspec
from hypothesis import given
from hypothesis import strategies as st

from kalscope.estimation.pool import Pool
from kalscope.estimation.request import Request
from kalscope.fleet.read import FleetOptions, Piece, Unit
from kalscope.fleet.run import (
    BATCHES,
    MAX_BATCH_BYTES,
    MAX_UNITS,
    MIN_BATCH_BYTES,
    Tally,
    WorkerDied,
    _Run,
    lay_out,
)
from kalscope.fleet.store import Row, stored
from kalscope.fleet.work import note_path


@given(st.lists(st.integers(0, 300_000) | st.integers(0, 1 << 30), max_size=300))
def test_batches_hold_each_unit_once_in_order_and_few_bytes(sizes):
    limit = min(max(sum(sizes) / BATCHES, MIN_BATCH_BYTES), MAX_BATCH_BYTES)
    assert [i for batch in lay_out(sizes) for i in batch] == list(range(len(sizes)))
    assert all(lay_out(sizes))
    assert all(sum(sizes[i] for i in batch) <= limit for batch in lay_out(sizes) if len(batch) > 1)


def test_a_kill_costs_a_thousandth_of_a_large_fleet_and_empty_files_make_batches_too():
    assert len(lay_out([8000] * 1_000_000)) in range(1000, 1010)
    assert {len(batch) for batch in lay_out([0] * 10_000)} == {MAX_UNITS}


class Draws:
    """Workers of which units of `poison` kill one; by chance others are killed, cut short or forgotten."""

    def __init__(self, poison, kills, seed):
        self.poison, self.kills, self.draw, self.flight = poison, kills, random.Random(seed), []

    def submit(self, batch, _call, units, _options, folder):
        self.flight.append((batch, [unit.id for unit in units], Path(folder)))

    def ended(self, _timeout):
        batch, keys, folder = self.flight.pop(self.draw.randrange(len(self.flight)))
        killer = next((i for i in batch if i in self.poison), self.draw.choice(batch))
        if killer in self.poison or self.draw.random() < self.kills:
            note_path(folder, keys).write_text(f"{killer}\n")
            return batch, WorkerDied()
        done = keys[: self.draw.choice([0, *range(1, len(batch) + 1)])]  # 0: the scheduler forgot it
        return batch, [stored(key, [Row(key, verdict="ok")], Pool.empty()) for key in done]


@given(st.integers(0, 60), st.sets(st.integers(0, 59), max_size=4), st.integers(), st.sampled_from([0.0, 0.3]))
def test_every_unit_is_done_once_or_is_lost_because_it_kills(n, poison, seed, kills):
    keys, units = [str(i) for i in range(n)], [Unit(str(i), (Piece("x", 1 << 25),)) for i in range(n)]
    rows, tally = [], Tally(n, 0)
    with tempfile.TemporaryDirectory() as folder:
        store = SimpleNamespace(folder=Path(folder), keep=rows.extend)
        _Run(units, keys, FleetOptions(Request()), store, tally).do(range(n), Draws(poison, kills, seed), None)
        assert not any(Path(folder).iterdir())
    verdicts = {one.key: Row(*msgspec.msgpack.decode(one.rows)[0]).verdict for one in rows}
    lost = {int(key) for key, verdict in verdicts.items() if verdict == "failed"}
    assert sorted(verdicts, key=int) == keys
    assert len(rows) == tally.done == n
    assert kills or lost == poison & set(range(n))
