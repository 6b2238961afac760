"""A view that fails shows nothing, all others are drawn, and it is back with the next frame that it can draw."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.app.headless import headless
from tests.app.recordings import walk

from kalscope_app.engine import engine as engine_module
from kalscope_app.session.changes import pin_present
from kalscope_app.session.opening import opened
from kalscope_app.views.window import is_empty, property_of, widgets_in

DRAWS = ("show", "show_below", "follow", "show_table", "show_check", "show_checks", "show_judged", "show_notes")
DRAWS += ("show_overview",)
"""The methods of views that draw."""

STUDIED = ("_checks", "_spectrum", "_allan", "_alternatives")
"""Views that only studies draw."""

BROKEN = "uncaught RuntimeError: RuntimeError('broken')"


def broken(*_args, **_options):
    raise RuntimeError("broken")


def shown_walk(seed, before=None):
    return opened(walk(300, ("one", "two"), period=1.0, seed=seed, title=f"record {seed}"), before)


@pytest.fixture(scope="module")
def screen(tmp_path_factory):
    with headless(shown_walk(1), tmp_path_factory.mktemp("out")) as (bench, _client):
        yield Screen(bench)


class Screen:
    """A dashboard, two states that it may show, and what each view shows in both."""

    def __init__(self, bench):
        self.bench, dashboard = bench, bench.dashboard
        self.views = {name: view for name, view in vars(dashboard).items() if any(widgets_in(view))}
        assert len(self.views) > 15
        bench.request(lambda state: pin_present(state.with_view(map_shown=True, why_shown=True)))
        self.first, self.second = bench.state, shown_walk(2, bench.state)
        self.at_second, self.at_first = self.look_at(self.second), self.look_at(self.first)

    def look_at(self, *states):
        """The bytes of all that each view shows, "" where that is nothing."""
        for state in states:
            self.bench.request(lambda _, state=state: state)
        return {name: b"".join(map(shown, widgets_in(view))) for name, view in self.views.items()}

    def errors(self):
        """What the log has since the last call."""
        errors, self.bench.errors = self.bench.errors, []
        return errors


def shown(widget):
    value = getattr(widget, property_of(widget)[0])
    return b"" if is_empty(widget) else value.encode() if isinstance(value, str) else np.asarray(value).tobytes()


@pytest.mark.slow
@pytest.mark.parametrize("half", [0, 1])
def test_the_views_that_fail_are_emptied_and_the_others_are_drawn(screen, half, monkeypatch):
    failing = list(screen.views)[half::2]
    kinds = [type(screen.views[name]) for name in failing]
    methods = [getattr(kind, method) for kind in kinds for method in DRAWS if hasattr(kind, method)]
    with monkeypatch.context() as patch:
        for method in methods:
            patch.setattr(method, "__code__", broken.__code__)
        seen = screen.look_at(screen.second.with_view(resets=5), screen.second)
        assert seen == screen.at_second | dict.fromkeys(failing, b"")
        assert screen.errors() == [BROKEN] * len(methods)
    assert screen.look_at(screen.first) == screen.at_first


@pytest.mark.parametrize(
    ("what", "emptied"),
    [("frame", ("_header", "signal", "_more", "_source", "_map")), ("studies", (*STUDIED, "_map", "_verdict"))],
)
def test_what_cannot_be_computed_leaves_nothing_of_the_one_before(screen, what, emptied, monkeypatch):
    studies = screen.bench.studies
    with monkeypatch.context() as patch:
        if what == "frame":
            patch.setattr(engine_module, "compute_frame", broken)
        else:
            patch.setattr(studies, "_studies", [replace(one, compute=broken) for one in studies._studies])
        seen = screen.look_at(screen.second.with_view(resets=5), screen.second)
        assert {seen[name] for name in emptied} == {b""}
        errors = 1 if what == "frame" else len(studies._studies) - 1  # keeping the filters shows nothing
        assert screen.errors() == [BROKEN] * errors
    assert screen.look_at(screen.first) == screen.at_first
