"""The guard as a real Chromium meets it: the user's way in, and what a hostile page or text can do."""

from __future__ import annotations

import functools
import http.server
import queue
import threading
from contextlib import closing
from types import SimpleNamespace

import pytest
import viser
from tests.browser.screen import KNOWN_PAGE_ERRORS
from tests.support.waiting import PATIENCE

from kalscope_app.guard.requests import Policy
from kalscope_app.guard.server import guarded_server
from kalscope_app.views.window import page_script

pytestmark = pytest.mark.browser
LABEL = "process noise q"


@pytest.fixture(scope="module")
def dashboard():
    """A guarded server with a number to set, and what it was set to."""
    changed = queue.Queue()
    with guarded_server(port=0, page_script=page_script()) as running:
        number = running.server.gui.add_number(LABEL, 0.5)
        number.on_update(lambda event: changed.put(event.target.value))
        home = f"http://127.0.0.1:{running.port}{Policy(running.port, running.token).home}"
        yield SimpleNamespace(running=running, changed=changed, home=home)


@pytest.fixture(scope="module")
def hostile(tmp_path_factory):
    """Another program of this machine that serves a folder: same site, so even Strict cookies go along."""
    folder, cookies = tmp_path_factory.mktemp("hostile"), []
    (folder / "favicon.ico").touch()

    class Handler(http.server.SimpleHTTPRequestHandler):
        def do_GET(self):
            cookies.extend(self.headers.get_all("Cookie") or ())
            super().do_GET()

        def log_message(self, *_):
            """Keep the test's output quiet."""

    handler = functools.partial(Handler, directory=folder)
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever).start()
        yield SimpleNamespace(folder=folder, port=server.server_port, cookies=cookies)
        server.shutdown()


@pytest.fixture(scope="module")
def user(browser, dashboard, hostile):
    """The page of a user who came by a link on another site's page: `localhost` is another site than 127.0.0.1.

    No test leaves it: to load it is most of the work of these tests.
    """
    with browser.new_context(color_scheme="light") as context:
        context.set_default_timeout(1000 * PATIENCE)
        (hostile.folder / "mail.html").write_text(f'<a href="{dashboard.running.url}">the link</a>')
        page = context.new_page()
        page.goto(f"http://localhost:{hostile.port}/mail.html")
        page.complaints = []
        page.on("console", lambda one: page.complaints.append(one.text) if one.type == "error" else None)
        page.on("pageerror", lambda error: page.complaints.append(str(error)))
        page.get_by_text("the link").click()
        page.wait_for_url(dashboard.home)
        page.get_by_text(LABEL).wait_for()
        yield page


def test_the_link_on_another_sites_page_lets_the_user_in_and_keeps_him_in(dashboard, user):
    user.get_by_role("textbox").first.fill("2")
    assert dashboard.changed.get(timeout=PATIENCE) == 2
    assert [text for text in user.complaints if not any(known in text for known in KNOWN_PAGE_ERRORS)] == []
    (cookie,) = user.context.cookies()
    assert cookie["name"] == f"kalscope_{dashboard.running.port}"
    assert (cookie["httpOnly"], cookie["sameSite"]) == (True, "Strict")
    assert user.evaluate("document.cookie") == ""
    with closing(user.context.new_page()) as page:
        page.goto(dashboard.home)  # without the token
        page.get_by_text(LABEL).wait_for()


def test_a_hostile_page_gets_no_cookie_no_frame_and_no_socket_though_the_user_is_in(dashboard, user, hostile):
    """Browsers do not keep cookies of one port from another: its path does."""
    (hostile.folder / "inner.html").write_text("<p>a frame that may be shown</p>")
    (hostile.folder / "index.html").write_text(
        "<img src='/d/'><script>fetch('/x/y/', {credentials: 'include'})</script>"
        f'<iframe id="ours" src="{dashboard.home}"></iframe><iframe id="own" src="/inner.html"></iframe>'
    )
    with closing(user.context.new_page()) as page:
        with page.expect_console_message(lambda message: "frame-ancestors" in message.text):
            page.goto(f"http://127.0.0.1:{hostile.port}/")
        page.frame_locator("#own").get_by_text("a frame that may be shown").wait_for()
        assert page.locator("#ours").element_handle().content_frame().url.startswith("chrome-error:")
        assert opening_a_socket(page, dashboard) == "refused"
    assert opening_a_socket(user, dashboard) == "opened"
    assert hostile.cookies == []


def opening_a_socket(page, dashboard):
    """What becomes of a websocket to the dashboard that this page's script opens."""
    return page.evaluate(
        """([url, protocol]) => new Promise(resolve => {
            const socket = new WebSocket(url, protocol);
            socket.onopen = () => resolve("opened");
            socket.onerror = () => resolve("refused");
        })""",
        [dashboard.home.replace("http", "ws"), f"viser-v{viser.__version__}"],
    )


TAKE = "document.title='taken'"
MARKUP = {
    "html": (f'<img src=x onerror="{TAKE}">', "inline event handler violates"),
    "markdown": (f'<iframe srcdoc="<script>parent.{TAKE}</script>"></iframe>', "inline script violates"),
}
"""How it is shown, and what the browser says of it."""


def test_a_text_of_the_page_runs_no_script_and_nothing_connects_elsewhere(dashboard, user, hostile):
    """A second line: names from files are escaped before they are shown."""
    for kind, (markup, words) in MARKUP.items():
        with user.expect_console_message(lambda message, words=words: words in message.text):
            text = getattr(dashboard.running.server.gui, f"add_{kind}")(markup)
        assert user.title() == "Kalscope"
        text.remove()
    send = "url => fetch(url, {mode: 'no-cors'}).then(() => 'sent', () => 'blocked')"
    with user.expect_console_message(lambda message: "connect-src" in message.text):
        assert user.evaluate(send, f"http://127.0.0.1:{hostile.port}/stolen") == "blocked"
