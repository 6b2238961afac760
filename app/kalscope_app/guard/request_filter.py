"""The filter before viser's socket: answers each request itself, or lets viser answer, as `rules` decides."""

from __future__ import annotations

import asyncio
import gzip
import http
import logging
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import viser
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

from kalscope_app.guard import pages, rules
from kalscope_app.guard.open_connections import OpenConnections

if TYPE_CHECKING:
    from websockets.asyncio.server import ServerConnection

_log = logging.getLogger(__name__)

MAX_CLIENTS = 32
"""Browsers at a time; the next one is refused with a message."""


class RequestFilter:
    """Answers each request instead of viser, or lets viser answer."""

    def __init__(self, policy: rules.Policy, page_script: str = "") -> None:
        self._page, self._packed, self._script_hashes = served_page(page_script)
        self._policy = policy
        self._clients = 0
        self.connections = OpenConnections()
        self.is_open = False
        """Pages are served at once, sockets after the self-test: an old tab may already be reconnecting."""
        self.ready = asyncio.Event()
        """Browsers that connect before it is set wait: there is nothing to show yet."""
        self.installed = False
        """Whether viser's socket was really opened behind this filter."""

    def answer(self, viser_answer: Callable[..., Any], connection: ServerConnection, request: Request) -> Any:
        """The `process_request` of websockets: None continues with the websocket handshake."""
        try:
            request.path = rules.below_home(self._policy, request.path)
            head = _head_of(request)
            answer = rules.decide(self._policy, head)
            if isinstance(answer, rules.Allow) and head.is_upgrade and not self.is_open:
                answer = rules.Refuse(503, "Kalscope is still starting.")
            if isinstance(answer, rules.Allow):
                self.connections.allow(connection)
                return self._own_page(head, request) or viser_answer(connection, request)
        except Exception:
            # A check that fails must neither let the request pass nor stop the server (CVE-2026-14631).
            answer = rules.NOT_UNDERSTOOD
        if isinstance(answer, rules.SetCookie):
            return _small_page(200, pages.link_page(self._policy.home), {"Set-Cookie": answer.cookie})
        if self.is_open:  # before that it is the self-test that is refused
            # Without the query: it may hold the token, under a wrong name or path.
            _log.info("refused %r: %s", request.path.partition("?")[0], answer.reason)
        return _small_page(answer.status, pages.refusal_page(self._policy, answer))

    def _own_page(self, head: rules.RequestHead, request: Request) -> Response | None:
        """The page of viser with our script; None for all else."""
        if head.target.partition("?")[0] != "/" or head.is_upgrade:
            return None
        headers, body = {"Content-Type": "text/html; charset=utf-8"}, self._page
        if any("gzip" in value for value in request.headers.get_all("Accept-Encoding")):
            headers, body = headers | {"Content-Encoding": "gzip"}, self._packed
        return Response(200, "OK", Headers(headers | {"Content-Length": str(len(body))}), body)

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
            hosts = request.headers.get_all("Host")
            known = len(hosts) == 1 and rules.host_allowed(self._policy, hosts[0])
            csp = pages.dashboard_csp(self._script_hashes, self._policy.origin_of(hosts[0]) if known else None)
            for name, value in pages.page_headers(csp).items():
                if name not in response.headers:
                    response.headers[name] = value
        return response


@cache
def served_page(page_script: str) -> tuple[bytes, bytes, tuple[str, ...]]:
    """The page of viser with our script, plain and packed, and the CSP sources of its scripts.

    Raises:
        ValueError: viser's page is not as expected.
    """
    stock = Path(viser.__file__).parent / "client" / "build" / "index.html"
    page = pages.dashboard_page(stock.read_text("utf-8"), page_script)
    plain = page.encode()
    return plain, gzip.compress(plain, 1), pages.inline_script_hashes(page)


def _head_of(request: Request) -> rules.RequestHead:
    headers = request.headers
    return rules.RequestHead(
        hosts=tuple(headers.get_all("Host")),
        origins=tuple(headers.get_all("Origin")),
        is_upgrade=any("websocket" in value.lower() for value in headers.get_all("Upgrade")),
        target=request.path,
        cookies=tuple(headers.get_all("Cookie")),
    )


def _small_page(status: int, page: str, extra_headers: dict[str, str] | None = None) -> Response:
    body = page.encode()
    headers = pages.page_headers(pages.small_page_csp()) | (extra_headers or {})
    headers |= {"Content-Type": "text/html; charset=utf-8", "Content-Length": str(len(body))}
    return Response(status, http.HTTPStatus(status).phrase, Headers(headers), body)
