"""The guard as a real Chromium meets it: the user's way in, and what a hostile page or text can do."""

from __future__ import annotations

import contextlib
import http.server
import queue
import threading
from collections.abc import Iterator
from types import SimpleNamespace
from typing import TYPE_CHECKING

import pytest
import viser
from tests.browser.chromium import CHROMIUM, FLAGS
from tests.support.waiting import PATIENCE

from kalscope_app.guard.requests import Policy
from kalscope_app.guard.server import GuardedServer, guarded_server
from kalscope_app.views.window import page_script

if TYPE_CHECKING:
    from playwright.sync_api import Browser, BrowserContext, Page

pytestmark = pytest.mark.browser

LABEL = "process noise q"
HARMLESS = "'unsafe-eval' is not an allowed source"
"""viser's page starts a sorter for Gaussian splats by eval. Kalscope draws no splats."""


@pytest.fixture(scope="module")
def dashboard() -> Iterator[SimpleNamespace]:
    """A guarded server with a number to set and an upload button, and what came of them."""
    changed, refused = queue.Queue(), queue.Queue()
    served = guarded_server(port=0, max_upload_bytes=2**20, on_refused=refused.put, page_script=page_script())
    with served as running:
        number = running.server.gui.add_number(LABEL, 0.5)
        number.on_update(lambda event: changed.put(event.target.value))
        running.server.gui.add_upload_button("Upload a recording")
        yield SimpleNamespace(running=running, changed=changed, refused=refused)


def new_context(browser: Browser) -> BrowserContext:
    context = browser.new_context(color_scheme="light")
    context.set_default_timeout(1000 * PATIENCE)
    return context


@pytest.fixture
def visitor(browser: Browser) -> Iterator[BrowserContext]:
    """A browser that has not been here before."""
    with new_context(browser) as context:
        yield context


@pytest.fixture(scope="module")
def arrival(browser: Browser, dashboard: SimpleNamespace) -> Iterator[SimpleNamespace]:
    """The page of a user who came by a link on another site's page, and what it complained about until then.

    No test leaves it: to load it is most of the work of these tests. `localhost` is another site than 127.0.0.1.
    """
    with another_program() as site, new_context(browser) as context:
        site.pages["/mail"] = f'<a href="{dashboard.running.url}">the link</a>'
        page = context.new_page()
        page.goto(f"http://localhost:{site.port}/mail")
        complaints = complaints_of(page)
        page.get_by_text("the link").click()
        page.wait_for_url(home(dashboard.running))
        page.get_by_text(LABEL).wait_for()
        yield SimpleNamespace(page=page, complaints=tuple(complaints))


@pytest.fixture
def user(arrival: SimpleNamespace) -> Page:
    """The page of a user who is in."""
    return arrival.page


@pytest.fixture
def hostile() -> Iterator[SimpleNamespace]:
    """Another program of this machine that serves pages."""
    with another_program() as served:
        yield served


@contextlib.contextmanager
def another_program() -> Iterator[SimpleNamespace]:
    """Another program of this machine that serves pages: same site, so even Strict cookies go along."""
    pages: dict[str, str] = {}
    cookies: list[str] = []

    class Handler(http.server.BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            cookies.extend(self.headers.get_all("Cookie") or ())
            body = pages.get(self.path, "").encode()
            self.send_response(200)
            self.send_header("Content-Type", "text/html")
            self.send_header("Content-Length", str(len(body)))
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, *_: object) -> None:  # pyright: ignore[reportIncompatibleMethodOverride]
            """Keep the test's output quiet."""

    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield SimpleNamespace(pages=pages, port=server.server_port, cookies=cookies)
        server.shutdown()
        thread.join()


def home(running: GuardedServer) -> str:
    return f"http://127.0.0.1:{running.port}{Policy(running.port, running.token).home}"


def complaints_of(page: Page) -> list[str]:
    """A list that fills with what the page's console and its scripts complain about."""
    found: list[str] = []
    page.on("console", lambda message: found.append(message.text) if message.type == "error" else None)
    page.on("pageerror", lambda error: found.append(str(error)))
    return found


# --- the user ---------------------------------------------------------------------------------------------


def test_the_link_on_another_sites_page_opens_a_live_dashboard_without_complaint(dashboard, arrival):
    arrival.page.get_by_role("textbox").first.fill("2")
    assert dashboard.changed.get(timeout=PATIENCE) == 2
    assert [text for text in arrival.complaints if HARMLESS not in text] == []


def test_the_cookie_is_out_of_reach_of_scripts_and_other_sites(dashboard, user):
    (cookie,) = user.context.cookies()
    assert cookie.get("name") == f"kalscope_{dashboard.running.port}"
    assert cookie.get("httpOnly") is True
    assert cookie.get("sameSite") == "Strict"
    assert user.evaluate("document.cookie") == ""


