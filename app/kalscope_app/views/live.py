"""A live board: choose its port, connect, see the state of the connection, record what it sends."""

from __future__ import annotations

from collections.abc import Callable

import viser

from kalscope.common.text import count, duration, number
from kalscope.sources.live.source import LiveStatus
from kalscope.sources.port.registry import PortSpec, port_of
from kalscope.sources.port.serial_port import list_ports
from kalscope.sources.recorder import Recorder
from kalscope_app.engine.frame import Frame
from kalscope_app.engine.jobs import Jobs
from kalscope_app.live import BoardConnection, BoardRecording
from kalscope_app.session.changes import set_board_channel
from kalscope_app.session.session import Failed, Session
from kalscope_app.session.state import ConnectionState
from kalscope_app.views.widgets import add_button, bind, escape_markdown, offer, on_user
from kalscope_app.views.window import TYPED

OpenSpec = Callable[[str], None]
"""Opens the file at a path."""

# Record what a board sends: the name of the file, the buttons, and the status of the recording.


class RecordingView:
    """The last part of the folder "Live board". Starting and stopping are jobs."""

    def __init__(self, gui: viser.GuiApi, jobs: Jobs, recording: BoardRecording, open_spec: OpenSpec) -> None:
        """Args: the usual; the recording; opens the file at a path."""
        self._board_recording = recording
        self._text = gui.add_markdown("")
        hint = "A new file in the folder in which Kalscope was started."
        self._name = gui.add_text("record to", recording.name, hint=hint)

        def add(label: str, hint: str, act: Callable[[], None]) -> viser.GuiButtonHandle:
            return add_button(gui, label, hint, lambda _client: jobs.run(act, Failed.RECORD), visible=False)

        hint = "Every line as received, before any filter."
        self._record = add("Record", hint, lambda: recording.start(self._name.value.strip()))
        self._stop = add("Stop recording", "Ends and closes the file.", recording.stop)
        hint = "In place of the board; q, r, p0 and pins stay."
        self._open = add("Open the recording", hint, lambda: open_spec(str(recording.last)))
        recording.on_change = self._on_change

    def _on_change(self, recorder: Recorder | None) -> None:
        """Show a recording whatever is on screen: the engine draws nothing while a file is."""
        self._text.content = recording_text(recorder)
        if recorder is None:
            self._name.value = self._board_recording.name

    def show(self, connection: ConnectionState, source: str) -> None:
        """Offer what can be done now; `source` is what is on screen."""
        ready = connection.connected and not connection.recording
        self._name.visible = self._record.visible = ready
        self._stop.visible = connection.recording
        last = self._board_recording.last
        self._open.visible = last is not None and not connection.recording and str(last) != source


def recording_text(recorder: Recorder | None) -> str:
    """The status of the recording, as markdown; the name of the file is escaped."""
    if recorder is None:
        return ""
    lines = [f"recording to **{escape_markdown(recorder.paths[-1].name)}**", str(recorder.counts)]
    if recorder.error:
        lines.append(f"**{escape_markdown(recorder.error, 200)}**")
    return "\n".join(f"- {line}" for line in lines)


# A live board: choose its port, connect, see the state of the connection, record.


ADDRESS_HINT = "Such as ssh://host/dev/ttyACM0, tcp://host:port, udp://:47269, mqtt://broker/topic or file:log.csv."
NO_CURVE = "–"

PORTS_INTERVAL = 2.0
"""Seconds between two queries of the system's ports."""


