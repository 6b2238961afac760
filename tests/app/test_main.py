"""Starting and stopping the program: every refusal is one line and status 2; the port is free afterwards."""

from __future__ import annotations

import socket

import pytest
from tests.app.wire import PATIENCE
from tests.support.program import end, link_of, start
from tests.support.required import needs

from kalscope.cli.app import run
from kalscope_app.main import add_dashboard

add_dashboard()


def test_nothing_is_said_at_the_end_after_a_library_counts_what_it_leaves(tmp_path):
    """DuckDB prints a list of its own objects that are left when Python ends; a forked program does not end so."""
    needs("duckdb")
    import duckdb

    file = tmp_path / "log.parquet"
    duckdb.execute(f"COPY (SELECT i * 0.1 AS t, sin(i) AS x FROM range(25) r(i)) TO '{file}' (FORMAT parquet)")
    with start(tmp_path, "tune", "log.parquet", source=None, fresh=True) as program:
        out, err = program.communicate(timeout=PATIENCE)
    assert (program.returncode, err) == (0, "")
    assert out.startswith("log.parquet: 25 rows, 1 channel")


REFUSED = [
    *(("open nowhere.csv", "nowhere.csv"), ("open sample:nothing", "nothing"), ("opne", "opne")),
    *(("open --config not.toml", "not.toml"), ("open serial:/dev/ttyACM0@fast", "baud rate must")),
    *(("open demo --port 99999", "port must"), ("open demo --host 0.0.0.0 --no-browser", "--allow-host")),
    ("open demo --host no.such.host.invalid", "cannot be used on this machine"),
    *(("open demo --no-such-option", "--no-such-option"), ("open demo --channel w", "channel must be one of")),
    *(("open demo --q much", "q must be a number"), ("open demo --x0 3", "x0 needs p0")),
]


@pytest.mark.slow
def test_what_cannot_be_opened_is_refused_in_one_line(tmp_path, monkeypatch, capsys):
    (tmp_path / "not.toml").write_text("q = [")
    monkeypatch.chdir(tmp_path)
    for line, message in REFUSED:
        assert run(line.split()) == 2
        out, err = capsys.readouterr()
        assert (out, err.startswith("kalscope: "), err.count("\n")) == ("", True, 1)
        assert message in err


def test_without_a_command_the_demo_opens(tmp_path):
    with socket.socket() as probe:
        if probe.connect_ex(("127.0.0.1", 8080)) == 0:
            pytest.skip("another program listens on port 8080")
    with start(tmp_path, source=None, env={"BROWSER": "true"}) as program:
        assert link_of(program).startswith("http://127.0.0.1:8080/?token=")
        assert end(program)[0] == 0
