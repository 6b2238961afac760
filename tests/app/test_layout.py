"""Sizes that fill a window, and how the window's size is found from viser's canvas reports."""

from __future__ import annotations

import pytest

from kalscope_app.views.layout import CANVAS_WIDTH, FIRST_RIGHT_WIDTH, LEFT_WIDTH, WindowFinder, sizes_for

DOCKED = float(LEFT_WIDTH + FIRST_RIGHT_WIDTH)
"""Width of both panels at first, px."""


def canvas(window_width, docked=DOCKED):
    return max(CANVAS_WIDTH, window_width - docked)


@pytest.mark.parametrize(("width", "height"), [(1920, 1080), (1600, 900), (1280, 720), (1024, 768)])
def test_panels_and_canvas_fill_the_window(width, height):
    sizes = sizes_for(width, height)
    assert LEFT_WIDTH + CANVAS_WIDTH + sizes.right_width == width
    assert sizes.signal_height > sizes.innovation_height > sizes.gain_height >= 90
    assert sizes.signal_height + sizes.innovation_height + sizes.gain_height < height


def test_a_tiny_window_keeps_usable_sizes():
    sizes = sizes_for(300, 200)
    assert (sizes.right_width, sizes.signal_height) == (300, pytest.approx(232, abs=60))


@pytest.mark.parametrize("pixel_ratio", [0.75, 1.0, 1.5, 2.0, 3.0])
@pytest.mark.parametrize(("width", "height"), [(1920, 1080), (1600, 900), (1280, 720), (1100, 700)])
def test_the_window_is_found_at_every_pixel_ratio(width, height, pixel_ratio):
    finder = WindowFinder()
    assert finder.report(width * pixel_ratio, height * pixel_ratio, DOCKED) is None
    assert finder.report(width * pixel_ratio, height * pixel_ratio, DOCKED) is None
    found = finder.report(canvas(width) * pixel_ratio, height * pixel_ratio, DOCKED)
    assert found == pytest.approx((width, height), rel=0.01)


@pytest.fixture
def found():
    finder = WindowFinder()
    finder.report(1600, 900, DOCKED)
    finder.report(canvas(1600), 900, DOCKED)
    return finder


def test_a_dragged_divider_is_left_alone(found):
    assert found.report(300, 900, DOCKED) is None


def test_a_changed_pixel_ratio_is_no_new_window(found):
    assert found.report(canvas(1600) * 0.8, 900 * 0.8, DOCKED) is None


def test_a_resized_window_is_news(found):
    assert found.report(canvas(1920), 1080, DOCKED) == pytest.approx((1920, 1080), rel=0.01)


def test_reports_without_size_are_ignored(found):
    assert found.report(0, 0, DOCKED) is None
    assert WindowFinder().report(0, 900, DOCKED) is None


@pytest.mark.parametrize("width", [1100, 1280, 1600])
def test_panels_that_may_be_too_wide_ask_for_room_and_are_measured_again(width):
    finder, wide = WindowFinder(), 1480.0
    finder.report(width, 800, wide)
    assert finder.report(canvas(width, wide), 800, wide) is None
    assert finder.needs_room
    assert finder.report(canvas(width), 800, DOCKED) == pytest.approx((width, 800), rel=0.01)
    assert not finder.needs_room
