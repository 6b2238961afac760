"""Every command of the palette after every other: no view, study, job or message of the dashboard fails."""

from __future__ import annotations

import pytest
from tests.app.headless import headless
from tests.app.recordings import walk
from tests.support.effort import FUZZ

from kalscope import open_source
from kalscope_app.session.changes import pin_present
from kalscope_app.session.opening import opened

RECORDINGS = {
    "three channels": lambda: open_source("synthetic:random_walk?n=200&channels=3&seed=36"),
    "constant with missing samples": lambda: walk(200, ("z",), "", None, scale=0.0, missing=0.3),
}

FEWER = {
    *("Undo", "Map", "Apply", "Pin", "Reset", "Add momentum", "Fuse", "Stop fusing", "Dark theme"),
    *("Show velocity", "Goal: best fit", "Use", "Delete", "Export this one", "Back to the Kalman filter"),
}
"""Commands that change the filter or what is drawn: those of the ordinary run."""


def each_after_each(many):
    """Numbers below `many` in an order in which each follows each, itself too, exactly once."""
    for one in range(many):
        yield one
        for other in range(one + 1, many):
            yield from (one, other)
    yield 0


@pytest.mark.slow
@pytest.mark.parametrize("name", RECORDINGS)
def test_no_command_fails_after_another(name, tmp_path):
    state = opened(RECORDINGS[name]())
    with headless(state, tmp_path) as (bench, client):
        commands = [one for one in bench.palette if FUZZ > 1 or one.label in FEWER]
        assert len(commands) >= (45 if FUZZ > 1 else len(FEWER))
        before = previous = None
        for at in each_after_each(len(commands)):
            command = commands[at]
            if bench.state.recording.source != state.recording.source:  # the one before has opened another
                bench.press(command, client)
                bench.request(lambda _: state)
            before, previous = previous, command.label
            bench.press(command, client)
            assert bench.errors == [], (before, previous)


def test_a_command_in_a_hidden_folder_is_not_offered_and_every_control_has_a_short_hint(tmp_path):
    with headless(opened(RECORDINGS["three channels"]()), tmp_path) as (bench, _client):
        widgets = bench.dashboard._server.gui._gui_input_handle_from_uuid.values()
        hints = {one.label: one.hint or "" for one in widgets if hasattr(one, "hint")}
        assert len(hints) > 40
        wrong = [label for label, hint in hints.items() if not 0 < len(hint) <= 130 or "{" in hint or label == hint]
        assert wrong == []
        palette = {one.label: one for one in bench.palette}
        hidden = [palette[name] for name in ("Use", "Delete", "Back to the Kalman filter", "Send q, r and p0")]
        assert all(one.disabled for one in hidden)
        assert not any(palette[name].disabled for name in ("Pin", "Fuse", "Dark theme", "Preview code"))
        bench.request(pin_present)
        assert [one.disabled for one in hidden] == [False, False, True, True]
