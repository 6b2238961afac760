"""Makes panels and charts fill a browser's window: measures it when a browser comes, and when it is resized."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable

import viser

from kalscope_app.views.layout import FIRST_RIGHT_WIDTH, PROBE, Panels, Sizes, sizes_for, window_size

SETTLED = 0.3
"""Seconds for which a canvas must keep its size to count as settled; viser eases its panels for 0.16 s."""

PATIENCE = 3.0
"""Seconds to wait for that at most."""

log = logging.getLogger(__name__)

Pixels = tuple[int, int]


class WindowFitter:
    """Fits the layout to the window that came or changed last. All browsers share one layout."""

    def __init__(
        self,
        panels: Panels,
        set_heights: Callable[[Sizes], None],
        set_portrait: Callable[[viser.ClientHandle, float | None], None],
    ) -> None:
        """Args: the panels; who sets chart heights; who draws the signal into a phone's canvas of a given shape."""
        self._panels = panels
        self._set_heights = set_heights
        self._set_portrait = set_portrait
        self._measuring = threading.Lock()

    def attach(self, client: viser.ClientHandle) -> None:
        """Fit now, and again whenever the height and the shape of this browser's canvas change together."""
        self._fit(client)
        known = canvas_of(client)

        def on_camera(_camera: object) -> None:
            nonlocal known
            now = canvas_of(client)
            before, known = known, now
            if resized(before, now) and self._fit(client):
                known = canvas_of(client)

        client.camera.on_update(on_camera)

    def _fit(self, client: viser.ClientHandle) -> bool:
        """Measure and fill; False if another measurement is under way."""
        if not self._measuring.acquire(blocking=False):
            return False
        try:
            self._panels.set_right_width(FIRST_RIGHT_WIDTH)
            first, docked = settled(client), self._panels.docked_width
            self._panels.set_right_width(FIRST_RIGHT_WIDTH + PROBE)
            second = settled(client)
            window = window_size(first, second, docked=docked, more=PROBE)
            self._set_portrait(
                client, second[0] / second[1] if window is None and second[0] < 0.8 * second[1] else None
            )
            if window is not None:
                sizes = sizes_for(*window)
                self._panels.set_right_width(sizes.right_width)
                self._set_heights(sizes)
                settled(client)
        finally:
            self._measuring.release()
        return True


def resized(before: Pixels, now: Pixels) -> bool:
    """Whether a canvas report means a new window size: height and shape changed.

    Height alone is viser's own scaling; width alone is the person dragging a divider, which is not ours to undo.
    """
    if min(*before, *now) <= 0 or before[1] == now[1]:
        return False
    return abs(now[0] / now[1] - before[0] / before[1]) > 0.01 * before[0] / before[1]


def canvas_of(client: viser.ClientHandle) -> Pixels:
    """Width and height of a browser's canvas in its own pixels, as last reported."""
    return client.camera.image_width, client.camera.image_height


def settled(client: viser.ClientHandle) -> Pixels:
    """The canvas once it has kept its size for a while; viser has no event for that."""
    start = last_change = time.monotonic()
    size = canvas_of(client)
    while time.monotonic() - last_change < SETTLED and time.monotonic() - start < PATIENCE:
        time.sleep(0.03)
        now = canvas_of(client)
        if now != size:
            size, last_change = now, time.monotonic()
    return size
