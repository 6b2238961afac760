"""What a connected client may send: updates of values, and uploads up to a cap. Each test is a raw client."""

from __future__ import annotations

import contextlib
import dataclasses
import queue
from collections.abc import Callable, Iterator

import msgspec
import pytest
import viser
from hypothesis import given
from hypothesis import strategies as st
from tests.app import wire
from tests.app.wire import CAMERA, PATIENCE, close_code, packed
from viser import _messages as messages
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection
from websockets.sync.connection import Connection

from kalscope_app.guard import messages as message_filter
from kalscope_app.guard import requests
from kalscope_app.guard import server as guard
from kalscope_app.guard.server import GuardedServer, guarded_server

TOKEN = "T0ken-T0ken_T0ken"
CAP = 1 << 20


def client(port: int) -> ClientConnection:
    return wire.client(port, token=TOKEN)


class Bench:
    """A guarded server with one text box and one upload button in each scope, and one connected client."""

    def __init__(self, running: GuardedServer, connection: Connection, refused: queue.Queue[str]) -> None:
        self.running, self.connection, self.refused = running, connection, refused
        self.changed: queue.Queue[str] = queue.Queue()
        self.uploaded: queue.Queue[viser.UploadedFile] = queue.Queue()
        self.guis, self.texts, self.buttons = {}, {}, {}

    def furnish(self, scope: str, gui: viser.GuiApi) -> None:
        self.guis[scope], text, button = gui, gui.add_text("text", "old"), gui.add_upload_button("upload")
        text.on_update(lambda event: self.changed.put(event.target.value))
        button.on_upload(lambda event: self.uploaded.put(event.target.value))
        self.texts[scope], self.buttons[scope] = text, button

    def send(self, kind: str, **fields: object) -> None:
        self.connection.send(packed(kind, **fields))

    def update(self, scope: str, **updates: object) -> None:
        self.send("GuiUpdateMessage", uuid=self.texts[scope]._impl.uuid, updates=updates)

    def start(self, uuid: str, size: object, parts: object, name: str = "t") -> None:
        transfer = {"source_component_uuid": uuid, "transfer_uuid": name, "filename": "x.csv"}
        self.send("FileTransferStartUpload", **transfer, mime_type="text/csv", part_count=parts, size_bytes=size)

    def part(self, uuid: str, index: int, content: object, name: str = "t") -> None:
        transfer = {"source_component_uuid": uuid, "transfer_uuid": name}
        self.send("FileTransferPart", **transfer, part_index=index, content=content)

    def settle(self) -> None:
        """Wait until everything sent before has been handled: messages are handled in their order."""
        for value in ("settled", "old"):
            self.update("shared", value=value)
            while self.changed.get(timeout=PATIENCE) != value:
                pass

    def under_way(self) -> dict[str, int]:
        uploads = [each for gui in self.guis.values() for each in gui._current_file_upload_states.items()]
        return {name: upload["total_bytes"] for name, upload in uploads}


@pytest.fixture
def bench(monkeypatch) -> Iterator[Bench]:
    monkeypatch.setattr(message_filter, "MAX_UPLOAD_BYTES", CAP)
    refused: queue.Queue[str] = queue.Queue()
    arrived: queue.Queue[viser.ClientHandle] = queue.Queue()
    with (
        guarded_server(port=0, token=lambda _port: TOKEN, on_refused=refused.put) as running,
        client(running.port) as connection,
    ):
        running.server.on_client_connect(arrived.put)
        bench = Bench(running, connection, refused)
        bench.send("ViewerCameraMessage", **CAMERA)
        bench.furnish("shared", running.server.gui)
        bench.furnish("client", arrived.get(timeout=PATIENCE).gui)
        yield bench


SCOPES = pytest.mark.parametrize("scope", ["shared", "client"])


@SCOPES
def test_of_an_update_only_the_value_is_taken(bench, scope):
    others = ("removed", "update_cb", "is_button", "update_timestamp", "uuid", "sync_cb")
    for attribute in others:
        bench.update(scope, **{attribute: "hostile"})
    bench.update(scope, value="new", **dict.fromkeys(others, "hostile"))
    assert bench.changed.get(timeout=PATIENCE) == "new"
    assert "hostile" not in [getattr(bench.texts[scope]._impl, attribute) for attribute in others]
    bench.texts[scope].value = "still usable"


