"""The pictures of the map and of a phone: what lies where, and colours that can be told apart in both themes."""

from __future__ import annotations

from dataclasses import replace
from unittest.mock import MagicMock

import numpy as np
import pytest

from kalscope import Recording, synthesize
from kalscope_app.engine.filter_runs import Cache
from kalscope_app.engine.frame import compute_frame
from kalscope_app.session import state as session_state
from kalscope_app.session.changes import pin_present, set_dark
from kalscope_app.session.opening import opened
from kalscope_app.studies.tuning_map import MapFrame, compute_map, exponents_of, nothing
from kalscope_app.views.charts import DARK, LIGHT
from kalscope_app.views.map import SHARPNESS, draw_map_picture, lag_words, shades
from kalscope_app.views.phone import VISIBLE, WIDTH, PhonePictures, draw_picture

pytestmark = pytest.mark.slow

BOTH = pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
PALETTES = {False: LIGHT, True: DARK}


@pytest.fixture(scope="module")
def state():
    return opened(synthesize("random_walk", n=2000, seed=2))


@pytest.fixture(scope="module")
def shown(state):
    return compute_map(state, Cache())


def rgb(colour):
    return [int(colour[i : i + 2], 16) for i in (1, 3, 5)]


@BOTH
def test_the_best_shade_lies_under_the_mark_of_the_estimate_and_a_pinned_pair_at_its_place(state, shown, dark):
    state, palette = set_dark(dark)(state), PALETTES[dark]
    x, y = (round(SHARPNESS * at) for at in shown.frame.pixel(shown.optimum))
    bare = draw_map_picture(state, replace(shown, optimum=None, contour=None))
    around = bare[y - 6 : y + 7, x - 6 : x + 7].astype(int)
    assert np.abs(around - np.array(rgb(palette.shades[-1]))).sum(axis=-1).min() < 30
    picture = draw_map_picture(state, shown)
    assert picture[y, x].tolist() == rgb(palette.best)
    assert picture.shape == (SHARPNESS * MapFrame.height, SHARPNESS * MapFrame.width, 3)
    edge = np.concatenate([picture[0], picture[-1], picture[:, 0], picture[:, -1]])
    assert (edge == rgb(palette.paper)).all()
    x, y = (round(SHARPNESS * at) for at in shown.frame.pixel(exponents_of(state.tuning.q, state.tuning.r)))
    picture = draw_map_picture(pinned := pin_present(state), shown)
    patch = picture[y - 10 : y + 10, x - 10 : x + 10].reshape(-1, 3).tolist()
    assert rgb(pinned.variants[0].css(dark=dark)) in patch


def test_where_there_is_no_map_the_reason_is_written(state):
    why = nothing("The signal is constant: there is nothing to tune.")
    assert (draw_map_picture(state, why) != draw_map_picture(state, nothing(""))).any()


def test_a_lag_is_told_in_one_unit():
    for period, lag, words in (
        *((0.01, 3.0, "30 ms"), (0.01, 1e5, "1\u202f000 s"), (1e-6, 3.0, "3 µs")),
        *((31557600.0, 10.0, "10 years"), (None, 30.0, "30")),
    ):
        assert lag_words(lag, period) == words


# --- what a phone shows behind its controls ---------------------------------------------------------------


def frame_of(values, dark=False):
    z = np.array(values, dtype=float)[:, None]
    recording = Recording(np.arange(float(len(z))), ("<b>z",), ("V",), z, 1.0)
    return compute_frame(opened(recording).with_view(dark=dark))


@BOTH
def test_the_filtered_curve_runs_through_the_visible_part(dark):
    picture = draw_picture(frame_of(np.sin(np.arange(300) / 20), dark), shape=390 / 844)
    assert picture.shape == (round(WIDTH * 844 / 390), WIDTH, 3)
    curve = np.argwhere((picture == rgb(PALETTES[dark].filtered)).all(axis=2))
    assert curve[:, 0].max() < VISIBLE * picture.shape[0]
    assert curve[:, 1].min() < 0.15 * WIDTH
    assert curve[:, 1].max() > 0.94 * WIDTH


