"""Who may connect: the token, the rules, and the filter before viser's socket."""

from __future__ import annotations

import asyncio
import base64
import gzip
import hashlib
import hmac
import html
import http
import ipaddress
import logging
import os
import re
import secrets
import stat
from collections.abc import Callable, Generator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import viser
from websockets.asyncio.server import ServerConnection
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

from kalscope.common.files import temporary_folder, write_private
from kalscope.errors import BadSetting, describe
from kalscope_app.program.user_settings import state_folder

# Who may connect, as pure functions: the head of a request goes in, a decision comes out.
#
# Nothing here opens a socket or imports viser; `requests.py` calls these functions once a request. The threats:
# a page of another site that opens our socket (Origin), a foreign name that is made to point at this machine
# (Host: DNS rebinding), another user or program of this machine (the token), and a link to our own page that
# makes it load foreign code (`?websocket=`, `?playbackPath=`).


_HOST = re.compile(r"(?:\[(?P<v6>[0-9A-Fa-f:.]+)\]|(?P<name>[A-Za-z0-9._-]+))(?::[0-9]{1,5})?")
_NAME = re.compile(r"[A-Za-z0-9._:-]{1,253}")
_TOKEN = re.compile(r"[A-Za-z0-9_-]{16,128}")
_TOKEN_QUERY = re.compile(r"token=([A-Za-z0-9_-]{1,128})")


@dataclass(frozen=True)
class Policy:
    """How the server was started."""

    port: int
    """The port we listen on. It names the cookie, so that two dashboards do not overwrite each other's."""
    token: str
    """The secret of the printed link: 16 to 128 of A–Z a–z 0–9 _ -."""
    extra_hosts: frozenset[str] = frozenset()
    """Names or addresses, lower case and without port, by which this machine may be called
    besides localhost and the loopback addresses."""
    behind: str = ""
    """Name, or name:port, of the https address under which a reverse proxy shows us; empty without one."""

    def __post_init__(self) -> None:
        if not is_token(self.token):
            raise BadSetting("the token must have 16 to 128 characters out of A-Z a-z 0-9 _ -")
        for name in self.extra_hosts:
            if not _NAME.fullmatch(name) or name != name.lower():
                raise BadSetting(f"an allowed host must be a name or address without a port (got {name!r})")

    @property
    def cookie_name(self) -> str:
        """The name under which the browser keeps the token."""
        return f"kalscope_{self.port}"

    @property
    def home(self) -> str:
        """The path of the dashboard, "/…/", which the cookie is bound to.

        Browsers send a cookie to every port of a machine, so to other users' servers too, but only under its path,
        which these do not know. It is derived from the token, so that open tabs survive a restart.
        """
        return f"/{hmac.new(self.token.encode(), b'home', hashlib.sha256).hexdigest()[:24]}/"

    def origin_of(self, host: str) -> str:
        """The origin of our own pages for a browser that calls us by this Host header."""
        return f"{'https' if self.is_behind(host) else 'http'}://{host}"

    def is_behind(self, host: str) -> bool:
        """Whether this Host header is the one that the https proxy passes on."""
        return bool(self.behind) and host.lower() == self.behind


def is_token(text: str) -> bool:
    """Whether a cookie and a link can carry this as the secret: 16 to 128 of A-Z a-z 0-9 _ -."""
    return _TOKEN.fullmatch(text) is not None


def behind_of(address: str | None) -> str:
    """What `Policy.behind` is for the address given with --behind: its name and, if not 443, its port.

    Raises:
        BadSetting: it is not https://NAME or https://NAME:PORT.
    """
    if not address:
        return ""
    match = re.fullmatch(r"https://([A-Za-z0-9.-]{1,253}(?::[0-9]{1,5})?)/?", address)
    if match is None:
        raise BadSetting(f"--behind must be https://NAME or https://NAME:PORT, without a path (got {address!r})")
    return match[1].lower().removesuffix(":443")


