"""The dashboard as a user has it: the real program, a real Chromium, and what stands on the screen."""

from __future__ import annotations

import contextlib
import io
import os
import re
from pathlib import Path

import numpy as np
from PIL import Image
from tests.support.program import end, running
from tests.support.waiting import PATIENCE, wait_until

from kalscope_app.program.user_settings import FOLDER_VARIABLE, UserSettings

ARTEFACTS = Path(__file__).parents[1] / "artefacts"
PICTURES = bool(os.environ.get("KALSCOPE_PICTURES"))
"""Whether every step of the browser tests leaves a picture in `ARTEFACTS`."""
KNOWN_PAGE_ERRORS = (
    "'unsafe-eval' is not an allowed source",
    "blocked a JavaScript eval",
    "call to Function() blocked by CSP",
)
"""viser's splat sorter probes for eval and does without it; the guard's policy refuses it. Of both browsers."""

FIND = """(label) => {
    const charts = Object.values(window.__viserTestpoints?.uplots ?? {}).map(entry => entry.chart)
        .filter(chart => chart.series.some(series => series.label === label));
    return charts.find(chart => chart.scales.x.distr !== 3) ?? charts[0]; }"""
"""The chart with a line of this label: that over time rather than the spectrum, which has the same labels."""

LEAVE = "() => { const left = document.activeElement; left.blur(); return left !== document.body; }"
"""Takes the focus from what has it; whether any control had it."""

FITS = """() => { const box = (one) => one.getBoundingClientRect(), map = box(document.querySelector('canvas'));
    const [left, right] = ['left', 'right'].map(edge => box(document.querySelector(`[data-dock-region=${edge}]`)));
    const pane = [...document.querySelectorAll('[data-dock-region=right] .mantine-ScrollArea-viewport')]
        .find(view => view.checkVisibility());
    const charts = [...pane.querySelectorAll('.uplot')].map(box), near = (a, b) => Math.abs(a - b) < 12;
    const open = near(map.right, right.left) && near(left.right, map.left)
        && near(map.width, Math.min(innerHeight / 2, Math.max(300, 0.38 * (innerWidth - 355))));
    return near(left.width, 345) && (open || near(left.right, right.left)) && near(right.right, innerWidth)
        && charts.length > 1 && charts.every(chart => near(chart.width, right.width - 20))
        && pane.scrollHeight <= pane.clientHeight
        && pane.clientHeight - (charts.at(-1).bottom - box(pane).top) < 40; }"""
"""Whether both panels, an open map between them and the charts of the Signal tab fill the window."""


@contextlib.contextmanager
def dashboard(*arguments, cwd, first_run=False):
    """The link of `kalscope open` in a process of its own, which must end in order when the block does."""
    env = settings_in(Path(cwd) / "config", tour_seen=not first_run)
    with running(Path(cwd), "open", *map(str, arguments), source=None, env=env) as (program, url):
        yield url
        code, _, err = end(program)
        assert code == 0, err


def settings_in(folder, *, tour_seen=True):
    """The environment in which a program keeps its settings in a folder."""
    if tour_seen:
        UserSettings(folder).keep(tour_seen=True)
    return {FOLDER_VARIABLE: str(folder)}


