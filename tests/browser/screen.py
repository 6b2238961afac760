"""The dashboard as a user has it: the real program, a real browser, and what stands on the screen.

Many tests share a page, because to open one takes 2 s of work: it shows another source when asked.
"""

from __future__ import annotations

import contextlib
import io
import os
import re
from dataclasses import replace
from multiprocessing.connection import Listener
from pathlib import Path

import numpy as np
from axe_playwright_python.base import AXE_SCRIPT
from PIL import Image
from tests.browser.reopening import SOURCE
from tests.support.program import end, running
from tests.support.waiting import PATIENCE, wait_until

from kalscope import kalman_filter
from kalscope.estimation.request import starting_params
from kalscope_app.program.user_settings import FOLDER_VARIABLE, UserSettings
from kalscope_app.views.goal import MORE_FOLDER

ARTEFACTS = Path(__file__).parents[1] / "artefacts"
PICTURES = bool(os.environ.get("KALSCOPE_PICTURES"))
"""Whether every browser test leaves a picture in `ARTEFACTS`."""
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

NOTE_NOTICES = """window.notices = new Set(); new MutationObserver(() => {
    for (const one of document.querySelectorAll('.mantine-Notification-root')) notices.add(one.textContent);
    }).observe(document, { childList: true, subtree: true });"""
"""Keeps the text of every notice: one closes after 8 s, or for the next one, before a busy machine looks for it."""

NAMED = "() => new Promise((done) => setTimeout(done, 250))"
"""Until the page has named what is new: it does so by a timer of 200 ms, which was set before this one."""

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

OPENED = "xpath=//*[contains(@class, 'tabler-icon-chevron-up')]/.."
"""Headings of the sections that are open."""

ARE_CLOSED = """(closed) => [...document.querySelectorAll(':has(> .tabler-icon-chevron-down)')]
    .every((heading) => !closed.includes(heading.textContent) || !heading.nextElementSibling.checkVisibility())"""
"""Whether no section of these names is still closing: one that is opened meanwhile would stay empty."""

NO_NOTIFICATION = """() => {
    for (const button of document.querySelectorAll('.mantine-Notification-closeButton')) button.click();
    notices.clear();
    return !document.querySelector('.mantine-Notification-root'); }"""
"""Closes notices and forgets them; whether none is open."""


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

    def __init__(self, browser, url, width=1440, height=900, script=""):
        self.context = browser.new_context(viewport={"width": width, "height": height}, accept_downloads=True)
        self.context.add_init_script(NOTE_NOTICES + script)
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

    def button(self, name):
        return self.page.get_by_role("button", name=name, exact=True)

    def press(self, name):
        """By the keyboard: what is written above a button may move it away from the mouse."""
        self.pause()
        self.page.get_by_role("button", name=name, exact=True, disabled=False).press("Enter")

    def wait_for_text(self, text):
        self.page.get_by_text(text).first.wait_for()

    def open_more(self):
        """Open the folder of the settings that are needed less."""
        self.page.get_by_role("button", name=MORE_FOLDER).press("Enter")

    def darken(self):
        """Choose the dark theme."""
        self.tab("View")
        self.page.get_by_text("dark theme").click()
        self.wait("() => document.documentElement.dataset.mantineColorScheme === 'dark'")

    def text_box(self, label):
        """The text box whose label begins so; viser's label sits beside the input."""
        row = self.page.locator("label", has_text=re.compile(f"^{re.escape(label)}"))
        return row.locator("xpath=ancestor::*[.//input][1]").locator("input").first

    def q_and_r(self):
        """The numbers in their text boxes."""
        return [float(self.text_box(name).input_value()) for name in ("process noise q", "measurement noise r")]

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

    def retype(self, label, text, delay=0):
        """Put the cursor into a text box and type another text, key by key; `delay` in ms."""
        self.text_box(label).click()
        self.page.keyboard.press("ControlOrMeta+a")
        self.page.keyboard.type(text, delay=delay)

    def pause(self):
        """viser throttles all widgets of a panel together, 50 ms: faster than any hand it loses a value."""
        self.page.wait_for_timeout(80)

    def choose(self, label, option):
        self.pause()
        self.text_box(label).click()
        self.page.get_by_role("option", name=option, exact=True).click()

    def tick(self, sensor):
        """Tick a sensor of those that are fused, or take it away."""
        self.pause()
        self.page.get_by_label(re.compile(f"^{sensor}(: share .*)?$")).click()

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

    def wait_for_notice(self, text):
        """Until a notice with this text was shown, be it still open or not."""
        self.wait("(text) => [...notices].some((one) => one.includes(text))", text)

    def wait_for_picture(self, holds):
        """Until `holds` is true of the page's pixels, (height, width, 3)."""
        wait_until(lambda: holds(pixels(self.page.screenshot())), "the picture", pause=0.2)  # a look is much work

    def axe_findings(self, rules=()):
        """Each violation on the page that axe-core, the judge of accessibility, finds by these rules, () = all.

        The work is nearly the same for a part of the page as for all of it.
        """
        if not self.page.evaluate("() => !!window.axe"):
            self.page.evaluate(AXE_SCRIPT)
        self.page.evaluate(NAMED)
        violations = self.page.evaluate(
            """(rules) => axe.run({ resultTypes: ['violations'], preload: false,
                ...(rules.length && { runOnly: rules }) }).then((found) => found.violations)""",
            list(rules),
        )
        return [
            f"{violation['id']}: {node['html'][:120]} {' '.join(check['message'] for check in node['any'])}"
            for violation in violations
            for node in violation["nodes"]
        ]

    def close(self):
        self.check()
        self.context.close()

    def check(self):
        """No script of the page has failed; where pictures are asked for, leave one of the end of the test."""
        if PICTURES:
            ARTEFACTS.mkdir(exist_ok=True)
            name = os.environ.get("PYTEST_CURRENT_TEST", "").partition("::")[2].partition(" ")[0]
            self.page.screenshot(path=ARTEFACTS / f"{name[:100]}.png")
        unknown = [error for error in self.page_errors if not any(known in error for known in KNOWN_PAGE_ERRORS)]
        assert unknown == []


