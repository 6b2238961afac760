"""The tuning map in the canvas between the panels: a flat picture, the present point, what the mouse does."""

from __future__ import annotations

import threading
import time
from functools import partial
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
import viser

from kalscope_app.engine.frame import Frame
from kalscope_app.engine.jobs import Jobs
from kalscope_app.program.user_settings import UserSettings
from kalscope_app.session.changes.parameters import set_point
from kalscope_app.session.changes.view import set_map_colour, set_map_shown
from kalscope_app.session.session import Session
from kalscope_app.session.state import MAP_COLOURS, State
from kalscope_app.studies.map_geometry import (
    DISTANCE,
    PIXELS,
    MapFrame,
    Point,
    field_of_view,
    frame_for,
    grabbed,
    hit,
)
from kalscope_app.studies.tuning_map import TuningMap, exponents_of, nothing
from kalscope_app.views.binding import bind, offer, on_user
from kalscope_app.views.map.picture import MapPictureInput, chips, draw_map_picture, draw_ring
from kalscope_app.views.window.layout import shape_of

FLAT = (0.0, 1.0, 0.0, 0.0)
"""Half a turn about x: viser hangs pictures upside down and facing away."""

RING = 0.30
"""Width of the mark of the present point, units of the scene."""

PACE = 0.1
"""Seconds between two moves of the mark at least: each makes the browser redraw the scene, which may be slow."""

SIZE = (400.0, 800.0)
"""Width and height of the picture, px. Each browser's camera fits it into the canvas."""

MIN_SHAPE = 0.2
"""Width : height of a canvas that shows the map at least: viser keeps a strip of canvas where there is none."""

SHOW, HIDE = "Map", "Hide map"

SIDE = 400.0
"""Width of the invisible plane that takes every drag, so that none turns the view."""


