"""The system's Chromium, headless and drawing in software."""

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
    "--use-gl=angle",  # viser draws no widget without WebGL: draw it in software
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-accelerated-2d-canvas",  # charts through SwiftShader take a second a frame
    "--disable-gpu-rasterization",
    "--disable-gpu-compositing",  # pages are put together without SwiftShader, at a fifth of the work
    "--disable-quic",  # and nothing that calls home
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    f"--disable-features={','.join(NEEDLESS)}",
)

NO_CANVAS = """for (const name of ["drawArrays", "drawElements", "drawArraysInstanced", "drawElementsInstanced"])
    WebGL2RenderingContext.prototype[name] = () => {};"""
"""Leaves viser's 3-D canvas empty. Drawing it in software takes more time than all the rest of a page."""

NO_SMOOTHING = """const open = HTMLCanvasElement.prototype.getContext;
    HTMLCanvasElement.prototype.getContext = function(kind, wanted) {
        return open.call(this, kind, kind.startsWith("webgl") ? {...wanted, antialias: false} : wanted); };"""
"""Edges of the 3-D canvas are drawn with one sample a pixel: in software each sample costs as much as the first."""
