"""One Chromium for all browser tests. A missing tool is a skip with a reason, or a failure where required."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from chromium import CHROMIUM, FLAGS
from required import not_here
from screen import Screen, dashboard

if TYPE_CHECKING:
    from playwright.sync_api import Browser


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    """A headless Chromium. Take a fresh `browser.new_context()` for each visitor: they share no cookies."""
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        not_here("playwright is not installed")
    if CHROMIUM is None:
        not_here("Chromium is not installed")
    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=CHROMIUM, args=list(FLAGS))
        yield chromium
        chromium.close()


@pytest.fixture
def start(browser: Browser, tmp_path: Path) -> Iterator[Callable[..., Screen]]:
    """Start the program with arguments and open a page on it."""
    with contextlib.ExitStack() as running:

        def begin(*arguments: object, **page: int) -> Screen:
            url = running.enter_context(dashboard(*arguments, cwd=tmp_path))
            return running.enter_context(Screen(browser, url, **page))

        yield begin
