"""Makes panels and charts fill a browser's window: measures it when a browser comes, and when it is resized."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable

import viser

from kalscope_app.views.layout import FIRST_RIGHT_WIDTH, PROBE, Panels, Sizes, sizes_for, window_size

SETTLED = 0.4
"""Seconds for which a canvas must keep its size to count as settled; viser eases its panels for 0.16 s."""

PATIENCE = 1.5
"""Seconds to wait for that at most."""

ATTEMPTS = 5
"""Measurements at most; each checks itself."""

PHONE_REPORTS = 4
"""Reports that must agree before a window counts as a phone's: two attempts."""

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

    def set_map_shown(self, shown: bool) -> None:
        """Give the map its room in the window that was measured last, or give that room to the charts."""
        if shown != self._map_shown:
            self._map_shown = shown
            self._waiting.put(None)

    def _on_camera(self, client: viser.ClientHandle) -> None:
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
        seen: list[Pixels] = []
        self._unmeasured.add(client)
        for attempt in range(ATTEMPTS):  # the first may meet a page that has not docked its panels yet
            # A page without a graphics card reports late: each attempt is more patient than the one before.
            if client not in self._fitted or self._measure_and_fill(client, SETTLED * (1 + attempt), seen):
                self._unmeasured.discard(client)
                break
            if is_phone(seen):
                self._set_portrait(client, seen[-1][0] / seen[-1][1])
                break
        else:
            self._set_portrait(client, None)
        for one in tuple(self._fitted):
            if one in self._fitted:
                self._fitted[one] = canvas_of(one)

    def _measure_and_fill(self, client: viser.ClientHandle, hold: float, seen: list[Pixels]) -> bool:
        """One attempt, with sizes that keep for `hold` s, added to `seen`; True if the canvas is as it must be."""
        self._panels.set_right_width(FIRST_RIGHT_WIDTH)
        first, docked = settled(client, hold), self._panels.docked_width
        self._panels.set_right_width(FIRST_RIGHT_WIDTH + PROBE)
        second = settled(client, hold, unlike=first)
        seen += [first, second]
        window = window_size(first, second, docked=docked, more=PROBE)
        if window is None:
            return False
        self._set_portrait(client, None)
        self._window = window
        sizes = self._fill(window)
        return reaches(client, sizes.canvas_width / window[1], PATIENCE + 4.0 * hold)


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


def is_phone(seen: list[Pixels]) -> bool:
    """Whether the last reports, taken at two panel widths in turn, are an upright phone's, which docks nothing.

    One pair says too little: a slow page in a wide window answers late, and its canvas too is higher than wide
    while the panels stand beside it.
    """
    last = seen[-PHONE_REPORTS:]
    upright = len(last) == PHONE_REPORTS and all(0 < width < 0.8 * height for width, height in last)
    return upright and all(same_shape(last[0], size) for size in last)


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
