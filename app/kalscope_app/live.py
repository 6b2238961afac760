"""The live board beside the session: its connection, its recording, commands to it, the noise that it measures."""

from __future__ import annotations

import re
import threading
from collections.abc import Callable
from functools import partial
from pathlib import Path

from kalscope.common.files import check_inside
from kalscope.common.progress import Progress
from kalscope.errors import BadDevice, BadFile, BadSetting, Cancelled, KalscopeError, describe
from kalscope.export.board import BoardAnswer, FixedFilter, board_filter, commands, measure, values_in_use
from kalscope.export.float32 import float32_params, float32_tuning, runs_kalman
from kalscope.sources.live.source import LiveSource
from kalscope.sources.port.registry import PortSpec
from kalscope.sources.recorder import Recorder, first_free
from kalscope_app.engine.jobs import Jobs
from kalscope_app.session.changes import opened_live
from kalscope_app.session.session import Failed, Session
from kalscope_app.session.state import BoardCalibration, ConnectionState, Sent, State

# The connection of the live board, which the State names by its source.


class BoardConnection:
    """The board that is connected, or is being waited for, and those that Undo may return to."""

    def __init__(self, jobs: Jobs, first: LiveSource | None = None) -> None:
        """Args: separate jobs, because a port must not wait for a long search; what the first State shows."""
        self._jobs = jobs
        self._lock = threading.Lock()  # of all that follows: the engine and jobs change it
        self._connected = first
        self._left: LiveSource | None = None  # closed only because something else was opened
        self._awaited: LiveSource | None = None  # connected, but its request has not been applied yet

    def start(self) -> None:
        """Connect the source, if there is one; does nothing if it is connected already."""
        source = self.source
        if source is not None:
            source.start()

    @property
    def source(self) -> LiveSource | None:
        """The board that is connected, or is being waited for."""
        with self._lock:
            return self._connected

    def source_of(self, state: State) -> LiveSource:
        """The board on screen.

        Raises:
            BadSetting: it is not connected.
        """
        source = self.source
        if source is None or state.live is None or state.live.board is not source:
            raise BadSetting("no board is connected: connect one in the Source tab first")
        return source

    def open(self, session: Session, port: PortSpec) -> None:
        """Connect another board and show it; waits for the port, so run it as a job."""
        self.close()
        source = LiveSource(port)
        source.start()
        with self._lock:
            self._connected = self._awaited = source

        def show(state: State) -> State:
            with self._lock:  # here, because a later request of the same turn may show something else
                self._awaited = None if self._awaited is source else self._awaited
            return opened_live(source, source.spec.url, state)

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

    def state(self, board: LiveSource | None) -> ConnectionState:
        """The state of the connection to the board on screen, or to a board recorded in the background."""
        connected = self.source
        shown = connected if board is None else board
        recording = connected is not None and connected.recorder is not None
        return ConnectionState(connected is not None, recording, None if shown is None else shown.status())

    def look_at(self, board: LiveSource | None) -> None:
        """This board is on screen now: close another that is not recorded; reopen this one if that closed it."""
        work: Callable[[], None] | None = None
        with self._lock:
            connected = self._connected
            if connected is None and board is not None and board is self._left:
                self._connected, self._left, work = board, None, self.start
            elif connected and connected.recorder is None and connected not in (board, self._awaited):
                self._connected, self._left, work = None, connected, connected.close
        if work is not None:
            self._jobs.run(work)


# Lets the live board measure the noise of the channel on screen.


def measured_by_board(state: State, source: LiveSource, seconds: float, progress: Progress) -> BoardCalibration:
    """The result, also where the board did not answer; waits for the board, so run it as a job.

    Raises:
        BadSetting: fused sensors are on screen.
        Cancelled: `progress` stopped it.
    """
    state.require_one_channel()
    try:
        (found,) = measure(source, state.channel, seconds, progress)
    except Cancelled:
        raise
    except KalscopeError as error:
        return BoardCalibration(state.record_key, state.channel, failed=describe(error))
    return BoardCalibration(state.record_key, state.channel, found)


# Records what the connected board sends, and reports on it while it runs.


CHECK_EVERY = 0.5
"""Seconds between two checks of a recording: a full disk must be announced within 2 s."""


