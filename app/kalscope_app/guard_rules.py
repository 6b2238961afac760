"""Who may connect, as pure functions: what a peer asks for goes in, an answer comes out.

Nothing here opens a socket or imports viser; `guard.py` asks these functions once a request. The threats:
a page of another site that opens our socket (Origin), a foreign name that is made to point at this machine
(Host: DNS rebinding), another user or program of this machine (the token), and a link to our own page that
makes it load foreign code (`?websocket=`, `?playbackPath=`).
"""

from __future__ import annotations

import base64
import hashlib
import hmac
import html
import ipaddress
import re
from dataclasses import dataclass

from kalscope.errors import BadSetting

_HOST = re.compile(r"(?:\[(?P<v6>[0-9A-Fa-f:.]+)\]|(?P<name>[A-Za-z0-9._-]+))(?::[0-9]{1,5})?")
_NAME = re.compile(r"[A-Za-z0-9._:-]{1,253}")
_TOKEN = re.compile(r"[A-Za-z0-9_-]{16,128}")
_TOKEN_QUERY = re.compile(r"token=([A-Za-z0-9_-]{1,128})")

OPEN_THE_LINK = "Open the link printed in the terminal"


@dataclass(frozen=True)
class Policy:
    """What the server was told when it started."""

    port: int
    """The port we listen on. It names the cookie, because browsers do not separate cookies by port."""
    token: str
    """The secret of the printed link: 16 to 128 of A–Z a–z 0–9 _ -."""
    extra_hosts: frozenset[str] = frozenset()
    """Names or addresses, lower case and without port, by which this machine may be called
    besides localhost and the loopback addresses."""

    def __post_init__(self) -> None:
        if not _TOKEN.fullmatch(self.token):
            raise BadSetting("the token must have 16 to 128 characters out of A-Z a-z 0-9 _ -")
        for name in self.extra_hosts:
            if not _NAME.fullmatch(name) or name != name.lower():
                raise BadSetting(f"an allowed host must be a name or address without a port (got {name!r})")

    @property
    def cookie_name(self) -> str:
        """The name under which the browser keeps the token."""
        return f"kalscope_{self.port}"


@dataclass(frozen=True)
class Ask:
    """The parts of a request that decide; headers as the peer sent them, every occurrence of each."""

    hosts: tuple[str, ...] = ()
    """The Host headers. HTTP wants exactly one."""
    origins: tuple[str, ...] = ()
    """The Origin headers: which page asks. Browsers send it with every websocket."""
    is_upgrade: bool = False
    """Whether any Upgrade header asks for a websocket, in whatever case of letters."""
    target: str = "/"
    """The request target: path and query."""
    cookies: tuple[str, ...] = ()
    """The Cookie headers."""
    method: str = "GET"
    """The HTTP method."""


@dataclass(frozen=True)
class Allow:
    """Let viser answer."""


@dataclass(frozen=True)
class SetCookie:
    """The link was right: answer with the small page that keeps the token and goes on to `/`."""

    cookie: str
    """The value of the Set-Cookie header."""


@dataclass(frozen=True)
class Refuse:
    """Answer with an error page; viser never sees the request."""

    status: int
    """The HTTP status."""
    words: str
    """What the person in front of the browser should know, in one or two sentences."""


def decide(policy: Policy, ask: Ask) -> Allow | Refuse | SetCookie:
    """Decide on one request. Never raises: whatever cannot be judged is refused."""
    try:
        return _decide(policy, ask)
    except Exception:
        # A check that falls over must not open the door, nor take the server with it (CVE-2026-14631).
        return Refuse(400, "This request could not be understood.")


def _decide(policy: Policy, ask: Ask) -> Allow | Refuse | SetCookie:
    path, _, query = ask.target.partition("?")
    refusal = _refusal_of_sender(policy, ask)
    if refusal is not None:
        return refusal
    if query:
        return _answer_to_query(policy, path, query, ask.is_upgrade)
    if not _has_cookie(policy, ask.cookies):
        return Refuse(403, "This browser has not opened Kalscope's link yet, or the link has changed since.")
    return Allow()


