"""The attacks on the dashboard, each as one row: who does what, and what must be seen.

`test_attacks.py` carries them out against the real program.
"""

from __future__ import annotations

import contextlib
import math
import socket
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import msgspec
from tests.app.wire import Guest, client
from tests.support.program import port_of, running, token_of
from tests.support.waiting import PATIENCE
from websockets.exceptions import ConnectionClosed, InvalidStatus

UPGRADE = "Connection: Upgrade\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n"


@dataclass(frozen=True)
class Victim:
    """A server to attack."""

    port: int
    """Where it listens."""
    token: str
    """The secret, known to the user and, where the row says so, stolen."""

    @property
    def own(self) -> str:
        return f"127.0.0.1:{self.port}"

    @property
    def cookie(self) -> str:
        return f"kalscope_{self.port}={self.token}"


Act = Callable[[Victim], str]
"""Does something to a server; returns what was seen."""


@dataclass(frozen=True)
class Attack:
    """One row."""

    what: str
    """Who does what."""
    expected: str
    """What must be seen at Kalscope."""
    perform: Act
    """Do it; returns what was seen."""


# --- requests ---------------------------------------------------------------------------------------------


def exchange(port: int, request: str, address: str = "127.0.0.1") -> bytes:
    """What the server answers to these very bytes (latin-1), until it closes or has opened a websocket."""
    with socket.create_connection((address, port), timeout=PATIENCE) as raw:
        raw.sendall(request.encode("latin-1"))
        answer = b""
        while chunk := raw.recv(65536):
            answer += chunk
            if answer.startswith(b"HTTP/1.1 101") and b"\r\n\r\n" in answer:
                break
    return answer


def status(answer: bytes) -> str:
    """The status as a word: an opened websocket is "open"."""
    code = answer.split(b" ", 2)[1].decode() if answer.startswith(b"HTTP/") else "nothing"
    return "open" if code == "101" else code


def page(target: str = "/", *hosts: str | None, cookie: bool = True, extra: str = "") -> Act:
    """Ask for a page, by default as the user; `hosts` in place of our own, None for ours, "" for none at all."""

    def perform(victim: Victim) -> str:
        names = [victim.own if host is None else host for host in hosts or (None,)]
        lines = [f"Host: {name}" for name in names if name]
        lines += [f"Cookie: {victim.cookie}"] if cookie else []
        lines += [extra.format(own=victim.own)] if extra else []
        head = "\r\n".join([f"GET {target.format(token=victim.token)} HTTP/1.1", *lines])
        return status(exchange(victim.port, f"{head}\r\n\r\n"))

    return perform


def opens(origin: str | None, host: str = "{own}", *, cookie: bool = True, word: str = "websocket") -> Act:
    """Ask for a websocket."""

    def perform(victim: Victim) -> str:
        names = {"own": victim.own, "port": victim.port}
        request = f"GET / HTTP/1.1\r\nHost: {host.format(**names)}\r\nUpgrade: {word}\r\n{UPGRADE}"
        request += f"Origin: {origin.format(**names)}\r\n" if origin is not None else ""
        request += f"Cookie: {victim.cookie}\r\n" if cookie else ""
        return status(exchange(victim.port, request + "\r\n"))

    return perform


# --- what a connected client does -------------------------------------------------------------------------


def is_served(victim: Victim) -> str:
    """Whether the user still gets the page."""
    seen = page()(victim)
    return "served on" if seen == "200" else seen


def sends(frame: bytes | str) -> Act:
    """A logged-in client sends one broken frame."""

    def perform(victim: Victim) -> str:
        with client(victim.port, token=victim.token) as hostile:
            hostile.send(frame)
            with contextlib.suppress(ConnectionClosed, TimeoutError):
                while True:
                    hostile.recv(timeout=PATIENCE)
        return is_served(victim)

    return perform


def sets_value(value: float) -> Act:
    """A logged-in client sends a slider beyond its end; another one comes and looks."""

    def perform(victim: Victim) -> str:
        with Guest(victim.port, victim.token) as hostile:
            hostile.read_until(lambda: "GuiSliderMessage" in {m["type"] for m in hostile.widgets.values()})
            uuid = next(u for u, made in hostile.widgets.items() if made["type"] == "GuiSliderMessage")
            limits = hostile.widgets[uuid]["props"]
            hostile.set(uuid, value)
            hostile.connection.ping(ack_on_close=True).wait(PATIENCE)  # by then the value has been handled
        with Guest(victim.port, victim.token) as honest:
            honest.read_until(lambda: uuid in honest.values)
            seen = honest.values[uuid]
        return "within the range" if limits["min"] <= seen <= limits["max"] else f"{seen:g} is kept"

    return perform


