"""The picture of the tuning map: its best shade lies under the mark of the estimate; what is written on it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from kalscope import synthesize
from kalscope_app.engine.filter_runs import Cache
from kalscope_app.session.changes import pin_present, set_dark
from kalscope_app.session.opening import opened
from kalscope_app.studies.tuning_map import MapFrame, compute_map, exponents_of, nothing
from kalscope_app.views.charts import DARK, LIGHT
from kalscope_app.views.map import SHARPNESS, draw_map_picture, lag_words, shades


@pytest.fixture(scope="module")
def state():
    return opened(synthesize("random_walk", n=2000, seed=2))


@pytest.fixture(scope="module")
def shown(state):
    return compute_map(state, Cache())


def rgb(colour):
    return [int(colour[i : i + 2], 16) for i in (1, 3, 5)]


@pytest.mark.slow
@pytest.mark.parametrize("dark", [False, True])
def test_the_best_shade_lies_under_the_mark_of_the_estimate_and_nothing_leaves_the_picture(state, shown, dark):
    state, palette = state.with_view(dark=dark), DARK if dark else LIGHT
    x, y = (round(SHARPNESS * at) for at in shown.frame.pixel(shown.optimum))
    bare = draw_map_picture(state, replace(shown, optimum=None, contour=None))
    around = bare[y - 6 : y + 7, x - 6 : x + 7].astype(int)
    assert np.abs(around - np.array(rgb(palette.shades[-1]))).sum(axis=-1).min() < 30
    picture = draw_map_picture(state, shown)
    assert picture[y, x].tolist() == rgb(palette.best)
    assert picture.shape == (SHARPNESS * MapFrame.height, SHARPNESS * MapFrame.width, 3)
    edge = np.concatenate([picture[0], picture[-1], picture[:, 0], picture[:, -1]])
    assert (edge == rgb(palette.paper)).all()


@pytest.mark.parametrize("palette", [LIGHT, DARK])
def test_lightness_alone_tells_better_from_worse(palette):
    light = 255.0 * shades(palette)(np.linspace(0, 1, 50))[:, :3] @ [0.2126, 0.7152, 0.0722]
    steps = np.diff(light)
    assert (steps <= 0).all() or (steps >= 0).all()
    assert abs(light[-1] - light[0]) > 120


@pytest.mark.parametrize("dark", [False, True])
def test_pinned_variants_are_drawn_at_their_pair(state, shown, dark):
    pinned = set_dark(dark)(pin_present(state))
    x, y = (round(SHARPNESS * at) for at in shown.frame.pixel(exponents_of(state.tuning.q, state.tuning.r)))
    patch = draw_map_picture(pinned, shown)[y - 10 : y + 10, x - 10 : x + 10].reshape(-1, 3).tolist()
    assert rgb(pinned.variants[0].css(dark=dark)) in patch


def test_where_there_is_no_map_the_reason_is_written(state):
    why = nothing("The signal is constant: there is nothing to tune.")
    assert (draw_map_picture(state, why) != draw_map_picture(state, nothing(""))).any()


@pytest.mark.parametrize(
    ("period", "lag", "words"),
    [
        (0.01, 3.0, "30 ms"),
        (0.01, 1e5, "1\u202f000 s"),
        (1e-6, 3.0, "3 µs"),
        (31557600.0, 10.0, "10 years"),
        (None, 30.0, "30"),
    ],
)
def test_a_lag_is_told_in_one_unit(period, lag, words):
    assert lag_words(lag, period) == words