def _refusal_of_sender(policy: Policy, ask: Ask) -> Refuse | None:
    """What is wrong before any secret is looked at: who calls us by what name, from what page."""
    if ask.method != "GET":
        return Refuse(405, "Only GET requests are answered here.")
    if len(ask.hosts) != 1 or not host_allowed(policy, ask.hosts[0]):
        return Refuse(
            403,
            "Kalscope is not known under this address. "
            "If it should be, start it with --allow-host and the name that you typed.",
        )
    if not origin_allowed(ask.hosts[0], ask.origins, required=ask.is_upgrade):
        return Refuse(403, "The page that asked is not Kalscope's own.")
    if not all(text.isascii() for text in (ask.target, *ask.cookies)) or not ask.target.startswith("/"):
        return Refuse(400, "This request could not be understood.")
    return None


def host_allowed(policy: Policy, host: str) -> bool:
    """Whether a Host header names this machine: loopback, localhost, or a name that the user listed."""
    match = _HOST.fullmatch(host)
    if match is None:
        return False
    name = (match["v6"] or match["name"]).lower()
    return name == "localhost" or name in policy.extra_hosts or is_loopback(name)


def is_loopback(name: str) -> bool:
    """Whether `name` is written as a loopback address: 127.0.0.0/8 or ::1."""
    try:
        return ipaddress.ip_address(name).is_loopback
    except ValueError:
        return False


def origin_allowed(host: str, origins: tuple[str, ...], *, required: bool) -> bool:
    """Whether the asking page is our own: the Origin must be the Host, to the letter and with its port."""
    if not origins:
        return not required
    return origins == (f"http://{host}",)


def _answer_to_query(policy: Policy, path: str, query: str, is_upgrade: bool) -> Refuse | SetCookie:
    """Judge a target with a query: only the printed link has one, and only a plain page is asked with it."""
    match = _TOKEN_QUERY.fullmatch(query)
    if match is None or path != "/" or is_upgrade:
        return Refuse(403, "Kalscope takes nothing after the address but its own link.")
    if not hmac.compare_digest(match[1], policy.token):
        return Refuse(403, "This link is not, or no longer, the right one.")
    # Strict: no page of another site can make the browser send it.
    return SetCookie(f"{policy.cookie_name}={policy.token}; HttpOnly; SameSite=Strict; Path=/")


def _has_cookie(policy: Policy, headers: tuple[str, ...]) -> bool:
    pairs = (pair.strip().partition("=") for header in headers for pair in header.split(";"))
    sent = [value for name, _, value in pairs if name == policy.cookie_name]
    return any(hmac.compare_digest(value, policy.token) for value in sent)


# --- what is answered -------------------------------------------------------------------------------------

_GO_ON = "location.replace('/')"

