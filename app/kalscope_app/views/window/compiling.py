"""A note in every browser while loops are compiled, at the first start after an installation."""

from __future__ import annotations

import threading
from weakref import WeakKeyDictionary

import viser

from kalscope.common.compiled import Compiling

STAYS_S = 1.5
"""Seconds after the last loop for which the note stays: the next one often begins at once."""


class CompilingNote:
    """Shows the progress of the compiler; removed when it has finished."""

    def __init__(self, server: viser.ViserServer) -> None:
        self._server = server
        self._notes = WeakKeyDictionary[viser.ClientHandle, viser.NotificationHandle]()
        self._changing = threading.Lock()
        self._end: threading.Timer | None = None

    def show(self, progress: Compiling) -> None:
        """Show this in every browser; runs on the thread that compiles."""
        body = f"{progress}.".capitalize()
        with self._changing:
            if self._end is not None:
                self._end.cancel()
            for client in self._server.get_clients().values():
                if client in self._notes:
                    self._notes[client].body = body
                else:
                    self._notes[client] = client.add_notification("Kalscope", body, loading=True)
            self._end = threading.Timer(STAYS_S, self._remove)
            if not progress.is_busy:
                self._end.start()

    def _remove(self) -> None:
        with self._changing:
            for note in self._notes.values():
                note.remove()
            self._notes.clear()
