"""Every command of the palette after every other: no view, study, job or message of the dashboard fails."""

from __future__ import annotations

import numpy as np
import pytest
from tests.app.headless import headless
from tests.support.effort import FUZZ

from kalscope import Recording, open_source
from kalscope_app.session.changes import pin_present
from kalscope_app.session.opening import opened

RNG = np.random.default_rng(36)
STEPS = np.arange(200.0)
WALK = np.cumsum(RNG.normal(size=(200, 1)), axis=0)

RECORDINGS = {
    "demo": lambda: open_source("demo"),
    "three channels": lambda: Recording(
        0.01 * STEPS, ("a", "b", "c"), ("V", "V", "V"), WALK + RNG.normal(size=(200, 3)), 0.01, source="three"
    ),
    "constant with missing samples": lambda: Recording(
        STEPS, ("z",), ("",), np.where(RNG.random((200, 1)) < 0.3, np.nan, 3.7), None, source="constant"
    ),
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
        palette = bench.dashboard._server.gui._command_handle_from_uuid.values()
        commands = [one for one in palette if FUZZ > 1 or one.label in FEWER]
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
        palette = {one.label: one for one in bench.dashboard._server.gui._command_handle_from_uuid.values()}
        hidden = [palette[name] for name in ("Use", "Delete", "Back to the Kalman filter", "Send q, r and p0")]
        assert all(one.disabled for one in hidden)
        assert not any(palette[name].disabled for name in ("Pin", "Fuse", "Dark theme", "Preview code"))
        bench.request(pin_present)
        assert [one.disabled for one in hidden] == [False, False, True, True]