def test_a_share_request_does_nothing(bench, monkeypatch):
    """W13: stock viser opens a tunnel to a public server."""
    tunnels = []
    monkeypatch.setattr("viser._viser.ViserTunnel", lambda *args: tunnels.append(args))
    for kind in messages.ShareUrlRequest, messages.ShareUrlDisconnect:
        bench.send(kind.__name__)
        assert kind not in bench.running.server._websock_server._incoming_handlers
    bench.settle()
    assert (bench.running.server.request_share_url(), tunnels) == (None, [])


@SCOPES
def test_an_upload_within_the_cap_arrives(bench, scope):
    uuid = bench.buttons[scope]._impl.uuid
    bench.start(uuid, 3, 1)
    bench.part(uuid, 0, b"1,2")
    assert bench.uploaded.get(timeout=PATIENCE) == viser.UploadedFile("x.csv", b"1,2")
    bench.start(uuid, 0, 0)  # an empty file has no parts
    assert bench.uploaded.get(timeout=PATIENCE) == viser.UploadedFile("x.csv", b"")
    assert bench.under_way() == {}


@SCOPES
def test_an_oversize_upload_is_refused_before_a_part_is_stored(bench, scope):
    uuid = bench.buttons[scope]._impl.uuid
    for size, parts in (CAP + 1, 3), (10**12, 2 * 10**6), (CAP, 10**9), (5, 0), (1, 2), (-1, 0):
        bench.start(uuid, size, parts)
        words = bench.refused.get(timeout=PATIENCE)
        bench.part(uuid, 0, b"x" * 1000)
        bench.settle()
        assert bench.under_way() == {}
        assert words.endswith("kalscope open FILE") if size > CAP else words
        assert bench.refused.empty()


def test_a_refused_upload_frees_the_button(bench):
    """The browser disables its button until the last acknowledgement, which would never come."""
    uuid, sent = bench.buttons["client"]._impl.uuid, []
    next(iter(bench.running.server.get_clients().values()))._websock_connection.queue_message = sent.append
    bench.start(uuid, CAP + 1, 3, "big")
    bench.refused.get(timeout=PATIENCE)
    done, removed = sent
    assert (done.source_component_uuid, done.transferred_bytes, done.total_bytes) == (uuid, 0, 0)
    assert removed.uuid == "upload-big"


def test_one_upload_runs_at_a_time_and_no_other_client_can_replace_it_or_add_to_it(bench):
    shared, own = bench.buttons["shared"]._impl.uuid, bench.buttons["client"]._impl.uuid
    bench.start(shared, 2, 1, "a")
    bench.start(shared, 9, 1, "a")  # announced again
    bench.start(own, 1, 1, "b")
    assert "under way" in bench.refused.get(timeout=PATIENCE)
    with client(bench.running.port) as other:
        intruder = Bench(bench.running, other, bench.refused)
        intruder.part(shared, 0, b"!", "a")
        intruder.start(shared, 1, 1, "c")
        assert "under way" in bench.refused.get(timeout=PATIENCE)  # the part was handled before
    assert bench.under_way() == {"a": 2}
    bench.part(shared, 0, b"ok", "a")
    assert bench.uploaded.get(timeout=PATIENCE).content == b"ok"
    assert bench.refused.empty()


def test_more_bytes_than_announced_are_refused_and_end_the_connection(bench):
    uuid = bench.buttons["shared"]._impl.uuid
    bench.start(uuid, 2000, 2)
    bench.part(uuid, 0, b"x" * 1500)
    bench.part(uuid, 1, b"x" * 1500)
    assert "more bytes than it announced" in bench.refused.get(timeout=PATIENCE)
    assert close_code(bench.connection) == 1008
    assert bench.under_way() == {}


def test_an_upload_that_stalls_gives_its_room_to_others(bench, monkeypatch):
    uuid = bench.buttons["shared"]._impl.uuid
    bench.start(uuid, CAP, 2, "never sent")
    bench.settle()
    monkeypatch.setattr(message_filter, "STALLED_S", -1.0)
    bench.start(uuid, CAP, 2, "next")
    bench.settle()
    assert bench.under_way() == {"next": CAP}
    assert bench.refused.empty()


