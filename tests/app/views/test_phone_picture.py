"""The picture behind a phone's sheet: the right size, the signal where it can be seen, both themes."""

from __future__ import annotations

from types import SimpleNamespace
from unittest.mock import MagicMock

import numpy as np
import pytest

from kalscope import Recording
from kalscope_app.engine.frame import compute_frame
from kalscope_app.session.opening import opened
from kalscope_app.views.phone import VISIBLE, WIDTH, PhonePictures, draw_picture


def frame_of(values, dark=False):
    n = len(values)
    recording = Recording(np.arange(float(n)), ("<b>z",), ("V",), np.array(values, dtype=float)[:, None], 1.0)
    return compute_frame(opened(recording).with_view(dark=dark))


def pixels(picture, colour):
    wanted = [int(colour[i : i + 2], 16) for i in (1, 3, 5)]
    return np.argwhere((picture == wanted).all(axis=2))


@pytest.mark.parametrize(("dark", "colour"), [(False, "#D55E00"), (True, "#ff8a3d")])
def test_the_filtered_curve_runs_through_the_visible_part(dark, colour):
    picture = draw_picture(frame_of(np.sin(np.arange(300) / 20), dark), shape=390 / 844)
    assert picture.shape == (round(WIDTH * 844 / 390), WIDTH, 3)
    curve = pixels(picture, colour)
    assert curve[:, 0].max() < VISIBLE * picture.shape[0]
    assert curve[:, 1].min() < 0.15 * WIDTH
    assert curve[:, 1].max() > 0.94 * WIDTH


@pytest.mark.parametrize("values", [[1.0], [5.0] * 9, [np.nan, 1.0, np.nan, 2.0], [1e-9, 3e-9], [1e200, -1e200]])
def test_every_recording_can_be_pictured(values):
    assert draw_picture(frame_of(values), shape=0.5).shape == (1560, WIDTH, 3)


@pytest.fixture
def phones(monkeypatch):
    """`PhonePictures` with one browser, whose hidden checkbox reports what `box.value` is."""
    monkeypatch.setattr("kalscope_app.views.phone.draw_picture", lambda frame, shape: (frame, shape))
    pictures, client, box = PhonePictures(), MagicMock(), SimpleNamespace(value=False)
    client.camera.image_width, client.camera.image_height = 390, 844
    client.gui.add_checkbox.return_value = box
    box.on_update = lambda report: vars(box).update(report=lambda: report(None))
    pictures.attach(client)
    pictures.show("first")
    drawn = client.scene.set_background_image
    return SimpleNamespace(pictures=pictures, client=client, box=box, drawn=drawn)


def test_a_phone_gets_the_picture_of_every_frame_and_a_wide_window_none(phones):
    assert not phones.drawn.called
    phones.box.value = True
    phones.box.report()
    phones.pictures.show("second")
    assert [call.args[0] for call in phones.drawn.call_args_list] == [("first", 390 / 844), ("second", 390 / 844)]
    phones.box.value = False
    phones.box.report()
    phones.pictures.show("third")
    assert phones.drawn.call_count == 2


def test_a_phone_that_is_turned_gets_one_picture_of_the_new_shape(phones):
    phones.box.value = True
    (moved,) = phones.client.camera.on_update.call_args.args
    moved(None)
    moved(None)
    phones.client.camera.image_width, phones.client.camera.image_height = 844, 390
    moved(None)
    assert [call.args[0][1] for call in phones.drawn.call_args_list] == [390 / 844, 844 / 390]


def test_a_browser_that_disconnects_before_its_report_gets_none(phones):
    phones.pictures.detach(phones.client)
    phones.box.value = True
    phones.box.report()
    phones.pictures.show("second")
    assert not phones.drawn.called
