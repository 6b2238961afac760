"""A live board: choose its port, connect, see how the line is, record."""

from __future__ import annotations

import math
import threading
from typing import TYPE_CHECKING, Any

from kalscope.common.text import count, duration, number
from kalscope.errors import BadSetting
from kalscope.sources.live.live_source import LiveSource
from kalscope.sources.port.port_spec import list_ports, port_of
from kalscope_app.session.changes.channels import set_board_channel
from kalscope_app.session.live import opened_live
from kalscope_app.views.source.recording import RecordingView
from kalscope_app.views.text import escape_markdown

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    import viser

    from kalscope.sources.live.live_status import LiveStatus
    from kalscope_app.engine.frame import Frame
    from kalscope_app.engine.jobs import Jobs
    from kalscope_app.session.session import Session

TYPED = "type it below"
NO_CURVE = "–"
BAUD_RATES = (9600, 19200, 38400, 57600, 115200, 230400, 250000, 460800, 500000, 921600, 1000000, 2000000)
OTHER_RATE = "another"


class LiveView:
    """The folder "Live board" of the Source tab. Ports are opened and closed as jobs."""

    def __init__(
        self, gui: viser.GuiApi, session: Session, jobs: Jobs, tell: Callable[..., None], folder: Path
    ) -> None:
        """Args: the usual; jobs of its own, for a port must not wait for a long search; where to record."""
        self._session, self._jobs = session, jobs
        self._lock = threading.Lock()  # of the next three: jobs and frames change them
        self._source: LiveSource | None = None
        self._left: LiveSource | None = None  # closed only because something else is looked at
        self._serial: float = 0
        self._devices: dict[str, str] = {}
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
            self._status = gui.add_markdown("", visible=False)
            self._board = gui.add_dropdown(
                "board's own curve",
                list[str]([NO_CURVE]),
                hint="The channel in which the board sends its own filtered value.",
            )
            self._recording = RecordingView(gui, jobs, tell, folder, lambda: self.connected)
        self._search.on_click(self._on_search)
        self._port.on_update(self._on_port)
        self._baud.on_update(self._on_baud)
        self._connect.on_click(self._on_connect)
        self._disconnect.on_click(self._on_disconnect)
        self._board.on_update(self._on_board)
        self._look_for_ports()

    def adopt(self, source: LiveSource) -> None:
        """Connect a source that the command line has named, and name it here."""
        self._source = source
        spec, rate = source.spec, str(source.spec.baud)
        listed = [label for label, device in self._devices.items() if device == spec.url]
        self._port.value = listed[0] if listed else TYPED
        self._typed.value, self._typed.visible = spec.url, not listed
        self._baud.value = rate if rate in self._baud.options else OTHER_RATE
        self._rate.value, self._rate.visible = rate, rate not in self._baud.options
        source.start()

    @property
    def connected(self) -> LiveSource | None:
        """The board that is connected, or is being waited for."""
        return self._source

    def close(self, timeout: float = 3.0) -> None:
        """Free the port and finish a recording; returns when that is done.

        Args:
            timeout: Seconds to wait at most for an attempt to connect over the network.
        """
        with self._lock:
            source, self._source, self._left = self._source, None, None
        if source is not None:
            source.close(timeout)

    async def _on_search(self, _event: viser.GuiEvent[Any]) -> None:
        self._jobs.run(self._look_for_ports)

    async def _on_port(self, _event: viser.GuiEvent[Any]) -> None:
        self._typed.visible = self._port.value == TYPED

    async def _on_baud(self, _event: viser.GuiEvent[Any]) -> None:
        self._rate.visible = self._baud.value == OTHER_RATE

    async def _on_connect(self, _event: viser.GuiEvent[Any]) -> None:
        spec = self._typed.value.strip() if self._port.value == TYPED else self._devices.get(self._port.value, "")
        rate = self._rate.value if self._baud.value == OTHER_RATE else self._baud.value
        reconnect, reset = self._reconnect.value, self._reset.value
        self._jobs.run(lambda: self._open(spec, rate.strip(), reconnect=reconnect, reset=reset))

    async def _on_disconnect(self, _event: viser.GuiEvent[Any]) -> None:
        self._jobs.run(self.close)

    async def _on_board(self, event: viser.GuiEvent[Any]) -> None:
        if event.client is not None:
            name = self._board.value
            self._session.request(set_board_channel(None if name == NO_CURVE else name))

    def _look_for_ports(self) -> None:
        self._devices = {f"{port.device} {port.description}".strip(): port.device for port in list_ports()}
        ports = tuple(self._devices)
        self._port.options = (*ports, TYPED)
        self._port.value = ports[0] if ports else TYPED
        self._typed.visible = not ports  # else it would be typed in vain

    def _open(self, spec: str, rate: str, *, reconnect: bool, reset: bool) -> None:
        if not spec:
            raise BadSetting("the port must be named, such as /dev/ttyACM0 or COM3 (got nothing)")
        if "://" in spec and not spec.lower().startswith(("socket://", "rfc2217://")):
            raise BadSetting(f"an address must begin with socket:// or rfc2217:// (got {spec!r:.100})")
        named = "@" in spec or spec.lower().startswith("socket://")
        port = port_of(spec if named else f"{spec}@{rate}", reset=reset)
        self.close()
        source = LiveSource(port, reconnect=reconnect)
        source.start()
        with self._lock:
            self._serial = math.inf  # until the session knows it, a frame does not look at another board
            self._source = source
            self._serial = self._session.request(lambda state: opened_live(source, source.spec.url, state))

    def show(self, frame: Frame) -> None:
        """Tell how the line is; free the port of a board that is no longer looked at."""
        source = self._looked_at(frame)
        for button, visible in ((self._connect, source is None), (self._disconnect, source is not None)):
            if button.visible != visible:
                button.visible = visible
        self._recording.show(source)
        status = frame.status
        if status is None and source is not None:
            status = source.status()
        text = "" if status is None else status_text(status)
        if self._status.content != text:
            self._status.content = text
            self._status.visible = bool(text)
        self._show_board(frame)

    def _looked_at(self, frame: Frame) -> LiveSource | None:
        """The board that stays connected: the one on screen, or one that is recorded while a file is looked at.

        One that was left connects again when the person comes back to it, by Undo.
        """
        feed = frame.state.live.feed if frame.state.live is not None else None
        with self._lock:
            source = self._source
            if frame.serial < self._serial:
                return source
            if source is not None and feed is not source and source.recorder is None:
                self._source, self._left = None, source
                self._jobs.run(source.close)
            elif source is None and self._left is not None and feed is self._left:
                back = self._source = self._left
                self._left = None
                self._jobs.run(lambda: self._return_to(back))
            return self._source

    def _return_to(self, source: LiveSource) -> None:
        if self._source is source:
            source.start()

    def _show_board(self, frame: Frame) -> None:
        options = (NO_CURVE, *frame.state.recording.names)
        if self._board.options != options:
            self._board.options = options
        value = frame.state.board or NO_CURVE
        if self._board.value != value:
            self._board.value = value


def status_text(status: LiveStatus) -> str:
    """How the line is, as markdown; what came from outside is escaped."""
    lines = [f"**{escape_markdown(status.word, 200)}**: {escape_markdown(status.port, 200)}"]
    spread = "" if status.jitter is None else f" ± {duration(status.jitter)}"
    if status.hint:
        lines.append(escape_markdown(status.hint, 300))
    lines += [
        f"{number(status.lines_per_s)} lines/s",
        *([f"one sample every {duration(status.period)}{spread}"] if status.period else []),
        f"{count(status.received)} lines = {count(status.accepted)} read + {count(status.rejected)} rejected"
        f" + {count(status.dropped)} dropped",
        f"connected again {count(status.reconnects)} ×",
        f"longest wait of the port to be read: {duration(status.max_read_latency)}",
    ]
    if status.left_memory:
        lines.append(f"{count(status.left_memory)} older samples have left memory")
    return "\n".join(f"- {line}" for line in lines)
