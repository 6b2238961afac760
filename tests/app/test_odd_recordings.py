"""Every tab on odd recordings: no frame and no study fails, and none shows what belongs to another state."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np
import pytest
from tests.app.headless import headless
from tests.support.effort import FUZZ

from kalscope import Recording
from kalscope.papers.generalized import GeneralizedParams
from kalscope_app.session.changes import pin_present, set_match_by, set_velocity, set_window
from kalscope_app.session.opening import opened

RNG = np.random.default_rng(71)


def walk(n, channels=1):
    return np.cumsum(0.1 * RNG.normal(size=(n, channels)), axis=0) + RNG.normal(size=(n, channels))


def with_holes(z, share):
    return np.where(RNG.random(z.shape) < share, np.nan, z)


def recording(values, period=0.01, time=None, **more):
    z = np.asarray(values, dtype=float)
    z = z.reshape(len(z), -1)
    names = tuple(f"c{i}" for i in range(z.shape[1]))
    time = np.arange(len(z)) * (period or 1.0) if time is None else time
    return Recording(time, names, ("",) * len(names), z, period, **more)


RECORDINGS = {
    "no time": recording(walk(400), None),
    "two samples": recording([1.0, 2.0]),
    "three samples": recording([1.0, 2.0, 5.0]),
    "hardly a sample": recording(with_holes(walk(500), 0.98)),
    "missing at first": recording(np.vstack([np.full((100, 1), np.nan), walk(300)])),
    "nothing but missing": recording(np.full(50, np.nan)),
    "one sample among missing": recording(np.where(np.arange(50) == 20, 1.0, np.nan)),
    "gaps as dt": recording(walk(400), time=np.cumsum(np.where(RNG.random(400) < 0.05, 0.37, 0.01)), gaps="dt"),
    "time steps back": recording(walk(400), time=0.01 * np.r_[0:200, 150:350], gaps="dt"),
    "constant": recording(np.full(300, 3.7)),
    "ramp": recording(np.arange(300.0)),
    "coarse counts": recording(np.round(0.2 * walk(600))),
    "sine": recording(np.sin(np.arange(800) / 5.0)),
    "sixteen channels": recording(with_holes(walk(200, 16), 0.1)),
    "twenty channels": recording(walk(200, 20)),
    "truth": recording(walk(300), truth=np.zeros((300, 1))),
    "far from zero": recording(1e9 + walk(300)),
    "huge": recording(1e200 * walk(200)),
    "tiny": recording(1e-200 * walk(200)),
}

KHAN = GeneralizedParams(1.0, None, None, "without_slip")
SETTINGS = {
    "start": lambda state: state,
    "pinned": lambda state: pin_present(state).with_tuning(q=1e-12, r=1.0),
    "q = 0": lambda state: state.with_tuning(q=0.0, r=1.0),
    "r = 0": lambda state: state.with_tuning(q=1.0, r=0.0),
    "equal noise": set_match_by("noise"),
    "start and gate": lambda state: state.with_tuning(p0=1.0, x0=0.0, gate=4.0),
    "momentum": lambda state: set_velocity(True)(pin_present(state).with_tuning(momentum=20.0)),
    "shortest momentum, equal noise": lambda state: set_match_by("noise")(state.with_tuning(momentum=5e-324)),
    "momentum, r = 0": lambda state: state.with_tuning(q=1.0, r=0.0, momentum=9.0),
    "momentum, far away": lambda state: state.with_tuning(q=1e-300, r=1e300, momentum=9.0, p0=1.0, gate=4.0),
    "part of it": lambda state: set_window(0.0, float(np.median(state.recording.time)))(state),
    "Khan et al.": lambda state: state.with_tuning_of(0, replace(state.tuning, paper=KHAN)),
}


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    with headless(opened(RECORDINGS["truth"]), tmp_path_factory.mktemp("out")) as (bench, _client):
        yield bench


def some_settings(name):
    """Those that a recording is looked at with: the first and a quarter of the others, met by a quarter of all."""
    first, *others = SETTINGS.values()
    return [first, *(others if FUZZ > 1 else others[list(RECORDINGS).index(name) % 4 :: 4])]


@pytest.mark.parametrize("name", RECORDINGS)
def test_no_tab_fails_on_an_odd_recording_whatever_the_setting(bench, name):
    with warnings.catch_warnings():
        if name in ("huge", "tiny"):  # squares beyond the largest double are inf, and shown so
            warnings.simplefilter("ignore", RuntimeWarning)
        for setting in some_settings(name):
            state = setting(opened(RECORDINGS[name]))
            bench.request(lambda _, state=state: state)
    assert bench.errors == []


def test_a_tab_without_an_answer_shows_no_chart_of_an_earlier_one(bench):
    state, board = opened(RECORDINGS["truth"]), bench.dashboard
    charts = [board._spectrum._density, board._spectrum._response, board._allan._chart]
    charts += [board._alternatives._chart, board._checks._correlation]
    paper, short = SETTINGS["Khan et al."](state), opened(RECORDINGS["three samples"])
    for shown, visible in (state, [True] * 5), (paper, [False] * 5), (state, [True] * 5), (short, [False] * 3):
        bench.request(lambda _, shown=shown: shown)
        assert [chart.handle.visible for chart in charts][: len(visible)] == visible
