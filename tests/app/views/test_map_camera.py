"""The camera before the tuning map: what arrives in several threads leaves it at the newest canvas."""

from __future__ import annotations

import threading
from contextlib import nullcontext
from types import SimpleNamespace
from unittest.mock import MagicMock

from kalscope_app.studies.map_geometry import field_of_view
from kalscope_app.views.map.view import TuningMapView


class Client:
    """A browser whose canvas gets another shape in another thread while its first one is being read."""

    def __init__(self, view):
        self.camera, self.view, self.other, self.width = self, view, None, 400
        self.image_height = 800

    def atomic(self):
        return nullcontext()

    @property
    def image_width(self):
        width = self.width
        if self.other is None:
            self.width = 1200
            self.other = threading.Thread(target=self.view._look_straight, args=(self,))
            self.other.start()
            self.other.join(0.3)
        return width


def test_the_camera_fits_the_newest_canvas_and_what_is_noted_of_it():
    view = TuningMapView(MagicMock(), SimpleNamespace())
    client = Client(view)
    view._look_straight(client)
    client.other.join()
    assert client.fov == field_of_view(view._frame, 1.5)
    assert view._aimed[client] == 1.5
