"""What a box shows when it is left alone is what the filter uses, however fast it was typed."""

from __future__ import annotations

import contextlib
import itertools

import pytest
from tests.browser.screen import Screen
from tests.support.effort import FUZZ
from tests.support.waiting import wait_until

from kalscope.sources.grammar.read_options import DEFAULTS
from kalscope_app.dashboard import Dashboard
from kalscope_app.guard.server import guarded_server
from kalscope_app.open_command import first_state
from kalscope_app.program.user_settings import FOLDER_VARIABLE, UserSettings
from kalscope_app.session.changes import set_text
from kalscope_app.views.widgets import typed
from kalscope_app.views.window import page_script

pytestmark = pytest.mark.browser
Q, R = "process noise q", "measurement noise r"
DELAYS = (20, 60, 90, 130)
"""Milliseconds between two keys."""


@pytest.fixture(scope="module")
def typing_page(browser, tmp_path_factory):
    """The session of a dashboard of this process, a page on it, and the state that both begin with."""
    folder = tmp_path_factory.mktemp("typing")
    UserSettings(folder).keep(tour_seen=True)
    with pytest.MonkeyPatch.context() as patch, contextlib.ExitStack() as running:
        patch.chdir(folder)
        patch.setenv(FOLDER_VARIABLE, str(folder))
        state = first_state("demo", DEFAULTS, None)
        start = guarded_server(port=0, page_script=page_script(), max_upload_bytes=2**20, on_refused=print)
        guarded = running.enter_context(start)
        dashboard = Dashboard(guarded.server, state, folder)
        running.callback(dashboard.stop)
        dashboard.start()
        yield dashboard.session, running.enter_context(Screen(browser, guarded.url, width=1090, height=720)), state


@pytest.fixture
def demo_page(typing_page):
    """The session and the page of the demo, as they begin: all tests of this file share them."""
    session, screen, state = typing_page
    session.request(lambda _: state)
    wait_until(lambda: tuning_of(session) == state.tuning, "the state at the beginning")
    screen.tab("Tune")
    for label, value in ((Q, state.tuning.q), (R, state.tuning.r)):
        wait_until(lambda label=label, value=value: screen.text_box(label).input_value() == typed(value), label)
    return session, screen


def tuning_of(session):
    seen = []
    session.with_state(lambda state: seen.append(state.tuning))
    wait_until(lambda: seen, "the state")
    return seen[0]


def retype(screen, label, text, delay=0):
    """Put the cursor into a box and type another text, key by key."""
    screen.text_box(label).click()
    screen.page.keyboard.press("ControlOrMeta+a")
    screen.page.keyboard.type(text, delay=delay)


NUMBERS = "47", "3,5", "8e-4", "0.83", "12", "2,7", "5e-9", "0.29", "64", "9,1", "1e-2", "0.55"
"""Texts as they are typed, short and long."""


@pytest.mark.slow
def test_every_typed_number_counts(demo_page):
    """Every kind of text, ended with Enter, by leaving the box, or not at all."""
    session, screen = demo_page
    rounds = 1 if FUZZ == 1 else 5
    ends, delays, labels = map(itertools.cycle, (("Enter", "Tab", None), DELAYS, (Q, Q, R, Q, R)))
    for text, key, delay, label in zip(NUMBERS * rounds, ends, delays, labels, strict=False):
        retype(screen, label, text, delay)
        if key:
            screen.page.keyboard.press(key)
        value, name = float(text.replace(",", ".")), "q" if label == Q else "r"
        wait_until(lambda name=name, value=value: getattr(tuning_of(session), name) == value, f"{name} = {text}")
        screen.wait_for_value(label, typed(value))


def test_what_is_being_typed_is_neither_overwritten_nor_lost(demo_page):
    session, screen = demo_page
    box = screen.text_box(Q)
    retype(screen, Q, "1e")
    session.request(set_text("q", "5"))  # as the end of a search would
    session.request(set_text("r", "6"))
    wait_until(lambda: screen.text_box(R).input_value() == "6", "the other box follows")
    assert box.input_value() == "1e"
    screen.page.keyboard.type("-3")
    screen.page.keyboard.press("Enter")
    wait_until(lambda: tuning_of(session).q == 0.001, "what was typed")
    wait_until(lambda: box.input_value() == "0.001", "what the filter uses")


def test_escape_brings_back_what_the_filter_uses(demo_page):
    session, screen = demo_page
    box, before = screen.text_box(Q), tuning_of(session)
    shown = box.input_value()
    retype(screen, Q, "77")
    screen.page.keyboard.press("Escape")
    wait_until(lambda: box.input_value() == shown, "the number before")
    screen.page.keyboard.press("Tab")
    assert tuning_of(session) == before

    retype(screen, Q, "78")
    wait_until(lambda: tuning_of(session).q == 78.0, "the pause after a complete number")
    screen.page.keyboard.press("Escape")
    wait_until(lambda: typed(tuning_of(session).q) == shown, "the number before in the filter")
    wait_until(lambda: box.input_value() == shown, "and in its box")
