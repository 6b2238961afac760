"""Files of the user in the folder of a fleet are never written over."""

from __future__ import annotations

import sqlite3
from contextlib import closing

import pytest
from tests.fleet.fleet_runs import PLAIN, files_of, run_here, write_devices

from kalscope.fleet.store import STORE, TUNING, Store
from kalscope.tuning.file import load_tuning, save_tuning
from kalscope.tuning.tuning import ChannelTuning, Tuning

OWN = Tuning((ChannelTuning("mine", "", 1.0, 2.0),), source_name="fleet of 2")


@pytest.fixture
def fleet(tmp_path, at_once, capsys):
    """Two devices, and the folder of their results."""
    write_devices(tmp_path / "logs", 2)
    return tmp_path / "logs", tmp_path / "out"


@pytest.mark.parametrize("name", ["units.sqlite", "fleet.json", "fleet.parquet", "tuning.toml"])
def test_a_folder_with_a_file_of_that_name_is_refused_before_the_run(fleet, capsys, name):
    logs, out = fleet
    out.mkdir()
    (out / name).write_text("mine")
    refused = run_here(capsys, logs, "-o", out, *PLAIN, expect=2)
    assert refused.err.startswith("kalscope: -o must name a ")
    assert name in refused.err
    assert (out / name).read_text() == "mine"
    assert files_of(out) == {name}


@pytest.mark.slow
def test_a_tuning_of_the_user_is_kept_and_named(fleet, capsys):
    logs, out = fleet
    run_here(capsys, logs, "-o", out, *PLAIN)
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


@pytest.mark.slow
def test_the_own_tuning_is_known_whatever_died(fleet, capsys):
    logs, out = fleet
    run_here(capsys, logs, "-o", out, *PLAIN)
    first = (out / TUNING).read_text()
    run_here(capsys, logs, "-o", out, "--lag-ms", "50")
    (out / TUNING).write_text(first)  # as a kill before the last file leaves it
    run_here(capsys, logs, "-o", out, "--lag-ms", "50")
    assert "lag of 50 ms" in load_tuning(out / TUNING).channels[0].how


def test_a_tuning_that_the_user_saves_during_the_run_is_kept(fleet, capsys, monkeypatch):
    logs, out = fleet
    run_here(capsys, logs, "-o", out, *PLAIN)
    settled = Store.settled
    monkeypatch.setattr(Store, "settled", lambda store: save_tuning(OWN, out / TUNING) or settled(store))
    assert "of your own" in run_here(capsys, logs, "-o", out, *PLAIN, expect=2).err
    assert load_tuning(out / TUNING).channels == OWN.channels


def test_a_database_of_another_program_is_kept(fleet, capsys):
    logs, out = fleet
    out.mkdir()
    with closing(sqlite3.connect(out / STORE)) as other, other:
        other.execute("CREATE TABLE mine (x)")
    before = (out / STORE).read_bytes()
    assert f"whose {STORE} no fleet wrote" in run_here(capsys, logs, "-o", out, *PLAIN, expect=2).err
    assert (out / STORE).read_bytes() == before
