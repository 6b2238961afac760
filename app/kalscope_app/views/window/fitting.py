"""Makes panels and charts fill a browser's window: measures it when a browser comes, and when it is resized."""

from __future__ import annotations

import queue
import threading
import time
from collections import Counter
from typing import TYPE_CHECKING

from kalscope_app.views.window.layout import FIRST_RIGHT_WIDTH, PROBE, Panels, Sizes, sizes_for, window_size

if TYPE_CHECKING:
    from collections.abc import Callable

    import viser

SETTLED = 0.4
"""Seconds for which a canvas must keep its size to count as settled; viser eases its panels for 0.16 s."""

PATIENCE = 1.5
"""Seconds to wait for that at most."""

ATTEMPTS = 5
"""Measurements at most; each checks itself."""

ANSWER = 15.0
"""Seconds to wait at most for a page to answer a moved camera."""

HAIR = 0.01
"""How far a camera is moved to make a page report."""

Pixels = tuple[int, int]


class WindowFitter:
    """Fits the layout to the window that came or changed last. All browsers share one layout."""

    def __init__(
        self,
        panels: Panels,
        set_sizes: Callable[[Sizes], None],
        set_portrait: Callable[[viser.ClientHandle, float | None], None],
        aim: Callable[[viser.ClientHandle], None],
    ) -> None:
        """Args: the panels; who draws for sizes, into a phone's canvas of a given shape; who aims a camera anew."""
        self._panels = panels
        self._set_sizes = set_sizes
        self._set_portrait = set_portrait
        self._aim = aim
        self._busy = False
        self._fitted: dict[viser.ClientHandle, Pixels | None] = {}
        self._unmeasured: set[viser.ClientHandle] = set()
        self._reports: Counter[viser.ClientHandle] = Counter()
        self._window: tuple[float, float] | None = None
        self._map_shown = True
        self._waiting: queue.SimpleQueue[viser.ClientHandle | None] = queue.SimpleQueue()
        # A daemon of its own: measuring takes seconds, and viser's callback threads would keep the program alive.
        threading.Thread(target=self._run, name="kalscope-fitting", daemon=True).start()

    def attach(self, client: viser.ClientHandle) -> None:
        """Fit now, and again whenever the height and the shape of this browser's canvas change together."""
        self._fitted[client] = None
        self._waiting.put(client)
        client.camera.on_update(lambda _camera: self._on_camera(client))

    def detach(self, client: viser.ClientHandle) -> None:
        """Forget a browser that has gone."""
        self._fitted.pop(client, None)
        self._unmeasured.discard(client)
        self._reports.pop(client, None)

    def set_map_shown(self, shown: bool) -> None:
        """Give the map its room in the window that was measured last, or give that room to the charts."""
        if shown != self._map_shown:
            self._map_shown = shown
            self._waiting.put(None)

    def _on_camera(self, client: viser.ClientHandle) -> None:
        self._reports[client] += 1
        if self._busy:
            return
        if self._needs_fit(client) and self._waiting.empty():
            self._waiting.put(client)
        else:
            self._aim(client)

    def _needs_fit(self, client: viser.ClientHandle) -> bool:
        known, now = self._fitted.get(client, (0, 0)), canvas_of(client)
        if known is None or resized(known, now):
            return True
        # Where nothing could be measured, a width alone is a late answer of a slow page, not a divider dragged.
        return client in self._unmeasured and not same_shape(known, now)

    def _run(self) -> None:
        while True:
            client = self._waiting.get()
            self._busy = True  # no camera moves meanwhile: every move has to be drawn before a size is reported
            if client is None:
                self._refill()
            elif self._needs_fit(client):  # what was reported meanwhile may have been our own doing
                self._fit(client)
            self._busy = False
            for one in tuple(self._fitted):
                self._aim(one)

    def _refill(self) -> None:
        """Fill the window as measured before."""
        if self._window is None:
            return
        self._fill(self._window)
        for one in tuple(self._fitted):
            size = settled(one, SETTLED)
            if one in self._fitted:
                self._fitted[one] = size

    def _fill(self, window: tuple[float, float]) -> Sizes:
        sizes = sizes_for(*window, map_shown=self._map_shown)
        self._panels.set_right_width(sizes.right_width)
        self._set_sizes(sizes)
        return sizes

    def _fit(self, client: viser.ClientHandle) -> None:
        """Measure and fill; then remember what every browser's canvas has become by that."""
        self._unmeasured.add(client)
        for attempt in range(ATTEMPTS):  # the first may meet a page that has not docked its panels yet
            # A page without a graphics card reports late: each attempt is more patient than the one before.
            if client not in self._fitted or self._measure_and_fill(client, SETTLED * (1 + attempt)):
                break
        else:
            self._set_portrait(client, None)
        for one in tuple(self._fitted):
            if one in self._fitted:
                self._fitted[one] = canvas_of(one)

    def _measure_and_fill(self, client: viser.ClientHandle, hold: float) -> bool:
        """One attempt, with sizes that keep for `hold` s; True if the canvas is then as the window says."""
        first, docked = self._canvas_beside(client, FIRST_RIGHT_WIDTH, hold), self._panels.docked_width
        second = self._canvas_beside(client, FIRST_RIGHT_WIDTH + PROBE, hold, unlike=first)
        window = window_size(first, second, docked=docked, more=PROBE)
        if window is None:
            return self._is_phone(client, first, second)
        self._set_portrait(client, None)
        self._window = window
        sizes = self._fill(window)
        if not reaches(client, sizes.canvas_width / window[1], PATIENCE + 4.0 * hold):
            return False
        self._unmeasured.discard(client)
        return True

    def _canvas_beside(
        self, client: viser.ClientHandle, width: int, hold: float, unlike: Pixels | None = None
    ) -> Pixels:
        """The settled canvas beside a chart panel of this width, px; a second attempt asks the page for it."""
        self._panels.set_right_width(width)
        if hold > SETTLED:
            self._answers(client)
        return settled(client, hold, unlike)

    def _is_phone(self, client: viser.ClientHandle, first: Pixels, second: Pixels) -> bool:
        """Whether an upright canvas keeps its shape beside any panel: then the signal is drawn into it.

        A slow page in a wide window looks the same until it answers. So it counts only if the page, asked again
        after the panel has become narrow, still has that shape.
        """
        if not (is_upright(second) and same_shape(first, second)):
            return False
        self._panels.set_right_width(FIRST_RIGHT_WIDTH)
        if not (self._answers(client) and self._answers(client)):
            return False
        if not same_shape(second, settled(client, SETTLED)):
            return False
        self._set_portrait(client, second[0] / second[1])
        return True

    def _answers(self, client: viser.ClientHandle) -> bool:
        """Move the camera by a hair and wait until the page says where it is, and so how large it is."""
        before, end = self._reports[client], time.monotonic() + ANSWER
        x, y, z = client.camera.position
        client.camera.position = (x + HAIR, y, z)
        while client in self._fitted and self._reports[client] == before and time.monotonic() < end:
            time.sleep(0.03)
        return self._reports[client] != before


