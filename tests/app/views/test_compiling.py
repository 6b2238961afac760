"""The note that tells browsers what is compiled at a first start."""

from __future__ import annotations

import threading
from types import SimpleNamespace

from waiting import PATIENCE

from kalscope.common.compiled import Compiling
from kalscope_app.views import window


class Client:
    """A browser's end: what it was asked to show."""

    def __init__(self):
        self.notes = []

    def add_notification(self, title, body, loading):
        note = SimpleNamespace(title=title, body=body, loading=loading, gone=threading.Event())
        note.remove = note.gone.set
        self.notes.append(note)
        return note


def test_one_note_a_browser_counts_the_loops_and_goes_when_the_last_is_done(monkeypatch):
    monkeypatch.setattr(window, "STAYS_S", 0.0)
    first, late = Client(), Client()
    clients = {0: first}
    note = window.CompilingNote(SimpleNamespace(get_clients=lambda: clients))
    note.show(Compiling(0, is_busy=True))
    clients[1] = late
    note.show(Compiling(1, is_busy=True))
    for client in (first, late):
        (shown,) = client.notes
        assert shown.loading
        assert shown.body == "Compiling for this computer, only at the first start: 1 done."
        assert not shown.gone.is_set()
    note.show(Compiling(2, is_busy=False))
    assert all(client.notes[0].gone.wait(PATIENCE) for client in (first, late))
    note.show(Compiling(2, is_busy=True))  # a loop that is first needed later
    assert [len(client.notes) for client in (first, late)] == [2, 2]


def test_the_note_stays_between_two_loops(monkeypatch):
    monkeypatch.setattr(window, "STAYS_S", PATIENCE)
    client = Client()
    note = window.CompilingNote(SimpleNamespace(get_clients=lambda: {0: client}))
    for done in range(3):
        note.show(Compiling(done, is_busy=True))
        note.show(Compiling(done + 1, is_busy=False))
    (shown,) = client.notes
    assert not shown.gone.is_set()
    note.show(Compiling(3, is_busy=True))  # ends the timer
