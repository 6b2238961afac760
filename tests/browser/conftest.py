"""A Chromium and a page for all browser tests of a worker, a Firefox. A missing tool is a skip, or a failure."""

from __future__ import annotations

import contextlib
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from tests.browser.chromium import CHROMIUM, FLAGS
from tests.browser.screen import Screen, SharedPage, dashboard, shared_page
from tests.support.required import not_here

FIREFOX = next(filter(None, map(shutil.which, ("firefox-esr", "firefox"))), None)
UNPATCHED = "moz-firefox"
"""Playwright's name for a Firefox as it is installed."""


@pytest.fixture(scope="session")
def playwright():
    """What drives browsers."""
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        not_here("playwright is not installed")
    with sync_playwright() as driver:
        yield driver


@pytest.fixture(scope="session")
def browser(playwright):
    """A headless Chromium. Take a fresh `browser.new_context()` for each visitor: they share no cookies."""
    if CHROMIUM is None:
        not_here("Chromium is not installed")
    chromium = playwright.chromium.launch(executable_path=CHROMIUM, args=list(FLAGS))
    yield chromium
    chromium.close()


@pytest.fixture(scope="module")
def firefox(playwright):
    """A headless Firefox, to be used as the Chromium."""
    if FIREFOX is None:
        not_here("Firefox is not installed")
    no_webgl = {"webgl.disabled": True}  # nobody needs it: as in the Chromium of the tests
    browser = playwright.firefox.launch(channel=UNPATCHED, executable_path=FIREFOX, firefox_user_prefs=no_webgl)
    yield browser
    browser.close()


@pytest.fixture(scope="session")
def program_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the program that tests share runs."""
    return tmp_path_factory.mktemp("program")


@pytest.fixture
def tmp_path(program_folder: Path) -> Path:
    """The folder of the program that tests share, empty."""
    for one in program_folder.iterdir():
        shutil.rmtree(one) if one.is_dir() else one.unlink()
    return program_folder


@pytest.fixture(scope="session")
def one_page(browser, program_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[SharedPage]:
    """A page that shows one source after the other."""
    with shared_page(browser, program_folder, tmp_path_factory.mktemp("own")) as screen:
        yield screen


@pytest.fixture
def start(browser, tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[Callable[..., Screen]]:
    """Open a page on a source: the one that tests share, or with `own` a program and a page of its own."""
    with contextlib.ExitStack() as running:

        def begin(*arguments: object, own: bool = False, **page: object) -> Screen:
            if own:
                url = running.enter_context(dashboard(*arguments, cwd=tmp_path))
                return running.enter_context(Screen(browser, url, **page))
            screen: SharedPage = request.getfixturevalue("one_page")
            screen.open(*arguments, failures=request.session.testsfailed, **page)
            running.callback(screen.check)
            return screen

        yield begin
