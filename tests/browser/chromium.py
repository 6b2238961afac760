"""The system's Chromium, headless and without WebGL."""

from __future__ import annotations

import shutil

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
NEEDLESS = (
    "WebUIOmniboxPopup",  # pages behind the address bar of every window: a fifth of the work of opening a page
    "WebUIOmniboxAimPopup",
    "PaintHolding",  # this list takes the place of playwright's: what is still needed of that one
    "HttpsUpgrades",
    "HttpsFirstBalancedModeAutoEnable",
    "ThirdPartyStoragePartitioning",
    "LensOverlay",
    "MediaRouter",  # what calls home
    "OptimizationHints",
    "NetworkTimeServiceQuerying",
    "AimEnabled",
    "PreconnectToSearch",
)
"""Features of Chromium that no test needs."""
FLAGS = (
    "--no-sandbox",  # tests run as root
    "--disable-gpu",
    "--disable-3d-apis",  # nobody needs WebGL: scene.js takes its place, whether there is one or not
    "--disable-quic",  # and nothing that calls home
    "--js-flags=--no-opt --no-maglev",  # a page of a test ends before compiling it for speed is worth the work
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    f"--disable-features={','.join(NEEDLESS)}",
)
