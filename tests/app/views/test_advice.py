"""Advice as buttons: every action has its words and does one step that Undo takes back, or is no button."""

from __future__ import annotations

import typing
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from kalscope import Recording, estimate, open_source, steady_state
from kalscope.analysis import actions
from kalscope.analysis.findings import Finding
from kalscope.analysis.judge import Judgement
from kalscope.estimation.request import FitResult, Noise, Request, find_parameters
from kalscope_app.session.changes import apply_found
from kalscope_app.session.opening import opened
from kalscope_app.session.session import Session, undo
from kalscope_app.studies import checks as still_stretch
from kalscope_app.studies.checks import StillStretches, compute_checks
from kalscope_app.views.checks import COLOURS, UNJUDGED, VerdictView, label_of, take
from kalscope_app.views.goal import SEARCH_METHODS

EXAMPLES = {
    actions.Scale(10.0, 0.5): "Raise q 10 × and lower r 2 ×",
    actions.Scale(172.0, 1.0): "Raise q 200 ×",  # as the advice words it
    actions.Scale(5000.0, 0.02): "Raise q 1000 × or more and lower r 50 ×",
    actions.SetGate(4.0): "Switch the gate on (4 σ)",
    actions.SetGate(None): "Switch the gate off",
    actions.EstimateAgain(): "Fit again",
    actions.AddMomentum(9.0): "Add momentum at this lag",
    actions.SetSpikesAside(): "Set the spikes aside and fit again",
    actions.UseStillStretch(100, 301): "Use the still stretch 1 to 3 s",
    actions.GiveNoise(): "Give the noise of the sensor",
    actions.ChooseFilter(): "Choose a lag",
    actions.UnsetStart(): "Start from the first sample",
    actions.RecordLonger(): "",
}


@pytest.fixture
def state():
    z = np.random.default_rng(4).normal(size=(1000, 1)).cumsum(axis=0)
    given = opened(Recording(np.arange(1000) * 0.01, ("a",), ("V",), z, 0.01)).with_view(search_method="best fit")
    return given.with_tuning(q=2.0, r=5.0, p0=3.0, x0=9.0)


class Searches:
    """In place of the view that searches: notes what it is asked for."""

    def __init__(self, state):
        self.state, self.requests = state, []

    def search(self, request):
        self.requests.append(request(self.state))


def test_every_action_has_its_words(state):
    assert {type(action) for action in EXAMPLES} == set(typing.get_args(actions.Action))
    for action, words in EXAMPLES.items():
        assert label_of(action, state) == words
    assert label_of(None, state) == ""
    assert label_of(actions.ChooseFilter(), state.with_view(search_method="maximum lag")) == ""  # it is chosen


@pytest.mark.parametrize(
    "action", [one for one, words in EXAMPLES.items() if words], ids=lambda one: type(one).__name__
)
def test_a_button_changes_something_in_one_step_that_undo_takes_back(state, action):
    given = state.with_tuning(gate=9.0) if action == actions.SetGate(None) else state
    session, searches = Session(given), Searches(given)
    take(action, given, session, searches)
    after = session.apply_requests()[0]
    if searches.requests:
        assert after is given
        assert isinstance(searches.requests[0], Request)
        return
    assert (after.settings, after.view) != (given.settings, given.view)
    take(action, given, session, searches)  # a second click on the same advice does no more
    assert session.apply_requests()[0].settings == after.settings
    session.request(undo)
    undone = session.apply_requests()[0]
    assert undone.settings == given.settings
    assert undone.answers.note != "There is nothing to undo." or after.view.search_method in SEARCH_METHODS


def test_the_values_are_those_of_the_advice(state):
    def tuned(action):
        session = Session(state)
        take(action, state, session, Searches(state))
        return session.apply_requests()[0].tuning

    scaled = tuned(actions.Scale(10.0, 0.5))
    assert (scaled.q, scaled.r, scaled.how) == (20.0, 2.5, "by hand")
    assert tuned(actions.SetGate(4.0)).gate == 16.0
    assert (tuned(actions.UnsetStart()).p0, tuned(actions.UnsetStart()).x0) == (None, None)


def test_advice_on_another_recording_is_not_taken(state):
    other = opened(Recording(np.arange(50.0), ("b",), ("",), np.ones((50, 1)), 1.0))
    session, searches = Session(other), Searches(other)
    for action in (actions.Scale(2.0, 2.0), actions.EstimateAgain()):
        take(action, state, session, searches)
    assert session.apply_requests()[0] is other
    assert searches.requests == [None]


def test_the_still_stretch_is_searched_with(state):
    searches = Searches(state)
    take(actions.UseStillStretch(100, 301), state, Session(state), searches)
    assert searches.requests[0].noise == Noise(still=(100, 301))