@dataclass(frozen=True)
class Refuse:
    """Answer with an error page; viser never sees the request."""

    status: int
    """The HTTP status."""
    reason: str
    """What the user should know, in one or two sentences."""


NOT_UNDERSTOOD = Refuse(400, "This request could not be understood.")


def below_home(policy: Policy, target: str) -> str:
    """A request target as viser knows it: without the path of the dashboard.

    viser's page asks for its socket without the last "/".
    """
    home = policy.home
    return target[len(home) - 1 :] or "/" if f"{target}/".startswith(home) else target


def decide(policy: Policy, request: Request) -> Refuse | str | None:
    """Decide on one request. Any exception counts as a refusal.

    Returns:
        None lets viser answer. A text where the link was right: the cookie to set, with the page that leads to
        `Policy.home`.
    """
    hosts, origins, cookies = (tuple(request.headers.get_all(name)) for name in ("Host", "Origin", "Cookie"))
    if len(hosts) != 1 or not host_allowed(policy, hosts[0]):
        return Refuse(
            403,
            "Kalscope is not known under this address. "
            "If it should be, start it with --allow-host and the name that you typed.",
        )
    if not origin_allowed(policy.origin_of(hosts[0]), origins, required=is_upgrade(request)):
        return Refuse(403, "The request came from a page that is not Kalscope's.")
    if not all(text.isascii() for text in (request.path, *cookies)) or not request.path.startswith("/"):
        return NOT_UNDERSTOOD
    path, _, query = request.path.partition("?")
    if query:
        return _answer_to_query(policy, request, path, query)
    if not _has_cookie(policy, cookies):
        return Refuse(403, "This browser has not opened Kalscope's link yet, or the link has changed since.")
    return None


def origin_allowed(own: str, origins: tuple[str, ...], *, required: bool) -> bool:
    """Whether the requesting page is our own: the Origin must equal ours exactly, port included."""
    return origins == (own,) if origins else not required  # browsers send one with every websocket


def _has_cookie(policy: Policy, headers: tuple[str, ...]) -> bool:
    pairs = (pair.strip().partition("=") for header in headers for pair in header.split(";"))
    sent = [value for name, _, value in pairs if name == policy.cookie_name]
    return any(hmac.compare_digest(value, policy.token) for value in sent)


def is_upgrade(request: Request) -> bool:
    """Whether any Upgrade header asks for a websocket, in any letter case."""
    return any("websocket" in value.lower() for value in request.headers.get_all("Upgrade"))


def _answer_to_query(policy: Policy, request: Request, path: str, query: str) -> Refuse | str:
    """Decide on a target with a query: only the printed link has one, and only for a page."""
    match = _TOKEN_QUERY.fullmatch(query)
    if match is None or path != "/" or is_upgrade(request):
        return Refuse(403, "Kalscope accepts no parameter in its address except the token of its link.")
    if not hmac.compare_digest(match[1], policy.token):
        return Refuse(403, "This link is wrong, or no longer valid.")
    # Strict: no page of another site can make the browser send it. A path without its last "/" covers both forms.
    cookie = f"{policy.cookie_name}={policy.token}; HttpOnly; SameSite=Strict; Path={policy.home.rstrip('/')}"
    return f"{cookie}; Secure" if policy.is_behind(request.headers.get_all("Host")[0]) else cookie


def host_allowed(policy: Policy, host: str) -> bool:
    """Whether a Host header names this machine: loopback, localhost, or a name that the user listed."""
    match = _HOST.fullmatch(host)
    if match is None:
        return False
    name = (match["v6"] or match["name"]).lower()
    return name == "localhost" or name in policy.extra_hosts or is_loopback(name) or policy.is_behind(host)


def is_loopback(name: str) -> bool:
    """Whether `name` is written as a loopback address: 127.0.0.0/8 or ::1."""
    try:
        return ipaddress.ip_address(name).is_loopback
    except ValueError:
        return False


