"""The dashboard in the thread of a test, without a browser: a step returns when all that it asked for is done."""

from __future__ import annotations

import logging
import math
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
import viser
from tests.app.wire import Guest
from tests.support.waiting import PATIENCE, wait_until

from kalscope_app.dashboard import Dashboard
from kalscope_app.guard.server import guarded_server
from kalscope_app.program.user_settings import FOLDER_VARIABLE
from kalscope_app.session.state import Change, State
from kalscope_app.views import live, map

OTHERS_IDLE_WORK = "Idle work failed and is not tried again"
"""Logged by the dashboards of other tests, whose servers are closed: this one has no idle work."""


class Headless(logging.Handler):
    """A dashboard whose engine and studies have no turn of their own, and every error that is logged."""

    def __init__(self, dashboard: Dashboard) -> None:
        super().__init__(logging.ERROR)
        self.dashboard, self.errors = dashboard, list[str]()
        self.studies, dashboard.engine._studies = dashboard.engine._studies, self
        self._studied: State | None = None

    def of(self, state: State) -> None:
        """Where the engine would start the studies."""
        self._studied = state

    def emit(self, record: logging.LogRecord) -> None:
        if record.msg != OTHERS_IDLE_WORK:
            self.errors.append(f"{record.getMessage()}: {record.exc_info and record.exc_info[1]!r}")

    @property
    def state(self) -> State:
        return self.dashboard.session._state

    @property
    def palette(self) -> list[viser.CommandHandle]:
        return [*self.dashboard._server.gui._command_handle_from_uuid.values()]

    def request(self, change: Change) -> None:
        """Change the state."""
        self.dashboard.session.request(change)
        self.settle()

    def press(self, command: viser.CommandHandle, client: viser.ClientHandle) -> None:
        """Choose a command of the palette."""
        event = viser.CommandEvent(client, client.client_id, command)
        for callback in command._impl.trigger_cb:
            with pytest.raises(StopIteration):  # it ends at once, without an event loop
                callback(event).send(None)
        self.settle()

    def settle(self) -> None:
        """Apply what is requested, finish every job, and draw every part and study of the state that follows."""
        engine, wakeup = self.dashboard.engine, self.dashboard.session.wakeup
        wakeup.set()
        while wakeup.is_set():
            wakeup.clear()
            engine._guarded(engine._turn)
            for jobs in self.dashboard._jobs, self.dashboard._port_jobs, self.dashboard._board._calibration._jobs:
                done = threading.Event()
                jobs.run(done.set)
                assert done.wait(PATIENCE), "a job hangs"
        engine._guarded(lambda: engine._show_parts(engine._schedule.take_due(math.inf, moving=False)))
        state = self._studied
        if state is not None and state is not self.studies._state:
            self.studies._state = state
            self.studies._round(state)


@contextmanager
def headless(state: State, folder: Path) -> Iterator[tuple[Headless, viser.ClientHandle]]:
    """A dashboard that shows `state`, and a client as a browser would be."""
    with pytest.MonkeyPatch.context() as patch, guarded_server(port=0) as guarded:
        patch.setenv(FOLDER_VARIABLE, str(folder / "config"))  # commands change what is kept between starts
        patch.setattr(live, "list_ports", lambda: ())  # those of this machine have nothing to do with a test
        patch.setattr(live, "PORTS_INTERVAL", 1e6)
        patch.setattr(map, "SHARPNESS", 1)  # a quarter of the pixels to draw and to pack
        bench = Headless(Dashboard(guarded.server, state, folder))
        logging.getLogger().addHandler(bench)
        with Guest(guarded.port, guarded.token) as guest:
            reader = threading.Thread(target=lambda: [None for _ in guest.connection])
            reader.start()
            wait_until(guarded.server.get_clients, "the client")
            (client,) = guarded.server.get_clients().values()
            bench.settle()
            yield bench, client
        reader.join()
        logging.getLogger().removeHandler(bench)
        bench.dashboard._worker.close()
