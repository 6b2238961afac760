"""A viser server that answers only to the holder of the printed link, and its self-test."""

from __future__ import annotations

import contextlib
import functools
import http.client
import ipaddress
import secrets
import socket
import threading
from collections.abc import Callable, Generator, Iterable
from dataclasses import dataclass
from typing import Any

import rich
import viser
import websockets.asyncio.server

from kalscope.errors import BadSetting, KalscopeError, reason_of
from kalscope_app.guard import requests as pages
from kalscope_app.guard.messages import MessageFilter
from kalscope_app.guard.requests import BURST, MAX_UNKNOWN, Policy, RequestFilter
from kalscope_app.guard.viser_private import replaced

# The self-test: the attacks that every new server must withstand before its link is printed.
#
# The rows carry the numbers of tests/support/browsers/attack_table.py. Sockets that the rules allow are still
# answered 503, because the filter opens to them after the test.


FOREIGN = "kalscope-self-test.invalid"
"""A name that no machine can have."""

TIMEOUT_S = 30.0
"""Seconds that the server may take for one answer, even on a busy machine."""

_UPGRADE = {
    "Upgrade": "websocket",
    "Connection": "Upgrade",
    "Sec-WebSocket-Version": "13",
    "Sec-WebSocket-Key": "a2Fsc2NvcGUga2Fsc2NvcA==",
}


class GuardFailed(KalscopeError, RuntimeError):
    """The server would not be safe, so it was stopped: viser is not as expected, or Kalscope has a bug."""


def run_self_test(policy: Policy, address: str) -> None:
    """Send the attacks that stock viser lets through, and what the user does, to the server at this address.

    Raises:
        GuardFailed: an answer is not as expected, or lacks a security header.
    """
    own, home = f"127.0.0.1:{policy.port}", policy.home
    cookie = {"Cookie": f"{policy.cookie_name}={policy.token}"}
    user, origin = {"Host": own, **cookie}, {"Origin": f"http://{own}"}
    attempts: tuple[tuple[str, int, str, dict[str, str]], ...] = (
        ("a page without the cookie (H1)", 403, home, {"Host": own}),
        ("a page under a foreign name (H2)", 403, home, {"Host": FOREIGN, **cookie}),
        ("a page told to connect elsewhere (H9)", 403, f"/?websocket=ws://{FOREIGN}", user),
        ("a file outside the page's folder (H11)", 404, "/%2e%2e/%2e%2e/_viser.py", user),
        ("the user's own page (H8)", 200, home, user),
        ("a socket of no page (W1)", 403, home, user | _UPGRADE),
        ("a socket of a foreign page (W3)", 403, home, user | _UPGRADE | {"Origin": f"http://{FOREIGN}"}),
        ("a socket without the cookie (W8)", 403, home, {"Host": own} | _UPGRADE | origin),
        ("the user's own socket, too early (W9)", 503, home, user | _UPGRADE | origin),
    )
    for what, expected, target, headers in attempts:
        try:
            with contextlib.closing(http.client.HTTPConnection(address, policy.port, timeout=TIMEOUT_S)) as server:
                server.request("GET", target, headers=headers)
                answer = server.getresponse()
        except (OSError, http.client.HTTPException) as error:
            raise GuardFailed(f"the guard's self-test got no answer: {error!r}") from error
        if answer.status != expected:
            raise GuardFailed(f"the guard's self-test failed: {what} was answered {answer.status}, not {expected}")
        for name in ("Content-Security-Policy", *pages.SECURITY_HEADERS):
            if name not in answer.headers:
                raise GuardFailed(f"the guard's self-test failed: {what} was answered without {name}")


# A viser server that answers only to the holder of the printed link.
#
# Stock viser lets any web page drive it. No fork is needed: while viser is constructed, this module replaces the
# one call by which viser opens its socket, and puts the request filter before viser's own answer. `requests.py`
# decides what is allowed. If viser is not as expected, nothing starts.


_construction = threading.Lock()

MAX_FRAME_BYTES = 2**20
"""The largest message of a client. viser cuts uploads into parts of 512 KiB; all else is far smaller."""


@dataclass(frozen=True)
class GuardedServer(contextlib.AbstractContextManager["GuardedServer"]):
    """A running dashboard server. Use it in a `with` statement, or call `stop`."""

    server: viser.ViserServer
    """To build the panels on."""
    url: str
    """The link for the user, token included: it is all that a user needs to open the dashboard."""
    port: int
    """The port actually bound."""
    token: str
    """The secret alone, so that logs can leave it out."""
    _ready: Callable[[], object]

    def let_in(self) -> None:
        """Connect the browsers that are waiting, and from then on all others at once."""
        with contextlib.suppress(RuntimeError):  # the server has stopped
            self.server.get_event_loop().call_soon_threadsafe(self._ready)

    def stop(self) -> None:
        """Stop the server and free its port. A second call does nothing."""
        self.let_in()  # a connection that waits could not be closed
        _stop(self.server)

    def __exit__(self, *_: object) -> None:
        self.stop()


