"""The intervals of q, r and τ on simulated truth, and walks without momentum; benchmarks/ has the full runs."""

from __future__ import annotations

import runpy
from pathlib import Path

import pytest
from tests.support.effort import FUZZ

FOLDER = Path(__file__).parents[2] / "benchmarks"
RUNS = 20 * FUZZ
UNLIKELY = 1e-3
"""Chance at which a count outside the promised shares is taken for a fault and not for luck."""

pytestmark = pytest.mark.slow


def binom():
    """Imported where it is used, because every worker collects this file."""
    from scipy.stats import binom

    return binom


@pytest.fixture(scope="module")
def benchmark():
    return runpy.run_path(str(FOLDER / "momentum_coverage.py"))


@pytest.mark.parametrize("n", [300, 1500])
def test_the_intervals_cover_the_truth(benchmark, n):
    """Over all τ together: 60 runs can tell 95 % from 67 %, a single τ hardly; 98 % only `make soak` can."""
    rows = [benchmark["coverage"](truth, n, RUNS) for truth in benchmark["TRUTHS"]]
    count = RUNS * len(rows)
    for name in ("q", "r", "tau"):
        covered = round(sum(RUNS * getattr(row, name) for row in rows))
        assert binom().cdf(covered, count, 0.92) > UNLIKELY, (name, covered, count)
        assert binom().sf(covered - 1, count, 0.98) > UNLIKELY, (name, covered, count)


def test_the_intervals_cover_the_truth_where_the_choice_is_uncertain(benchmark):
    chosen, *shares = benchmark["uncertain_choice"](RUNS)
    assert 0.0 < chosen < 1.0
    for share in shares:
        assert binom().cdf(round(RUNS * share), RUNS, 0.92) > UNLIKELY


def test_random_walks_get_no_momentum(benchmark):
    found = round(RUNS * benchmark["false_momentum"](RUNS))
    assert binom().sf(found - 1, RUNS, 0.02) > UNLIKELY
