"""A fleet beside the recording, on the map and in the table: Undo leaves it alone, a device has its filter."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tests.support.fleet_folder import NOISY, devices_with, finished_fleet
from tests.support.required import needs

from kalscope import FilterParams, synthesize
from kalscope.catalogue import open_source
from kalscope.errors import BadSetting
from kalscope.estimation.pool import Losses
from kalscope.fleet.results import Fleet, RunNote, Shared, read_fleet, reopen
from kalscope.sources.grammar.read_options import ReadOptions
from kalscope_app.engine.filter_runs import Cache
from kalscope_app.session.changes import at_device, close_fleet, find_devices, open_fleet, set_fleet_order, set_text
from kalscope_app.session.opening import opened
from kalscope_app.session.session import Session, undo
from kalscope_app.session.state import MAX_ROWS, ORDERS, OpenFleet
from kalscope_app.studies.tuning_map import MapFrame, compute_map, fleet_layer
from kalscope_app.views.charts import LIGHT
from kalscope_app.views.fleet import device_labels, fleet_rows, fleet_table
from kalscope_app.views.map import SHARPNESS, draw_map_picture

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def fleet(tmp_path_factory):
    needs("pyarrow")
    return read_fleet(finished_fleet(tmp_path_factory.mktemp("fleet")))


@pytest.fixture
def state(fleet):
    return open_fleet(fleet)(opened(open_source("demo")))


def at(fleet, state, i):
    """As the dashboard opens a device."""
    return at_device(fleet, i)(opened(reopen(fleet.devices.ids[i], fleet.devices.sources[i], fleet.note), state))


def test_a_fleet_opens_with_the_map_and_a_device_at_its_own_filter(fleet, state):
    assert (state.view.map_shown, find_devices("x")(close_fleet(state)).fleet) == (True, None)
    found = find_devices(" dev\n0 " + "x" * 999)(state).fleet.find
    assert (found[:7], len(found)) == ("dev 0 x", 200)
    own = at(fleet, state, NOISY)
    assert (own.tuning.q, own.tuning.r) == (fleet.devices.q[NOISY], fleet.devices.r[NOISY])
    assert own.fleet is state.fleet
    assert own.recording.title == "dev03.csv"
    assert "its own filter" in own.note

    empty = fleet.devices.ids.index("empty.csv")
    after = at_device(fleet, empty)(opened(open_source("demo"), state))
    assert "no q and r" in after.note
    assert after.tuning == after.start


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
    assert (back.recording.source[:7], back.fleet.fleet) == ("sample:", fleet)


def test_every_order_lists_devices_once_and_no_other_is_taken(fleet):
    rows = {order: ranked(fleet).tolist() for order, ranked in ORDERS.items()}
    assert all(len(set(one)) == len(one) > 0 for one in rows.values())
    assert rows["largest r"][0] == NOISY
    assert [fleet.devices.ids[i] for i in rows["without q and r"]] == ["empty.csv"]
    with pytest.raises(BadSetting):
        set_fleet_order("by heart")


# --- on the map, and in the table -----------------------------------------------------------------------


RANGES = (-6, 2), (-4, 2)


def fleet_of(q, r, odd=(), growth=None, names=None):
    """A fleet with these arrays; `odd` are unlike the others."""
    n = len(q)
    unlike = np.zeros(n, dtype=bool)
    unlike[list(odd)] = True
    devices = devices_with(names or [f"dev{i:06d}.csv" for i in range(n)], q, r, verdicts=["ok"] * n)
    zeros = np.zeros(n)
    losses = Losses(zeros, zeros, zeros if growth is None else np.asarray(growth, float))
    shared = Shared(FilterParams(0.01, 1.0), (0.009, 0.011), "pooled", losses)
    fleet = Fleet(Path("fleet"), devices, shared, "", RunNote(ReadOptions(), None))
    vars(fleet).update(distance=np.where(unlike, 9.0, 1.0), outlier=unlike)  # in place of those of the arrays
    return fleet


def test_a_small_fleet_is_points_at_their_q_and_r():
    fleet = fleet_of([0.1, np.nan, 1.0, 0.0], [1.0, 1.0, 0.01, 1.0])
    layer = fleet_layer(OpenFleet(fleet), *RANGES)
    assert dict(zip(layer.devices.tolist(), layer.points.tolist(), strict=True)) == {0: [-1.0, 0.0], 2: [0.0, -2.0]}
    assert layer.shared == pytest.approx((-2.0, 0.0))
    frame = MapFrame(*RANGES)
    x, y = frame.pixel((0.0, -2.0))
    assert layer.nearest(frame, (x + 5, y - 5)) == 2
    assert layer.nearest(frame, (x + 12, y)) is None


def test_the_outliers_of_a_large_fleet_are_drawn_last_and_can_be_clicked():
    q, r = np.exp(0.3 * np.random.default_rng(0).normal(size=(2, 100_000)))
    layer, frame = fleet_layer(OpenFleet(fleet_of(0.01 * q, r, odd=range(40))), *RANGES), MapFrame(*RANGES)
    assert sorted(layer.devices[-40:].tolist()) == list(range(40))
    assert layer.nearest(frame, frame.pixel(layer.points[-1])) == layer.devices[-1]


def test_the_picture_has_a_point_in_its_colour_where_the_device_is():
    two = fleet_of([1e-4, 0.3], [0.1, 0.1], growth=[0.0, 0.5])
    state = open_fleet(two)(opened(synthesize("random_walk", n=1000, seed=1)))
    shown = compute_map(state, Cache())
    picture = draw_map_picture(state, shown)
    for (q, r), kind in ((-4.0, -1.0), 0), ((np.log10(0.3), -1.0), 2):
        x, y = (round(SHARPNESS * at) for at in shown.frame.pixel((q, r)))
        colour = LIGHT.devices[kind]
        assert picture[y, x].tolist() == [int(colour[i : i + 2], 16) for i in (1, 3, 5)]


def test_the_table_is_short_and_no_name_is_markup():
    names = [f"<img src=x>|{i}](javascript:1)" for i in range(30)]
    shown = OpenFleet(fleet_of([0.01] * 30, [1.0] * 30, odd=[5], names=names))
    lines = fleet_table(shown).splitlines()
    assert len(lines) == MAX_ROWS + 2
    assert {line.replace("\\|", "").count("|") for line in lines} == {6}
    assert ("**" in lines[2], "<" in "".join(lines).replace("\\<", "")) == (True, False)
    labels = device_labels(shown)
    assert (next(iter(labels.values())), len(labels)) == (5, MAX_ROWS)


def test_devices_are_found_by_a_part_of_their_name_those_without_q_and_r_too():
    fleet = fleet_of([0.01] * 30 + [np.nan], [1.0] * 31, odd=[17])
    assert OpenFleet(fleet, find="dev00001").rows == [17, 10, 11, 12, 13, 14, 15, 16, 18, 19]
    assert OpenFleet(fleet, find="DEV000030").rows == [30]
    assert "it\u00a0is\u00a0empty" in fleet_table(OpenFleet(fleet, find="30"))
    assert [row[2] for row in fleet_rows(fleet, OpenFleet(fleet, find="0003").rows)] == ["0.01", ""]
    assert fleet_table(OpenFleet(fleet, find="nowhere")) == "None."
    assert len(OpenFleet(fleet, find="csv").rows) == MAX_ROWS
