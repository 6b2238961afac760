"""The Frame holds what the filter gives on the full data; the drawn points depend on the signal alone."""

from __future__ import annotations

import numpy as np
import pytest

from kalscope import FilterParams, Recording, diagnose, kalman_filter, steady_state
from kalscope_app.engine.filter_runs import MAX_POINTS, choose_samples
from kalscope_app.engine.frame import compute_frame, samples_to_settle
from kalscope_app.session.changes import set_text
from kalscope_app.session.opening import opened


def recording(n=20_000, missing=0.0, truth=False, period=0.01):
    g = np.random.default_rng(1)
    signal = np.cumsum(g.normal(0, 0.1, n))
    z = signal + g.normal(size=n)
    z[g.random(n) < missing] = np.nan
    return Recording(
        np.arange(n) * (period or 1.0),
        ("z",),
        ("V",),
        z[:, None],
        period,
        truth=signal[:, None] if truth else None,
    )


def frame_of(state):
    return compute_frame(state, 0, choose_samples(state.recording, state.channel, state.view.window))


@pytest.mark.parametrize("n", [1, 2, 5, 300, MAX_POINTS, MAX_POINTS + 1, 50_000])
@pytest.mark.parametrize("truth", [False, True])
def test_never_more_than_the_limit_is_drawn_and_all_of_a_short_record(n, truth):
    shown = choose_samples(recording(n, truth=truth), "z", None)
    assert len(shown.indices) <= MAX_POINTS
    assert (np.diff(shown.indices) > 0).all()
    assert shown.decimated == (len(shown.indices) < n)
    assert n > MAX_POINTS or len(shown.indices) == n


def test_what_is_drawn_is_the_filter_on_all_samples():
    state = opened(recording(missing=0.01))
    result = kalman_filter(state.recording.channel("z"), state.params)
    frame = frame_of(state)
    at = frame.drawn.indices
    assert frame.drawn.decimated
    assert np.array_equal(frame.filtered, result.x[at])
    assert np.array_equal(frame.spread, 2 * np.sqrt(result.p[at]))
    assert np.array_equal(frame.innovation, result.innovation[at], equal_nan=True)
    assert np.array_equal(frame.innovation_spread, 2 * np.sqrt(result.s[at]))
    assert np.array_equal(frame.gain, result.k[frame.gain_samples.astype(int)])
    assert frame.drawn.missing == np.isnan(state.recording.values).sum()


@pytest.mark.slow
def test_a_parameter_changes_y_only():
    state = opened(recording())
    before, after = frame_of(state), frame_of(set_text("q", "100")(state))
    assert np.array_equal(before.drawn.time, after.drawn.time)
    assert np.array_equal(before.drawn.raw, after.drawn.raw)
    assert not np.array_equal(before.filtered, after.filtered)


def test_time_that_steps_back_is_drawn_without_stepping_back():
    rec = recording(100)
    time = rec.time.copy()
    time[50:] -= 0.2
    shown = choose_samples(Recording(time, rec.names, rec.units, rec.values, 0.01), "z", None)
    assert (np.diff(shown.time) >= 0).all()


@pytest.mark.parametrize("q", [1e-4, 1e-2, 1.0, 100.0])
def test_the_start_up_ends_where_the_gain_is_within_one_percent(q):
    result = kalman_filter(np.zeros(5000), FilterParams(q, 1.0))
    settled = float(steady_state(FilterParams(q, 1.0)).gain)
    at = samples_to_settle(lambda size: result.k[:size], len(result.k), settled)
    assert abs(result.k[at] / settled - 1) <= 0.01
    assert at == 0 or abs(result.k[at - 1] / settled - 1) > 0.01


def test_a_dense_line_is_a_band_that_holds_every_sample_about_it():
    rng = np.random.default_rng(5)
    for n in (2001, 3999, 50_000):
        z = rng.normal(size=n)
        rec = Recording(np.arange(n) * 0.01, ("z",), ("V",), z[:, None], 0.01)
        shown = choose_samples(rec, "z", None)
        low, high = shown.band
        assert (low <= shown.raw).all()
        assert (shown.raw <= high).all()
        assert (low.min(), high.max()) == (z.min(), z.max())
        for place in rng.integers(0, len(shown.indices) - 1, 50):  # every sample, drawn or not, lies in the band
            first, last = shown.indices[place], shown.indices[place + 1]
            between = z[first:last]
            assert low[place] <= between.min() <= between.max() <= high[place]


def test_the_chart_marks_the_samples_that_the_gate_rejected_as_often_as_all_count_them():
    one = recording(n=900)
    one.values[[100, 400, 401], 0] += 40.0
    state = opened(one).with_tuning(gate=16.0)
    frame = frame_of(state)
    result = kalman_filter(one.channel("z"), state.params)
    assert frame.refused is not None
    assert int(np.isfinite(frame.refused).sum()) == frame.rejected == result.rejected >= 3
    assert frame.rejected == diagnose(result).evidence.refused
    assert set(np.flatnonzero(np.isfinite(frame.refused))) >= {100, 400, 401}
    assert frame_of(state.with_tuning(gate=None)).refused is None
