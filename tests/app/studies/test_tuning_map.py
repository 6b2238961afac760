"""The tuning map of a state: where its best cell lies, what it is computed from, what it costs to move a slider."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from kalscope import FilterParams, Recording, estimate, steady_state
from kalscope.estimation.likelihood import log_likelihood
from kalscope_app.engine.filter_runs import Cache
from kalscope_app.session.changes import set_point, set_slider, set_text, set_window
from kalscope_app.session.opening import opened
from kalscope_app.studies.tuning_map import TUNING_MAP_CELLS, MapFrame, cell_exponents, compute_map, lag_lines


def walk(n=5000, q=0.02, r=1.0, seed=0, scale=1.0, period=0.01):
    g = np.random.default_rng(seed)
    z = scale * (np.cumsum(np.sqrt(q) * g.normal(size=n)) + np.sqrt(r) * g.normal(size=n))
    return Recording(np.arange(n) * period, ("a",), ("V",), z[:, None], period)


@pytest.mark.slow
def test_moving_q_r_or_the_window_gives_the_same_map_without_work_and_a_point_outside_a_wider_one():
    make, state = partial(compute_map, kept=Cache()), opened(walk())
    shown = make(state)
    for change in (set_slider("q", -1.0), set_slider("r", 0.5), set_window(1.0, 5.0), set_point(-2.0, 0.2)):
        state = change(state)
        assert make(state) is shown
    assert make(state.with_view(dark=True)) is shown
    state = opened(walk())
    low, high = make(state).frame.q
    assert make(set_point(float(low), 0.0)(state)).frame.q == (low, high)
    assert make(set_point(float(high), 0.0)(state)).frame.q == (low, high)
    assert make(set_point(low - 0.5, 0.0)(state)).frame.q == (low - 1, high)
    gated = make(set_text("p0", "1")(state.with_tuning(gate=9.0)))
    assert re.fullmatch(r"Drawn without .*initial variance p0 and outlier gate\.", gated.note)


@pytest.mark.slow
def test_the_map_of_a_record_with_spikes_is_that_of_the_fit_without_them():
    state = opened(walk(3000, 0.05))
    values = state.recording.values.copy()
    values[100::100] += 50.0
    shown = compute_map(opened(replace(state.recording, values=values)), Cache())
    best = estimate(values[:, 0])
    assert best.outliers.sum() == 29
    at = np.unravel_index(np.argmax(shown.shade), shown.shade.shape)
    cell = (shown.frame.r[1] - shown.frame.r[0]) / TUNING_MAP_CELLS
    assert cell_exponents(shown.frame.r)[at[0]] == pytest.approx(math.log10(best.r), abs=cell)
    assert "Spikes (29) count as missing." in shown.note


def test_a_point_becomes_q_and_r_at_three_digits_within_what_a_filter_takes():
    for asked, q, r in ((-2.123456, 1.0), 0.00753, 10.0), ((-999.0, 999.0), 1e-300, 7.94e299):
        state = set_point(*asked)(opened(walk()))
        assert (state.tuning.q, state.tuning.r, state.tuning.how) == (q, r, "by hand")


@pytest.mark.slow
@pytest.mark.parametrize(("momentum", "scale"), [(0.0, 1.0), (7.0, 1.0), (300.0, 1.0), (0.0, 1e-9), (0.0, 1e9)])
def test_each_cell_is_the_likelihood_of_its_pair_at_the_present_momentum(momentum, scale):
    state = set_text("momentum", str(momentum))(opened(walk(3000, 0.05, scale=scale)))
    found, shown = estimate(state.z, momentum=momentum), compute_map(state, Cache())
    assert shown.optimum == pytest.approx((math.log10(found.q), math.log10(found.r)))
    for row, column in np.random.default_rng(1).integers(0, TUNING_MAP_CELLS, (12, 2)):
        q, r = 10 ** cell_exponents(shown.frame.q)[column], 10 ** cell_exponents(shown.frame.r)[row]
        expected = log_likelihood(state.z, FilterParams(q=q, r=r, momentum=momentum))
        assert shown.values[row, column] == pytest.approx(expected, rel=5e-3, abs=0.1)


@pytest.mark.parametrize("momentum", [0.0, 2.0, 100.0, 1e4])
def test_the_corners_are_the_ends_of_the_ranges_and_the_filter_where_a_line_leaves_the_map_has_its_lag(momentum):
    frame = MapFrame((-6, 2), (-4, 2), momentum)
    assert frame.pixel((-6, -4)) == pytest.approx((frame.left, frame.bottom))  # r goes up
    assert frame.pixel((2, 2)) == pytest.approx((frame.right, frame.top))
    assert frame.point(frame.pixel((-1.5, 0.3))) == pytest.approx((-1.5, 0.3))
    lines = lag_lines(frame, 10.0)  # ms, at 100 Hz
    written = sorted(float(f"{10.0 * lag:.3g}") for lag, _ in lines)
    assert set(written) <= {10, 30, 100, 300, 1e3, 3e3, 1e4, 3e4, 1e5}
    assert momentum or len(written) == 8
    assert len(written) == len(set(written)) > 4
    for lag, (q, r) in lines:
        assert q == pytest.approx(frame.q[1]) or r == pytest.approx(frame.r[1])
        steady = steady_state(FilterParams(q=10.0 ** (q - r), r=1.0, momentum=momentum))
        assert float(steady.lag_samples) == pytest.approx(lag, rel=1e-6)
