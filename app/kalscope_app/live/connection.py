"""The connection of the live board. The State names a board by its `BoardId`; the running source is kept here."""

from __future__ import annotations

import threading
from collections.abc import Callable
from weakref import WeakKeyDictionary

from kalscope.errors import BadSetting
from kalscope.sources.live.live_samples import Snapshot
from kalscope.sources.live.live_source import LiveSource
from kalscope.sources.port.port_spec import PortSpec, port_of
from kalscope_app.engine.jobs import Jobs
from kalscope_app.session.changes.live import opened_live
from kalscope_app.session.live_state import BoardId, ConnectionState
from kalscope_app.session.session import Session
from kalscope_app.session.state import State


class BoardConnection:
    """The board that is connected, or is being waited for, and those that Undo may return to."""

    def __init__(self, jobs: Jobs) -> None:
        """Args: separate jobs, because a port must not wait for a long search."""
        self._jobs = jobs
        self._lock = threading.Lock()  # of all that follows: the engine and jobs change it
        self._sources = WeakKeyDictionary[BoardId, LiveSource]()  # forgotten with the last State that names them
        self._connected: BoardId | None = None
        self._left: BoardId | None = None  # closed only because something else was opened
        self._awaited: BoardId | None = None  # connected, but its request has not been applied yet

    def adopt(self, board: BoardId, source: LiveSource) -> None:
        """Take over a source that the first State shows; `start` connects it."""
        self._sources[board], self._connected = source, board

    def start(self) -> None:
        """Connect the source, if there is one; does nothing if it is connected already."""
        source = self.source
        if source is not None:
            source.start()

    @property
    def source(self) -> LiveSource | None:
        """The board that is connected, or is being waited for."""
        with self._lock:
            return None if self._connected is None else self._sources[self._connected]

    def is_connected(self, board: BoardId) -> bool:
        """Whether this is the board that is connected."""
        return self._connected is board

    def source_of(self, state: State) -> LiveSource:
        """The board on screen.

        Raises:
            BadSetting: it is not connected.
        """
        source = self.source
        if source is None or state.live is None or not self.is_connected(state.live.board):
            raise BadSetting("no board is connected: connect one in the Source tab first")
        return source

    def open(self, session: Session, port: PortSpec, *, reconnect: bool) -> None:
        """Connect another board and show it; waits for the port, so run it as a job."""
        self.close()
        source, board = LiveSource(port, reconnect=reconnect), BoardId()
        source.start()
        with self._lock:
            self._sources[board] = source
            self._connected = self._awaited = board

        def show(state: State) -> State:
            with self._lock:  # here, because a later request of the same turn may show something else
                self._awaited = None if self._awaited is board else self._awaited
            return opened_live(board, source.spec.url, state)

        session.request(show)

    def close(self, timeout: float = 3.0) -> None:
        """Free the port and finish a recording; returns when that is done.

        Args:
            timeout: Seconds to wait at most for an attempt to connect over the network.
        """
        source = self.source
        with self._lock:
            self._connected = self._left = None
        if source is not None:
            source.close(timeout)

    def snapshot(self, board: BoardId) -> Snapshot | None:
        """The samples of a board; None before the first."""
        source = self._sources.get(board)
        return None if source is None else source.snapshot()

    def state(self, board: BoardId | None) -> ConnectionState:
        """The state of the connection to the board on screen, or to a board recorded in the background."""
        connected = self.source
        shown = connected if board is None else self._sources.get(board)
        recording = connected is not None and connected.recorder is not None
        return ConnectionState(connected is not None, recording, None if shown is None else shown.status())

    def look_at(self, board: BoardId | None) -> None:
        """This board is on screen now: close another that is not recorded; reopen this one if that closed it."""
        work: Callable[[], None] | None = None
        with self._lock:
            connected = self._connected
            source = None if connected is None else self._sources[connected]
            if source is None and board is not None and board is self._left:
                self._connected, self._left, work = board, None, self.start
            elif source is not None and source.recorder is None and connected not in (board, self._awaited):
                self._connected, self._left, work = None, connected, source.close
        if work is not None:
            self._jobs.run(work)


def port_named(spec: str, rate: str, *, reset: bool) -> PortSpec:
    """The port of a device or an address as it was typed, and of its baud rate.

    Raises:
        BadSetting: it is not a port.
    """
    if not spec:
        raise BadSetting("the port must be named, such as /dev/ttyACM0 or COM3 (got nothing)")
    return port_of(spec, default_baud=rate, in_dashboard=True, reset=reset)
