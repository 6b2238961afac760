"""What a long record costs beside its own samples: twice as many samples must not need more than their share."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest

from kalscope import Recording
from kalscope_app.engine.filter_runs import FilterRuns, choose_samples
from kalscope_app.engine.frame import compute_frame
from kalscope_app.session.opening import opened
from kalscope_app.studies.checks import StillStretches, compute_allan, compute_checks, compute_spectra
from kalscope_app.studies.comparisons import AlternativesStudy, Overviews, VariantTable
from kalscope_app.studies.tuning_map import MapMaker

SHORT, LONG = 300_000, 600_000
COLUMN = 8 * (LONG - SHORT)
"""Bytes by which one number per sample differs."""

MAX_COLUMNS = 10
"""Six times the samples' bytes, values and time, less these samples themselves."""

STUDIES = {
    "variants": lambda state: VariantTable().compute(state),
    "map": lambda state: MapMaker().__call__(state),
    "checks": compute_checks,
    "channels": lambda state: Overviews().compute(state),
    "spectra": compute_spectra,
    "Allan": compute_allan,
    "alternatives": lambda state: AlternativesStudy().compute(state),
    "still": lambda state: StillStretches().study(state),
}


def long_record(n, *, spikes=False):
    rng = np.random.default_rng(3)
    z = np.cumsum(rng.normal(size=n)) + rng.normal(size=n)
    if spikes:
        z[rng.integers(0, n, n // 500)] += 60.0
    return Recording(np.arange(n) * 0.01, ("z",), ("",), z[:, None], 0.01)


def cost(compute, *arguments):
    """Bytes at most while it is computed, and bytes that its answer holds."""
    tracemalloc.start()
    try:
        answer = compute(*arguments)
        held, most = tracemalloc.get_traced_memory()
        del answer
        return most, held
    finally:
        tracemalloc.stop()


def growth(compute, make):
    short, long = (cost(compute, make(n)) for n in (SHORT, LONG))
    return tuple((after - before) / COLUMN for before, after in zip(short, long, strict=True))


@pytest.fixture(scope="module", params=[False, True], ids=["plain", "with spikes"])
def states(request):
    made = {n: opened(long_record(n, spikes=request.param)) for n in (1000, SHORT, LONG)}
    for study in STUDIES.values():
        study(made[1000])  # imports and compiled loops are no cost of a record
    return made


@pytest.mark.slow
@pytest.mark.parametrize("name", STUDIES)
def test_a_study_stays_within_six_times_the_samples(name, states):
    most, held = growth(STUDIES[name], states.__getitem__)
    assert most <= MAX_COLUMNS
    assert held <= 0.2 or name == "alternatives"  # it compares 200,000 samples at most


def test_opening_a_record_keeps_no_array():
    opened(long_record(1000))
    most, held = growth(opened, {n: long_record(n) for n in (SHORT, LONG)}.__getitem__)
    assert most <= 5.0
    assert held <= 0.01


@pytest.mark.slow
@pytest.mark.parametrize("momentum", [0.0, 5.0])
@pytest.mark.parametrize("window", [None, (300.0, 900.0)])
def test_a_move_of_a_slider_holds_what_is_drawn_and_no_more(states, momentum, window):
    def mover(n):
        state = states[n].with_view(window=window).with_tuning(momentum=momentum)
        runs = FilterRuns()
        drawn = choose_samples(state.recording, state.channel, window)

        def move(factor):
            moved = state.with_tuning(q=factor * state.tuning.q)
            return compute_frame(moved, 1, drawn, runs)

        move(1.0)
        return move

    most, held = growth(lambda move: move(2.0), mover)
    assert most <= 0.05
    assert held <= 0.01