@pytest.mark.parametrize("values", [[1.0], [5.0] * 9, [np.nan, 1.0, np.nan, 2.0], [1e-9, 3e-9], [1e200, -1e200]])
def test_every_recording_can_be_pictured(values):
    assert draw_picture(frame_of(values), shape=0.5).shape == (1560, WIDTH, 3)


def test_a_phone_gets_each_frame_and_each_shape_once_and_a_wide_window_nothing(monkeypatch):
    monkeypatch.setattr("kalscope_app.views.phone.draw_picture", lambda frame, shape: (frame, shape))
    pictures, client = PhonePictures(), MagicMock()
    client.camera.image_width, client.camera.image_height = 390, 844
    box = client.gui.add_checkbox.return_value  # by it the page says whether it is on a phone
    box.value = False
    pictures.attach(client)
    (report,), (turned,) = box.on_update.call_args.args, client.camera.on_update.call_args.args
    pictures.show("first")
    box.value = True
    report(None)
    pictures.show("second")
    turned(None)
    client.camera.image_width, client.camera.image_height = 844, 390
    turned(None)
    turned(None)
    box.value = False
    report(None)
    pictures.show("third")
    upright, across = 390 / 844, 844 / 390
    drawn = [call.args[0] for call in client.scene.set_background_image.call_args_list]
    assert drawn == [("first", upright), ("second", upright), ("second", across)]


# --- colours: WCAG 2.2, 1.4.3 and 1.4.11; texts of the page itself are judged by axe-core in the browser ---


PAPER = {False: "#ffffff", True: "#242424"}
"""Behind the charts: Mantine's white and dark 7."""
TEXT, GRAPHICS = 4.5, 3.0


def linear(colour):
    """Linear red, green and blue of #rrggbb, 0 … 1."""
    parts = (part / 255 for part in rgb(colour))
    return np.array([part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts])


def contrast(one, other):
    """Of two colours, #rrggbb: 1 to 21."""
    low, high = sorted(linear(colour) @ [0.2126, 0.7152, 0.0722] for colour in (one, other))
    return (high + 0.05) / (low + 0.05)


@BOTH
def test_every_line_of_a_chart_stands_out_and_the_words_of_the_map_can_be_read(dark):
    assert contrast("#767676", "#ffffff") == pytest.approx(4.54, abs=0.005)  # the lightest grey that may be text
    palette, pictures = PALETTES[dark], ("paper", "ink", "quiet", "best")
    lines = [one for name, one in vars(palette).items() if name not in pictures and str(one).startswith("#")]
    lines += [*palette.sensors, *palette.alternatives, *(session_state.DARK if dark else session_state.LIGHT)]
    assert len(lines) > 25
    assert [colour for colour in lines if contrast(colour, PAPER[dark]) < GRAPHICS] == []
    assert min(contrast(ink, palette.paper) for ink in (palette.ink, palette.quiet)) >= TEXT
    assert contrast(palette.filtered, palette.paper) >= GRAPHICS


@BOTH
def test_a_deuteranope_can_tell_the_first_sensors_the_fused_line_and_better_from_worse_in_the_map(dark):
    # Machado, Oliveira and Fernandes (2009): what a deuteranope sees, in linear RGB; then distances in CIELAB.
    sees = np.array([[0.3673, 0.8606, -0.2280], [0.2801, 0.6725, 0.0474], [-0.0118, 0.0429, 0.9689]])
    to_xyz = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
    palette = PALETTES[dark]
    colours = [palette.filtered, *palette.sensors[:3]]
    x, y, z = np.cbrt(to_xyz @ (sees @ np.array([linear(one) for one in colours]).T).clip(1e-3, 1.0))
    lab = np.stack([116 * y, 500 * (x / 0.983 - y), 200 * (y - z / 1.029)], axis=1)
    distances = np.linalg.norm(lab[:, None] - lab, axis=2)
    assert distances[np.triu_indices(4, 1)].min() > 25
    light = 255.0 * shades(palette)(np.linspace(0, 1, 50))[:, :3] @ [0.2126, 0.7152, 0.0722]
    steps = np.diff(light)
    assert (steps <= 0).all() or (steps >= 0).all()
    assert abs(light[-1] - light[0]) > 120
