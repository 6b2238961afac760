"""The system's Chromium, headless and drawing in software."""

from __future__ import annotations

import shutil

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
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
)

NO_CANVAS = """for (const name of ["drawArrays", "drawElements", "drawArraysInstanced", "drawElementsInstanced"])
    WebGL2RenderingContext.prototype[name] = () => {};"""
"""Leaves viser's 3-D canvas empty. Drawing it in software takes more time than all the rest of a page."""
