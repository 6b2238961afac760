"""When the studies of a state begin."""

from __future__ import annotations

import threading
from types import SimpleNamespace

import pytest
from waiting import PATIENCE

from kalscope import open_source
from kalscope_app.engine import engine
from kalscope_app.engine.engine import IDLE_DELAY, MAX_IDLE_DELAY, Studies, Study, idle_delay
from kalscope_app.session.opening import opened


@pytest.mark.parametrize(
    ("longest", "delay"),
    [(0.0, IDLE_DELAY), (0.1, IDLE_DELAY), (0.6, 0.6), (1.0, MAX_IDLE_DELAY), (9.0, MAX_IDLE_DELAY)],
)
def test_long_studies_wait_longer(longest, delay):
    assert idle_delay(longest) == delay


@pytest.mark.slow
def test_the_wait_is_that_of_the_longest_study_of_the_round_before(monkeypatch):
    asked, done = [], threading.Event()
    monkeypatch.setattr(engine, "idle_delay", lambda longest: asked.append(longest) or 0.0)
    times = iter([0.0, 0.1, 1.0, 1.7, 2.0, 2.2, 3.0, 3.1, 4.0, 4.1, 5.0, 5.1])
    monkeypatch.setattr(engine, "time", SimpleNamespace(monotonic=lambda: next(times)))
    quick = Study(lambda _: None, lambda _: None, pytest.fail)
    studies = Studies([quick, quick, Study(lambda _: None, lambda _: done.set(), pytest.fail)])
    demo = opened(open_source("demo"))
    for state in (demo, demo.with_view(dark=True)):
        done.clear()
        studies.of(state)
        assert done.wait(PATIENCE)
    assert asked == [MAX_IDLE_DELAY, pytest.approx(0.7)]  # at first the browser is still loading the page
