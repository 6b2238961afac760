"""While a control moves: the signal is sent first and alone, with fewer points, and nothing is sent twice."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.app.recordings import walk
from viser._messages import GuiUpdateMessage
from viser.infra._async_message_buffer import AsyncMessageBuffer

from kalscope import kalman_filter, open_source
from kalscope_app.dashboard import Dashboard
from kalscope_app.engine.engine import DELAYS, Part
from kalscope_app.engine.filter_runs import Cache, choose_samples
from kalscope_app.engine.frame import compute_frame
from kalscope_app.guard.server import guarded_server
from kalscope_app.session.changes import set_text
from kalscope_app.session.opening import opened
from kalscope_app.views.signal import MAX_MOVING_POINTS, places_to_keep

FLUSH = "flush"


class Watched:
    """A dashboard whose engine has no thread, and what it sends."""

    def __init__(self, dashboard, messages):
        self.dashboard, self.messages = dashboard, messages
        self.turn()

    def turn(self, *changes):
        """One turn of the engine after these requests; what it sent."""
        for change in changes:
            self.dashboard.session.request(change)
        return self.sent(self.dashboard.engine._turn)

    def show(self, *parts):
        """Draw parts of the last frame; what that sent."""
        return self.sent(lambda: self.dashboard.show(self.dashboard.engine._frame, parts))

    def sent(self, act):
        self.messages.clear()
        act()
        return list(self.messages)

    def data(self, messages, chart):
        """The arrays that these messages bring to a chart; one message has them."""
        updates = [one.updates for one in messages if getattr(one, "uuid", "") == chart.handle._impl.uuid]
        (found,) = (one["data"] for one in updates if "data" in one)
        return found


@pytest.fixture
def watched(monkeypatch, tmp_path):
    messages = []

    def watch(name):
        stock = getattr(AsyncMessageBuffer, name)

        def watched(buffer, *message):
            messages.extend(message or (FLUSH,))
            stock(buffer, *message)

        monkeypatch.setattr(AsyncMessageBuffer, name, watched)

    with guarded_server(port=0) as guarded:
        state = opened(open_source("synthetic:random_walk?n=20000&seed=1&sigma=0.5"))
        dashboard = Dashboard(guarded.server, state, tmp_path)
        dashboard.engine._studies = None
        watch("push")
        watch("flush")
        yield Watched(dashboard, messages)


def test_a_move_sends_the_numbers_of_the_signal_first_and_alone(watched):
    signal = watched.dashboard.signal.signal
    assert "lag" not in [line["label"] for line in signal.handle.series]  # too short to see, nor in the legend
    watched.turn(set_text("q", "1e-5"))
    assert signal.handle.series[-1]["label"] == "lag"
    sent = watched.turn(set_text("q", "2e-5"))
    assert [(one.uuid, list(one.updates)) for one in sent[:-1]] == [(signal.handle._impl.uuid, ["data"])]
    assert sent[-1] == FLUSH
    x, *lines = watched.data(sent[:-1], signal)
    assert all(len(line) == len(x) <= MAX_MOVING_POINTS for line in lines)
    assert np.isfinite(lines[-1]).any()


def test_the_other_parts_bring_the_rest_and_all_points(watched):
    moving = watched.data(watched.turn(set_text("q", "0.5"))[:-1], watched.dashboard.signal.signal)
    sent = watched.show(*DELAYS)
    signal, innovation = watched.dashboard.signal.signal, watched.dashboard.signal.innovation
    state = watched.dashboard.engine._frame.state
    result = kalman_filter(state.z, state.params)
    at = choose_samples(state.recording, state.channel, None).indices
    assert len(at) > MAX_MOVING_POINTS
    whole = watched.data(sent, signal)
    lines = [(whole, result.x[at], 0), (watched.data(sent, innovation), result.innovation[at], 1)]
    for drawn, expected, first in lines:
        assert any(np.allclose(line[first:], expected[first:], rtol=0, atol=1e-9) for line in drawn)
    kept = np.isin(whole[0], moving[0])
    for some, every in zip(moving, whole, strict=True):  # what was drawn before stays where it was
        assert np.array_equal(some, every[kept], equal_nan=True)
    assert (moving[0][0], moving[0][-1]) == (whole[0][0], whole[0][-1])
    for parts in (DELAYS, Part, (Part.FULL,)):  # what is drawn already is not sent again
        assert [message for message in watched.show(*parts) if isinstance(message, GuiUpdateMessage)] == []


def test_what_is_no_move_comes_as_one_batch(watched):
    sent = watched.turn(lambda state: state.with_view(dark=True, window=(10.0, 900.0)))
    assert sent.count(FLUSH) == 1
    first = sent[: sent.index(FLUSH)]
    for chart in (watched.dashboard.signal.signal, watched.dashboard.signal.innovation):
        assert len(watched.data(first, chart)[0]) > 2


def frame_of(n, **more):
    return compute_frame(opened(walk(n, ("z",), seed=n, **more)))


@pytest.mark.slow
@pytest.mark.parametrize(("n", "truth"), [(2100, True), (4000, False), (4001, True), (300_000, False)])
def test_the_ends_and_the_extremes_stay(n, truth):
    frame = frame_of(n, truth=truth)
    places = places_to_keep(frame, Cache())
    assert len(places) <= MAX_MOVING_POINTS < len(frame.drawn.indices)
    assert (np.diff(places) > 0).all()
    assert (places[0], places[-1]) == (0, len(frame.drawn.indices) - 1)
    raw, (low, high) = frame.drawn.raw, frame.drawn.band
    assert (raw[places].min(), raw[places].max()) == (raw.min(), raw.max())
    assert (low[places].min(), high[places].max()) == (low.min(), high.max())


def test_samples_that_can_be_seen_one_by_one_all_stay_and_the_points_are_chosen_once_for_a_view():
    for n, missing in (2, 0.0), (2000, 0.0), (50_000, 0.01):
        assert places_to_keep(frame_of(n, missing=missing), Cache()) is None
    frame, kept = frame_of(5000), Cache()
    assert places_to_keep(replace(frame, set_aside=frame.filtered), Cache()) is None  # so do rings
    places = places_to_keep(frame, kept)
    assert places_to_keep(replace(frame, filtered=2.0 * frame.filtered), kept) is places
    assert places_to_keep(frame_of(6000), kept) is not places


def test_the_axis_of_the_innovation_shows_its_unit_where_its_numbers_are_scaled(watched):
    for scale, unit, label in (1.0, "counts", "innovation"), (1e-3, "", "1e-3"), (1e-3, "V", "mV"):
        shown = opened(walk(200, ("a",), unit, scale=scale), watched.dashboard.session._state)
        watched.turn(lambda _, shown=shown: shown)
        assert watched.dashboard.signal.innovation.handle.axes[1]["label"] == label
