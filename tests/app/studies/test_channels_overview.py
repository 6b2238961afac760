"""Several channels: tuned together or one by one, copied, and seen side by side."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from kalscope import BadSetting, Recording, denoise, open_source, steady_state
from kalscope.papers.generalized import GeneralizedParams
from kalscope.tuning.tuning import ChannelTuning
from kalscope_app.session.changes import (
    reset_parameters,
    select_channel,
    set_exponent,
    set_link,
    set_text,
    set_window,
)
from kalscope_app.session.opening import opened
from kalscope_app.session.session import Session, undo
from kalscope_app.session.state import SAME_LAG, SAME_NUMBERS, UNLINKED, apply_to_linked, scaled_copy
from kalscope_app.studies.comparisons import MAX_LANE_POINTS, MAX_LANES, Overviews
from kalscope_app.views.chart_tabs import lanes_of, lead_of, table_of


def recording(n=500, channels=3, scale=10.0):
    z = np.random.default_rng(7).normal(size=(n, channels)) * scale ** np.arange(channels)
    names = tuple(f"c{i}" for i in range(channels))
    return Recording(np.arange(n) * 0.01, names, ("V",) * channels, z, 0.01)


@pytest.fixture
def state():
    return opened(recording())


def lags(state):
    return [float(steady_state(tuning.params).lag_samples) for tuning in state.settings.tunings]


A = ChannelTuning("a", "", 2.0, 8.0, p0=1.0, x0=5.0, gate=9.0, how="by hand")
B = ChannelTuning("b", "V", 1.0, 1.0, p0=3.0, x0=7.0)


@pytest.mark.parametrize(
    ("way", "expected"),
    [
        (UNLINKED, B),
        (SAME_NUMBERS, ChannelTuning("b", "V", 2.0, 8.0, 1.0, 5.0, "by hand", 9.0)),
        (SAME_LAG, ChannelTuning("b", "V", 200.0, 800.0, 100.0, 7.0, "by hand", 9.0)),
    ],
)
def test_what_a_follower_takes_over(way, expected):
    starts = (replace(A, r=0.5), replace(B, r=50.0))
    assert apply_to_linked((A, B), starts, 0, way) == (A, expected)


def test_a_scaled_setting_is_still_a_filter():
    tiny = scaled_copy(replace(A, q=1e-299, r=0.0), B, 1e-10)
    assert (tiny.q, tiny.r) == (1e-300, 0.0)
    assert scaled_copy(replace(A, r=1e299), B, 1e10).r == 1e300
    assert scaled_copy(replace(A, p0=None, x0=None), B, 3.0).x0 is None


CHANGES = [
    set_text("q", "0.3"),
    set_exponent("r", 1.0),
    set_text("p0", "4"),
    set_text("gate", "9"),
    reset_parameters,
]


@pytest.mark.parametrize("change", CHANGES)
def test_tuned_together_every_change_sets_all_channels(state, change):
    together = change(set_link(SAME_NUMBERS)(set_text("q", "0.1")(state)))
    assert len({tuning.params for tuning in together.settings.tunings}) == 1
    alone = change(set_text("q", "0.1")(state))
    assert alone.settings.tunings[1:] == state.settings.tunings[1:]


def test_the_same_lag_holds_for_channels_of_any_scale(state):
    together = set_text("q", "0.3")(set_link(SAME_LAG)(state))
    assert lags(together) == pytest.approx([lags(together)[0]] * 3)
    noise = [start.r for start in state.settings.starts]
    assert [t.r / n for t, n in zip(together.settings.tunings, noise, strict=True)] == pytest.approx([1.0] * 3)


def test_going_together_is_undone_in_one_step(state):
    session = Session(select_channel("c1")(state))
    session.request(set_link(SAME_NUMBERS))
    together = session.apply_requests()[0]
    assert {tuning.q for tuning in together.settings.tunings} == {state.settings.tunings[1].q}
    session.request(undo)
    back = session.apply_requests()[0]
    assert (back.settings.link, back.settings.tunings) == (UNLINKED, state.settings.tunings)
    with pytest.raises(BadSetting, match="way of tuning channels must be one of"):
        set_link("<img>")(state)


def test_lanes_hold_each_channel_on_its_own_scale(state):
    overview = Overviews().compute(state)
    assert [lane.name for lane in overview.lanes] == ["c0", "c1", "c2"]
    for i, lane in enumerate(overview.lanes):
        z = state.recording.values[:, i]
        assert (lane.low, lane.high) == (z.min(), z.max())
        middle, half = (z.max() + z.min()) / 2, (z.max() - z.min()) / 2
        assert np.allclose(lane.raw, (z - middle) / half, atol=1e-12)
        filtered = denoise(z, state.settings.tunings[i].params)
        assert np.allclose(lane.filtered, (filtered - middle) / half, atol=1e-9)


@pytest.mark.parametrize(("channels", "lanes"), [(1, 0), (2, 2), (16, 16), (40, MAX_LANES)])
def test_sixteen_channels_are_drawn_of_any_number(channels, lanes):
    state = opened(recording(n=20_000, channels=channels, scale=1.5))
    overview = Overviews().compute(state)
    assert len(overview.lanes) == lanes
    assert len(overview.time) <= MAX_LANE_POINTS + MAX_LANES
    assert (np.diff(overview.time) > 0).all()
    if lanes:
        _, ys, layout = lanes_of(overview)
        assert len(layout.series) == 1 + len(ys) == 1 + 2 * lanes
        assert layout.y_range == (0.5, lanes + 0.5)
        for i, y in enumerate(ys):
            assert (np.abs(y - (i // 2 + 1)) < 0.5).all()  # no lane reaches into the next
        assert table_of(overview).count("\n") == lanes + 1
    assert ("24 more than 16" in lead_of(overview)) == (channels == 40)


def test_a_window_shows_its_part_and_only_what_changed_is_filtered_again(state):
    overviews = Overviews()
    first = overviews.compute(state)
    second = overviews.compute(set_text("q", "3")(state))
    assert second.lanes[1].filtered.tolist() == first.lanes[1].filtered.tolist()
    assert second.lanes[0].filtered.tolist() != first.lanes[0].filtered.tolist()
    part = overviews.compute(set_window(1.0, 2.0)(state))
    assert (part.time[0], part.time[-1]) == (1.0, 2.0)


def test_constant_and_empty_channels_have_a_flat_lane():
    values = np.column_stack([np.full(50, 3.0), np.full(50, np.nan), np.arange(50.0)])
    values[0, 1] = 2.0
    state = opened(Recording(np.arange(50.0), ("a", "b", "c"), ("", "", ""), values, 1.0))
    overview = Overviews().compute(state)
    assert (overview.lanes[0].raw == 0).all()
    assert overview.lanes[1].missing == 49
    assert "| 49 |" in table_of(overview)


def test_the_second_papers_filter_has_a_lane_and_no_q(state):
    other = state.with_tuning_of(0, replace(state.tuning, paper=GeneralizedParams(1.0, None, None, "without_slip")))
    overview = Overviews().compute(other)
    expected = other.filter.run(state.recording.values[:, 0]).x
    assert np.argmax(overview.lanes[0].filtered) == np.argmax(expected)
    assert table_of(overview).count("| – | – |") == 1
    assert "| – | – |" not in table_of(Overviews().compute(state))


def test_channel_names_are_escaped_in_the_table():
    rec = replace(open_source("sample:lis302dl"), names=("<b>|x", "y", "z"))
    text = table_of(Overviews().compute(opened(rec)))
    assert "<b>" not in text
    assert text.splitlines()[2].replace(r"\|", "").count("|") == 8
    assert "missing" not in text  # where no channel misses a sample, that column is left out