class Screen:
    """One page on the program, in either browser."""

    def __init__(self, browser, url, width=1600, height=900, script=""):
        self.context = browser.new_context(viewport={"width": width, "height": height}, accept_downloads=True)
        if script:
            self.context.add_init_script(script)
        self.page = self.context.new_page()
        self.page.set_default_timeout(1000 * PATIENCE)
        self.page_errors = []
        self.page.on("pageerror", lambda error: self.page_errors.append(str(error)))
        self.url = url
        self.page.goto(url)
        self.ready()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    def ready(self):
        """Charts are drawn."""
        self.wait(f"() => ({FIND})('filtered') && ({FIND})('innovation')")

    def wait(self, condition, argument=None):
        self.page.wait_for_function(condition, arg=argument, polling=50)  # ms; else at every frame

    def wait_for_fit(self):
        """Until panels, map and charts fill the window."""
        self.wait(FITS)

    def line(self, label):
        """Values that are drawn under a label, and their x."""
        x, y = self.page.evaluate(
            f"""(label) => {{ const chart = ({FIND})(label);
            const at = chart.series.findIndex(series => series.label === label);
            return [Array.from(chart.data[0]), Array.from(chart.data[at])]; }}""",
            label,
        )
        return np.array(x), np.array(y, dtype=float)

    def wait_for_line(self, label, expected, tolerance=0.0):
        """Until the drawn line equals `expected`."""
        self.wait(
            f"""([label, expected, tolerance]) => {{ const chart = ({FIND})(label);
            if (!chart) return false;
            const y = chart.data[chart.series.findIndex(series => series.label === label)];
            return y.length === expected.length
                && expected.every((value, i) => Math.abs(value - y[i]) <= tolerance); }}""",
            [label, np.asarray(expected).tolist(), tolerance],
        )

    def range(self, axis, label="filtered"):
        """Lowest and highest value that an axis shows."""
        return self.page.evaluate(
            f"([axis, label]) => {{ const {{min, max}} = ({FIND})(label).scales[axis]; return [min, max]; }}",
            [axis, label],
        )

    def tab(self, name):
        self.page.get_by_role("tab", name=name, exact=True).click()

    def text_box(self, label):
        """The text box whose label begins so; viser's label sits beside the input."""
        row = self.page.locator("label", has_text=re.compile(f"^{re.escape(label)}"))
        return row.locator("xpath=ancestor::*[.//input][1]").locator("input").first

    def wait_for_value(self, label, value):
        """Until a text box shows `value`: a chart may be drawn before the boxes follow."""
        from playwright.sync_api import expect  # absent where these tests are skipped

        expect(self.text_box(label)).to_have_value(value, timeout=1000 * PATIENCE)

    def slider(self, name):
        """The slider of q, r or p0, by the row that bears its label."""
        row = self.page.locator("label", has_text=re.compile(f"^log₁₀ {name}$"))
        return row.locator("xpath=ancestor::*[.//*[@role='slider']][1]").get_by_role("slider").first

    def type(self, label, text, enter=True):
        box = self.text_box(label)
        self.pause()
        box.fill(text)
        self.pause()
        if enter:
            box.press("Enter")
            self.page.evaluate(LEAVE)  # a box that is left later sends its text once more, and swallows a click

    def pause(self):
        """viser throttles all widgets of a panel together, 50 ms: faster than any hand it loses a value."""
        self.page.wait_for_timeout(80)

    def choose(self, label, option):
        self.pause()
        self.text_box(label).click()
        self.page.get_by_role("option", name=option, exact=True).click()

    def upload(self, button, path):
        """Choose a file in the dialog that the button of this name opens."""
        self.pause()
        with self.page.expect_file_chooser() as chooser:
            self.page.get_by_role("button", name=button).click()
        chooser.value.set_files(path)

    def download(self, button, path=None):
        """The bytes that the button of this name sends, saved at `path` too."""
        with self.page.expect_download() as download:
            self.page.get_by_role("button", name=button, exact=True).click()
        content = download.value.path().read_bytes()
        if path is not None:
            path.write_bytes(content)
        return content

    def notification(self, text):
        return self.page.locator(".mantine-Notification-root", has_text=text)

    def wait_for_picture(self, holds):
        """Until `holds` is true of the page's pixels, (height, width, 3)."""
        wait_until(lambda: holds(pixels(self.page.screenshot())), "the picture", pause=0.2)  # a look is much work

    def shot(self, name):
        """Take the mouse away and, where pictures are asked for, leave one: a tenth of a second of work each."""
        self.page.mouse.move(2, 2)
        if PICTURES:
            ARTEFACTS.mkdir(exist_ok=True)
            self.page.screenshot(path=ARTEFACTS / f"{name}.png")

    def close(self):
        self.context.close()
        self.check()

    def check(self):
        """No script of the page has failed."""
        unknown = [error for error in self.page_errors if not any(known in error for known in KNOWN_PAGE_ERRORS)]
        assert unknown == []


def pixels(png):
    """The pixels of a screenshot, (height, width, 3)."""
    return np.asarray(Image.open(io.BytesIO(png)).convert("RGB")).astype(int)
