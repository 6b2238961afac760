"""A page that many tests share, because to open one takes 2 s of work: it shows another source when asked."""

from __future__ import annotations

import contextlib
from multiprocessing.connection import Listener

from tests.browser.reopening import SOURCE
from tests.browser.screen import LEAVE, Screen, settings_in
from tests.support.program import end, running

from kalscope_app.program.user_settings import UserSettings

ARE_CLOSED = """(closed) => [...document.querySelectorAll(':has(> .tabler-icon-chevron-down)')]
    .every((heading) => !closed.includes(heading.textContent) || !heading.nextElementSibling.checkVisibility())"""
"""Whether no section of these names is still closing: one that is opened meanwhile would stay empty."""

NO_NOTIFICATION = """() => {
    for (const button of document.querySelectorAll('.mantine-Notification-closeButton')) button.click();
    return !document.querySelector('.mantine-Notification-root'); }"""
"""Closes notifications; whether there is none."""


class SharedPage(Screen):
    """A page that shows what `kalscope open SOURCE` shows first, as often as asked."""

    def __init__(self, browser, url, program, settings):
        """Args: the browser; the link; the connection to `reopening.serve`; the settings of the program."""
        super().__init__(browser, url)
        self._program, self._sections = program, program.recv()
        self.settings = settings

    def open(self, source, width=1600, height=900):
        """Begin with a source in a window of this size."""
        self.page.mouse.move(2, 2)
        self.page.set_viewport_size({"width": width, "height": height})
        self._program.send(source)
        mark = self._program.recv()
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
        for heading in reversed(self.page.query_selector_all(":has(> .tabler-icon-chevron-up)")):  # inner first
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
