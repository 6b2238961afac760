"""A live board: choose its port, connect, see the state of the connection, record what it sends."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import viser

from kalscope.common.text import count, duration, number
from kalscope.sources.live.source import LiveStatus
from kalscope.sources.port.registry import PortSpec, named_transport
from kalscope.sources.port.serial_port import list_ports
from kalscope.sources.recorder import Recorder
from kalscope_app.engine.frame import Frame
from kalscope_app.engine.jobs import Jobs
from kalscope_app.live import BoardConnection, BoardRecording, account, port_named
from kalscope_app.session.changes import set_board_channel
from kalscope_app.session.session import Failed, Session
from kalscope_app.session.state import ConnectionState
from kalscope_app.views.widgets import bind, escape_markdown, offer, on_user
from kalscope_app.views.window import OTHER_RATE, TYPED

# Record what a board sends: the name of the file, the buttons, and the status of the recording.


class RecordingView:
    """The last part of the folder "Live board". Starting and stopping are jobs."""

    def __init__(
        self, gui: viser.GuiApi, jobs: Jobs, recording: BoardRecording, open_spec: Callable[[str, Failed], None]
    ) -> None:
        """Args: the usual; the recording; opens the file at a path."""
        self._board_recording = recording
        self._text = gui.add_markdown("")
        self._name = gui.add_text(
            "record to", recording.name, hint="A new file in the folder in which Kalscope was started."
        )
        self._record = gui.add_button("Record", visible=False, hint="Every line as received, before any filter.")
        self._stop = gui.add_button("Stop recording", visible=False, hint="Ends and closes the file.")
        on_user(
            self._record.on_click,
            lambda _client: jobs.run(partial(recording.start, self._name.value.strip()), Failed.RECORD),
        )
        on_user(self._stop.on_click, lambda _client: jobs.run(recording.stop, Failed.RECORD))
        self._open = gui.add_button(
            "Open the recording", visible=False, hint="In place of the board; q, r, p0 and pins stay."
        )
        on_user(self._open.on_click, lambda _client: open_spec(str(recording.last), Failed.OPEN))
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
    lines = [f"recording to **{escape_markdown(recorder.paths[-1].name)}**", account(recorder.counts)]
    if recorder.error:
        lines.append(f"**{escape_markdown(recorder.error, 200)}**")
    return "\n".join(f"- {line}" for line in lines)


# A live board: choose its port, connect, see the state of the connection, record.


ADDRESS_HINT = "Such as ssh://host/dev/ttyACM0, tcp://host:port, udp://:47269, mqtt://broker/topic or file:log.csv."
NO_CURVE = "–"
BAUD_RATES = (9600, 19200, 38400, 57600, 115200, 230400, 250000, 460800, 500000, 921600, 1000000, 2000000)

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
        open_spec: Callable[[str, Failed], None],
    ) -> None:
        """Args: the usual; the connection's own jobs; the connection; its recording; opens the file at a path."""
        self._session, self._jobs, self._connection = session, jobs, connection
        self._devices: dict[str, str] = {}
        self._chosen = ""
        with gui.add_folder("Live board"):
            self._add_port(gui)
            self._connect = gui.add_button("Connect", hint="Opens the port and shows what the board sends.")
            self._disconnect = gui.add_button(
                "Disconnect", visible=False, hint="Frees the port, for the Arduino IDE or another program."
            )
            self._status = gui.add_markdown("", visible=False)
            self._recording = RecordingView(gui, jobs, recording, open_spec)
            self._add_options(gui)
        on_user(self._connect.on_click, lambda _client: self._on_connect())
        on_user(self._disconnect.on_click, lambda _client: jobs.run(self._on_disconnect))
        bind(self._board, session, lambda name: set_board_channel(None if name == NO_CURVE else name))
        self._list_ports()
        if connection.source is not None:
            self._name(connection.source.spec)
        jobs.when_idle(self._list_ports, PORTS_INTERVAL)

    def _add_port(self, gui: viser.GuiApi) -> None:
        self._port = gui.add_dropdown(
            "port",
            list[str]([TYPED]),
            hint="A board that is plugged in appears here automatically. An address may be typed here, too.",
        )
        self._typed = gui.add_text("address", "", hint=ADDRESS_HINT)
        self._baud = gui.add_dropdown(
            "baud rate",
            (*map(str, BAUD_RATES), OTHER_RATE),
            initial_value="115200",
            hint="As in the sketch: Serial.begin().",
        )
        self._rate = gui.add_text("rate", "", hint="Any other baud rate.", visible=False)
        on_user(self._port.on_update, lambda _client: self._choose_port())
        on_user(self._baud.on_update, lambda _client: self._show_typed())
        on_user(self._typed.on_update, lambda _client: self._show_typed())

    def _add_options(self, gui: viser.GuiApi) -> None:
        with gui.add_folder("Advanced", expand_by_default=False):
            self._reconnect = gui.add_checkbox(
                "reconnect automatically", True, hint="After unplugging. Off: the port stays free, for flashing."
            )
            self._reset = gui.add_checkbox(
                "reset the board on connecting", True, hint="DTR: most boards restart, and some send only then."
            )
            self._board = gui.add_dropdown(
                "board's filtered channel",
                list[str]([NO_CURVE]),
                hint="The channel in which the board sends its own filtered value.",
            )

    def _choose_port(self) -> None:
        self._chosen = self._port.value
        self._show_typed()

    def _show_typed(self) -> None:
        away = not self._connect.visible  # a port is open
        typed = self._port.value == TYPED
        self._port.visible = self._baud.visible = not away
        self._typed.visible = typed and not away
        self._rate.visible = self._baud.value == OTHER_RATE and not away
        # Not hidden: "Connect", whose press sends the address, would move away from under the pointer.
        self._baud.disabled = self._rate.disabled = typed and not has_baud(self._typed.value)

    def _name(self, spec: PortSpec) -> None:
        """Show the port that the command line named."""
        listed = [label for label, device in self._devices.items() if device == spec.url]
        self._port.value = listed[0] if listed else TYPED
        self._typed.value, self._rate.value = spec.url, str(spec.baud)
        self._baud.value = str(spec.baud) if spec.baud in BAUD_RATES else OTHER_RATE
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

    def _on_connect(self) -> None:
        spec = self._typed.value.strip() if self._port.value == TYPED else self._devices.get(self._port.value, "")
        rate = self._rate.value if self._baud.value == OTHER_RATE else self._baud.value
        reconnect, reset = self._reconnect.value, self._reset.value

        def connect() -> None:
            self._connection.open(self._session, port_named(spec, rate.strip(), reset=reset), reconnect=reconnect)

        self._jobs.run(connect, Failed.CONNECT)

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


def has_baud(address: str) -> bool:
    """Whether this address uses a baud rate; True for an unfinished one, too."""
    transport = named_transport(address.strip())
    return transport is None or transport.has_baud


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
