"""What the browser benchmarks share: the real program in a process of its own, and a real Chromium on it."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from playwright.sync_api import Browser, Locator, Page, sync_playwright

from kalscope_app.program.user_settings import FOLDER_VARIABLE, UserSettings

PROGRAM = Path(sys.executable).with_name("kalscope")
BROWSERS = ("chromium", "chromium-browser", "google-chrome")
FLAGS = (
    "--no-sandbox",
    "--use-gl=angle",  # stock viser draws no widget without WebGL: draw it in software
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-accelerated-2d-canvas",  # but the charts on the CPU: through the software GL one takes 0.8 s
    "--disable-gpu-rasterization",
    "--disable-quic",  # and nothing that calls home
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)

MAP_DRAWN = 4000
"""Milliseconds in which the map of a million samples is computed and drawn."""

SIGNAL_CHART = """Object.values(window.__viserTestpoints?.uplots ?? {}).map(entry => entry.chart)
    .find(chart => chart.series.some(series => series.label === 'filtered'))"""
"""JavaScript expression: the uPlot chart that holds the filtered line, undefined while there is none."""

FILTERED = "chart.data[chart.series.findIndex(series => series.label === 'filtered')]"
"""JavaScript expression: the numbers that the filtered line of `chart` is drawn from."""


class Program:
    """`kalscope open SOURCE`, or a program with the same arguments, in a process of its own; use it in a `with`."""

    def __init__(
        self,
        source: str,
        program: Sequence[str | Path] = (PROGRAM, "open"),
        *,
        map_shown: bool = False,
        folder: Path | None = None,
        environment: Mapping[str, str] | None = None,
    ) -> None:
        """Start it, and wait until it prints its link.

        Args:
            source: what it opens.
            program: the command before the source.
            map_shown: whether the map was open when it was last used.
            folder: where it runs and keeps its settings; None = a new one, deleted at the end.
            environment: variables that take the place of those of this process.
        """
        self._folder = tempfile.TemporaryDirectory(prefix="kalscope-bench-")
        self.folder = folder or Path(self._folder.name)
        # the window of the tour would cover what is measured
        UserSettings(self.folder).keep(tour_seen=True, map_shown=map_shown)
        self.process = subprocess.Popen(
            [*program, source, "--port", "0", "--no-browser"],
            cwd=self.folder,  # recordings go there
            env={**os.environ, **(environment or {}), FOLDER_VARIABLE: str(self.folder)},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        self._errors: list[str] = []
        self._reader = threading.Thread(target=self._read_errors, daemon=True)
        self._reader.start()  # a full pipe would stop the program
        self.url = self._wait_for_line()

    def _read_errors(self) -> None:
        self._errors.extend(self.process.stderr or ())

    def _wait_for_line(self) -> str:
        for line in self.process.stdout or ():
            if line.startswith("Kalscope: http"):
                return line.split()[1]
        self._reader.join(timeout=5.0)
        raise RuntimeError(f"kalscope must print its link (it ended): {''.join(self._errors)}")

    def __enter__(self) -> Program:
        return self

    def __exit__(self, *_: object) -> None:
        self.process.send_signal(signal.SIGTERM)
        try:
            self.process.wait(timeout=15.0)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        if self.process.stdout is not None:
            self.process.stdout.close()
        self._folder.cleanup()


@contextmanager
def chromium() -> Iterator[Browser]:
    """A headless system Chromium."""
    path = next(filter(None, map(shutil.which, BROWSERS)), None)
    if path is None:
        raise SystemExit(f"one of {', '.join(BROWSERS)} must be installed (got none)")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=list(FLAGS))
        try:
            yield browser
        finally:
            browser.close()


@contextmanager
def dashboard_page(browser: Browser, url: str, *, live: bool = False) -> Iterator[Page]:
    """A page on the dashboard, charts drawn, nothing but a board still moving."""
    context = browser.new_context(viewport={"width": 1600, "height": 900})
    try:
        page = context.new_page()
        page.set_default_timeout(30_000)
        page.goto(url)
        page.wait_for_function(f"() => {SIGNAL_CHART}?.data[0].length > 2")
        if not live:
            wait_until_quiet(page)
        yield page
    finally:
        context.close()


def wait_until_quiet(page: Page, milliseconds: int = 400) -> None:
    """Wait until the signal chart has kept its width, height and numbers for so long."""
    page.evaluate("() => { window.__quiet = null }")
    page.wait_for_function(
        f"""(least) => {{
            const chart = {SIGNAL_CHART};
            if (!chart) return false;
            const now = JSON.stringify([chart.width, chart.height, {FILTERED}.reduce((a, b) => a + b, 0)]);
            if (window.__quiet?.what !== now) window.__quiet = {{what: now, since: performance.now()}};
            return performance.now() - window.__quiet.since >= least;
        }}""",
        arg=milliseconds,
    )


def slider(page: Page, name: str) -> Locator:
    """The thumb of the slider of q, r, p0 or momentum."""
    label = re.compile("^τ " if name == "momentum" else f"^log₁₀ {name}$")  # that of τ goes on with its value
    root = page.locator("label", has_text=label).first.get_attribute("for")
    return page.locator(f'[id="{root}"] [role="slider"]')


def text_box(page: Page, label: str) -> Locator:
    """The text box whose label begins with `label`."""
    near = page.locator("label", has_text=label).first
    return near.locator("xpath=ancestor::*[.//input][1]//input").first


@contextmanager
def map_open(page: Page) -> Iterator[None]:
    """The map beside the charts, drawn; closed again after it."""
    page.get_by_role("button", name="Map", exact=True).click()
    page.get_by_role("button", name="Hide map").wait_for()
    page.wait_for_timeout(MAP_DRAWN)
    yield
    page.get_by_role("button", name="Hide map").click()
    wait_until_quiet(page, 1000)


def choose(page: Page, label: str, option: str) -> None:
    """Choose an option of a dropdown."""
    text_box(page, label).click()
    page.get_by_role("option", name=option, exact=True).click()
    page.wait_for_timeout(200)


def filtered_line(page: Page) -> list[float]:
    """The numbers that the filtered line is drawn from."""
    found: Any = page.evaluate(f"() => {{ const chart = {SIGNAL_CHART}; return Array.from({FILTERED}) }}")
    return [float(value) for value in found]
