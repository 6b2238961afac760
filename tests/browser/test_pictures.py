"""The pictures of the documentation show the screen of today."""

from __future__ import annotations

import json

import pytest
from tests.browser.pictures import FOLDER, PICTURES, STAMPS, on_screen, said
from tests.support.effort import FUZZ
from tests.support.waiting import wait_until

pytestmark = pytest.mark.browser

LONG = {"dark", "phone", "goal", "fleet", "live"} if FUZZ == 1 else set()
"""Left to `make soak`: a fleet and a board take ten seconds each; the goal, the dark theme and the phone show what
the first picture shows, and `make pictures` makes all of them."""


@pytest.mark.parametrize("name", [name for name in PICTURES if name not in LONG])
def test_a_picture_is_as_new_as_the_screen_it_shows(name, browser, one_page, tmp_path):
    """Where this fails, `make pictures` makes all of them again."""
    picture, kept = PICTURES[name], json.loads(STAMPS.read_text(encoding="utf-8"))[name]
    with on_screen(picture, browser, one_page, tmp_path) as screen:
        try:
            wait_until(lambda: said(screen, picture) == kept, f"the screen of {name}.png")
        except AssertionError:
            assert said(screen, picture) == kept
    assert (FOLDER / f"{name}.png").stat().st_size > 20_000