# The connections that no valid request has come on: the oldest is closed where there are too many.
#
# Anybody who reaches the port may open a connection, send nothing and keep it; each takes one of the descriptors
# that the files of the program need too.


_log = logging.getLogger(__name__)

MAX_UNKNOWN = 64
"""Connections without a valid request at a time. macOS gives a program 256 descriptors, Linux 1024."""

BURST = 8
"""Connections that the event loop accepts before it counts them."""


def counted_connections(unknown: dict[ServerConnection, None]) -> type[ServerConnection]:
    """For `create_connection` of websockets: each connection is in `unknown` until a request on it is allowed."""

    class Counted(ServerConnection):
        def connection_made(self, transport: asyncio.BaseTransport) -> None:
            super().connection_made(transport)
            unknown[self] = None
            if len(unknown) > MAX_UNKNOWN:
                oldest = next(iter(unknown))
                del unknown[oldest]
                oldest.transport.abort()
                _warn_of_flood()

        def connection_lost(self, exc: Exception | None) -> None:
            unknown.pop(self, None)
            super().connection_lost(exc)

    return Counted


@cache  # once
def _warn_of_flood() -> None:
    _log.warning(
        "too many open connections: of more than %d without a valid request the oldest is closed", MAX_UNKNOWN
    )


# The secret of the link on disk: kept over a restart and passed to the browser, readable by this user only.


_MAX_BYTES = 1024
"""Bytes of a token file that are read, at most."""
_IS_POSIX = os.name == "posix"


def kept_token(port: int, folder: Path | None = None, *, renew: bool = False) -> str:
    """The token of this port, the same as last time, so that open tabs reconnect after a restart.

    A file that others could have read or put there is replaced. Where none can be kept safely the token is new each
    time, and the log says why.

    Args:
        port: the port listened on; each has a token of its own.
        folder: where tokens are kept; None is the user's state folder.
        renew: make a new one, which makes the old link useless.
    """
    token = secrets.token_urlsafe(32)
    try:
        folder = state_folder() if folder is None else folder
        with suppress(FileExistsError):
            folder.mkdir(mode=0o700, parents=True)
        _check_folder(folder)
        file = folder / f"token-{port}"
        known = None if renew else _read_private(file)
        if known is not None and is_token(known):
            return known
        write_private(file, token.encode())
    except OSError as error:
        _log.warning("The link changes with each start, because its token cannot be kept: %s", describe(error))
    return token


@contextmanager
def opening_page(url: str) -> Generator[Path]:
    """A page, readable by this user only, that sends the browser on to `url`; it is removed when the block ends.

    Every user of the machine can read command lines; the name of this file tells them nothing.
    """
    with temporary_folder("kalscope-open-") as folder:
        file = folder / "kalscope.html"
        write_private(file, link_page(url).encode())
        yield file


def _check_folder(folder: Path) -> None:
    """Refuse a folder in which another user could replace the file."""
    found = folder.lstat()
    others = _IS_POSIX and (found.st_uid != os.geteuid() or found.st_mode & 0o022)
    if others or not stat.S_ISDIR(found.st_mode):  # a link is none either
        must = "must be a folder of yours, no link, that no other user can write to"
        raise OSError(f"{str(folder)!r} {must} (got {stat.filemode(found.st_mode)} of user {found.st_uid})")


def _read_private(file: Path) -> str | None:
    """The content of a file that only this user could read and write; None for any other file, link or device."""
    flags = os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
    try:
        handle = os.open(file, flags)
    except OSError:  # missing, or a link
        return None
    with os.fdopen(handle, "rb") as opened:
        found = os.fstat(opened.fileno())  # of the open file itself: its name may point elsewhere by now
        is_ours = not _IS_POSIX or (found.st_uid == os.geteuid() and not found.st_mode & 0o077)
        if not stat.S_ISREG(found.st_mode) or found.st_nlink != 1 or not is_ours:
            return None
        return opened.read(_MAX_BYTES).decode("ascii", "replace").strip()


