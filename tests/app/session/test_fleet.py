"""A fleet beside the recording: it outlives recordings, Undo leaves it alone, a device comes with its filter."""

from __future__ import annotations

import pytest
from fleet_folder import NOISY, finished_fleet
from required import not_here

from kalscope.catalogue import open_source
from kalscope.errors import BadSetting
from kalscope.fleet.results import read_fleet, reopen
from kalscope_app.session.changes import (
    at_device,
    close_fleet,
    find_devices,
    open_fleet,
    set_at_shared,
    set_fleet_order,
    set_text,
)
from kalscope_app.session.opening import opened
from kalscope_app.session.session import Session, undo
from kalscope_app.session.state import ORDERS

try:
    import pyarrow  # noqa: F401
except ImportError:
    not_here("pyarrow is not installed")


@pytest.fixture(scope="module")
def fleet(tmp_path_factory):
    return read_fleet(finished_fleet(tmp_path_factory.mktemp("fleet")))


@pytest.fixture
def state(fleet):
    return open_fleet(fleet)(opened(open_source("demo")))


def at(fleet, state, i):
    """As the dashboard opens a device."""
    return at_device(fleet, i)(opened(reopen(fleet.devices.ids[i], fleet.devices.sources[i], fleet.note), state))


@pytest.mark.slow
def test_a_fleet_opens_with_the_map_and_closes(fleet, state):
    assert state.fleet.fleet is fleet
    assert state.view.map_shown
    assert close_fleet(state).fleet is None


@pytest.mark.slow
def test_a_device_opens_at_its_own_filter_or_at_the_one_for_all(fleet, state):
    own = at(fleet, state, NOISY)
    assert (own.tuning.q, own.tuning.r) == (fleet.devices.q[NOISY], fleet.devices.r[NOISY])
    assert own.fleet is state.fleet
    assert own.recording.title == "dev03.csv"
    assert "its own filter" in own.answers.note
    shared = at(fleet, set_at_shared(True)(state), NOISY)
    assert (shared.tuning.q, shared.tuning.r) == (fleet.shared.params.q, fleet.shared.params.r)
    assert "the filter for all" in shared.answers.note


@pytest.mark.slow
def test_a_device_without_q_and_r_says_why(fleet, state):
    empty = fleet.devices.ids.index("empty.csv")
    after = at_device(fleet, empty)(opened(open_source("demo"), state))
    assert "no q and r" in after.answers.note
    assert after.tuning == after.start


@pytest.mark.slow
def test_undo_goes_back_to_the_recording_and_keeps_the_fleet(fleet, state):
    session = Session(opened(open_source("demo")))
    session.request(open_fleet(fleet))
    session.request(lambda now: at(fleet, now, 0))
    session.request(set_text("q", "0.5"))
    assert session.apply_requests()[0].tuning.q == 0.5
    session.request(undo)
    assert session.apply_requests()[0].tuning.q == fleet.devices.q[0]
    session.request(undo)
    back = session.apply_requests()[0]
    assert back.recording.source.startswith("sample:")
    assert back.fleet.fleet is fleet


def test_what_a_browser_cannot_choose_is_refused():
    with pytest.raises(BadSetting):
        set_fleet_order("by heart")


@pytest.mark.parametrize("order", ORDERS)
def test_every_order_lists_devices_once(fleet, order):
    rows = ORDERS[order](fleet).tolist()
    assert len(set(rows)) == len(rows) > 0
    if "largest r" in order:
        assert rows[0] == NOISY
    if order == "without q and r":
        assert [fleet.devices.ids[i] for i in rows] == ["empty.csv"]


@pytest.mark.slow
def test_a_text_to_find_is_one_short_line(state):
    assert find_devices(" dev\n0 " + "x" * 999)(state).fleet.find.startswith("dev 0 x")
    assert len(find_devices("x" * 999)(state).fleet.find) == 200
    assert find_devices("x")(close_fleet(state)).fleet is None
