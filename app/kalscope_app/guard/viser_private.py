"""The private names of viser 1.1.1 that Kalscope uses, all in one place and with their types.

viser has no public hook before a message is handled or after a callback has failed. A name that another version
lacks is an AttributeError or a LookupError when the guard is installed, before any browser can connect.
"""
# viser leaves the type arguments of its coroutines and widget states open.
# pyright: reportPrivateUsage=false, reportUnknownMemberType=false
# pyright: reportUnknownVariableType=false, reportUnknownArgumentType=false

from __future__ import annotations

import inspect
from collections.abc import Callable, Coroutine, Generator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, cast

import viser
from viser import _messages as messages
from viser import _scene_api, _viser
from viser.infra import ClientId

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from viser._gui_handles import _GuiInputHandle
    from viser.infra import Message, WebsockClientConnection, WebsockServer
    from websockets.asyncio.server import ServerConnection

    Handle = Callable[[int, Message], Coroutine[Any, Any, None]]

__all__ = ["messages"]  # the rest is defined here


class Channel:
    """What comes in for one set of panels: the shared ones, or those of one client."""

    def __init__(self, handler: WebsockServer | WebsockClientConnection) -> None:
        self._handler = handler
        self.handlers: dict[type[Message], Any] = handler._incoming_handlers
        (on_upload,) = self.handlers[messages.FileTransferStartUpload]
        gui = getattr(on_upload, "__self__", None)
        if not isinstance(gui, viser.GuiApi):
            raise TypeError(f"uploads are handled by {type(gui).__name__}")
        self._gui, self._widgets = gui, gui._gui_input_handle_from_uuid
        self.uploads = gui._current_file_upload_states
        """The unfinished uploads, by their transfer_uuid."""
        self.handle = cast("Handle", handler._handle_incoming_message)
        """viser's own way of handling a message."""

    def widget(self, uuid: str) -> _GuiInputHandle[Any] | None:
        """The widget of this name, if there is one."""
        return self._widgets.get(uuid)

    def is_upload_button(self, uuid: str | None) -> bool:
        """Whether there is an upload button of this name."""
        return isinstance(self._widgets.get(uuid or ""), viser.GuiUploadButtonHandle)

    def send(self, message: Message) -> None:
        """Send to the browsers that show these panels."""
        self._handler.queue_message(message)

    def drop_uploads(self, client_id: int) -> None:
        """Forget the unfinished uploads of a client."""
        self._gui._drop_uploads_from_client(ClientId(client_id))

    def intercept(self, dispatch: Handle) -> None:
        """Call `dispatch` for each message instead of `handle`."""
        setattr(self._handler, "_handle_incoming_message", dispatch)  # noqa: B010


def socket_of(server: viser.ViserServer) -> WebsockServer:
    """The part of viser that communicates with browsers."""
    return server._websock_server


def connection_of(socket: WebsockServer, client_id: int) -> ServerConnection | None:
    """The open connection of a client."""
    return socket._live_connections.get(client_id)


def thread_pool(server: viser.ViserServer) -> Executor:
    """The threads that run callbacks."""
    return server._thread_executor


def take_upload(button: viser.GuiUploadButtonHandle) -> viser.UploadedFile:
    """The uploaded file, which viser would keep in memory otherwise."""
    file, button._impl.value = button.value, viser.UploadedFile("", b"")
    return file


def widgets_of(gui: viser.GuiApi) -> tuple[_GuiInputHandle[Any], ...]:
    """Every widget that a user can press or change, in the order in which they were made."""
    return tuple(gui._gui_input_handle_from_uuid.values())


def is_on_screen(gui: viser.GuiApi, widget: Any) -> bool:
    """Whether neither a widget nor a folder around it is hidden; a closed folder is on screen."""
    while widget is not None and getattr(widget, "visible", True):
        impl = getattr(widget, "_impl", None)  # tabs and the root have none
        widget = gui._container_handle_from_uuid.get(getattr(impl, "parent_container_id", ""))
    return widget is None


def commands_of(gui: viser.GuiApi) -> tuple[str, ...]:
    """The names in the command palette."""
    return tuple(command.label for command in gui._command_handle_from_uuid.values())


async def press(widget: _GuiInputHandle[Any], client: viser.ClientHandle) -> None:
    """Do what a click of this browser on the widget would do."""
    event = viser.GuiEvent(client=client, client_id=client.client_id, target=widget)
    for callback in tuple(widget._impl.update_cb):
        answer = callback(event)
        if inspect.isawaitable(answer):
            await answer


def set_ends(slider: viser.GuiSliderHandle[float], low: tuple[float, str], high: tuple[float, str]) -> None:
    """Set both ends of a slider, each a position and the words below it."""
    if (slider.min, slider.max) != (low[0], high[0]) or slider._marks is None:
        slider.min, slider.max = low[0], high[0]
        slider._marks = tuple(messages.GuiSliderMark(*end) for end in (low, high))


@contextmanager
def replaced(module: object, name: str, value: Callable[..., Any] | str) -> Generator[None]:
    """Replace a function or a value of a module while the block runs."""
    stock = getattr(module, name)
    setattr(module, name, value)
    try:
        yield
    finally:
        setattr(module, name, stock)


@contextmanager
def callback_errors_to(report: Callable[[BaseException], None]) -> Generator[None]:
    """While the block runs, report what a callback raises on viser's event loop, which would print it."""
    name = "print_awaited_callback_error"
    with replaced(_scene_api, name, report), replaced(_viser, name, report):
        yield