def guarded_server(
    host: str = "127.0.0.1",
    port: int = 8080,
    *,
    allow_hosts: Iterable[str] = (),
    behind: str | None = None,
    token: Callable[[int], str] = lambda _port: secrets.token_urlsafe(32),
    on_refused: Callable[[str], None] | None = None,
    page_script: str = "",
    hold: bool = False,
) -> GuardedServer:
    """Start viser behind the guard. When this returns, the server has passed the self-test.

    Args:
        host: name or address of this machine to listen on. All networks (0.0.0.0, ::) need `allow_hosts`.
        port: 1 to 65535, or 0 for any free one.
        allow_hosts: names or addresses, without port, by which a browser may call this machine
            besides localhost and the loopback addresses.
        behind: the https address, `https://NAME`, under which a reverse proxy shows this server; the proxy
            must pass the Host header on.
        token: returns the secret of the link, 16 to 128 of A-Z a-z 0-9 _ -, for the port that was bound.
        on_refused: called with a sentence for each upload that was refused. It runs on the event loop:
            it may show a notification, and must not block.
        page_script: JavaScript that runs in the dashboard's page before viser's own.
        hold: a page may load at once, but its connection waits until `let_in` is called.

    Raises:
        BadSetting: host, port, an allowed name or the token cannot be used.
        GuardFailed: viser is not as expected, or the self-test failed; nothing is left running.
    """
    names = tuple(name.strip("[]").lower() for name in allow_hosts)
    with contextlib.ExitStack() as undo:
        listener = undo.enter_context(_listen(host, port))
        address, bound_port = listener.getsockname()[:2]
        link_host = _link_host(host, address, names)
        known = frozenset({*names, link_host})
        policy = pages.Policy(bound_port, token(bound_port), known, pages.behind_of(behind))
        with _expecting_known_viser():
            requests = RequestFilter(policy, page_script)
        server = _start_viser(listener, requests)
        listener.listen(MAX_UNKNOWN)  # asyncio takes one number for the queue of the system and for its own burst
        undo.callback(_stop, server)
        with _expecting_known_viser():
            MessageFilter(server, on_refused).install()
        ip = ipaddress.ip_address(address)
        run_self_test(policy, address if not ip.is_unspecified else "127.0.0.1" if ip.version == 4 else "::1")
        requests.is_open = True
        undo.pop_all()
    shown_host = f"[{link_host}]" if ":" in link_host else link_host
    origin = f"https://{policy.behind}" if policy.behind else f"http://{shown_host}:{bound_port}"
    link = f"{origin}/?token={policy.token}"
    guarded = GuardedServer(server, link, bound_port, policy.token, requests.ready.set)
    if not hold:
        guarded.let_in()
    return guarded


# --- the socket -------------------------------------------------------------------------------------------


def _listen(host: str, port: int) -> socket.socket:
    """Take the port before viser exists: viser waits forever on a bad host and skips a busy port."""
    if not 0 <= port <= 65535:  # the system would take another
        raise BadSetting(f"the port must be 0 to 65535 (got {port})")
    try:
        found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)
        # IPv4 first: every browser finds 127.0.0.1.
        family, *_, where = min(found, key=lambda info: info[0] != socket.AF_INET)
        return socket.create_server(where, family=family)  # pyright: ignore[reportArgumentType]
    except (OSError, ValueError) as error:  # a name with a zero byte, or too long
        reason = reason_of(error).partition(" (while")[0]  # what follows repeats the address
        raise BadSetting(
            f"host {host!r} with port {port} cannot be used on this machine: {reason}; --port 0 takes any free port"
        ) from error


def _link_host(host: str, address: str, names: tuple[str, ...]) -> str:
    """The name that the printed link carries: the address on this machine, else the name the user gave."""
    if ipaddress.ip_address(address).is_unspecified:
        if not names:
            raise BadSetting(
                f"host {host} listens on all networks: "
                "also give the name by which browsers reach this machine, with --allow-host"
            )
        return names[0]
    return address if pages.is_loopback(address) else host.lower()


# --- viser, started behind the filter ---------------------------------------------------------------------


def _start_viser(listener: socket.socket, requests: RequestFilter) -> viser.ViserServer:
    """Construct viser so that it serves on `listener`, behind the filter."""
    port = listener.getsockname()[1]
    with _construction, _serving_behind(requests, listener), _without_viser_output():
        server = viser.ViserServer("127.0.0.1", port, label="Kalscope", verbose=False, share=False)
    if not requests.installed or server.get_port() != port:
        _stop(server)
        raise GuardFailed("viser no longer opens its socket the way Kalscope guards: install viser 1.1.1")
    return server


def _serving_behind(requests: RequestFilter, listener: socket.socket) -> contextlib.AbstractContextManager[None]:
    stock_serve = websockets.asyncio.server.serve

    def serve(handler: Any, _host: object, _port: object, *, process_request: Any, **kwargs: Any) -> Any:
        kwargs |= {
            "process_request": functools.partial(requests.answer, process_request),
            "process_response": requests.harden,
            "max_size": MAX_FRAME_BYTES,
            "create_connection": requests.connection_type,
            "backlog": BURST,
        }
        requests.installed = True
        return stock_serve(requests.admit(handler), sock=listener, **kwargs)

    return replaced(websockets.asyncio.server, "serve", serve)


def _without_viser_output() -> contextlib.AbstractContextManager[None]:
    """Standard output is for our one line, the link; viser prints as it starts and stops, verbose or not."""
    return replaced(rich, "print", lambda *_args, **_kwargs: None)


def _stop(server: viser.ViserServer) -> None:
    with _construction, _without_viser_output():
        server.stop()


@contextlib.contextmanager
def _expecting_known_viser() -> Generator[None]:
    try:
        yield
    except (AttributeError, LookupError, TypeError, ValueError) as error:
        raise GuardFailed(f"viser is not the version Kalscope guards, 1.1.1 ({error!r})") from error