def half_open(victim: Victim) -> str:
    """200 connections that never finish their first line."""
    with contextlib.ExitStack() as stack:
        for i in range(200):
            half = stack.enter_context(socket.create_connection(("127.0.0.1", victim.port)))
            half.sendall(b"GET / HTTP/1.1\r\nHost: 127" if i % 2 else b"")
        return is_served(victim)


def from_network(victim: Victim) -> str:
    """By an address of this machine that is not the one listened on."""
    try:
        return status(exchange(victim.port, f"GET / HTTP/1.1\r\nHost: {victim.own}\r\n\r\n", "127.0.0.2"))
    except ConnectionRefusedError:
        return "refused"


ATTACKS = {
    "H1": Attack("page without the token", "403", page(cookie=False)),
    "H2": Attack("page under a foreign name (DNS rebinding)", "403", page("/", "evil.example")),
    "H3a": Attack("page under our name as a prefix, stolen cookie", "403", page("/", "localhost.evil.example")),
    "H3b": Attack("page under our address as a prefix, stolen cookie", "403", page("/", "127.0.0.1.nip.io")),
    "H4": Attack("page without a Host", "403", page("/", "")),
    "H5": Attack("page under two names", "403", page("/", None, "evil.example")),
    "H6a": Attack("Host `[::1`", "403", page("/", "[::1")),
    "H6b": Attack("Host of 5000 letters", "403", page("/", "a" * 5000)),
    "H6c": Attack("Host of raw bytes", "403", page("/", "\xff\xfe")),
    "H7a": Attack("link with a wrong token", "403", page("/?token=wrong-wrong-wrong-wrong", cookie=False)),
    "H7b": Attack("the printed link (the user)", "200", page("/?token={token}", cookie=False)),
    "H8": Attack("page with the cookie (the user)", "200", page()),
    "H9": Attack("`?websocket=`: our page connects elsewhere", "403", page("/?websocket=ws://evil:1")),
    "H10": Attack("`?playbackPath=`: our page plays a foreign file", "403", page("/?playbackPath=http://evil/x")),
    "H11a": Attack("path out of the folder, `%2e%2e`", "404", page("/%2e%2e/%2e%2e/_viser.py")),
    "H11b": Attack("path out of the folder, backslash", "404", page("/..\\..\\_viser.py")),
    "H12": Attack("cookie of raw bytes", "400", page(extra="Cookie: x=\xff")),
    "W1": Attack("socket without an Origin", "403", opens(None)),
    "W2": Attack("socket of a foreign page", "403", opens("http://evil.example", cookie=False)),
    "W3": Attack("socket of a foreign page, stolen cookie", "403", opens("http://evil.example")),
    "W4": Attack("socket of a page without a name (`null`)", "403", opens("null")),
    "W5": Attack("socket of another local program's page", "403", opens("http://127.0.0.1:3000")),
    "W6": Attack("socket of our origin as a prefix", "403", opens("http://{own}.evil.example")),
    "W7": Attack("socket by DNS rebinding", "403", opens("http://evil.example", "evil.example")),
    "W8": Attack("socket of our origin without the cookie", "403", opens("http://{own}", cookie=False)),
    "W9": Attack("socket by 127.0.0.1 (the user)", "open", opens("http://{own}")),
    "W10": Attack("socket by localhost (the user)", "open", opens("http://localhost:{port}", "localhost:{port}")),
    "W11": Attack("socket of the https page of our name", "403", opens("https://{own}")),
    "W12": Attack("`Upgrade: WebSocket` of a foreign page", "403", opens("http://evil.example", word="WebSocket")),
    "W14": Attack("a client sends a broken frame", "served on", sends(b"\xc1\xff garbage")),
    "W15": Attack("a client sends text", "served on", sends("text")),
    "W16a": Attack("a client sets a slider to 1e9", "within the range", sets_value(1e9)),
    "W16b": Attack("a client sets a slider to NaN", "within the range", sets_value(math.nan)),
    "D1a": Attack("200 half-open connections", "served on", half_open),
    "D1b": Attack("another address of this machine", "refused", from_network),
}


@contextlib.contextmanager
def kalscope() -> Iterator[Victim]:
    """The real program."""
    with tempfile.TemporaryDirectory() as folder, running(Path(folder)) as (_, url):
        yield Victim(port_of(url), token_of(url))


def seen_by(attack: Attack, victim: Victim) -> str:
    """What happens, as one word or a few."""
    try:
        return attack.perform(victim)
    except InvalidStatus as refused:
        return str(refused.response.status_code)
    except (OSError, AssertionError, LookupError, msgspec.DecodeError) as error:
        return type(error).__name__
