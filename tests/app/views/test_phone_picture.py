"""The picture behind a phone's sheet: the right size, the signal where it can be seen, both themes."""

from __future__ import annotations

import threading
from types import SimpleNamespace
from unittest.mock import MagicMock

import numpy as np
import pytest

from kalscope import Recording
from kalscope_app.engine.filter_runs import choose_samples
from kalscope_app.engine.frame import compute_frame
from kalscope_app.session.opening import opened
from kalscope_app.views.phone import VISIBLE, WIDTH, PhonePictures, draw_picture


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
    assert curve[:, 1].min() < 0.15 * WIDTH
    assert curve[:, 1].max() > 0.94 * WIDTH


@pytest.mark.parametrize("values", [[1.0], [5.0] * 9, [np.nan, 1.0, np.nan, 2.0], [1e-9, 3e-9], [1e200, -1e200]])
def test_every_recording_can_be_pictured(values):
    assert draw_picture(frame_of(values), shape=0.5).shape == (1560, WIDTH, 3)


class Checkbox:
    """The hidden one of a browser; while it is read something else may happen."""

    def __init__(self, phones):
        self.reports, self._phones = False, phones

    @property
    def value(self):
        now = self.reports
        self._phones.during_report()
        return now

    def on_update(self, call):
        self._phones.reported = call


class Phones:
    """`PhonePictures` with one browser; what overtakes runs in another thread, as in viser's pool."""

    def __init__(self, monkeypatch):
        self.browsers, self.others = {}, []
        self.during_report = lambda: None
        server = SimpleNamespace(get_clients=lambda: self.browsers)
        self.pictures = PhonePictures(server)
        self.checkbox = Checkbox(self)
        self.client = MagicMock(client_id=1)
        self.client.camera.image_width, self.client.camera.image_height = 390, 844
        self.client.gui.add_checkbox.return_value = self.checkbox
        self.browsers[1] = self.client
        monkeypatch.setattr("kalscope_app.views.phone.draw_picture", self.draw)
        self.pictures.attach(self.client)
        self.pictures.show(frame_of([1.0, 2.0]))

    def draw(self, _frame, _shape):
        return "picture"

    def report(self, is_phone):
        self.checkbox.reports = is_phone
        self.reported(None)

    def overtake(self, act):
        """Do this in another thread, which may have to wait for what runs."""
        self.during_report = lambda: None
        self.others.append(threading.Thread(target=act))
        self.others[-1].start()
        self.others[-1].join(0.3)

    def settle(self):
        for other in self.others:
            other.join()

    @property
    def background(self):
        return self.client.scene.set_background_image.call_args.args[0]

    def is_forgotten(self):
        return not self.pictures._shapes


@pytest.fixture
def phones(monkeypatch):
    return Phones(monkeypatch)


def test_a_phone_gets_the_picture_of_every_frame_and_a_wide_window_none(phones):
    scene = phones.client.scene
    assert phones.is_forgotten()
    phones.report(True)
    assert (list(phones.pictures._shapes), phones.background) == ([phones.client], "picture")
    phones.report(False)
    assert phones.is_forgotten()
    drawn = scene.set_background_image.call_count
    phones.pictures.show(frame_of([1.0, 2.0]))
    assert scene.set_background_image.call_count == drawn == 1


@pytest.mark.slow
def test_a_report_that_is_overtaken_by_a_later_one_has_no_effect(phones):
    phones.during_report = lambda: phones.overtake(lambda: phones.report(False))
    phones.report(True)
    phones.settle()
    assert phones.is_forgotten()


@pytest.mark.slow
def test_a_browser_that_disconnects_during_its_report_is_forgotten(phones):
    def disconnect():
        phones.browsers.clear()
        phones.pictures.detach(phones.client)

    phones.during_report = lambda: phones.overtake(disconnect)
    phones.report(True)
    phones.settle()
    assert phones.is_forgotten()
    phones.report(True)
    assert phones.is_forgotten()