_PAGE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1"><title>{title}</title><style>
:root {{ color-scheme: light dark;
  --ink: #1c2430; --dim: #5a6675; --paper: #f4f6f8; --card: #fff; --line: #d9dfe6 }}
@media (prefers-color-scheme: dark) {{
  :root {{ --ink: #e6eaf0; --dim: #9aa6b5; --paper: #14181e; --card: #1d232b; --line: #323b47 }} }}
body {{ margin: 0; min-height: 100vh; display: grid; place-items: center; background: var(--paper);
  color: var(--ink); font: 16px/1.5 system-ui, sans-serif }}
main {{ max-width: 32rem; margin: 1rem; padding: 1.5rem 2rem; background: var(--card);
  border: 1px solid var(--line); border-radius: 12px }}
h1 {{ font-size: 1.25rem; margin: 0 0 .5rem }} p {{ margin: .5rem 0 }} .dim {{ color: var(--dim) }}
code {{ font-size: .9em; overflow-wrap: anywhere }} a {{ color: inherit }}
</style></head><body><main><h1>{title}</h1>{body}</main></body></html>
"""


def refusal_page(policy: Policy, refusal: Refuse) -> str:
    """The page of a refusal: what to do first, then why."""
    return _PAGE.format(
        title=OPEN_THE_LINK,
        body=f"<p>{html.escape(refusal.words)}</p><p class=dim>When Kalscope starts it prints a line like "
        f"<br><code>Kalscope: http://127.0.0.1:{policy.port}/?token=…</code><br>"
        "Open that address once in this browser. Afterwards the address without the token is enough.</p>",
    )


def link_page() -> str:
    """The page behind the printed link.

    It goes on by script: a browser that follows another site's link to us would not send a Strict cookie
    along a redirect.
    """
    body = f'<p><a href="/">Go on to the dashboard</a></p><script>{_GO_ON}</script>'
    return _PAGE.format(title="Opening Kalscope…", body=body)


def inline_script_hashes(page: str) -> tuple[str, ...]:
    """The CSP sources of the inline scripts of an HTML page, `'sha256-…'` each, in their order."""
    scripts = re.findall(r"<script\b[^>]*>(.*?)</script>", page, re.DOTALL)
    digests = (hashlib.sha256(script.encode()).digest() for script in scripts)
    return tuple(f"'sha256-{base64.b64encode(digest).decode()}'" for digest in digests)


def page_headers(csp: str) -> dict[str, str]:
    """The security headers of every answer that is not a websocket."""
    return {
        "Content-Security-Policy": csp,
        "X-Content-Type-Options": "nosniff",
        "Referrer-Policy": "no-referrer",
        "Cache-Control": "no-store",
        "Cross-Origin-Resource-Policy": "same-origin",
        "Cross-Origin-Opener-Policy": "same-origin",
    }


def small_page_csp() -> str:
    """The content policy of our own two small pages."""
    scripts = " ".join(inline_script_hashes(link_page()))
    return (
        f"default-src 'none'; style-src 'unsafe-inline'; script-src {scripts}; "
        "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    )


def dashboard_csp(script_hashes: tuple[str, ...], host: str | None = None) -> str:
    """The content policy of viser's page: its own loader runs, and nothing that a text brought in.

    Args:
        script_hashes: of the inline scripts of viser's page. 'strict-dynamic' lets the loader start the
            program it unpacks, and leaves scripts and handlers inside texts (file names, CSV headers) dead.
        host: a Host header that `host_allowed` has accepted; some browsers do not count our own websocket
            as 'self' and want it by name.
    """
    scripts = " ".join(script_hashes)
    socket = f" ws://{host}" if host else ""
    return (
        f"default-src 'none'; script-src {scripts} 'strict-dynamic' 'wasm-unsafe-eval' blob:; "
        "worker-src blob:; style-src 'unsafe-inline'; img-src 'self' data: blob:; font-src 'self' data:; "
        f"media-src data: blob:; connect-src 'self'{socket} data: blob:; "
        "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    )


# --- the self-test ----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Attempt:
    """One request of the self-test."""

    what: str
    """Who asks for what, in words."""
    target: str
    """Path and query."""
    headers: dict[str, str]
    """The request headers, Host included."""
    expected_status: int
    """The only HTTP status that lets the server live on."""


def self_test_attempts(policy: Policy) -> tuple[Attempt, ...]:
    """What a new server is asked before anybody is given its link: five attacks, and the user's own page."""
    own, foreign = f"127.0.0.1:{policy.port}", "kalscope-self-test.invalid"
    cookie = {"Cookie": f"{policy.cookie_name}={policy.token}"}
    socket = {
        "Upgrade": "websocket",
        "Connection": "Upgrade",
        "Sec-WebSocket-Version": "13",
        "Sec-WebSocket-Key": "a2Fsc2NvcGUga2Fsc2NvcA==",
    }
    from_foreign, from_own = {"Origin": f"http://{foreign}"}, {"Origin": f"http://{own}"}
    return (
        Attempt("a page under a foreign name", "/", {"Host": foreign} | cookie, 403),
        Attempt("a page without the cookie", "/", {"Host": own}, 403),
        Attempt("a socket of a foreign page", "/", {"Host": own} | from_foreign | socket | cookie, 403),
        Attempt("a socket without the cookie", "/", {"Host": own} | from_own | socket, 403),
        Attempt("a page told to load foreign code", f"/?websocket=ws://{foreign}", {"Host": own} | cookie, 403),
        Attempt("the user's own page", "/", {"Host": own} | cookie, 200),
    )