# The small pages besides the dashboard itself, and the security headers of every page. Pure.


_KEEP_ADDRESS = (
    "{ const replace = history.replaceState; history.replaceState = (state) => replace.call(history, state, ''); }"
)
"""Below a path viser appends ?websocket=… to the page's address, which would be refused after a reload."""

_PAGE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1"><link rel="icon" href="data:,">{head}
<title>{title}</title><style>
:root {{ color-scheme: light dark }} code {{ overflow-wrap: anywhere }} a {{ color: inherit }}
body {{ max-width: 32rem; margin: 15vh auto; padding: 0 1rem; background: Canvas;
  font: 16px/1.5 system-ui, sans-serif }}
</style></head><body><main><h1>{title}</h1>{body}</main></body></html>
"""


def refusal_page(policy: Policy, refusal: Refuse) -> str:
    """The page of a refusal: what to do first, then why."""
    return _PAGE.format(
        head="",
        title="Open the link printed in the terminal",
        body=f"<p>{html.escape(refusal.reason)}</p><p>When Kalscope starts it prints a line like "
        f"<br><code>Kalscope: http://127.0.0.1:{policy.port}/?token=…</code><br>"
        "Open that address once in this browser. It leads to a page that may be bookmarked.</p>",
    )


def link_page(url: str) -> str:
    """A page that leads on to `url`: the one behind the printed link leads to the path of the dashboard.

    No redirect: a browser that follows another site's link to us would not send a Strict cookie along.
    """
    url = html.escape(url)
    head = f'<meta name="referrer" content="no-referrer"><meta http-equiv="refresh" content="0; url={url}">'
    return _PAGE.format(
        head=head, title="Opening Kalscope…", body=f'<p><a href="{url}">Go on to the dashboard</a></p>'
    )


def inline_script_hashes(page: str) -> tuple[str, ...]:
    """The CSP sources of the inline scripts of an HTML page, `'sha256-…'` each, in their order."""
    scripts = re.findall(r"<script\b[^>]*>(.*?)</script>", page, re.DOTALL)
    digests = (hashlib.sha256(script.encode()).digest() for script in scripts)
    return tuple(f"'sha256-{base64.b64encode(digest).decode()}'" for digest in digests)


_NO_FRAMES = "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
SMALL_PAGE_CSP = f"default-src 'none'; style-src 'unsafe-inline'; img-src data:; {_NO_FRAMES}"
"""The content policy of our own two small pages."""
SECURITY_HEADERS = {
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
}
"""The headers, beside the content policy, of every answer that is not a websocket."""


def dashboard_csp(script_hashes: tuple[str, ...], own_origin: str) -> str:
    """The content policy of viser's page: its own loader runs, and nothing that a text injects.

    Args:
        script_hashes: of the inline scripts of viser's page. 'strict-dynamic' lets the loader start the
            program it unpacks, but no script or handler inside a text (a file name, a CSV header) runs.
        own_origin: `http://HOST` or `https://HOST`, with a HOST that `host_allowed` has accepted; some browsers
            do not count our own websocket as 'self' and want it by name.
    """
    scripts = " ".join(script_hashes)
    return (
        f"default-src 'none'; script-src {scripts} 'strict-dynamic' 'wasm-unsafe-eval' blob:; "
        "worker-src blob:; style-src 'unsafe-inline'; img-src 'self' data: blob:; font-src 'self' data:; "
        f"media-src data: blob:; connect-src 'self' {own_origin.replace('http', 'ws', 1)} data: blob:; {_NO_FRAMES}"
    )


# The filter before viser's socket: answers each request itself, or lets viser answer, as `rules` decides.


MAX_CLIENTS = 32
"""Browsers at a time; the next one is refused with a message."""


class RequestFilter:
    """Answers each request instead of viser, or lets viser answer."""

    def __init__(self, policy: Policy, page_script: str = "") -> None:
        self._page, self._script_hashes = served_page(page_script)
        self._policy = policy
        self._clients = 0
        self._unknown: dict[ServerConnection, None] = {}
        self.connection_type = counted_connections(self._unknown)
        self.is_open = False
        """Pages are served at once, sockets after the self-test: an old tab may already be reconnecting."""
        self.ready = asyncio.Event()
        """Browsers that connect before it is set wait: there is nothing to show yet."""
        self.installed = False
        """Whether viser's socket was really opened behind this filter."""

    def answer(self, viser_answer: Callable[..., Any], connection: ServerConnection, request: Request) -> Any:
        """The `process_request` of websockets: None continues with the websocket handshake."""
        try:
            request.path = below_home(self._policy, request.path)
            answer = decide(self._policy, request)
            if answer is None and is_upgrade(request) and not self.is_open:
                answer = Refuse(503, "Kalscope is still starting.")
            if answer is None:
                self._unknown.pop(connection, None)
                return self._own_page(request) or viser_answer(connection, request)
        except Exception:
            # A check that fails must neither let the request pass nor stop the server (CVE-2026-14631).
            answer = NOT_UNDERSTOOD
        small = {"Content-Security-Policy": SMALL_PAGE_CSP}
        if isinstance(answer, str):
            return _html(200, link_page(self._policy.home).encode(), small | {"Set-Cookie": answer})
        if self.is_open:  # before that it is the self-test that is refused
            # Without the query: it may hold the token, under a wrong name or path.
            _log.info("refused %r: %s", request.path.partition("?")[0], answer.reason)
        return _html(answer.status, refusal_page(self._policy, answer).encode(), small)

    def _own_page(self, request: Request) -> Response | None:
        """The page of viser with our script; None for all else."""
        if request.path.partition("?")[0] != "/" or is_upgrade(request):
            return None
        return _html(200, self._page, {"Content-Encoding": "gzip"})

    def admit(self, handler: Callable[..., Any]) -> Callable[..., Any]:
        """The handler of viser's websockets, for MAX_CLIENTS at a time."""

        async def handle(connection: ServerConnection) -> None:
            if connection.subprotocol != f"viser-v{viser.__version__}":  # viser would print on standard output
                await connection.close(1002, "reload the page: it belongs to another version")
                return
            if self._clients >= MAX_CLIENTS:
                await connection.close(1013, "too many browsers")
                return
            self._clients += 1
            try:
                await self.ready.wait()
                await handler(connection)
            finally:
                self._clients -= 1

        return handle

    def harden(self, _: ServerConnection, request: Request, response: Response) -> Response:
        """The `process_response` of websockets: security headers on everything but an opened websocket."""
        if response.status_code != http.HTTPStatus.SWITCHING_PROTOCOLS:
            response.headers.update(SECURITY_HEADERS)
            if "Content-Security-Policy" not in response.headers:  # the Host was allowed
                csp = dashboard_csp(self._script_hashes, self._policy.origin_of(request.headers["Host"]))
                response.headers["Content-Security-Policy"] = csp
        return response


@cache
def served_page(page_script: str) -> tuple[bytes, tuple[str, ...]]:
    """The page of viser with our script, packed by gzip, and the CSP sources of its scripts.

    Raises:
        ValueError: viser's page is not as expected.
    """
    page = (Path(viser.__file__).parent / "client" / "build" / "index.html").read_text("utf-8")
    start = f"<head><script>{_KEEP_ADDRESS}{page_script}</script>"
    for stock, own in (("<head>", start), ("<title>Viser</title>", "<title>Kalscope</title>")):
        if page.count(stock) != 1:
            raise ValueError(f"viser's page must have one {stock}")
        page = page.replace(stock, own)
    return gzip.compress(page.encode(), 1), inline_script_hashes(page)


def _html(status: int, body: bytes, more: dict[str, str]) -> Response:
    headers = {"Content-Type": "text/html; charset=utf-8", "Content-Length": str(len(body)), **more}
    return Response(status, http.HTTPStatus(status).phrase, Headers(headers), body)
