"""Who may connect, as pure functions: the head of a request goes in, a decision comes out.

Nothing here opens a socket or imports viser; `request_filter.py` calls these functions once a request. The threats:
a page of another site that opens our socket (Origin), a foreign name that is made to point at this machine
(Host: DNS rebinding), another user or program of this machine (the token), and a link to our own page that
makes it load foreign code (`?websocket=`, `?playbackPath=`).
"""

from __future__ import annotations

import hashlib
import hmac
import ipaddress
import re
from dataclasses import dataclass

from kalscope.errors import BadSetting

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
class RequestHead:
    """The parts of a request that decide; headers as the peer sent them, every occurrence of each."""

    hosts: tuple[str, ...] = ()
    """The Host headers. HTTP requires exactly one."""
    origins: tuple[str, ...] = ()
    """The Origin headers: the page that sent the request. Browsers send one with every websocket."""
    is_upgrade: bool = False
    """Whether any Upgrade header asks for a websocket, in any letter case."""
    target: str = "/"
    """The request target: path and query."""
    cookies: tuple[str, ...] = ()
    """The Cookie headers."""


@dataclass(frozen=True)
class Allow:
    """Let viser answer."""


@dataclass(frozen=True)
class SetCookie:
    """The link was right: answer with the small page that keeps the token and leads to `Policy.home`."""

    cookie: str
    """The value of the Set-Cookie header."""


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


def decide(policy: Policy, head: RequestHead) -> Allow | Refuse | SetCookie:
    """Decide on one request. Any exception counts as a refusal."""
    refusal = _refusal_of_sender(policy, head)
    if refusal is not None:
        return refusal
    path, _, query = head.target.partition("?")
    if query:
        return _answer_to_query(policy, head, path, query)
    if not _has_cookie(policy, head.cookies):
        return Refuse(403, "This browser has not opened Kalscope's link yet, or the link has changed since.")
    return Allow()


def _refusal_of_sender(policy: Policy, head: RequestHead) -> Refuse | None:
    """What is wrong before any secret is compared: the name of this machine, and the page that asks."""
    if len(head.hosts) != 1 or not host_allowed(policy, head.hosts[0]):
        return Refuse(
            403,
            "Kalscope is not known under this address. "
            "If it should be, start it with --allow-host and the name that you typed.",
        )
    if not origin_allowed(policy.origin_of(head.hosts[0]), head.origins, required=head.is_upgrade):
        return Refuse(403, "The request came from a page that is not Kalscope's.")
    if not all(text.isascii() for text in (head.target, *head.cookies)) or not head.target.startswith("/"):
        return NOT_UNDERSTOOD
    return None


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


def origin_allowed(own: str, origins: tuple[str, ...], *, required: bool) -> bool:
    """Whether the requesting page is our own: the Origin must equal ours exactly, port included."""
    return origins == (own,) if origins else not required


def _answer_to_query(policy: Policy, head: RequestHead, path: str, query: str) -> Refuse | SetCookie:
    """Decide on a target with a query: only the printed link has one, and only for a page."""
    match = _TOKEN_QUERY.fullmatch(query)
    if match is None or path != "/" or head.is_upgrade:
        return Refuse(403, "Kalscope accepts no parameter in its address except the token of its link.")
    if not hmac.compare_digest(match[1], policy.token):
        return Refuse(403, "This link is wrong, or no longer valid.")
    # Strict: no page of another site can make the browser send it. A path without its last "/" covers both forms.
    secure = "; Secure" if policy.is_behind(head.hosts[0]) else ""
    return SetCookie(
        f"{policy.cookie_name}={policy.token}; HttpOnly; SameSite=Strict; Path={policy.home.rstrip('/')}{secure}"
    )


def _has_cookie(policy: Policy, headers: tuple[str, ...]) -> bool:
    pairs = (pair.strip().partition("=") for header in headers for pair in header.split(";"))
    sent = [value for name, _, value in pairs if name == policy.cookie_name]
    return any(hmac.compare_digest(value, policy.token) for value in sent)
