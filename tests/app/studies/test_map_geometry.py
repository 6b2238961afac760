"""Pixels and exponents of the tuning map, as laws and truth tables."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from kalscope import FilterParams, steady_state
from kalscope_app.studies.tuning_map import diagonal, frame_for, lag_lines

FRAME = frame_for(452, 900, (-6, 2), (-4, 2))


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


@pytest.mark.parametrize("ratio", [1e-5, 0.01, 1.0, 300.0])
def test_on_a_diagonal_the_ratio_and_so_the_lag_is_the_same(ratio):
    line = diagonal(FRAME, ratio)
    for end in (line.start, line.end):
        q, r = FRAME.point(end)
        assert q - r == pytest.approx(math.log10(ratio))
        assert FRAME.inside((round(end[0], 6), round(end[1], 6)))
    assert line.lag == pytest.approx(float(steady_state(FilterParams(q=ratio, r=1.0)).lag_samples))


def test_lines_of_equal_lag_are_1_and_3_of_every_decade_that_crosses_the_map():
    lags = [line.lag * 10.0 for line in lag_lines(FRAME, 10.0)]  # ms, at 100 Hz
    assert lags == pytest.approx([10, 30, 100, 300, 1e3, 3e3, 1e4, 3e4], rel=1e-9)


@pytest.mark.parametrize("momentum", [2.0, 100.0, 1e4])
def test_with_momentum_the_lines_have_the_lag_that_is_written_beside_them(momentum):
    frame = replace(FRAME, momentum=momentum)
    lines = lag_lines(frame, 10.0)
    written = sorted(float(f"{10.0 * line.lag:.3g}") for line in lines)
    assert set(written) <= {10, 30, 100, 300, 1e3, 3e3, 1e4, 3e4, 1e5}
    assert len(written) == len(set(written)) > 4
    for line in lines:
        q, r = frame.point(line.end)
        steady = steady_state(FilterParams(q=10.0 ** (q - r), r=1.0, momentum=momentum))
        assert float(steady.lag_samples) == pytest.approx(line.lag, rel=1e-6)
