"""Help where the hand is: every control says in a short hint what it is for."""

from __future__ import annotations

import pytest

from kalscope import open_source
from kalscope_app.dashboard import Dashboard
from kalscope_app.guard.server import guarded_server
from kalscope_app.session.opening import opened

MAX_LETTERS = 130
"""Letters that fit into a bubble beside the hand."""


@pytest.fixture(scope="module")
def controls(tmp_path_factory):
    """Every control of the panels: its kind, its name on screen, its hint; a progress bar is none."""
    with guarded_server(port=0) as guarded:
        dashboard = Dashboard(guarded.server, opened(open_source("sample:lis302dl")), tmp_path_factory.mktemp("x"))
        dashboard.start()
        handles = guarded.server.gui._gui_input_handle_from_uuid.values()
        shown = [handle for handle in handles if hasattr(handle, "hint")]
        yield [(type(handle).__name__, handle.label, handle.hint) for handle in shown]
        dashboard.stop()


def test_every_control_has_a_short_hint_that_is_no_copy_of_its_label(controls):
    assert len({kind for kind, _, _ in controls}) >= 5
    assert len(controls) > 40
    wrong = [
        (label, hint)
        for _, label, hint in controls
        if not (hint or "").strip() or len(hint) > MAX_LETTERS or "{" in hint
        or hint.strip(". ").lower() == label.lower()
    ]  # fmt: skip
    assert wrong == []
