"""Advice as buttons: every action has its words and does one step that Undo takes back, or is no button."""

from __future__ import annotations

import typing
from dataclasses import replace

import numpy as np
import pytest

from kalscope import Recording, estimate, open_source, steady_state
from kalscope.analysis import actions
from kalscope.estimation.request import FitResult, Noise, Request, find_parameters
from kalscope_app.session.changes import apply_found
from kalscope_app.session.opening import opened
from kalscope_app.session.session import Session, undo
from kalscope_app.studies.checks import compute_checks
from kalscope_app.views.checks import label_of, take
from kalscope_app.views.goal import SEARCH_METHODS

EXAMPLES = dict[actions.Action, str]([
    *((actions.Scale(10.0, 0.5), "Raise q 10 × and lower r 2 ×"), (actions.Scale(172.0, 1.0), "Raise q 200 ×")),
    (actions.Scale(901.0, 0.02), "Raise q 1000 × or more and lower r 50 ×"),
    *((actions.SetGate(4.0), "Switch the gate on (4 σ)"), (actions.SetGate(None), "Switch the gate off")),
    *((actions.EstimateAgain(), "Fit again"), (actions.AddMomentum(9.0), "Add momentum at this lag")),
    *((actions.AddTwoSpeeds(), "Add two speeds"), (actions.AddNotch(), "Add a notch")),
    (actions.SetSpikesAside(), "Set the spikes aside and fit again"),
    *((actions.UseStillStretch(100, 301), "Use the still stretch 1 to 3 s"), (actions.RecordLonger(), "")),
    *((actions.GiveNoise(), "Give the noise of the sensor"), (actions.ChooseFilter(), "Choose a lag")),
    (actions.UnsetStart(), "Start from the first sample"),
])  # fmt: skip


@pytest.fixture
def state():
    z = np.random.default_rng(4).normal(size=(1000, 1)).cumsum(axis=0)
    given = opened(Recording(np.arange(1000) * 0.01, ("a",), ("V",), z, 0.01)).with_view(search_method="best fit")
    return given.with_tuning(q=2.0, r=5.0, p0=3.0, x0=9.0)


def taken(action, state, session=None):
    """The state after a piece of advice about `state` was taken, and the searches that it asked for."""
    session, requests = session or Session(state), []
    take(action, state, session, lambda request: requests.append(request(session.apply_requests()[0])))
    return session.apply_requests()[0], requests


def test_every_action_has_its_words(state):
    assert {type(action) for action in EXAMPLES} == set(typing.get_args(actions.Action))
    for action, words in EXAMPLES.items():
        assert label_of(action, state) == words
    assert label_of(None, state) == ""
    assert label_of(actions.ChooseFilter(), state.with_view(search_method="maximum lag")) == ""  # it is chosen


@pytest.mark.parametrize("action", [one for one in EXAMPLES if EXAMPLES[one]], ids=lambda one: type(one).__name__)
def test_a_button_changes_something_in_one_step_that_undo_takes_back(state, action):
    given = state.with_tuning(gate=9.0) if action == actions.SetGate(None) else state
    session = Session(given)
    after, requests = taken(action, given, session)
    if requests:
        assert after is given
        assert isinstance(requests[0], Request)
        return
    assert (after.settings, after.view) != (given.settings, given.view)
    assert taken(action, given, session)[0].settings == after.settings  # a second click does no more
    session.request(undo)
    undone = session.apply_requests()[0]
    assert undone.settings == given.settings
    assert undone.note != "There is nothing to undo." or after.view.search_method in SEARCH_METHODS


def test_the_values_are_those_of_the_advice(state):
    for action, values in (
        (actions.Scale(10.0, 0.5), {"q": 20.0, "r": 2.5, "how": "by hand"}),
        (actions.SetGate(4.0), {"gate": 16.0}),
        (actions.UnsetStart(), {"p0": None, "x0": None}),
    ):
        assert taken(action, state)[0].tuning == replace(state.tuning, **values)
    (request,) = taken(actions.UseStillStretch(100, 301), state)[1]
    assert request.noise == Noise(still=(100, 301))


def test_advice_on_another_recording_is_not_taken(state):
    other = opened(Recording(np.arange(50.0), ("b",), ("",), np.ones((50, 1)), 1.0))
    for action, requests in ((actions.Scale(2.0, 2.0), []), (actions.EstimateAgain(), [None])):
        assert taken(action, state, Session(other)) == (other, requests)


@pytest.mark.slow
def test_momentum_is_advised_where_it_helps_and_added_at_the_lag_on_screen():
    demo = opened(open_source("demo"))
    off = demo.with_tuning(momentum=0.0, q=300.0)
    far = demo.with_tuning(momentum=0.0, q=10.0)  # at this lag momentum would go too far at every turn
    advised = [[type(one.action) for one in compute_checks(state).urgent.findings] for state in (demo, far, off)]
    assert [actions.AddMomentum in advice for advice in advised] == [False, False, True]
    (request,) = taken(compute_checks(off).urgent.findings[0].action, off)[1]
    found = find_parameters(off.z, request, sample_period=0.02)
    assert found.params.momentum == pytest.approx(demo.tuning.momentum)
    assert steady_state(found.params).lag_samples == pytest.approx(steady_state(off.params).lag_samples)


def test_after_a_search_without_a_pair_the_panel_says_what_else_gives_one(state):
    lost = estimate(np.arange(200.0) ** 2)
    assert lost.verdict == "no_noise"
    failed = apply_found(state.recording, "a", FitResult(None, "maximum likelihood", "No noise.", lost))(state)
    urgent, without = compute_checks(failed, lambda _state: (100, 301)).urgent, compute_checks(failed).urgent
    assert (urgent.status, urgent.findings[0].action) == ("no_pair", actions.UseStillStretch(100, 301))
    assert without.findings[0].action == actions.GiveNoise()
    assert compute_checks(failed.with_tuning(q=7.0)).search is None  # the user has gone on
