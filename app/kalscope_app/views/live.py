"""A live board: choose its port, connect, see how the line is, record."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import viser

from kalscope.atomic import check_inside
from kalscope.errors import BadSetting
from kalscope.sources.live import LiveSource, LiveStatus
from kalscope.sources.serial_port import list_ports, port_of
from kalscope_app.changes import set_board_channel
from kalscope_app.frame import Frame
from kalscope_app.jobs import Jobs
from kalscope_app.live import opened_live
from kalscope_app.session import Session
from kalscope_app.views.words import count, duration, number, plain

TYPED = "type it below"
NO_CURVE = "–"
BAUD_RATES = (9600, 19200, 38400, 57600, 115200, 230400, 250000, 460800, 500000, 921600, 1000000, 2000000)
OTHER_RATE = "another"


class LiveView:
    """The folder "Live board" of the Source tab. Ports are opened and closed as jobs."""

    def __init__(
        self, gui: viser.GuiApi, session: Session, jobs: Jobs, tell: Callable[..., None], folder: Path
    ) -> None:
        self._session, self._jobs, self._tell, self._folder = session, jobs, tell, folder
        self._source: LiveSource | None = None
        self._leaving: list[LiveSource] = []
        self._serial: float = 0
        with gui.add_folder("Live board", expand_by_default=False):
            self._port = gui.add_dropdown("port", list[str]([TYPED]), hint="Where the Arduino is plugged in.")
            self._search = gui.add_button("Look for ports", hint="After plugging a board in.")
            self._typed = gui.add_text(
                "port or address", "", hint="Such as /dev/ttyACM0, COM3, socket://host:port or rfc2217://host:port."
            )
            self._baud = gui.add_dropdown(
                "baud rate",
                (*map(str, BAUD_RATES), OTHER_RATE),
                initial_value="115200",
                hint="As in the sketch: Serial.begin().",
            )
            self._rate = gui.add_text("rate", "", hint="Any other baud rate.", visible=False)
            self._reconnect = gui.add_checkbox(
                "connect again by itself", True, hint="After unplugging. Off: the port stays free, for flashing."
            )
            self._reset = gui.add_checkbox(
                "reset the board on connecting",
                True,
                hint="DTR: most boards start afresh, and some send only then.",
            )
            self._connect = gui.add_button("Connect", hint="Opens the port and shows what the board sends.")
            self._disconnect = gui.add_button(
                "Disconnect", visible=False, hint="Frees the port, for the Arduino IDE or another program."
            )
            self._status = gui.add_markdown("")
            self._board = gui.add_dropdown(
                "board's own curve",
                list[str]([NO_CURVE]),
                hint="The channel in which the board sends its own filtered value.",
            )
            self._name = gui.add_text(
                "record to", "recording.csv", hint="A name inside the folder in which Kalscope was started."
            )
            self._record = gui.add_button(
                "Record", visible=False, hint="Every line as received, before any filter."
            )
            self._stop = gui.add_button("Stop recording", visible=False, hint="Ends and closes the file.")
        self._search.on_click(self._on_search)
        self._baud.on_update(self._on_baud)
        self._connect.on_click(self._on_connect)
        self._disconnect.on_click(self._on_disconnect)
        self._board.on_update(self._on_board)
        self._record.on_click(self._on_record)
        self._stop.on_click(self._on_stop)
        self._look_for_ports()

    def adopt(self, source: LiveSource) -> None:
        """Connect a source that the command line has named."""
        self._source = source
        source.start()

    @property
    def connected(self) -> LiveSource | None:
        """The board that is connected, or is being waited for."""
        return self._source

    def close(self, timeout: float = 3.0) -> None:
        """Free the port and finish a recording; a network that does not answer is waited for `timeout` s."""
        source, self._source = self._source, None
        if source is not None:
            self._leaving.append(source)
        self._close_leaving(timeout)

    def _close_leaving(self, timeout: float = 3.0) -> None:
        """Close boards that nobody looks at any more; at the end also those whose job waits behind another."""
        for source in tuple(self._leaving):
            source.close(timeout)
            with contextlib.suppress(ValueError):  # another thread closes it too
                self._leaving.remove(source)

    async def _on_search(self, _event: viser.GuiEvent[Any]) -> None:
        self._jobs.run(self._look_for_ports)

    async def _on_baud(self, _event: viser.GuiEvent[Any]) -> None:
        self._rate.visible = self._baud.value == OTHER_RATE

    async def _on_connect(self, _event: viser.GuiEvent[Any]) -> None:
        spec = self._typed.value.strip() if self._port.value == TYPED else self._port.value.split(" ")[0]
        rate = self._rate.value if self._baud.value == OTHER_RATE else self._baud.value
        reconnect, reset = self._reconnect.value, self._reset.value
        self._jobs.run(lambda: self._open(spec, rate.strip(), reconnect=reconnect, reset=reset))

    async def _on_disconnect(self, _event: viser.GuiEvent[Any]) -> None:
        self._jobs.run(self.close)

    async def _on_board(self, event: viser.GuiEvent[Any]) -> None:
        if event.client is not None:
            name = self._board.value
            self._session.request(set_board_channel(None if name == NO_CURVE else name))

    async def _on_record(self, _event: viser.GuiEvent[Any]) -> None:
        name = self._name.value.strip()
        self._jobs.run(lambda: self._start_recording(name))

    async def _on_stop(self, _event: viser.GuiEvent[Any]) -> None:
        self._jobs.run(self._stop_recording)

    def _look_for_ports(self) -> None:
        ports = tuple(f"{port.device} {port.description}".strip() for port in list_ports())
        self._port.options = (*ports, TYPED)
        self._port.value = ports[0] if ports else TYPED

    def _open(self, spec: str, rate: str, *, reconnect: bool, reset: bool) -> None:
        if not spec:
            raise BadSetting("the port must be named, such as /dev/ttyACM0 or COM3 (got nothing)")
        text = spec if "://" in spec or "@" in spec else f"{spec}@{rate}"
        if "://" in spec and not spec.lower().startswith(("socket://", "rfc2217://")):
            raise BadSetting(f"an address must begin with socket:// or rfc2217:// (got {spec!r:.100})")
        source = LiveSource(port_of(text, reset=reset), reconnect=reconnect)
        self.close()  # what is connected stays until the new port has a usable name
        source.start()
        self._serial = math.inf  # until the session knows it, a frame does not look at another board
        self._source = source
        self._serial = self._session.request(lambda state: opened_live(source, source.spec.url, state))

    def _start_recording(self, name: str) -> None:
        path = check_inside(name, self._folder)
        if path.suffix != ".csv" or any(part.startswith(".") for part in Path(name).parts if part != "."):
            raise BadSetting(f"the recording must be named like recording.csv (got {name!r:.200})")
        if self._source is None:
            raise BadSetting("a board must be connected before its lines are recorded (got none)")
        self._source.record(path)
        self._tell(f"Recording to {path}", good=True)

    def _stop_recording(self) -> None:
        recorder = self._source.recorder if self._source is not None else None
        if self._source is not None and recorder is not None:
            self._source.stop_recording()
            done = recorder.counts
            self._tell(f"Recorded {count(done.written)} lines, {count(done.rejected)} rejected", good=True)

    def show(self, frame: Frame) -> None:
        """Tell how the line is; free the port of a board that is no longer looked at."""
        live, source = frame.state.live, self._source
        connected = source is not None
        other = frame.serial >= self._serial and (live is None or live.feed is not source)
        if source is not None and other:
            self._leaving.append(source)
            self._source, connected = None, False
            self._jobs.run(self._close_leaving)
        for button, visible in ((self._connect, not connected), (self._disconnect, connected)):
            if button.visible != visible:
                button.visible = visible
        recording = source is not None and source.recorder is not None
        for button, visible in ((self._record, connected and not recording), (self._stop, recording)):
            if button.visible != visible:
                button.visible = visible
        text = "" if frame.status is None else status_text(frame.status)
        if self._status.content != text:
            self._status.content = text
        self._show_board(frame)

    def _show_board(self, frame: Frame) -> None:
        options = (NO_CURVE, *frame.state.recording.names)
        if self._board.options != options:
            self._board.options = options
        value = frame.state.board or NO_CURVE
        if self._board.value != value:
            self._board.value = value


def status_text(status: LiveStatus) -> str:
    """How the line is, as markdown; what came from outside is escaped."""
    lines = [f"**{plain(status.word, 200)}**"]
    if status.hint:
        lines.append(plain(status.hint, 300))
    lines += [
        f"{number(status.lines_per_s)} lines/s",
        f"one sample every {duration(status.period)} ± {duration(status.jitter)}",
        f"{count(status.received)} lines = {count(status.accepted)} read + {count(status.rejected)} rejected"
        f" + {count(status.dropped)} dropped",
        f"{count(status.reconnects)} reconnects",
    ]
    if status.recording_trouble:
        lines.append(f"**{plain(status.recording_trouble, 200)}**")
    if status.left_memory:
        lines.append(f"{count(status.left_memory)} older samples have left memory")
    return "\n".join(f"- {line}" for line in lines)