def resized(before: Pixels, now: Pixels) -> bool:
    """Whether a canvas report means a new window size: height and shape changed.

    Height alone is viser's own scaling; width alone is the person dragging a divider, which is not ours to undo.
    """
    if min(*before, *now) <= 0 or before[1] == now[1]:
        return False
    return abs(now[0] / now[1] - before[0] / before[1]) > 0.01 * before[0] / before[1]


def same_shape(one: Pixels, other: Pixels) -> bool:
    """Whether two canvas reports have the same width : height, to within 2 %; viser scales both sides together."""
    return min(*one, *other) > 0 and abs(one[0] * other[1] / (one[1] * other[0]) - 1.0) <= 0.02


def is_upright(size: Pixels) -> bool:
    """Whether a canvas is clearly higher than wide."""
    return 0 < size[0] < 0.8 * size[1]


def canvas_of(client: viser.ClientHandle) -> Pixels:
    """Width and height of a browser's canvas in its own pixels, as last reported."""
    return client.camera.image_width, client.camera.image_height


def reaches(client: viser.ClientHandle, shape: float, within: float) -> bool:
    """Whether the canvas takes this shape, width : height, within some seconds."""
    end = time.monotonic() + within
    while time.monotonic() < end:
        width, height = canvas_of(client)
        if abs(width / max(height, 1) - shape) <= 0.05 * shape:
            return True
        time.sleep(0.03)
    return False


def settled(client: viser.ClientHandle, hold: float, unlike: Pixels | None = None) -> Pixels:
    """The canvas once it has changed from `unlike` and kept its size for `hold` s; viser has no event for that."""
    end = time.monotonic() + PATIENCE + 2.0 * (hold - SETTLED)
    while unlike is not None and canvas_of(client) == unlike and time.monotonic() < end:
        time.sleep(0.03)
    size, last_change = canvas_of(client), time.monotonic()
    while time.monotonic() - last_change < hold and time.monotonic() < end + hold:
        time.sleep(0.03)
        now = canvas_of(client)
        if now != size:
            size, last_change = now, time.monotonic()
    return size
