"""`kalscope bench`: it runs, both sides do the same work, and what is missing is said. Nothing here is timed."""

from __future__ import annotations

import json
import math
import sys
from importlib.util import find_spec

import numpy as np
import pytest
from program import command
from waiting import PATIENCE

from kalscope.cli.app import run
from kalscope.cli.bench import contest as bench
from kalscope.cli.bench import peers as bench_peers
from kalscope.cli.bench.command import line_of
from kalscope.cli.bench.contest import Contest, Row, Work, measure, take_turns
from kalscope.cli.bench.own import five_lines, five_lines_in_python
from kalscope.filtering.filter import kalman_filter
from kalscope.filtering.params import FilterParams

SAME_WORK = 1e-9
PEERS = ("filterpy", "pykalman", "simdkalman", "statsmodels")
OURS = ("denoise", "kalman_filter", "KalmanFilter", "estimate", "np.", "z.copy", "five lines")


SHORT = """
from kalscope.cli.bench import command, contest
command.QUICK = command.Sizes(samples=10_000, repetitions=1, slowness=100.0)
contest.MIN_TURN_S = 0.0
"""
"""Each side takes one turn, however short: nothing here is timed."""


@pytest.fixture(scope="module")
def rows():
    """One run of the program in a process of its own: the peers' warnings are not ours."""
    with command("bench", "--quick", "--samples", "20_000", "--json", change=SHORT) as program:
        out, err = program.communicate(timeout=PATIENCE)
    assert (program.returncode, err) == (0, "")
    return [Row(**row) for row in json.loads(out)]


def test_every_row_has_its_fields(rows):
    for row in rows:
        assert row.name
        assert row.against.startswith(OURS)
        if row.note == "not installed":
            assert (row.microseconds_per_sample, row.ratio, row.difference) == (None, None, None)
        else:
            assert row.n >= 500
            assert row.microseconds_per_sample > 0
            assert row.ratio > 0
            assert math.isfinite(row.ratio)


def test_both_sides_do_the_same_work(rows):
    differences = {row.name: row.difference for row in rows if row.note != "not installed"}
    fit = differences.pop("statsmodels llevel fit", 0.0)  # an optimizer: it stops near the top
    assert abs(fit) < 1e-5
    assert all(0 <= difference <= SAME_WORK for difference in differences.values()), differences


def test_every_peer_has_a_row_installed_or_not(rows):
    told = {row.name.split()[0]: row.note == "not installed" for row in rows}
    assert [told[peer] for peer in PEERS] == [find_spec(peer) is None for peer in PEERS]


@pytest.mark.parametrize("module", ["filterpy.kalman", "no_such_library"])
def test_a_missing_library_is_a_row_that_says_so(monkeypatch, module):
    monkeypatch.setitem(sys.modules, module, None)
    peer = ("filterpy", module, "kalman_filter", bench_peers.filterpy_contests)
    monkeypatch.setattr(bench_peers, "PEERS", (peer,))
    (row,) = bench_peers.peer_contests(lambda _: Work.make(1_000))
    assert row == Row("filterpy", 0, None, None, "kalman_filter", None, "not installed")
    assert line_of(row).split() == ["filterpy", "kalman_filter", "not", "installed"]


def test_the_plain_loops_are_the_filter():
    z = np.random.default_rng(4).normal(size=300)
    x = kalman_filter(z, FilterParams(q=0.3, r=2.0)).x
    np.testing.assert_allclose(five_lines(z, 0.3, 2.0, np.empty_like(z)), x, rtol=0, atol=1e-14)
    np.testing.assert_allclose(five_lines_in_python(z, 0.3, 2.0), x, rtol=0, atol=1e-14)


def test_the_two_sides_take_turns_and_the_order_alternates(monkeypatch):
    seen = []
    monkeypatch.setattr(bench, "_seconds", lambda run: run() or 1.0)
    take_turns(lambda: seen.append("A"), lambda: seen.append("B"), 3)
    assert "".join(seen) == "ABBAAB"


def test_the_ratio_is_the_median_of_the_turns(monkeypatch):
    monkeypatch.setattr(bench, "take_turns", lambda *_: ([2.0, 30.0, 4.0], [1.0, 1.0, 1.0]))
    row = measure(Contest("a", "b", 4, lambda: None, lambda: None, lambda _: 0.5), 3)
    assert (row.ratio, row.microseconds_per_sample, row.difference) == (4.0, 1e6, 0.5)


@pytest.mark.parametrize("text", ["many", "9999", "1e9", "nan", "20000.5"])
def test_a_wrong_number_of_samples_is_one_line(text, capsys):
    assert run(["bench", "--samples", text]) == 2
    said = capsys.readouterr().err
    assert said == f"kalscope: --samples must be a whole number from 10,000 to 50,000,000 (got {text!r})\n"
