"""The tuning map between the panels: a flat picture, the mark of the present point, what the mouse does.

Picture, mark and mouse are hidden widgets here; `map.js` shows them over viser's canvas.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
import viser

from kalscope_app.engine.frame import Frame
from kalscope_app.engine.jobs import Jobs
from kalscope_app.program.user_settings import UserSettings
from kalscope_app.session.changes.fleet import pick_device
from kalscope_app.session.changes.parameters import set_point
from kalscope_app.session.changes.view import set_map_colour, set_map_shown
from kalscope_app.session.session import Session
from kalscope_app.session.state import State
from kalscope_app.session.view import MAP_COLOURS
from kalscope_app.studies.map_geometry import MapFrame, Point, frame_for
from kalscope_app.studies.tuning_map import TuningMap, exponents_of, nothing
from kalscope_app.views.binding import bind, offer, on_user, put
from kalscope_app.views.map.picture import MapPictureInput, chips, draw_map_picture, draw_ring
from kalscope_app.views.window.page.page_script import MAP_MARK, MAP_PICTURE, MAP_POINTED, MAP_PRESENT

if TYPE_CHECKING:
    from kalscope.fleet.results import Fleet

SIZE = (400.0, 800.0)
"""Width and height of the picture, px. Each browser fits it into the space between its panels."""

NOWHERE = (-1.0, -1.0)
"""The position that hides the mark."""

SHOW, HIDE = "Map", "Hide map"


class TuningMapView:
    """Picture, mark and mouse."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self.on_device: Callable[[Fleet, int], None] = lambda _fleet, _device: None
        """Called when the device of an open fleet that is picked is clicked."""
        self._lock = threading.Lock()
        self._map: TuningMap = nothing("")
        self._state: State | None = None
        self._drawn: MapPictureInput | None = None
        self._frame = frame_for(*SIZE, self._map.q, self._map.r)

    def build_button(self, gui: viser.GuiApi, settings: UserSettings, jobs: Jobs) -> None:
        """The button of the header; what it does is remembered for the next start."""
        self._shown = gui.add_button(SHOW, hint="The map of q and r beside the charts: click or drag in it.")

        def toggle() -> None:
            shown = self._shown.label == SHOW
            self._session.request(set_map_shown(shown))
            jobs.run(partial(settings.keep, map_shown=shown))

        on_user(self._shown.on_click, lambda _client: toggle())

    def build_controls(self, gui: viser.GuiApi) -> None:
        """The control of the View tab, for an open map, and the widgets that the page shows as the map."""
        self._colour = gui.add_dropdown(
            "map coloured by", MAP_COLOURS, hint="How well each pair explains the recording, its error, or its lag."
        )
        bind(self._colour, self._session, set_map_colour)
        dot = np.zeros((2, 2, 3), dtype=np.uint8)
        self._picture = gui.add_image(dot, label=MAP_PICTURE, format="png", visible=False)
        self._mark = gui.add_image(draw_ring(dark=False), label=MAP_MARK, format="png", visible=False)
        self._present = gui.add_vector2(MAP_PRESENT, NOWHERE, visible=False, hint="Hidden.")
        self._pointed = gui.add_vector3(MAP_POINTED, (0.0, 0.0, 0.0), visible=False, hint="Hidden.")
        on_user(self._pointed.on_update, lambda _client: self._on_pointed())

    # What the user does.

    def _on_pointed(self) -> None:
        """File the pair under a drag or a click; a click may also choose a colouring."""
        across, down, gesture = self._pointed.value
        frame, state = self._frame, self._state
        if state is None or not self._map.colour:
            return
        x, y = across * frame.width, down * frame.height
        if gesture < 0.0 and self._on_fleet((x, y)):
            return
        if gesture > 0.0 or frame.inside((x, y)):
            point = frame.held(frame.point((x, y)))
            self._session.request(set_point(*point), key=f"held:map {gesture:.0f}")
        else:
            truth = state.recording.truth is not None
            for colour, (left, top, right, bottom) in chips(frame, truth):
                if left <= x <= right and top <= y <= bottom:
                    self._session.request(set_map_colour(colour))

    def _on_fleet(self, at: Point) -> bool:
        """Whether a click is for a device: the first click names it, a second one opens it."""
        fleet = self._map.fleet
        if fleet is None:
            return False
        asked = self._state and self._state.fleet  # the map may be drawn a little later
        device, picked = fleet.nearest(self._frame, at), asked and asked.picked
        if device is not None and device == picked:
            self.on_device(fleet.fleet, device)
        elif device != picked:
            self._session.request(pick_device(device))
        return device is not None

    # What the user sees.

    def follow(self, frame: Frame) -> None:
        """Move the mark of an open map."""
        self._state = frame.state
        shown = frame.state.view.map_shown
        put(self._colour, visible=shown)
        put(self._shown, label=HIDE if shown else SHOW)
        if shown:
            self._place(frame.state)

    def _place(self, state: State) -> None:
        visible = bool(self._map.colour) and state.is_standard
        put(self._present, value=self._share(exponents_of(state)) if visible else NOWHERE)

    def _share(self, point: Point) -> Point:
        """The position of a pair of exponents, in shares of the picture; on the edge of the map if outside."""
        frame = self._frame
        x, y = frame.pixel(frame.held(point))
        return x / frame.width, y / frame.height

    def on_emptied(self) -> None:
        """A click means nothing without a picture."""
        self._map = nothing("")
        put(self._present, value=NOWHERE)

    def show(self, answer: tuple[State, TuningMap] | None) -> None:
        """Draw the map of a state whose values have stopped changing; None: it is closed."""
        if answer is None:
            return
        with self._lock:
            self._state, self._map = answer
            self._draw(answer[0])

    def _draw(self, state: State) -> None:
        self._frame = frame_for(*SIZE, self._map.q, self._map.r, self._map.momentum)
        inputs = picture_input(state, self._map, self._frame)
        self._place(state)
        self._show_colour(state)
        if self._drawn is not None and same_picture(inputs, self._drawn):
            return
        self._mark.image, self._picture.image = draw_ring(dark=inputs.dark), draw_map_picture(inputs)
        self._drawn = inputs

    def _show_colour(self, state: State) -> None:
        """The colourings that this recording allows, and which is on screen."""
        options = tuple(c for c in MAP_COLOURS if c != "RMSE" or state.recording.truth is not None)
        offer(self._colour, options, self._map.colour or self._colour.value)


def picture_input(state: State, shown: TuningMap, frame: MapFrame) -> MapPictureInput:
    """What the picture is drawn from."""
    pinned = tuple((v.name, v.css(dark=state.view.dark), exponents_of(state, v.tuning)) for v in state.variants)
    recording = state.recording
    unit, truth = state.tuning.unit, recording.truth is not None
    return MapPictureInput(shown, frame, unit, recording.sample_period, state.view.dark, truth, pinned)


def same_picture(one: MapPictureInput, other: MapPictureInput) -> bool:
    """Whether two inputs give the same picture; maps hold arrays, which have no single equality."""
    rest = [(p.frame, p.unit, p.period, p.dark, p.truth, p.pinned) for p in (one, other)]
    return one.map is other.map and rest[0] == rest[1]
