"""A browser without a browser: viser's protocol from the client's side."""

from __future__ import annotations

import time
from typing import Any

import msgspec
import viser
import zstandard
from tests.support.waiting import PATIENCE
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect
from websockets.sync.connection import Connection

CAMERA = {"wxyz": (1.0, 0.0, 0.0, 0.0), "position": (1.0, 1.0, 1.0), "look_at": (0.0, 0.0, 0.0), "fov": 1.0}
CAMERA |= {"near": 0.1, "far": 10.0, "image_height": 10, "image_width": 10, "up_direction": (0.0, 0.0, 1.0)}
"""The message by which a browser says that it is there."""


def client(port: int, *, token: str) -> ClientConnection:
    """A websocket as our own page opens it."""
    return connect(
        f"ws://127.0.0.1:{port}/",
        origin=f"http://127.0.0.1:{port}",  # pyright: ignore[reportArgumentType]
        subprotocols=[f"viser-v{viser.__version__}"],  # pyright: ignore[reportArgumentType]
        additional_headers={"Cookie": f"kalscope_{port}={token}"},
        compression=None,
        max_size=None,
        max_queue=None,  # a client that does not read could not hear the end of its connection either
        proxy=None,
        open_timeout=PATIENCE,
    )


def packed(kind: str, **fields: object) -> bytes:
    """One message of a client."""
    return msgspec.msgpack.encode({"type": kind, **fields})


def messages_in(frame: bytes) -> list[dict[str, Any]]:
    """The messages of one frame of the server: two sizes, compressed msgpack, then arrays, which are left out."""
    size, length = (int.from_bytes(frame[at : at + 8], "little") for at in (0, 8))
    inner = zstandard.ZstdDecompressor().decompress(frame[16 : 16 + length], max_output_size=size)
    return msgspec.msgpack.decode(inner)["messages"]


def close_code(connection: Connection) -> int | None:
    """With what code the server ends this connection."""
    try:
        while True:
            connection.recv(timeout=PATIENCE)
    except ConnectionClosed as closed:
        return closed.rcvd.code if closed.rcvd else None


class Guest:
    """A connected client that knows the widgets and their values, as its screen would show them."""

    def __init__(self, port: int, token: str) -> None:
        self.connection = client(port, token=token)
        self.widgets: dict[str, dict[str, Any]] = {}
        """The message that made each widget, by its uuid."""
        self.values: dict[str, Any] = {}
        """The present value of each widget on this screen."""
        self.markdown: dict[str, str] = {}
        """The present text of each piece of markdown."""
        self.texts: set[str] = set()
        """Every text that any piece of markdown ever had."""
        self.nodes: set[str] = set()
        """Names of the nodes of the scene."""
        self.commands: dict[str, str] = {}
        """Labels of the commands of the palette, by uuid."""
        self.notices: list[str] = []
        """What notifications said."""
        self.send("ViewerCameraMessage", **CAMERA)

    def send(self, kind: str, **fields: object) -> None:
        self.connection.send(packed(kind, **fields))

    def set(self, uuid: str, value: object) -> None:
        """Move a widget: this screen shows it at once."""
        self.values[uuid] = value
        self.send("GuiUpdateMessage", uuid=uuid, updates={"value": value})

    def upload(self, name: str, content: bytes) -> None:
        """Send a file by the button of the Source tab."""
        transfer = {"source_component_uuid": self.find("Upload a file …"), "transfer_uuid": name}
        size = {"part_count": 1, "size_bytes": len(content), "mime_type": "text/csv"}
        self.send("FileTransferStartUpload", **transfer, **size, filename=name)
        self.send("FileTransferPart", **transfer, part_index=0, content=content)

    def read(self, timeout: float = PATIENCE) -> bool:
        """Take in one frame; False if none came in time."""
        try:
            frame = self.connection.recv(timeout=timeout)
        except TimeoutError:
            return False
        assert isinstance(frame, bytes)
        for message in messages_in(frame):
            self._take(message)
        return True

    def _take(self, message: dict[str, Any]) -> None:
        uuid = message.get("uuid", "")
        text = (message.get("props") or message.get("updates") or {}).get("_markdown")
        if isinstance(text, str):
            self.markdown[uuid] = text
            self.texts.add(text)
        if message["type"].startswith("Gui") and "props" in message:
            self.widgets[uuid] = message
            if "value" in message:
                self.values[uuid] = message["value"]
        elif message["type"] == "GuiUpdateMessage":
            if "value" in message["updates"]:
                self.values[uuid] = message["updates"]["value"]
            if "props" in self.widgets.get(uuid, {}):  # of a job that has ended since, too
                self.widgets[uuid]["props"].update(message["updates"])
        elif message["type"] == "RegisterCommandMessage":
            self.commands[uuid] = message["props"]["label"]
        elif "name" in message and "props" in message:
            self.nodes.add(message["name"])
        elif message["type"] in ("NotificationShowMessage", "NotificationMessage"):
            self.notices.append(str(message))

    def read_until(self, is_so: Any, timeout: float = PATIENCE) -> None:
        """Take in frames until something holds; a live board sends frames without end."""
        deadline = time.monotonic() + timeout
        while not is_so():
            assert self.read(timeout), "it never became so"
            assert time.monotonic() < deadline, "frames came, but it never became so"

    def find(self, label: str) -> str:
        """The uuid of the widget with this label."""
        labels = {made.get("props", {}).get("label"): uuid for uuid, made in reversed(self.widgets.items())}
        if label not in labels:
            raise LookupError(f"no widget {label!r} among {list(labels)}")
        return labels[label]

    def __enter__(self) -> Guest:
        return self

    def __exit__(self, *_: object) -> None:
        self.connection.close()
