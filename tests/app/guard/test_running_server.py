"""The guard before a real viser server: raw requests, websocket clients, settings that cannot work."""

from __future__ import annotations

import socket
import threading
import types

import pytest
import viser
import websockets.asyncio.server
from tests.app import wire
from tests.app.attack_table import exchange
from tests.support.waiting import PATIENCE
from viser.infra import _infra
from websockets.sync.client import ClientConnection

from kalscope.errors import BadSetting
from kalscope_app.guard import requests as request_filter
from kalscope_app.guard.server import GuardFailed, guarded_server

TOKEN = "T0ken-T0ken_T0ken"


def cookie(port: int) -> str:
    return f"kalscope_{port}={TOKEN}"


def status_of(answer: bytes) -> int:
    return int(answer.split(b" ", 2)[1])


def get(port: int, target: str = "/", host: str | None = None, extra: str = "") -> bytes:
    host = f"127.0.0.1:{port}" if host is None else host
    return exchange(port, f"GET {target} HTTP/1.1\r\nHost: {host}\r\n{extra}\r\n")


def client(port: int, *, token: str = TOKEN) -> ClientConnection:
    return wire.client(port, token=token)


def threads_of_viser() -> set[threading.Thread]:
    """The event loops of viser servers: viser starts them from a lambda, after which Python names them."""
    return {thread for thread in threading.enumerate() if "<lambda>" in thread.name}


# --- starting and stopping --------------------------------------------------------------------------------


def test_a_busy_port_and_an_unusable_host_are_named_at_once():
    """Stock viser takes the next port, or waits for ever."""
    with socket.create_server(("127.0.0.1", 0)) as taken:
        busy = "127.0.0.1", taken.getsockname()[1]
        hosts = ["no-such-name.invalid", "203.0.113.7", "a..b", "x" * 300, "nul\0", "127.0.0.1:80"]
        for host, port in (busy, *((host, 0) for host in hosts)):
            with pytest.raises(BadSetting) as error:
                guarded_server(host, port)
            said = f"host {host!r} with port {port} cannot be used on this machine: "
            assert str(error.value).startswith(said)
            assert str(error.value).endswith("; --port 0 takes any free port")
            assert "\n" not in str(error.value)


def test_all_networks_need_a_name():
    with pytest.raises(BadSetting, match="--allow-host"):
        guarded_server("0.0.0.0", 0)
    with guarded_server("0.0.0.0", 0, allow_hosts=["Raspberry.local"], token=lambda _port: TOKEN) as running:
        assert running.url == f"http://raspberry.local:{running.port}/?token={TOKEN}"
        host = f"raspberry.local:{running.port}"
        assert status_of(get(running.port, f"/?token={TOKEN}", host)) == 200
        assert status_of(get(running.port, f"/?token={TOKEN}", "other.local")) == 403


@pytest.mark.parametrize("hold", [False, True])
def test_stop_frees_the_port_even_with_a_client_that_is_connected_or_waits(hold):
    before = threads_of_viser()
    running = guarded_server(port=0, token=lambda _port: TOKEN, hold=hold)
    with client(running.port) as connected:
        _ = hold or connected.recv(timeout=PATIENCE)
        assert threads_of_viser() > before
        running.stop()
        running.stop()
    assert threads_of_viser() <= before
    guarded_server(port=running.port).stop()


def test_a_page_loads_while_its_connection_waits_for_the_screen():
    with guarded_server(port=0, token=lambda _port: TOKEN, hold=True) as running:
        assert status_of(get(running.port, extra=f"Cookie: {cookie(running.port)}\r\n")) == 200
        with client(running.port) as waiting:
            running.server.gui.add_button("built meanwhile")
            with pytest.raises(TimeoutError):
                waiting.recv(timeout=0.2)
            assert running.server.get_clients() == {}
            running.let_in()
            waiting.recv(timeout=PATIENCE)


@pytest.mark.skipif(not socket.has_ipv6, reason="this machine has no IPv6")
def test_the_link_of_an_ipv6_address_has_brackets():
    with guarded_server("::1", 0, token=lambda _port: TOKEN) as running:
        assert running.url == f"http://[::1]:{running.port}/?token={TOKEN}"
        link = f"GET /?token={TOKEN} HTTP/1.1\r\nHost: [::1]:{running.port}\r\n\r\n"
        answer = exchange(running.port, link, "::1")
    assert status_of(answer) == 200


# --- fail closed ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "answer"),
    [
        *(("host_allowed", True), ("origin_allowed", True), ("_has_cookie", True), ("_answer_to_query", None)),
        *(("decide", None), ("decide", request_filter.Refuse(403, "No."))),
    ],
)
def test_the_self_test_stops_a_server_that_lets_something_through_or_nothing(monkeypatch, name, answer):
    before = threads_of_viser()
    monkeypatch.setattr(request_filter, name, lambda *_, **__: answer)
    with pytest.raises(GuardFailed, match="self-test failed"):
        guarded_server(port=0)
    assert threads_of_viser() <= before


def test_a_viser_that_opens_its_socket_otherwise_is_stopped(monkeypatch):
    """As if viser had bound the name at import: our replacement is never called."""
    ports, stock = [], websockets.asyncio.server.serve

    def serve(handler, host, port, **kwargs):
        ports.append(port)
        return stock(handler, host, port, **kwargs)

    own = types.SimpleNamespace(datastructures=websockets.datastructures, exceptions=websockets.exceptions)
    own.asyncio = types.SimpleNamespace(server=types.SimpleNamespace(serve=serve))
    monkeypatch.setattr(_infra, "websockets", own)
    before = threads_of_viser()
    with pytest.raises(GuardFailed, match=r"install viser 1\.1\.1"):
        guarded_server(port=0)
    assert ports
    assert threads_of_viser() <= before


def test_a_viser_without_a_known_handler_or_private_name_is_stopped(monkeypatch):
    handlers, before, made = _infra.WebsockMessageHandler, threads_of_viser(), viser.GuiApi.__init__
    stock = handlers.register_handler
    shares = "ShareUrlRequest", "ShareUrlDisconnect"
    for missing in (*shares, "GuiUpdateMessage", "FileTransferStartUpload", "FileTransferPart"):

        def register(self, cls, callback, missing=missing):
            return None if cls.__name__ == missing else stock(self, cls, callback)

        monkeypatch.setattr(handlers, "register_handler", register)
        with pytest.raises(GuardFailed, match="not the version Kalscope guards"):
            guarded_server(port=0)
    monkeypatch.undo()

    def forget(self, *args, **kwargs):
        made(self, *args, **kwargs)
        del self._current_file_upload_states

    monkeypatch.setattr(viser.GuiApi, "__init__", forget)
    with pytest.raises(GuardFailed, match="_current_file_upload_states"):
        guarded_server(port=0)
    assert threads_of_viser() <= before