def test_a_file_cannot_become_the_value_of_another_widget(bench):
    """Stock viser stores it in whatever widget the client names, at the start or with the last part."""
    button, text = bench.buttons["shared"]._impl.uuid, bench.texts["shared"]._impl.uuid
    bench.start(text, 1, 1, "to the text")
    bench.part(text, 0, b"x", "to the text")
    bench.start(button, 1, 1, "moved")
    bench.part(text, 0, b"x", "moved")
    bench.settle()
    assert bench.texts["shared"].value == "old"
    assert bench.under_way() == {}


def test_a_client_that_leaves_takes_its_upload_with_it(bench):
    """Also one that never sent its camera, whom stock viser forgets to clean up after."""
    uuid = bench.buttons["shared"]._impl.uuid
    with client(bench.running.port) as other:
        Bench(bench.running, other, bench.refused).start(uuid, CAP, 2, "left behind")
        wait_for(lambda: bench.under_way() == {"left behind": CAP}, bench)
    wait_for(lambda: bench.under_way() == {}, bench)


def wait_for(is_so: Callable[[], bool], bench: Bench) -> None:
    """Ask after each round trip of the bench's own client; a round trip lets other clients' messages in."""
    for _ in range(2000):
        if is_so():
            return
        bench.settle()
    raise AssertionError("it never became so")


# --- an offender is disconnected, and no other client ------------------------------------------------------


UPLOAD = {"source_component_uuid": "u", "transfer_uuid": "t", "mime_type": "", "size_bytes": 1}
LONG = "x" * (message_filter.MAX_NAME + 1)
PART = {"source_component_uuid": "u", "transfer_uuid": "t", "part_index": 0}
IMPOSSIBLE = {
    "garbage": (b"\xc1\xff garbage", 1011),
    "a text": ("text", 1011),
    "no known message": (packed("NoSuchMessage"), 1011),
    "no mapping": (msgspec.msgpack.encode([1]), 1011),
    "a frame beyond the limit": (b"x" * (guard.MAX_FRAME_BYTES + 1), 1009),
    "updates in a list": (packed("GuiUpdateMessage", uuid="u", updates=[1]), 1008),
    "updates missing": (packed("GuiUpdateMessage", uuid="u", updates=None), 1008),
    "a number as name": (packed("GuiUpdateMessage", uuid=1, updates={}), 1008),
    "an endless name": (packed("GuiFormSubmitMessage", uuid=LONG), 1008),
    "a command of bytes": (packed("CommandTriggerMessage", uuid=b"u"), 1008),
    "a camera nowhere": (packed("ViewerCameraMessage", **CAMERA | {"position": (float("nan"), 0, 0)}), 1008),
    "an endless screen": (packed("ViewerCameraMessage", **CAMERA | {"image_width": 10**9}), 1008),
    "a hold at no frequency": (packed("GuiButtonHoldMessage", uuid="u", frequency=float("inf")), 1008),
    "an upload with a long name": (packed("FileTransferStartUpload", **UPLOAD, filename=LONG, part_count=1), 1008),
    "a part of text": (packed("FileTransferPart", **PART, content="text"), 1008),
}


def test_what_no_browser_sends_ends_only_its_own_connection(bench):
    for what, (frame, code) in IMPOSSIBLE.items():
        with client(bench.running.port) as hostile:
            hostile.send(frame)
            assert (what, close_code(hostile)) == (what, code)
        bench.settle()


def test_a_client_that_floods_is_disconnected(bench, monkeypatch):
    monkeypatch.setattr(message_filter, "MAX_PER_SECOND", 0.0)  # a slow machine may take them as slowly as a hand
    with client(bench.running.port) as hostile:
        with contextlib.suppress(ConnectionClosed):
            for _ in range(int(message_filter.MAX_BURST) + 1):
                hostile.send(packed("GuiFormSubmitMessage", uuid="u"))
        assert close_code(hostile) == 1008
    bench.settle()


def test_a_message_for_a_form_that_does_not_exist_leaves_nothing_behind(bench):
    """Stock viser keeps a message for each name that a client makes up, and sends them to all who come."""
    buffer = bench.running.server._websock_server._broadcast_buffer
    before = len(buffer.message_from_id)
    for i in range(100):
        bench.send("GuiFormDirtyMessage", uuid=f"made up {i}")
    bench.settle()
    assert len(buffer.message_from_id) <= before + 1


