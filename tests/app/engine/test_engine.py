"""The engine without a browser: the latest request wins, nothing stops it, failures are told."""

from __future__ import annotations

import threading
import time

import numpy as np
import pytest
from waiting import PATIENCE

from kalscope import Recording, kalman_filter
from kalscope_app.engine.engine import Engine, Part
from kalscope_app.session.changes import set_exponent, set_text
from kalscope_app.session.opening import opened
from kalscope_app.session.session import Session


class Screen:
    """Collects frames as a view would; `delay` makes it slow."""

    def __init__(self, delay=0.0):
        self.frames, self.told, self.headings, self.delay = [], [], [], delay
        self.drawn = {part: [] for part in Part}
        self.news = threading.Condition()

    def show(self, frame, parts):
        time.sleep(self.delay)
        with self.news:
            self.frames += [frame] if Part.SIGNAL in parts else []
            for part in parts:
                self.drawn[part].append(frame.serial)
            self.news.notify_all()

    def tell(self, message, failed=None):
        with self.news:
            self.told.append(message)
            self.headings.append(failed)
            self.news.notify_all()

    def wait(self, condition):
        with self.news:
            assert self.news.wait_for(condition, timeout=PATIENCE)


@pytest.fixture
def session():
    z = np.random.default_rng(0).normal(size=(3000, 1))
    return Session(opened(Recording(np.arange(3000.0), ("z",), ("",), z, 1.0)))


@pytest.fixture
def running(session):
    screen = Screen()
    engine = Engine(session, screen.show, screen.tell)
    engine.start()
    yield session, screen
    engine.stop()
    assert not any(thread.name == "kalscope-engine" for thread in threading.enumerate())


@pytest.mark.parametrize("burst", range(5))
def test_after_a_burst_of_requests_the_last_frame_holds_the_last_value(running, burst):
    session, screen = running
    for exponent in np.linspace(-4, 1, 200):
        session.request(set_exponent("q", float(exponent)))
    last = session.request(set_exponent("q", -1.0 - burst / 10))
    screen.wait(lambda: screen.frames and screen.frames[-1].serial == last)
    frame = screen.frames[-1]
    assert frame.state.tuning.q == pytest.approx(10 ** (-1.0 - burst / 10), rel=0.01)
    expected = kalman_filter(frame.state.recording.channel("z"), frame.state.params).x
    assert np.array_equal(frame.filtered, expected[frame.drawn.indices])
    assert len(screen.frames) < 100


def test_a_failing_view_does_not_stop_the_engine(session):
    screen = Screen()

    def show(frame, parts):
        if frame.state.tuning.q == 7:
            raise RuntimeError("a view broke")
        screen.show(frame, parts)

    engine = Engine(session, show, screen.tell)
    engine.start()
    session.request(set_text("q", "7"))
    screen.wait(lambda: screen.told)
    session.request(set_text("q", "8"))
    screen.wait(lambda: screen.frames and screen.frames[-1].state.tuning.q == 8)
    assert str(screen.told[0]) == "a view broke"
    engine.stop()


@pytest.mark.slow
def test_drawn_indices_are_chosen_once_for_one_view(running):
    session, screen = running
    last = session.request(set_exponent("q", -1.0))
    screen.wait(lambda: screen.frames and screen.frames[-1].serial == last)
    again = session.request(set_exponent("q", -2.0))
    screen.wait(lambda: screen.frames[-1].serial == again)
    assert screen.frames[-1].drawn is screen.frames[-2].drawn


@pytest.mark.slow
@pytest.mark.parametrize("delay", [0.0, 0.05])
def test_no_part_is_left_out_while_requests_keep_coming(session, delay):
    screen, stopping = Screen(delay), threading.Event()
    engine = Engine(session, screen.show, screen.tell)

    def move():
        step = 0
        while not stopping.wait(0.001):
            step += 1
            session.request(set_exponent("q", -3.0 + 0.01 * (step % 500)), key="slider q")

    mover = threading.Thread(target=move)
    engine.start()
    mover.start()
    often = (Part.SIGNAL, Part.NUMBERS, Part.CHARTS, Part.OTHER)
    screen.wait(lambda: all(len(screen.drawn[part]) >= 4 for part in often))
    assert screen.drawn[Part.FULL] == screen.drawn[Part.FULL][:1]  # only that of the first frame
    stopping.set()
    mover.join()
    last = session.request(set_exponent("q", -1.0))
    screen.wait(lambda: all(serials[-1] == last for serials in screen.drawn.values()))
    for serials in screen.drawn.values():
        assert serials == sorted(serials)
    engine.stop()
