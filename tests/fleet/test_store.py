"""The lock, the parts and the merged table."""

from __future__ import annotations

import random
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from effort import FUZZ

from kalscope.errors import BadSetting
from kalscope.estimation.pool import Pool, pool_of
from kalscope.fleet.store import Row, find_parts, locked, merge, sweep, write_part


def rows_of(key, n=2):
    """The rows of a unit and its pool, another one for each key."""
    rows = [Row(f"file {key}", f"channel {i}", q=float(i), r=1.0, verdict="ok") for i in range(n)]
    return rows, pool_of(np.random.default_rng(list(key.encode())).normal(size=(n, 20)))


def merged(folder, batches):
    table, pool = merge(batches, find_parts(folder))
    return [Row(**row) for row in table.to_pylist()], pool


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3 * FUZZ))
def test_the_table_is_the_same_however_the_parts_came_about(tmp_path, seed):
    draw = random.Random(seed)
    keys = [f"k{i}" for i in range(40)]
    contents = {key: rows_of(key, draw.randrange(3)) for key in keys}
    batches = [keys[:15], keys[15:16], keys[16:]]
    for batch in batches:
        left = batch[:]
        draw.shuffle(left)
        while left:
            some, left = left[: draw.randrange(1, 6)], left[draw.randrange(0, 6) :]  # in two parts, or none
            write_part(tmp_path, {key: contents[key] for key in some})
    done = find_parts(tmp_path)
    for key in keys:
        if key not in done:
            write_part(tmp_path, {key: contents[key]})
    rows, pool = merged(tmp_path, batches)
    assert rows == [row for key in keys for row in contents[key][0]]
    whole = Pool.empty()
    for key in keys:
        whole = whole + contents[key][1]
    assert np.array_equal(pool.sums, whole.sums)  # bit by bit: added up in the order of the fleet
    assert (pool.devices, pool.innovations) == (whole.devices, whole.innovations)


@pytest.mark.parametrize("cut", [0, 1, 100, -1])
def test_a_torn_part_counts_for_nothing(tmp_path, cut):
    path = write_part(tmp_path, {"k": rows_of("k")})
    path.write_bytes(path.read_bytes()[:cut])
    assert find_parts(tmp_path) == {}


def test_a_sweep_removes_what_killed_runs_left_and_what_is_stale(tmp_path):
    kept, stale = (write_part(tmp_path, {key: rows_of(key)}) for key in "ab")
    (kept.parent / f".{kept.name}.kalscope-0123456789abcdef.tmp").write_bytes(b"torn")
    (tmp_path / ".fleet.parquet.kalscope-0123456789abcdef.tmp").write_bytes(b"torn")
    sweep(tmp_path)
    assert {path for path in tmp_path.rglob("*") if path.is_file()} == {kept, stale}
    sweep(tmp_path, {kept})
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == [kept]


HOLD = """
import sys, pathlib
from kalscope.fleet.store import locked
with locked(pathlib.Path(sys.argv[1])):
    print("held", flush=True)
    sys.stdin.read()
"""


def test_a_folder_has_one_run_and_a_dead_one_holds_nothing(tmp_path):
    with subprocess.Popen(
        [sys.executable, "-c", HOLD, tmp_path], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as other:
        assert other.stdout.readline() == "held\n"
        with (
            pytest.raises(BadSetting, match="no other run writes") as refused,
            locked(tmp_path),
        ):
            pass
        assert "\n" not in str(refused.value)
        other.kill()
        other.wait()
    with locked(tmp_path):
        pass


def test_a_file_is_no_folder_of_results(tmp_path):
    Path(tmp_path / "x").write_text("")
    with pytest.raises(BadSetting, match="must go to a folder"), locked(tmp_path / "x"):
        pass


def test_a_name_that_is_no_utf_8_does_not_end_a_run(tmp_path):
    write_part(tmp_path, {"k": ([Row("a", source="/logs/\udcff.csv")], Pool.empty())})
    assert merged(tmp_path, [["k"]])[0][0].source == "/logs/\\udcff.csv"


def test_files_of_the_user_are_not_swept_away(tmp_path):
    own = [tmp_path / ".draft.tmp", tmp_path / "parts" / "v1" / "wing.parquet", tmp_path / "parts" / "v1" / "a.tmp"]
    own[1].parent.mkdir(parents=True)
    for path in own:
        path.write_text("mine")
    sweep(tmp_path, ())
    assert all(path.exists() for path in own)
