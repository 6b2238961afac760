"""The self-test: what every new server is asked before anybody is given its link.

The rows carry the letters of the table in docs/security.md. Sockets that the rules allow are still answered 503,
because the door opens to them after the test.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from kalscope_app.guard.rules import Policy

FOREIGN = "kalscope-self-test.invalid"
"""A name that can be nobody's."""

UPGRADE = (
    ("Upgrade", "websocket"),
    ("Connection", "Upgrade"),
    ("Sec-WebSocket-Version", "13"),
    ("Sec-WebSocket-Key", "a2Fsc2NvcGUga2Fsc2NvcA=="),
)


@dataclass(frozen=True)
class Attempt:
    """One request of the self-test."""

    what: str
    """Who asks for what, in words."""
    target: str
    """Path and query."""
    headers: tuple[tuple[str, str], ...]
    """All request headers, in this order."""
    expected_status: int
    """The only HTTP status that lets the server live on."""


def self_test_attempts(policy: Policy) -> tuple[Attempt, ...]:
    """The attacks that stock viser lets through, and what the user does."""
    return (*_pages(policy), *_sockets(policy))


def _pages(policy: Policy) -> tuple[Attempt, ...]:
    own = (("Host", f"127.0.0.1:{policy.port}"),)
    cookie = (("Cookie", f"{policy.cookie_name}={policy.token}"),)
    return (
        Attempt("a page without the cookie (H1)", policy.home, own, 403),
        Attempt("a page under a foreign name (H2)", "/", (("Host", FOREIGN), *cookie), 403),
        Attempt("a page under a name like ours (H3)", "/", (("Host", "127.0.0.1.nip.io"), *cookie), 403),
        Attempt("a page without a Host (H4)", "/", cookie, 403),
        Attempt("a page under two names (H5)", "/", (*own, ("Host", FOREIGN), *cookie), 403),
        Attempt("a page under half an address (H6)", "/", (("Host", "[::1"), *cookie), 403),
        Attempt("a link with a wrong token (H7)", "/?token=wrong", own, 403),
        Attempt("a page told to connect elsewhere (H9)", f"/?websocket=ws://{FOREIGN}", (*own, *cookie), 403),
        Attempt("a page told to play a foreign film (H10)", f"/?playbackPath=//{FOREIGN}/x", (*own, *cookie), 403),
        Attempt("a file outside the page's folder (H11)", "/%2e%2e/%2e%2e/_viser.py", (*own, *cookie), 404),
        Attempt("the user's own page (H8)", policy.home, (*own, *cookie), 200),
    )


def _sockets(policy: Policy) -> tuple[Attempt, ...]:
    own = f"127.0.0.1:{policy.port}"

    def attempt(
        what: str, origin: str | None, expected: int, *, host: str = own, has_cookie: bool = True
    ) -> Attempt:
        headers = (
            ("Host", host),
            *UPGRADE,
            *((("Origin", origin),) if origin is not None else ()),
            *((("Cookie", f"{policy.cookie_name}={policy.token}"),) if has_cookie else ()),
        )
        return Attempt(what, policy.home, headers, expected)

    return (
        attempt("a socket of no page (W1)", None, 403),
        attempt("a socket of a foreign page (W3)", f"http://{FOREIGN}", 403),
        attempt("a socket of a page without a name (W4)", "null", 403),
        attempt("a socket of another program's page (W5)", "http://127.0.0.1:1", 403),
        attempt("a socket of a name like ours (W6)", f"http://{own}.{FOREIGN}", 403),
        attempt("a socket under a foreign name (W7)", f"http://{FOREIGN}", 403, host=FOREIGN),
        attempt("a socket without the cookie (W8)", f"http://{own}", 403, has_cookie=False),
        attempt("a socket of an https page (W11)", f"https://{own}", 403),
        attempt("the user's own socket, too early (W9)", f"http://{own}", 503),
    )