class LiveView:
    """The folder "Live board" of the Source tab. Ports are opened and closed as jobs."""

    def __init__(
        self,
        gui: viser.GuiApi,
        session: Session,
        jobs: Jobs,
        connection: BoardConnection,
        recording: BoardRecording,
        open_spec: OpenSpec,
    ) -> None:
        """Args: the usual; the connection's own jobs; the connection; its recording; opens the file at a path."""
        self._session, self._jobs, self._connection = session, jobs, connection
        self._devices: dict[str, str] = {}
        self._chosen = ""
        with gui.add_folder("Live board"):
            hint = "A board that is plugged in appears here automatically. An address may be typed here, too."
            self._port = gui.add_dropdown("port", list[str]([TYPED]), hint=hint)
            self._typed = gui.add_text("address", "", hint=ADDRESS_HINT)
            hint = "Of a serial port, as in the sketch: Serial.begin()."
            self._baud = gui.add_text("baud rate", "115200", hint=hint)
            hint = "Opens the port and shows what the board sends."
            self._connect = add_button(gui, "Connect", hint, self._on_connect)
            hint = "Frees the port, for the Arduino IDE or another program."
            self._disconnect = add_button(
                gui, "Disconnect", hint, lambda _client: jobs.run(self._on_disconnect), visible=False
            )
            self._status = gui.add_markdown("", visible=False)
            self._recording = RecordingView(gui, jobs, recording, open_spec)
            with gui.add_folder("Advanced", expand_by_default=False):
                hint = "DTR: most boards restart, and some send only then."
                self._reset = gui.add_checkbox("reset the board on connecting", True, hint=hint)
                hint = "The channel in which the board sends its own filtered value."
                self._board = gui.add_dropdown("board's filtered channel", list[str]([NO_CURVE]), hint=hint)
        on_user(self._port.on_update, lambda _client: self._choose_port())
        bind(self._board, session, lambda name: set_board_channel(None if name == NO_CURVE else name))
        self._list_ports()
        if connection.source is not None:
            self._name(connection.source.spec)
        jobs.when_idle(self._list_ports, PORTS_INTERVAL)

    def _choose_port(self) -> None:
        self._chosen = self._port.value
        self._show_typed()

    def _show_typed(self) -> None:
        self._port.visible = self._baud.visible = free = self._connect.visible  # else a port is open
        self._typed.visible = free and self._port.value == TYPED

    def _name(self, spec: PortSpec) -> None:
        """Show the port that the command line named."""
        self._port.value = next((label for label, device in self._devices.items() if device == spec.url), TYPED)
        self._typed.value, self._baud.value = spec.url, str(spec.baud)
        self._show_typed()

    def _list_ports(self) -> None:
        """Offer the ports that the system lists now."""
        devices = {f"{port.device} {port.description}".strip(): port.device for port in list_ports()}
        if devices == self._devices:
            return
        typed = self._port.value == TYPED and bool(self._typed.value.strip())
        kept = typed or self._port.value == self._chosen
        value = port_to_show(self._port.value, tuple(self._devices), tuple(devices), kept=kept)
        self._devices = devices
        offer(self._port, (*devices, TYPED), value)
        self._show_typed()  # otherwise a box could stay in which an address has no effect

    def _on_connect(self, _client: viser.ClientHandle) -> None:
        spec = self._typed.value.strip() if self._port.value == TYPED else self._devices.get(self._port.value, "")
        rate, reset = self._baud.value.strip(), self._reset.value
        self._jobs.run(
            lambda: self._connection.open(self._session, port_of(spec, default_baud=rate, reset=reset)),
            Failed.CONNECT,
        )

    def _on_disconnect(self) -> None:
        self._connection.close()
        self._session.wakeup.set()  # the engine draws nothing by itself while a file is on screen

    def show(self, frame: Frame) -> None:
        """Show the state of the connection and what can be done."""
        connection = frame.connection
        self._connect.visible, self._disconnect.visible = not connection.connected, connection.connected
        self._show_typed()
        self._recording.show(connection, frame.state.recording.source)
        text = "" if connection.status is None else status_text(connection.status)
        self._status.content, self._status.visible = text, bool(text)
        offer(self._board, (NO_CURVE, *frame.state.recording.names), frame.state.board or NO_CURVE)


def port_to_show(shown: str, before: tuple[str, ...], now: tuple[str, ...], *, kept: bool) -> str:
    """Which port of a new list to show: the one that was just plugged in, unless the user chose another.

    Args:
        shown: the one on screen, or TYPED.
        before: the list until now.
        now: the new list.
        kept: whether the user chose the one on screen, or has typed an address.
    """
    if kept and shown in (*now, TYPED):
        return shown
    rest = shown if shown in now else next(iter(now), TYPED)
    return next((port for port in now if port not in before), rest) if before else rest


def status_text(status: LiveStatus) -> str:
    """The state of the connection, as markdown; what the board or the system sent is escaped."""
    lines = [f"**{escape_markdown(status.word, 200)}**: {escape_markdown(status.port, 200)}"]
    if status.hint:
        lines.append(escape_markdown(status.hint, 300))
    lines += [
        f"{number(status.lines_per_s)} lines/s",
        *([f"one sample every {duration(status.period)}"] if status.period else []),
        f"{count(status.received)} lines = {count(status.accepted)} read + {count(status.rejected)} rejected"
        f" + {count(status.dropped)} dropped",
        f"reconnects: {count(status.reconnects)}",
    ]
    return "\n".join(f"- {line}" for line in lines)
