"""The picture behind a phone's sheet: the right size, the signal where it can be seen, both themes."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import ImageFont

from kalscope import Recording
from kalscope.common.text import number
from kalscope_app.engine.decimation import choose_samples
from kalscope_app.engine.frame import compute_frame
from kalscope_app.session.opening import opened
from kalscope_app.views.charts.pen import printable
from kalscope_app.views.charts.phone_picture import VISIBLE, WIDTH, draw_picture


def frame_of(values, dark=False):
    n = len(values)
    recording = Recording(np.arange(float(n)), ("<b>z",), ("V",), np.array(values, dtype=float)[:, None], 1.0)
    state = opened(recording).with_view(dark=dark)
    return compute_frame(state, 0, choose_samples(recording, "<b>z", None))


def pixels(picture, colour):
    wanted = [int(colour[i : i + 2], 16) for i in (1, 3, 5)]
    return np.argwhere((picture == wanted).all(axis=2))


@pytest.mark.parametrize(("dark", "colour"), [(False, "#D55E00"), (True, "#ff8a3d")])
def test_the_filtered_curve_runs_through_the_visible_part(dark, colour):
    picture = draw_picture(frame_of(np.sin(np.arange(300) / 20), dark), shape=390 / 844)
    assert picture.shape == (round(WIDTH * 844 / 390), WIDTH, 3)
    curve = pixels(picture, colour)
    assert curve[:, 0].max() < VISIBLE * picture.shape[0]
    assert curve[:, 1].min() < 0.06 * WIDTH
    assert curve[:, 1].max() > 0.94 * WIDTH


@pytest.mark.parametrize("values", [[1.0], [5.0] * 9, [np.nan, 1.0, np.nan, 2.0], [1e-9, 3e-9], [1e200, -1e200]])
def test_every_recording_can_be_pictured(values):
    assert draw_picture(frame_of(values), shape=0.5).shape == (1560, WIDTH, 3)


@pytest.mark.parametrize("value", [-3.5, float("inf"), float("-inf"), -2e12, 15098.5, 1e-9])
def test_numbers_are_written_in_letters_that_the_font_has(value):
    font = ImageFont.load_default(size=24)
    no_such_letter = bytes(font.getmask("\U0010ffff"))
    for letter in printable(number(value)).replace(" ", ""):
        assert bytes(font.getmask(letter)) != no_such_letter