class SharedPage(Screen):
    """A page that shows what `kalscope open SOURCE` shows first, as often as asked."""

    def __init__(self, browser, url, program, settings):
        """Args: the browser; the link; the connection to `reopening.serve`; the settings of the program."""
        super().__init__(browser, url)
        self._program, self._sections = program, program.recv()
        self.settings, self._failures = settings, 0

    def open(self, source, width=1440, height=900, failures=0):
        """Begin with a source in a window of this size; load the page anew if a test has failed since."""
        self.page.mouse.move(2, 2)
        self.page.set_viewport_size({"width": width, "height": height})
        while self._program.poll():
            self._program.recv()  # the answer to a test that has failed
        self._program.send(source)
        assert self._program.poll(PATIENCE), f"{source} must be shown within {PATIENCE:g} s"
        mark = self._program.recv()
        if failures > self._failures:
            self._failures = failures
            self.page_errors.clear()
            self.page.mouse.up()
            self.page.reload()
        if isinstance(mark, Exception):
            raise mark
        self.wait("(mark) => !!document.getElementById(mark)", mark)
        self._close_sections()
        self.wait(NO_NOTIFICATION)
        for tab in self.page.query_selector_all("[data-dock-tab][aria-selected=false]:first-child"):
            tab.click()
        if self.page.evaluate(LEAVE):
            self.pause()  # what a text box sends as it is left must not swallow the first click of the test

    def _close_sections(self):
        """Close what a fresh page has closed, each in its tab: out of sight, its transition would never end."""
        for heading in reversed(self.page.query_selector_all(OPENED)):  # inner first
            if heading.text_content() in self._sections:
                for tab in self.page.query_selector_all("[data-dock-tab]"):
                    if heading.is_visible():
                        break
                    tab.click()
                heading.evaluate("(heading) => heading.click()")  # one that no tab shows now is closed too
                self.wait(ARE_CLOSED, self._sections)


@contextlib.contextmanager
def shared_page(browser, folder, own):
    """A page on a program in a folder, whose own files are in another one."""
    address = str(own / "sources")
    env = {**settings_in(own), "TMPDIR": str(own), "XDG_STATE_HOME": str(own)}
    change = f"from tests.browser import reopening; reopening.connect({address!r})"
    with (
        Listener(address) as sources,
        running(folder, "open", SOURCE, source=None, env=env, change=change) as (program, url),
        sources.accept() as connection,
        SharedPage(browser, url, connection, UserSettings(own)) as page,
    ):
        yield page
        code, _, err = end(program)
        assert code == 0, err


def filtered(z, **params):
    """What the chart must show of samples, at the starting values but for these."""
    return kalman_filter(z, replace(starting_params(z), **params)).x


def pixels(png):
    """The pixels of a screenshot, (height, width, 3)."""
    return np.asarray(Image.open(io.BytesIO(png)).convert("RGB")).astype(int)
