"""Pixels and exponents of the tuning map, as laws and truth tables."""

from __future__ import annotations

from dataclasses import replace

import pytest

from kalscope import FilterParams, steady_state
from kalscope_app.studies.tuning_map import MapFrame, lag_lines

FRAME = MapFrame((-6, 2), (-4, 2))


@pytest.mark.parametrize(
    ("point", "corner"),
    [
        ((-6, -4), ("left", "bottom")),
        ((2, -4), ("right", "bottom")),
        ((-6, 2), ("left", "top")),
        ((2, 2), ("right", "top")),
    ],
)
def test_the_corners_are_the_ends_of_the_ranges_and_r_goes_up(point, corner):
    x, y = FRAME.pixel(point)
    assert (x, y) == pytest.approx((getattr(FRAME, corner[0]), getattr(FRAME, corner[1])))
    assert FRAME.top < FRAME.bottom


@pytest.mark.parametrize(
    ("momentum", "expected"),
    [(0.0, [10, 30, 100, 300, 1e3, 3e3, 1e4, 3e4])] + [(tau, None) for tau in (2.0, 100.0, 1e4)],
)
def test_the_filter_where_a_line_leaves_the_map_has_its_lag(momentum, expected):
    frame = replace(FRAME, momentum=momentum)
    lines = lag_lines(frame, 10.0)  # ms, at 100 Hz
    written = sorted(float(f"{10.0 * lag:.3g}") for lag, _ in lines)
    assert set(written) <= {10, 30, 100, 300, 1e3, 3e3, 1e4, 3e4, 1e5}
    assert expected in (None, written)
    assert len(written) == len(set(written)) > 4
    for lag, (q, r) in lines:
        assert q == pytest.approx(frame.q[1]) or r == pytest.approx(frame.r[1])
        steady = steady_state(FilterParams(q=10.0 ** (q - r), r=1.0, momentum=momentum))
        assert float(steady.lag_samples) == pytest.approx(lag, rel=1e-6)