def test_no_more_clients_than_there_is_room_for(bench, monkeypatch):
    monkeypatch.setattr(requests, "MAX_CLIENTS", 2)
    with client(bench.running.port) as second:
        second.recv(timeout=PATIENCE)
        with client(bench.running.port) as third:
            assert close_code(third) == 1013
    bench.settle()
    wait_for(lambda: len(bench.running.server._websock_server._live_connections) == 1, bench)
    with client(bench.running.port) as after:
        after.recv(timeout=PATIENCE)


def test_after_a_gesture_every_browser_is_told_the_same_value(bench):
    """Its sender too: stock viser never tells it, so crossing edits leave two screens that differ."""
    uuid = bench.texts["shared"]._impl.uuid
    with wire.Guest(bench.running.port, TOKEN) as second:
        wait_for(lambda: len(bench.running.server.get_clients()) == 2, bench)
        second.set(uuid, "settled here")
        second.values.clear()
        second.read_until(lambda: second.values.get(uuid) == "settled here")


# --- which values a widget takes, decided without a server ----------------------------------------------


TAKEN = {
    "within the range": (0.5, 0.7, 0.0, 1.0, 0.7),
    "above": (0.5, 99, 0.0, 4.0, 4.0),
    "below": (0.5, -5, 0.001, 10.0, 0.001),
    "no range": (0.5, -1e300, None, None, -1e300),
    "a whole number for a fraction": (0.5, 1, 0.0, 1.0, 1),
    "a tick": (False, True, None, None, True),
    "two thumbs": ((0.0, 1.0), [0.2, 7], 0.0, 1.0, (0.2, 1.0)),
    "beyond every float": (0.5, 10**400, None, None, None),
    "a tick for a number": (0.5, True, None, None, None),
    "an endless text": ("a", "x" * (message_filter.MAX_TEXT + 1), None, None, None),
    "one thumb too many": ((0.0, 1.0), [0.1, 0.2, 0.3], None, None, None),
    "one number for two thumbs": ((0.0, 1.0), 0.5, None, None, None),
    "a widget of unknown kind": (object(), 1, None, None, None),
}
"""Present value, what is sent, lowest, highest, what is taken."""


@pytest.mark.parametrize(("current", "value", "low", "high", "expected"), TAKEN.values(), ids=TAKEN.keys())
def test_a_value_is_held_within_its_range_and_what_does_not_fit_is_left(current, value, low, high, expected):
    assert message_filter.fitting_value(current, value, low, high) == expected


junk = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5) | st.binary(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=2), inner, max_size=2),
)


KINDS = [messages.GuiUpdateMessage, messages.GuiFormSubmitMessage, messages.GuiButtonHoldMessage]
KINDS += [messages.CommandTriggerMessage, messages.FileTransferStartUpload, messages.FileTransferPart]
KINDS += [messages.ViewerCameraMessage, messages.SceneNodeClickMessage, messages.SceneNodeDragMessage]
KINDS += [messages.ScenePointerMessage, messages.TransformControlsUpdateMessage]
"""What viser handles."""


@pytest.mark.slow
@given(st.sampled_from(KINDS), st.data())
def test_a_message_of_junk_is_judged_and_nothing_else_is_raised(kind, data):
    message = kind(**{field.name: data.draw(junk) for field in dataclasses.fields(kind) if field.init})
    with contextlib.suppress(message_filter.Misbehaviour):
        message_filter.check_fields(message)


def test_a_menu_takes_its_own_words_only():
    assert [message_filter.fitting_value("a", word, None, None, ("a", "b")) for word in "bc"] == ["b", None]


def test_the_rate_limit_is_a_burst_and_then_a_rate():
    limit = message_filter.RateLimit(100.0)
    assert all(limit.allows(100.0) for _ in range(int(message_filter.MAX_BURST)))
    assert not limit.allows(100.0)
    limit = message_filter.RateLimit(0.0)
    assert all(
        limit.allows(i / (0.9 * message_filter.MAX_PER_SECOND)) for i in range(20 * int(message_filter.MAX_BURST))
    )
