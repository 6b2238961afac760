"""Sizes that fill a window, and how the window's size is found from viser's canvas reports."""

from __future__ import annotations

import pytest

from kalscope_app.views.window.fitting import is_upright, resized, same_shape
from kalscope_app.views.window.layout import (
    CANVAS_WIDTH,
    FIRST_RIGHT_WIDTH,
    LEFT_WIDTH,
    PROBE,
    canvas_width_for,
    sizes_for,
    window_size,
)

DOCKED = float(LEFT_WIDTH + FIRST_RIGHT_WIDTH)
"""Width of both panels at first, px."""


def canvas(width, height, docked, pixel_ratio):
    """What viser reports of a window: the canvas that the panels leave, in its own pixels."""
    return (max(CANVAS_WIDTH, width - docked) * pixel_ratio, height * pixel_ratio)


@pytest.mark.parametrize(("width", "height"), [(1920, 1080), (1600, 900), (1280, 720), (1024, 768)])
def test_panels_and_canvas_fill_the_window(width, height):
    sizes = sizes_for(width, height)
    assert LEFT_WIDTH + sizes.canvas_width + sizes.right_width == width
    assert sizes_for(width, height, map_shown=False).right_width == width - LEFT_WIDTH - CANVAS_WIDTH
    assert sizes.signal_height > sizes.innovation_height > sizes.gain_height >= 90
    assert sizes.signal_height + sizes.innovation_height + sizes.gain_height < height


@pytest.mark.parametrize(
    ("width", "shown", "canvas"),
    [
        (1920, True, 520),
        (1600, True, 452),
        (1280, True, 380),
        (1105, True, 380),
        (1104, True, CANVAS_WIDTH),  # the charts would be narrower than the map
        (1920, False, CANVAS_WIDTH),
    ],
)
def test_the_map_has_its_room_as_long_as_the_charts_keep_as_much(width, shown, canvas):
    assert canvas_width_for(width, map_shown=shown) == canvas
    assert canvas == CANVAS_WIDTH or width - LEFT_WIDTH - canvas >= canvas


def test_a_tiny_window_keeps_usable_sizes():
    sizes = sizes_for(300, 200)
    assert (sizes.right_width, sizes.signal_height) == (300, pytest.approx(232, abs=60))


@pytest.mark.parametrize("pixel_ratio", [0.75, 1.0, 1.5, 2.0, 3.0])
@pytest.mark.parametrize("later_ratio", [1.0, 0.8])
@pytest.mark.parametrize(("width", "height"), [(1920, 1080), (1600, 900), (1280, 720), (1100, 700)])
def test_the_window_is_found_at_every_pixel_ratio(width, height, pixel_ratio, later_ratio):
    first = canvas(width, height, DOCKED, pixel_ratio)
    second = canvas(width, height, DOCKED + PROBE, pixel_ratio * later_ratio)
    found = window_size(first, second, docked=DOCKED, more=PROBE)
    assert found == pytest.approx((width, height), rel=0.01)


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ((390, 844), (390, 844)),  # a phone docks nothing
        ((120, 700), (120, 700)),  # a tiny window has nothing left to give
        ((0, 900), (0, 900)),
        ((500, 0), (400, 0)),
        ((1600, 900), (707, 900)),  # not yet docked when first seen
    ],
)
def test_a_canvas_that_does_not_give_way_tells_nothing(first, second):
    assert window_size(first, second, docked=DOCKED, more=PROBE) is None


@pytest.mark.parametrize(
    ("before", "now", "news"),
    [
        ((120, 900), (120, 1080), True),
        ((120, 900), (500, 1080), True),
        ((120, 900), (96, 720), False),  # viser's own scaling
        ((120, 900), (300, 900), False),  # the person drags a divider
        ((120, 900), (120, 900), False),
        ((0, 0), (120, 900), False),
    ],
)
def test_only_a_new_window_size_is_news(before, now, news):
    assert resized(before, now) is news


def test_only_a_canvas_that_is_clearly_higher_than_wide_is_upright():
    assert is_upright((390, 844))
    assert not is_upright((844, 390))
    assert not is_upright((800, 900))
    assert not is_upright((0, 0))


def test_a_late_answer_of_a_slow_page_has_another_shape():
    assert same_shape((390, 844), (195, 422))
    assert not same_shape((515, 720), (395, 720))
    assert not same_shape((0, 0), (0, 0))