def test_the_address_without_the_token_keeps_the_user_in_and_no_other_server_is_handed_the_cookie(
    dashboard, user, hostile
):
    """Browsers do not keep cookies of one port from another: its path does."""
    page = user.context.new_page()
    hostile.pages["/"] = "<img src='/d/'><script>fetch('/x/y/', {credentials: 'include'})</script>hello"
    page.goto(f"http://127.0.0.1:{hostile.port}/")
    page.get_by_text("hello").wait_for()
    page.goto(home(dashboard.running))
    page.get_by_text(LABEL).wait_for()
    page.close()
    assert hostile.cookies == []


@pytest.mark.parametrize("query", ["", "?websocket=ws://127.0.0.1:1/", "?playbackPath=http://127.0.0.1:1/x.viser"])
def test_a_page_without_the_token_or_with_foreign_code_says_what_to_do(dashboard, visitor, query):
    page = visitor.new_page()
    answer = page.goto(f"{home(dashboard.running)}{query}")
    assert answer is not None
    assert answer.status == 403
    assert page.get_by_role("heading").inner_text() == "Open the link printed in the terminal"


def test_a_refused_upload_leaves_the_button_usable(dashboard, user, tmp_path):
    large = tmp_path / "large.csv"
    large.write_bytes(b"1\n" * 2**20)
    user.locator("input[type=file]").set_input_files(large)
    assert "up to 1 MiB" in dashboard.refused.get(timeout=PATIENCE)
    button = user.get_by_role("button", name="Upload a recording")
    user.wait_for_function("button => !button.disabled", arg=button.element_handle())
    user.get_by_text("large.csv").wait_for(state="detached")  # its notice would claim success


# --- the attacker -----------------------------------------------------------------------------------------


def test_a_rebound_name_reaches_neither_page_nor_socket(dashboard, browser, hostile):
    """The attacker's own name, made to point here after his page was loaded: same site and origin for a browser."""
    flags = [*FLAGS, "--host-resolver-rules=MAP evil.example 127.0.0.1"]
    other = browser.browser_type.launch(executable_path=CHROMIUM, args=flags)
    context = other.new_context()
    page = context.new_page()
    answer = page.goto(dashboard.running.url.replace("127.0.0.1", "evil.example"))
    assert answer is not None
    assert answer.status == 403
    assert context.cookies() == []
    page.goto(f"http://evil.example:{hostile.port}/")
    assert opening_a_socket(page, dashboard.running, "evil.example") == "refused"
    other.close()


def test_an_iframe_on_a_hostile_page_stays_empty(dashboard, user, hostile):
    hostile.pages["/frame"] = (
        f'<iframe id="ours" src="{home(dashboard.running)}"></iframe><iframe id="own" src="/inner"></iframe>'
    )
    hostile.pages["/inner"] = "<p>a frame that may be shown</p>"
    page = user.context.new_page()
    with page.expect_console_message(lambda message: "frame-ancestors" in message.text):
        page.goto(f"http://127.0.0.1:{hostile.port}/frame")
    page.frame_locator("#own").get_by_text("a frame that may be shown").wait_for()
    framed = page.locator("#ours").element_handle().content_frame()
    assert framed is not None
    assert framed.url.startswith("chrome-error:")
    page.close()


def opening_a_socket(page: Page, running: GuardedServer, name: str = "127.0.0.1") -> str:
    """What becomes of a websocket to the dashboard that this page's script opens."""
    return page.evaluate(
        """([url, protocol]) => new Promise(resolve => {
            const socket = new WebSocket(url, protocol);
            socket.onopen = () => resolve("opened");
            socket.onerror = () => resolve("refused");
        })""",
        [home(running).replace("http://127.0.0.1", f"ws://{name}"), f"viser-v{viser.__version__}"],
    )


def test_a_hostile_page_opens_no_socket_though_the_user_is_in(dashboard, user, hostile):
    page = user.context.new_page()
    page.goto(f"http://127.0.0.1:{hostile.port}/")
    assert opening_a_socket(page, dashboard.running) == "refused"
    assert opening_a_socket(user, dashboard.running) == "opened"
    page.close()


MARKUP = {
    "handler in html": ("add_html", "<img src=x onerror=\"document.title='taken'\">", "inline event handler"),
    "script in a frame in markdown": (
        "add_markdown",
        "<iframe srcdoc=\"<script>parent.document.title='taken'</script>\"></iframe>",
        "inline script",
    ),
}


@pytest.mark.parametrize(("kind", "markup", "what"), MARKUP.values(), ids=MARKUP.keys())
def test_markup_in_a_text_runs_no_script(dashboard, user, kind, markup, what):
    """A second line: names from files are escaped before they are shown."""
    with user.expect_console_message(
        lambda message: what in message.text and "violates the following" in message.text
    ):
        text = getattr(dashboard.running.server.gui, kind)(markup)
    assert user.title() == "Kalscope"
    text.remove()


def test_a_page_cannot_connect_elsewhere(dashboard, user, hostile):
    with user.expect_console_message(lambda message: "connect-src" in message.text):
        outcome = user.evaluate(
            "url => fetch(url, {mode: 'no-cors'}).then(() => 'sent', () => 'blocked')",
            f"http://127.0.0.1:{hostile.port}/stolen",
        )
    assert outcome == "blocked"