class TuningMapView:
    """Picture, mark, mouse and camera."""

    def __init__(self, server: viser.ViserServer, session: Session) -> None:
        self._server, self._session = server, session
        self._lock = threading.Lock()
        self._map: TuningMap = nothing("")
        self._state: State | None = None
        self._drawn: MapPictureInput | None = None
        self._frame = frame_for(*SIZE, self._map.q, self._map.r)
        # Browsers whose camera looks straight at the map; what others point at is not what they see.
        self._aimed = WeakKeyDictionary[viser.ClientHandle, float]()
        self._phones: set[viser.ClientHandle] = set()
        self._camera_lock = threading.Lock()  # reports of canvas and phone arrive in several threads
        self._drags, self._offset, self._moved = 0, (0.0, 0.0), 0.0
        self._build_scene()

    def _build_scene(self) -> None:
        scene, camera = self._server.scene, self._server.initial_camera
        scene.set_up_direction("+y")
        scene.configure_default_lights(False, cast_shadow=False)
        camera.up, camera.near, camera.far = (0.0, 1.0, 0.0), 1.0, 200.0
        camera.position, camera.look_at = (0.0, 0.0, DISTANCE), (0.0, 0.0, 0.0)
        camera.fov = field_of_view(self._frame, SIZE[0] / SIZE[1])
        dot = np.zeros((2, 2, 3), dtype=np.uint8)
        quiet: Any = {"wxyz": FLAT, "cast_shadow": False, "receive_shadow": False, "visible": False}
        self._picture = scene.add_image("/map/picture", dot, 1.0, 1.0, format="png", **quiet)
        self._ring = scene.add_image("/map/present", draw_ring(dark=False), RING, RING, format="png", **quiet)
        glass = np.zeros((2, 2, 4), dtype=np.uint8)
        self._glass = scene.add_image(
            "/map/glass", glass, SIDE, SIDE, format="png", position=(0.0, 0.0, 0.2), **quiet
        )
        self._glass.on_drag("left")(self._on_drag)
        self._glass.on_click(self._on_click)

    def build_button(self, gui: viser.GuiApi, settings: UserSettings, jobs: Jobs) -> None:
        """The button of the header; what it does is remembered for the next start."""
        self._shown = gui.add_button(SHOW, hint="The map of q and r beside the charts: click or drag in it.")

        def toggle() -> None:
            shown = self._shown.label == SHOW
            self._session.request(set_map_shown(shown))
            jobs.run(partial(settings.keep, map_shown=shown))

        on_user(self._shown.on_click, lambda _client: toggle())

    def build_controls(self, gui: viser.GuiApi) -> None:
        """The controls of the View tab, for an open map."""
        self._colour = gui.add_dropdown(
            "map coloured by", MAP_COLOURS, hint="How well each pair explains the recording, its error, or its lag."
        )
        self._flat = gui.add_button("Reset map view", hint="Undo turning, moving and zooming the map.")
        bind(self._colour, self._session, set_map_colour)
        on_user(self._flat.on_click, self._look_straight)

    # What the user does.

    async def _on_drag(self, event: viser.SceneNodeDragEvent[Any]) -> None:
        frame, state = self._frame, self._state
        if state is None or not self._map.colour or event.client not in self._aimed:
            return
        pixel = frame.of_scene(event.end_position[:2])
        if event.phase == "start":
            self._drags += 1
            self._offset = grabbed(frame, exponents_of(state), frame.of_scene(event.start_position[:2]))
        pixel = pixel[0] + self._offset[0], pixel[1] + self._offset[1]
        self._ask(frame.held(frame.point(pixel)))

    async def _on_click(self, event: viser.SceneNodePointerEvent[Any]) -> None:
        frame, place = self._frame, hit(event.ray_origin, event.ray_direction)
        if place is None or self._state is None or not self._map.colour or event.client not in self._aimed:
            return
        x, y = frame.of_scene(place)
        if frame.inside((x, y)):
            self._drags += 1
            self._ask(frame.point((x, y)))
        truth = self._state.recording.truth is not None
        for colour, (left, top, right, bottom) in chips(frame, truth):
            if left <= x <= right and top <= y <= bottom:
                self._session.request(set_map_colour(colour))

    def _ask(self, point: Point) -> None:
        """File the pair; every drag is one gesture with a key of its own."""
        self._session.request(set_point(*point), key=f"held:map {self._drags}")

    # What the user sees.

    def follow(self, frame: Frame) -> None:
        """Move the mark, at a limited rate; `show` puts it in its final place once the values stay."""
        self._state, now = frame.state, time.monotonic()
        shown = self._colour.visible = self._flat.visible = frame.state.view.map_shown
        self._shown.label = HIDE if shown else SHOW
        if now - self._moved >= PACE:
            self._place(frame.state)

    def _place(self, state: State) -> None:
        x, y = self._frame.scene(self._frame.pixel(self._frame.held(exponents_of(state))))
        visible = bool(self._map.colour) and state.filter.is_standard
        if visible and tuple(self._ring.position) != (x, y, 0.1):
            self._ring.position = (x, y, 0.1)
            self._moved = time.monotonic()
        self._ring.visible = visible

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
        picture, ring = draw_map_picture(inputs), draw_ring(dark=inputs.dark)
        self._drawn = inputs
        with self._server.atomic():
            self._ring.image = ring
            self._picture.image = picture
            self._picture.render_width = inputs.frame.width / PIXELS
            self._picture.render_height = inputs.frame.height / PIXELS
            self._picture.visible = self._glass.visible = True

    def _show_colour(self, state: State) -> None:
        """The colourings that this recording allows, and which is on screen."""
        options = tuple(c for c in MAP_COLOURS if c != "RMSE" or state.recording.truth is not None)
        offer(self._colour, options, self._map.colour or self._colour.value)

    # Cameras.

    def attach(self, client: viser.ClientHandle) -> None:
        """Fit the picture into a new browser's canvas, and again whenever that changes."""
        self._aim(client)
        client.camera.on_update(lambda _camera: self._aim(client))

    def detach(self, client: viser.ClientHandle) -> None:
        """Forget a browser that has disconnected."""
        self._aimed.pop(client, None)
        self._phones.discard(client)

    def _aim(self, client: viser.ClientHandle) -> None:
        """Fit the picture into this browser's canvas if that has another shape than before."""
        shape, known = shape_of(client), self._aimed.get(client, 0.0)
        if shape is not None and abs(shape - known) > 0.002 * known:
            self._look_straight(client)

    def _look_straight(self, client: viser.ClientHandle) -> None:
        """Look straight at the map; past it where the canvas is too narrow, or shows the signal as on a phone."""
        with self._camera_lock, client.atomic():
            shape, camera = shape_of(client), client.camera
            if shape is None:
                return
            self._aimed[client] = shape
            away = 10.0 * SIDE if client in self._phones or shape < MIN_SHAPE else 0.0
            camera.up_direction = (0.0, 1.0, 0.0)
            camera.position, camera.look_at = (away, 0.0, DISTANCE), (away, 0.0, 0.0)
            camera.fov = field_of_view(self._frame, shape)

    def set_phone(self, client: viser.ClientHandle, is_phone: bool) -> None:
        """Whether this browser is on a phone, and so has no map."""
        if is_phone != (client in self._phones):
            (self._phones.add if is_phone else self._phones.discard)(client)
            self._look_straight(client)


def picture_input(state: State, shown: TuningMap, frame: MapFrame) -> MapPictureInput:
    """What the picture is drawn from."""
    pinned = tuple((v.name, v.rgb(dark=state.view.dark), exponents_of(state, v.tuning)) for v in state.variants)
    recording = state.recording
    unit, truth = state.tuning.unit, recording.truth is not None
    return MapPictureInput(shown, frame, unit, recording.sample_period, state.view.dark, truth, pinned)


def same_picture(one: MapPictureInput, other: MapPictureInput) -> bool:
    """Whether two inputs give the same picture; maps hold arrays, which have no plain equality."""
    rest = [(p.frame, p.unit, p.period, p.dark, p.truth, p.pinned) for p in (one, other)]
    return one.map is other.map and rest[0] == rest[1]