def test_momentum_is_advised_where_it_helps_and_added_at_the_lag_on_screen():
    demo = opened(open_source("demo"))
    assert not any(isinstance(one.action, actions.AddMomentum) for one in compute_checks(demo).judgement.findings)
    off = demo.with_tuning(momentum=0.0, q=300.0)
    advice = compute_checks(off).urgent.findings[0]
    assert advice.text.startswith("with momentum the errors at the same lag would be")
    searches = Searches(off)
    take(advice.action, off, Session(off), searches)
    found = find_parameters(off.z, searches.requests[0], sample_period=0.02)
    assert found.params.momentum == pytest.approx(demo.tuning.momentum)
    assert steady_state(found.params).lag_samples == pytest.approx(steady_state(off.params).lag_samples)
    far = demo.with_tuning(momentum=0.0, q=10.0)  # at this lag momentum would go too far at every turn
    assert not any(isinstance(one.action, actions.AddMomentum) for one in compute_checks(far).urgent.findings)


def test_after_a_search_without_a_pair_the_panel_says_what_else_gives_one(state):
    lost = estimate(np.arange(200.0) ** 2)
    assert lost.verdict == "no_noise"
    failed = apply_found(state.recording, "a", FitResult(None, "maximum likelihood", "No noise.", lost))(state)
    checks = compute_checks(failed, lambda _state: (100, 301))
    assert checks.urgent is checks.search
    assert checks.urgent.status == "no_pair"
    assert checks.urgent.findings[0].action == actions.UseStillStretch(100, 301)
    without = compute_checks(failed).urgent
    assert without.findings[0].action == actions.GiveNoise()
    assert compute_checks(state).search is None
    assert compute_checks(failed.with_tuning(q=7.0)).search is None  # the user has gone on


def test_the_still_stretch_is_found_once_for_a_recording(monkeypatch):
    g = np.random.default_rng(3)
    z = np.where(np.arange(1200) < 600, np.cumsum(g.normal(0, 50, 1200)), 0.0) + g.normal(0, 1, 1200)
    state = opened(Recording(np.arange(1200.0), ("a",), ("",), z[:, None], 1.0))
    stretches, asked = StillStretches(), []
    monkeypatch.setattr(still_stretch, "find_still_stretch", lambda *z: asked.append(z) or (600, 1200))
    assert stretches.study(state) == (state, (600, 1200))
    assert stretches.of(state.with_tuning(q=3.0)) == (600, 1200)
    assert len(asked) == 1


class Widgets:
    """In place of viser: every widget is an object that keeps what it is given."""

    def __getattr__(self, _name):
        def add(*_args, **values):
            return Widget(**values)

        return add


class Widget:
    def __init__(self, **values):
        self.__dict__.update(content="", label="", visible=values.get("visible", True))

    def __enter__(self):
        return self

    def __exit__(self, *_):
        return None

    def on_click(self, callback):
        self.clicked = callback


def test_the_header_shows_one_word_the_headline_and_a_button_for_what_can_be_done(state):
    session = Session(state)
    view, checks = VerdictView(Widgets(), session), compute_checks(state)
    view.build_reasons(Widgets())
    advice = (
        Finding("spikes", "spikes: 3", actions.SetGate(4.0)),
        Finding("too_few", "too few", actions.RecordLonger()),
    )
    bad = Judgement(status="spikes", headline="Spikes mislead the fit.", findings=advice, word="spikes", tone="bad")
    view.show_checks(replace(checks, judgement=bad))
    assert (view._word.label, view._word.color) == ("spikes", COLOURS["bad"])
    assert view._headline.content == "**Spikes mislead the fit.**"
    first, second = view._advice
    assert (first._text.content, first._button.label) == ("Spikes: 3.", "Switch the gate on (4 σ)")
    assert [row._text.visible for row in (first, second)] == [True, True]
    assert [row._button.visible for row in (first, second)] == [True, False]
    view.show_checks(
        replace(checks, judgement=Judgement(status="fits", headline="It fits.", word="fits", tone="good"))
    )
    assert (view._word.label, view._word.color) == ("fits", COLOURS["good"])
    assert not any(row._text.visible or row._button.visible for row in (first, second))
    view.show_checks(None)
    assert (view._word.label, view._headline.content) == ("no verdict", UNJUDGED)


def test_a_click_on_the_word_shows_the_reasons_and_another_hides_them(state):
    session = Session(state)
    view = VerdictView(Widgets(), session)
    view.build_reasons(Widgets())
    for shown in (True, False):
        with pytest.raises(StopIteration):  # it ends at once, without an event loop
            view._word.clicked(SimpleNamespace(client=object())).send(None)
        state, _, failures = session.apply_requests()
        assert (state.view.why_shown, failures) == (shown, [])
        view.show(SimpleNamespace(state=state))
        assert view._why.visible is shown
