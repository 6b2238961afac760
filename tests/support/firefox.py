"""The system's Firefox, headless: playwright drives it over WebDriver BiDi and brings no browser of its own."""

from __future__ import annotations

import shutil

FIREFOX = next(filter(None, map(shutil.which, ("firefox-esr", "firefox"))), None)
CHANNEL = "moz-firefox"
"""Playwright's name for a Firefox that it has not patched."""
PREFERENCES = {
    "webgl.disabled": True,  # nobody needs WebGL: as in the Chromium of the tests
}