class BoardRecording:
    """Starts and stops the recording; both wait for the disk, so call them from a job."""

    def __init__(
        self, connection: BoardConnection, folder: Path, tell: Callable[..., None], wake: Callable[[], None]
    ) -> None:
        """Args: the connection; the folder to record into; how to notify the user; how to wake the engine."""
        self._connection, self._folder, self._tell, self._wake = connection, folder, tell, wake
        self.name = first_free(folder / "recording.csv").name
        """Name of a file that does not exist yet."""
        self.last: Path | None = None
        """The file that was recorded last."""
        self.on_change: Callable[[Recorder | None], None] = lambda _recorder: None
        """Called with the recorder that runs, or with None when it has ended or `name` changed."""

    def start(self, name: str) -> None:
        """Record to a new file.

        Raises:
            BadSetting: no board is connected, or the name is not one for a recording.
            BadFile: the file exists already or cannot be written.
        """
        path = check_inside(name, self._folder)
        if path.suffix != ".csv" or any(part.startswith(".") for part in Path(name).parts if part != "."):
            raise BadSetting(f"the recording must be named like recording.csv (got {name!r:.200})")
        source = self._connection.source
        if source is None:
            raise BadSetting("no board is connected: connect one in the Source tab first")
        try:
            recorder = source.record(path)
        except BadFile:
            self._propose(path)
            raise
        self._tell(f"Recording to {path}", good=True)
        watch = partial(self._watch, source, recorder)
        threading.Thread(target=watch, name="kalscope-recording", daemon=True).start()

    def stop(self) -> None:
        """End and close the file; does nothing where no recording runs."""
        source = self._connection.source
        if source is not None:
            source.stop_recording()

    def _watch(self, source: LiveSource, recorder: Recorder) -> None:
        """Report at once what prevents lines from being written, and at the end what was recorded."""
        reported, pause = "", threading.Event()
        while source.recorder is recorder:
            problem = recorder.error
            if problem and problem != reported:
                self._tell(f"Recording: {problem}", failed=Failed.RECORD)
            reported = problem
            self.on_change(source.status().recording)
            pause.wait(CHECK_EVERY)
        done = recorder.close()  # waits until the file is closed
        self._tell(f"Recorded {recorder.files}: {done}", good=not recorder.error, failed=Failed.RECORD)
        self.last = next(filter(Path.exists, recorder.paths), recorder.path)
        self._propose(recorder.path)
        self._wake()  # a board in the background is closed once it is no longer recorded

    def _propose(self, path: Path) -> None:
        """Propose a free name like this one."""
        stem = re.sub(r"_[0-9]+$", "", path.stem)
        free = first_free(path.with_name(f"{stem}{path.suffix}"))
        self.name = str(free.relative_to(self._folder.resolve()) if free.is_absolute() else free)
        self.on_change(None)


# Sends a setting to the live board that runs the exported filter.


def takes_no_values(state: State) -> str:
    """Why the board cannot take the values on screen while it runs; "" where it can."""
    if state.fusion is None and runs_kalman(state.tuning):
        return ""
    what = "a classic filter" if state.fusion is None else "fused sensors"
    return f"the sketch of {what} takes no values while it runs: export it again and flash it"


def send_setting(state: State, source: LiveSource) -> Sent:
    """Send q, r, momentum and p0 of the channel on screen to the board, one command at a time, each acknowledged.

    Raises:
        BadSetting: the values do not fit float32, the board has no such filter, another median or no momentum, or
            no Kalman filter of one channel is on screen.
        BadDevice: the board did not answer, or did not take a value.
    """
    state.require_exportable([state.channel])
    if why := takes_no_values(state):
        raise BadSetting(why)
    wanted = float32_tuning(state.tuning) or float32_params(state.params)
    names = state.recording.names
    answers = values_in_use(source)
    target = board_filter(names, state.channel, len(answers))
    if (target.number or 1) > len(answers):
        raise BadDevice(f"the board answered for only {len(answers)} of its channels: send again")
    used = _used(answers[(target.number or 1) - 1], wanted.median)
    *values, restart = commands(wanted, target.number, knows_momentum=used.momentum is not None)
    for line in values:
        values_in_use(source, line)
    snapshot = source.snapshot()
    row = 0 if snapshot is None else snapshot.first + len(snapshot.recording)
    answer = _used(values_in_use(source, restart)[-1], wanted.median)
    # x0 and gate stay those of the export.
    return Sent(state.record_key, state.channel, target.filtered, state.params, answer.applied_to(wanted), row)


def _used(answer: BoardAnswer | FixedFilter, median: int) -> BoardAnswer:
    """What a Kalman filter of the board uses.

    Raises:
        BadSetting: it is another filter, or its median is not of `median` samples.
    """
    again = "export the sketch with this tuning and flash it"
    if isinstance(answer, FixedFilter):
        raise BadSetting(f"the filter of {answer.name} on this board is not Kalman's and takes no values: {again}")
    if answer.median != median:
        raise BadSetting(
            f"the median must be that of the board, {answer.median} samples, which no command changes"
            f" (got {median}): {again}"
        )
    return answer
