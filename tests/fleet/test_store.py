"""The folder of a fleet: its database, whole batches, one run at a time, and no file of the user overwritten."""

from __future__ import annotations

import random
import sqlite3
from contextlib import closing

import numpy as np
import pytest
from tests.fleet.fleet_runs import ANSWER, PLAIN, files_of, run_here, write_devices
from tests.support.effort import FUZZ

from kalscope.errors import BadFile, BadSetting
from kalscope.estimation.many import series_of
from kalscope.estimation.pool import WIDTH, Pool, pool_of
from kalscope.fleet.store import STORE, TUNING, Row, Store, Stored, open_store, stored
from kalscope.tuning.file import load_tuning, save_tuning
from kalscope.tuning.tuning import ChannelTuning, Tuning


def rows_of(key, n=2):
    """The rows of a unit and its pool, another one for each key."""
    rows = [Row(f"file {key}", f"channel {i}", q=float(i), r=1.0, verdict="ok") for i in range(n)]
    return rows, pool_of(series_of(np.random.default_rng(list(key.encode())).normal(size=(n, 20))))


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2 * FUZZ))
def test_the_table_is_the_same_in_whatever_order_units_were_stored(tmp_path, seed):
    draw = random.Random(seed)
    keys = [f"k{i}" for i in range(40)]
    contents = {key: rows_of(key, draw.randrange(3)) for key in [*keys, "stale"]}
    left = [*contents, *draw.choices(keys, k=9)]  # some twice
    draw.shuffle(left)
    for i in range(0, len(left), 7):
        with open_store(tmp_path) as store:
            store.keep(stored(key, *contents[key]) for key in left[i : i + 7])
    with open_store(tmp_path) as store:
        table, inputs, pool = store.merged(keys)
        assert store.settled() == set(keys)
    rows = [row for key in keys for row in contents[key][0]]
    assert [Row(**row) for row in table.to_pylist()] == rows
    assert np.isnan(inputs).all()
    assert inputs.shape == (len(rows), WIDTH)
    whole = Pool.empty()
    for key in keys:
        whole = whole + contents[key][1]
    assert np.array_equal(pool.sums, whole.sums)  # bit by bit: added up in the order of the fleet
    assert (pool.devices, pool.innovations) == (whole.devices, whole.innovations)


def test_a_file_is_no_folder_of_results_and_a_folder_no_database(tmp_path):
    (tmp_path / "x").write_text("")
    with pytest.raises(BadSetting, match="must go to a folder"), open_store(tmp_path / "x"):
        pass
    (tmp_path / STORE).mkdir()
    with pytest.raises(PermissionError, match="unable to open database file"), open_store(tmp_path):
        pass


HUGE = stored("k", [Row("a", samples=2**64 - 1)], Pool.empty()).rows


@pytest.mark.parametrize("rows", [b"", b"\xc1", b"\x91\x91\x01", "text", b"\x91\x01", b"\x91" * 100_000, HUGE])
def test_units_of_somebody_else_are_refused_with_one_line(tmp_path, rows):
    with open_store(tmp_path) as store:
        for pool in (None, b"123"):
            store.keep([Stored("k", True, rows, pool)])
            with pytest.raises(BadFile, match="must hold the units of a fleet"):
                store.merged(["k"])


OWN = Tuning((ChannelTuning("mine", "", 1.0, 2.0),), source_name="fleet of 2")


@pytest.fixture
def fleet(tmp_path, at_once, capsys):
    """Two devices, and the folder of their results."""
    write_devices(tmp_path / "logs", 2)
    return tmp_path / "logs", tmp_path / "out"


@pytest.mark.parametrize("name", [*sorted(ANSWER), "a database"])
def test_a_folder_with_a_file_of_that_name_is_refused_before_the_run(fleet, capsys, name):
    logs, out = fleet
    out.mkdir()
    path = out / (STORE if name == "a database" else name)
    path.write_text("" if name == "a database" else "mine")
    if name == "a database":  # of another program
        with closing(sqlite3.connect(path)) as other, other:
            other.execute("CREATE TABLE mine (x)")
    before = path.read_bytes()
    refused = run_here(capsys, logs, "-o", out, *PLAIN, expect=2)
    assert refused.err.startswith("kalscope: -o must name a ")
    assert path.name in refused.err
    assert path.read_bytes() == before
    assert files_of(out) == {path.name}


@pytest.mark.slow
def test_a_tuning_of_the_user_is_kept_and_named(fleet, capsys, monkeypatch):
    logs, out = fleet
    run_here(capsys, logs, "-o", out, *PLAIN)
    first = (out / TUNING).read_text()
    save_tuning(OWN, out / TUNING)
    refused = run_here(capsys, logs, "-o", out, "--lag-ms", "50", expect=2)
    assert refused.err == (
        f"kalscope: -o must name a folder without a {TUNING} of your own (got {str(out / TUNING)!r}, which no fleet"
        " wrote or which was changed since): move it and run the same command again\n"
    )
    assert load_tuning(out / TUNING).channels == OWN.channels
    (out / TUNING).rename(out / "mine.toml")
    run_here(capsys, logs, "-o", out, "--lag-ms", "50")
    assert "lag of 50 ms" in load_tuning(out / TUNING).channels[0].how
    (out / TUNING).write_text(first)  # as a kill before the last file leaves it
    run_here(capsys, logs, "-o", out, "--lag-ms", "50")
    assert "lag of 50 ms" in load_tuning(out / TUNING).channels[0].how
    settled = Store.settled  # the user saves it during the run
    monkeypatch.setattr(Store, "settled", lambda store: save_tuning(OWN, out / TUNING) or settled(store))
    assert "of your own" in run_here(capsys, logs, "-o", out, *PLAIN, expect=2).err
    assert load_tuning(out / TUNING).channels == OWN.channels
