"""The self-test: the attacks that every new server must withstand before its link is printed.

The rows carry the numbers of the table in docs/project/security.md. Sockets that the rules allow are still answered
503, because the filter opens to them after the test.
"""

from __future__ import annotations

import http.client
from dataclasses import dataclass

from kalscope.errors import KalscopeError
from kalscope_app.guard import pages
from kalscope_app.guard.rules import Policy

FOREIGN = "kalscope-self-test.invalid"
"""A name that no machine can have."""

TIMEOUT_S = 30.0
"""Seconds that the server may take for one answer, even on a busy machine."""

_UPGRADE = (
    ("Upgrade", "websocket"),
    ("Connection", "Upgrade"),
    ("Sec-WebSocket-Version", "13"),
    ("Sec-WebSocket-Key", "a2Fsc2NvcGUga2Fsc2NvcA=="),
)


class GuardFailed(KalscopeError, RuntimeError):
    """The server would not be safe, so it was stopped: viser is not as expected, or Kalscope has a bug."""


@dataclass(frozen=True)
class Attempt:
    """One request of the self-test."""

    what: str
    """Who asks for what, in words."""
    expected_status: int
    """The only HTTP status that passes."""
    target: str
    """Path and query."""
    headers: tuple[tuple[str, str], ...]
    """All request headers, in this order."""


def self_test_attempts(policy: Policy) -> tuple[Attempt, ...]:
    """The attacks that stock viser lets through, and what the user does."""
    own, home = f"127.0.0.1:{policy.port}", policy.home
    cookie = (("Cookie", f"{policy.cookie_name}={policy.token}"),)

    def page(what: str, status: int, target: str = "/", *hosts: str, known: bool = True) -> Attempt:
        return Attempt(what, status, target, (*(("Host", host) for host in hosts), *(cookie if known else ())))

    def socket(what: str, status: int, origin: str | None, host: str = own, known: bool = True) -> Attempt:
        asking = (("Host", host), *_UPGRADE, *((("Origin", origin),) if origin else ()))
        return Attempt(what, status, home, (*asking, *(cookie if known else ())))

    return (
        page("a page without the cookie (H1)", 403, home, own, known=False),
        page("a page under a foreign name (H2)", 403, "/", FOREIGN),
        page("a page under a name like ours (H3)", 403, "/", "127.0.0.1.nip.io"),
        page("a page without a Host (H4)", 403),
        page("a page under two names (H5)", 403, "/", own, FOREIGN),
        page("a page under half an address (H6)", 403, "/", "[::1"),
        page("a link with a wrong token (H7)", 403, "/?token=wrong", own, known=False),
        page("a page told to connect elsewhere (H9)", 403, f"/?websocket=ws://{FOREIGN}", own),
        page("a page told to play back a foreign file (H10)", 403, f"/?playbackPath=//{FOREIGN}/x", own),
        page("a file outside the page's folder (H11)", 404, "/%2e%2e/%2e%2e/_viser.py", own),
        page("the user's own page (H8)", 200, home, own),
        socket("a socket of no page (W1)", 403, None),
        socket("a socket of a foreign page (W3)", 403, f"http://{FOREIGN}"),
        socket("a socket of a page without a name (W4)", 403, "null"),
        socket("a socket of another program's page (W5)", 403, f"http://127.0.0.1:{policy.port % 65535 + 1}"),
        socket("a socket of a name like ours (W6)", 403, f"http://{own}.{FOREIGN}"),
        socket("a socket under a foreign name (W7)", 403, f"http://{FOREIGN}", FOREIGN),
        socket("a socket without the cookie (W8)", 403, f"http://{own}", known=False),
        socket("a socket of an https page (W11)", 403, f"https://{own}"),
        socket("the user's own socket, too early (W9)", 503, f"http://{own}"),
    )


def run_self_test(policy: Policy, address: str) -> None:
    """Send each request to the server at this address.

    Raises:
        GuardFailed: an answer is not as expected, or lacks a security header.
    """
    for attempt in self_test_attempts(policy):
        status, headers = _answer_to(address, policy.port, attempt)
        expected = attempt.expected_status
        if status != expected:
            raise GuardFailed(f"the guard's self-test failed: {attempt.what} was answered {status}, not {expected}")
        missing = next((name for name in pages.page_headers("") if name not in headers), None)
        if missing is not None:
            raise GuardFailed(f"the guard's self-test failed: {attempt.what} was answered without {missing}")


def _answer_to(address: str, port: int, attempt: Attempt) -> tuple[int, http.client.HTTPMessage]:
    connection = http.client.HTTPConnection(address, port, timeout=TIMEOUT_S)
    try:
        connection.putrequest("GET", attempt.target, skip_host=True, skip_accept_encoding=True)
        for name, value in attempt.headers:
            connection.putheader(name, value)
        connection.endheaders()
        answer = connection.getresponse()
        answer.read()
        return answer.status, answer.headers
    except (OSError, http.client.HTTPException) as error:
        raise GuardFailed(f"the guard's self-test got no answer: {error!r}") from error
    finally:
        connection.close()
