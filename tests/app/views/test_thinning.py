"""Fewer points while a control moves: some of those at rest, and neither axis moves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from kalscope import Recording
from kalscope_app.engine.filter_runs import Cache
from kalscope_app.engine.frame import compute_frame
from kalscope_app.session.opening import opened
from kalscope_app.views.charts import MAX_MOVING_POINTS, places_to_keep


def frame_of(n, *, truth=False, missing=0.0):
    rng = np.random.default_rng(n)
    signal = np.cumsum(rng.normal(0, 0.1, n))
    z = signal + rng.normal(size=n)
    z[rng.random(n) < missing] = np.nan
    clean = signal[:, None] if truth else None
    return compute_frame(opened(Recording(np.arange(n) * 0.01, ("z",), ("V",), z[:, None], 0.01, truth=clean)))


@pytest.mark.parametrize("n", [2100, 4000, 4001, 50_000, 300_000])
@pytest.mark.parametrize("truth", [False, True])
def test_the_ends_and_the_extremes_stay(n, truth):
    frame = frame_of(n, truth=truth)
    places = places_to_keep(frame, Cache())
    assert len(places) <= MAX_MOVING_POINTS < len(frame.drawn.indices)
    assert (np.diff(places) > 0).all()
    assert (places[0], places[-1]) == (0, len(frame.drawn.indices) - 1)
    raw, (low, high) = frame.drawn.raw, frame.drawn.band
    assert (raw[places].min(), raw[places].max()) == (raw.min(), raw.max())
    assert (low[places].min(), high[places].max()) == (low.min(), high.max())


@pytest.mark.parametrize(("n", "missing"), [(2, 0.0), (2000, 0.0), (50_000, 0.01)])
def test_samples_that_can_be_seen_one_by_one_all_stay(n, missing):
    frame = frame_of(n, missing=missing)
    assert places_to_keep(frame, Cache()) is None
    assert places_to_keep(replace(frame_of(5000), set_aside=frame.filtered), Cache()) is None  # so do rings


def test_the_points_are_chosen_once_for_a_view():
    frame, kept = frame_of(5000), Cache()
    places = places_to_keep(frame, kept)
    assert places_to_keep(replace(frame, filtered=2.0 * frame.filtered), kept) is places
    assert places_to_keep(frame_of(6000), kept) is not places
